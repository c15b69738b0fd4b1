"""python -m tests.benchmarks.kernel [--avx2]: speed of the inner kernels relative to dgemm, and growth of the
cost with the size.

Run it with OMP_NUM_THREADS=1. --avx2: compile for AVX2; OPENBLAS_CORETYPE=Haswell restricts OpenBLAS
likewise.
"""

import ctypes
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

import solve
from solve.kernel import collocation, compiler
from solve.kernel.library import Size
from solve.period.grid import Grid
from solve.period.period_map import Steps, monodromy
from solve.period.points import SinglePoint
from tests.benchmarks.timing import best

STEPS, POINTS = 256, 64
AVX2 = (*compiler.MACHINE, "-mno-avx512f", "-mavx2", "-mfma")

CHAIN = """
void chain(const double *maps, double *product, long count) {
    static lane x[NX * W], y[NX * W];
    memset(x, 0, sizeof(x));
    for (int i = 0; i < NX; i++) x[i * W + i] += 1.0;
    for (long k = 0; k < count; k += 2) {
        follow((const lane *)maps + k * NX * W, x, y);
        follow((const lane *)maps + (k + 1) * NX * W, y, x);
    }
    for (int i = 0; i < NX * W; i++) ((loose *)product)[i] = x[i];
}
"""


def dgemm() -> float:
    """Return the flops per second of a product of matrices of order 1000."""
    A = np.random.default_rng(0).standard_normal((1000, 1000))
    return 2e9 / best(lambda: A @ A)


def products(n: int) -> float:
    """Return the flops per second of products of the maps (n × n) of a period in NumPy. A product has 2n³
    flops."""
    A = np.random.default_rng(0).standard_normal((STEPS, n, n)) / np.sqrt(n)
    steps = Steps(A, np.zeros((STEPS, n)))
    return 2.0 * n**3 * (STEPS - 1) / best(lambda: monodromy(steps))


def chain(n: int) -> tuple[float, float]:
    """Return the flops per second of products of maps (n × n, n even) by the function of lanes.c, and the
    error of the product of all maps. A product has 2n³ flops per lane."""
    text = Path(compiler.__file__).with_name("lanes.c").read_text(encoding="utf-8") + CHAIN
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder, "chain.c")
        source.write_text(text, encoding="utf-8")
        made = compiler.compiled(source, {"N": n // 2, "S": 2, "NODES": 3, "STIFF": 1, "ORBIT": 0})
    width = ctypes.c_int.in_dll(made, "lanes").value
    count = max(4, min(64, 2 * (30_000 // n**2 // 2)))
    maps, product = aligned((count, n, n, width)), aligned((n, n, width))
    maps[:] = np.random.default_rng(0).standard_normal(maps.shape) / np.sqrt(n)
    pointers = [part.ctypes.data_as(ctypes.POINTER(ctypes.c_double)) for part in (maps, product)]
    seconds = best(lambda: made.chain(*pointers, ctypes.c_long(count)))
    truth = np.linalg.multi_dot(maps[::-1, :, :, -1])
    error = np.abs(product[..., -1] - truth).max() / np.abs(truth).max()
    return 2.0 * n**3 * count * width / seconds, float(error)


def aligned(shape: tuple[int, ...]) -> np.ndarray:
    """Return an array whose start is aligned for vector registers."""
    room = np.empty(int(np.prod(shape)) + shape[-1])
    start = -(room.ctypes.data // 8) % shape[-1]
    return room[start : start + room.size - shape[-1]].reshape(shape)


def stages(n: int) -> float:
    """Return the flops per second of a step of Radau's method of order 9 in full lanes, including the product
    of its map."""
    method = solve.Radau().stages
    rng, s = np.random.default_rng(0), len(method.c)
    entry = np.arange(3 * n**2 + n)
    table = 0.1 * rng.standard_normal((STEPS * s, len(entry)))
    table[:, : n**2] += np.eye(n).ravel()
    points = max(1, POINTS // n // 8) * 8
    samples = collocation.Samples(table, np.ones((points, len(entry))), entry)
    size = Size(n, s, len(method.curve_nodes), method.stiffly_accurate, False)
    rows, N, lengths = s * n, 2 * n, np.full(STEPS, 2 * np.pi / STEPS)
    flops = 2 / 3 * rows**3 + 2 * rows**2 * N + 2 * N**3
    return (
        flops
        * STEPS
        * points
        / best(lambda: collocation.solved(size, method.weights, lengths, False, samples, None), 3)
    )


def exponent(sizes: list[int], run: Callable[[int], Callable[[], object]], repeats: int = 5) -> float:
    """Return the fitted power p of the cost a + b size^p. The sizes have a constant ratio, so that the
    differences of the costs grow with the same power for any fixed cost a."""
    times = [best(run(size), repeats) for size in sizes]
    return float(np.polyfit(np.log(sizes[1:]), np.log(np.diff(times)), 1)[0])


def one_grid(n: int, steps: int) -> Callable[[], object]:
    """Return a function that solves a constant system of n coordinates by Radau's method on one grid."""
    rng = np.random.default_rng(n)
    W = np.linalg.qr(rng.standard_normal((n, n)))[0]
    parts = np.eye(n), 0.1 * np.eye(n), W @ np.diag(rng.uniform(1, 9, n)) @ W.T

    def matrices(phase, speed):
        return *(np.broadcast_to(part, (len(phase), n, n)) for part in parts), np.ones((len(phase), n))

    system = solve.PeriodicSystem(matrices, [f"q{k}" for k in range(n)])
    grid = Grid.uniform(steps, system.period)
    return lambda: solve.Radau().solutions(SinglePoint(system, 1.0), grid, True)


def main() -> None:
    if "--avx2" in sys.argv[1:]:
        compiler.MACHINE = AVX2
    peak = dgemm()
    print(f"dgemm, n = 1000: {peak / 1e9:.1f} GF/s")
    for n in (3, 6, 10, 20, 50):
        rate = products(n)
        print(f"products of maps in NumPy, {n:3d} × {n}: {rate / 1e9:6.1f} GF/s, {100 * rate / peak:4.0f} %")
    for n in (4, 6, 8, 10, 12, 16, 20, 50):
        rate, error = chain(n)
        print(
            f"products of maps in lanes, {n:3d} × {n}: {rate / 1e9:6.1f} GF/s, {100 * rate / peak:4.0f} %,"
            f" error {error:.0e}"
        )
    for n in (2, 3, 4, 5, 6, 8, 10, 20, 40):
        rate = stages(n)
        print(f"steps of Radau in lanes, n = {n:3d}: {rate / 1e9:6.1f} GF/s, {100 * rate / peak:4.0f} %")
    sizes = [20, 40, 80, 160]
    print(f"cost over n = 20 … 160: power {exponent(sizes, lambda n: one_grid(n, 16)):.2f}")
    steps = [1024, 2048, 4096, 8192, 16384]
    print(f"cost over steps, NumPy, n = 3: power {exponent(steps, lambda m: one_grid(3, m + 1)):.2f}")


if __name__ == "__main__":
    main()
