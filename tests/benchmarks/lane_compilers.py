"""python -m tests.benchmarks.lane_compilers: three ways to compile one step for points side by side.

A step of Radau's method of order 9 for n coordinates, its map and the map's product with those before it:
lanes.c, CasADi's generated C with vectors for numbers, and, where it is installed, Numba with the points
as innermost loop. Neither of the latter two exchanges rows. Run it with OMP_NUM_THREADS=1.
"""

import ctypes
import functools
import os
import re
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import casadi as ca
import numpy as np

from solve.arrays import Array
from solve.kernel import collocation
from solve.kernel.compiler import compiled
from solve.kernel.library import Size, lanes
from solve.methods.radau import Radau
from tests.benchmarks.timing import best

METHOD = Radau().stages
STAGES, STEPS, POINTS = len(METHOD.c), 256, 256
H = 2 * np.pi / STEPS

Run = Callable[[], Array]
"""Φ of every point (POINTS, 2n, 2n)."""

DRIVER = """
typedef double lane __attribute__((vector_size(8 * LANES)));
typedef double loose __attribute__((vector_size(8 * LANES), aligned(8)));
typedef long long casadi_int;
#define casadi_real lane
static inline lane casadi_sq(lane x) { return x * x; }
%s
void level(const double *stages, const double *coefficients, double *Phi) {
    static lane e[S * R], x[NX * NX], y[NX * NX];
    const lane *arg[] = {e, x};
    lane *res[] = {y};
    for (long group = 0; group < GROUPS; group++) {
        const loose *c = (const loose *)(coefficients + group * R * LANES);
        for (int i = 0; i < NX * NX; i++) x[i] = (lane){0} + (i / NX == i %% NX);
        for (long step = 0; step < STEPS; step++) {
            for (int i = 0; i < S * R; i++) e[i] = c[i %% R] * stages[step * S * R + i];
            casadi_f0(arg, res, 0, 0, 0);
            for (int i = 0; i < NX * NX; i++) x[i] = y[i];
        }
        for (int i = 0; i < NX * NX; i++) ((loose *)Phi)[group * NX * NX + i] = x[i];
    }
}
"""


def advance(n: int) -> ca.Function:
    """Φ after a step, by rows (4n²,), from the entries at the stages (s (3n² + n),) and Φ before it."""
    entries = ca.SX.sym("e", STAGES * (3 * n**2 + n))
    before = ca.SX.sym("x", 4 * n**2)
    parts = ca.reshape(entries, 3 * n**2 + n, STAGES).T
    A, b = METHOD.A, METHOD.b
    left, right = ca.SX(STAGES * n, STAGES * n), ca.SX(STAGES * n, 2 * n)
    for i in range(STAGES):
        rows = slice(i * n, i * n + n)
        M, C, K = (ca.reshape(parts[i, k * n**2 : (k + 1) * n**2], n, n).T for k in range(3))
        for j in range(STAGES):
            left[rows, j * n : j * n + n] = H * A[i, j] * C + H**2 * (A @ A)[i, j] * K + (i == j) * M
        right[rows, :] = ca.horzcat(-K, -C - H * METHOD.c[i] * K)
    a = eliminated(left, right)
    q, v = (ca.kron(ca.DM(weights).T, ca.DM.eye(n)) @ a for weights in (b @ A, b))
    step = ca.vertcat(ca.horzcat(ca.DM.eye(n), H * ca.DM.eye(n)), ca.horzcat(ca.DM(n, n), ca.DM.eye(n)))
    after = (step + ca.vertcat(H**2 * q, H * v)) @ ca.reshape(before, 2 * n, 2 * n).T
    return ca.Function("advance", [entries, before], [ca.vec(after.T)])


def eliminated(left: ca.SX, right: ca.SX) -> ca.SX:
    """Return left⁻¹ right without row exchanges."""
    rows = ca.horzcat(left, right)
    order = left.shape[0]
    for k in range(order):
        inverse = 1 / rows[k, k]
        for i in range(k + 1, order):
            rows[i, k:] -= rows[i, k] * inverse * rows[k, k:]
    for k in reversed(range(order)):
        rows[k, order:] = (rows[k, order:] - rows[k, k + 1 : order] @ rows[k + 1 :, order:]) / rows[k, k]
    return rows[:, order:]


def vectorised(function: ca.Function) -> str:
    """The C text of the function alone: constants spread over the lanes, guards of null pointers gone."""
    generator = ca.CodeGenerator("advance.c", {"with_header": False})
    generator.add(function)
    text = generator.dump()
    text = text[text.index("static int casadi_f0") : text.index("CASADI_SYMBOL_EXPORT int advance(")]
    text = re.sub(r"arg\[\d\]\? (arg\[\d\]\[\d+\]) : 0", r"\1", text)
    return re.sub(r"=(-?[\d.]+(?:e[-+]\d+)?);", r"=(lane){0}+(\1);", text)


def by_casadi(n: int, table: Array, coefficients: Array) -> Run:
    """Return a function that runs CasADi's generated C code with vectors as wide as those of lanes.c for
    `casadi_real`."""
    width = lanes(_size(n))
    function, groups, columns = advance(n), POINTS // width, table.shape[1]
    sizes = {"S": STAGES, "R": columns, "NX": 2 * n, "GROUPS": groups, "STEPS": STEPS, "LANES": width}
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder, "casadi_lanes.c")
        source.write_text(DRIVER % vectorised(function), encoding="utf-8")
        library = compiled(source, sizes)
    grouped = np.ascontiguousarray(coefficients.reshape(groups, width, columns).transpose(0, 2, 1))
    Phi = np.empty((groups, 2 * n, 2 * n, width))
    pointers = [part.ctypes.data_as(ctypes.POINTER(ctypes.c_double)) for part in (table, grouped, Phi)]

    def run() -> Array:
        library.level(*pointers)
        return np.moveaxis(Phi, -1, 1).reshape(POINTS, 2 * n, 2 * n)

    return run


def _size(n: int) -> Size:
    return Size(n, STAGES, len(METHOD.curve_nodes), METHOD.stiffly_accurate, False)


def by_lanes(n: int, table: Array, coefficients: Array) -> Run:
    """Return a function that runs the kernel of the package."""
    samples = collocation.Samples(table, coefficients, np.arange(table.shape[1]))
    lengths = np.full(STEPS, 2 * np.pi / STEPS)
    return lambda: collocation.solved(_size(n), METHOD.weights, lengths, False, samples, None).Phi


def by_numba(n: int, table: Array, coefficients: Array, lanes: int) -> Run:
    """Return a function that runs Numba loops with the points as the innermost loop, in blocks of `lanes`
    points."""
    from tests.benchmarks.numba_lanes import level

    groups, columns = POINTS // lanes, table.shape[1]
    grouped = np.ascontiguousarray(coefficients.reshape(groups, lanes, columns).transpose(0, 2, 1))
    weights = METHOD.A, METHOD.A @ METHOD.A, METHOD.b, METHOD.b @ METHOD.A, np.array(METHOD.c)
    return lambda: np.moveaxis(level(n, H, STAGES, STEPS, table, grouped, *weights), -1, 1).reshape(
        POINTS, 2 * n, 2 * n
    )


def problem(n: int) -> tuple[Array, Array]:
    """Terms at the stages of all steps (k, 3n² + n), and coefficients of the points."""
    rng, columns = np.random.default_rng(n), 3 * n**2 + n
    table = 0.1 * rng.standard_normal((STEPS * STAGES, columns))
    table[:, : n**2] += np.eye(n).ravel()
    return table, rng.uniform(0.9, 1.1, (POINTS, columns))


def spent() -> float:
    """Return the processor time in seconds, including that of compilers that are called."""
    return sum(os.times()[:4])


def main() -> None:
    with tempfile.TemporaryDirectory() as cache:
        # Nothing compiled before, and nothing left behind.
        os.environ["XDG_CACHE_HOME"] = cache
        measure()


def measure() -> None:
    """Print one line per way and size."""
    ways = {"C by hand (lanes.c)": by_lanes, "CasADi's C, vectors": by_casadi}
    try:
        import numba

        for lanes in (1, 8, 64):
            ways[f"Numba {numba.__version__}, {lanes} innermost"] = functools.partial(by_numba, lanes=lanes)
    except ImportError:
        print("Numba is not installed here and is left out", file=sys.stderr)
    for n in (2, 3, 6):
        table, coefficients = problem(n)
        truth, unit = None, 0.0
        for name, way in ways.items():
            start = spent()
            run = way(n, table, coefficients)
            Phi = run().copy()
            ready = spent() - start
            seconds = best(run, 3) / (STEPS * POINTS)
            truth, unit = (Phi, seconds) if truth is None else (truth, unit)
            apart = np.abs(Phi - truth).max() / np.abs(truth).max()
            print(
                f"n = {n}  {name:28}{1e9 * seconds:9.0f} ns/step/point{seconds / unit:7.1f}"
                f"  apart {apart:.0e}, ready in {ready:.1f} s",
                flush=True,
            )


if __name__ == "__main__":
    main()
