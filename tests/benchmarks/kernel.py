"""python -m tests.benchmarks.kernel: the inner kernels beside dgemm, and how the cost grows.

Run it with OMP_NUM_THREADS=1. Processor time, best of several runs.
"""

import time
from collections.abc import Callable

import numpy as np

import solve
from solve.batch.engines import chosen_engine
from solve.batch.level import GridTables
from solve.batch.tables import Tables
from solve.methods.grid import Grid
from solve.methods.period_map import Steps, monodromy

STEPS, POINTS = 256, 64


def best(run: Callable[[], object], repeats: int = 5) -> float:
    """Shortest processor time in seconds, over runs that take some milliseconds at least."""
    run()
    times = []
    for _ in range(repeats):
        count, start = 0, time.process_time()
        while time.process_time() - start < 0.02:
            run()
            count += 1
        times.append((time.process_time() - start) / count)
    return min(times)


def dgemm() -> float:
    """Flops a second of a product of matrices of order 1000."""
    A = np.random.default_rng(0).standard_normal((1000, 1000))
    return 2e9 / best(lambda: A @ A)


def products(n: int) -> float:
    """Flops a second of the products of a period's maps, n × n, in NumPy: 2n³ each."""
    A = np.random.default_rng(0).standard_normal((STEPS, n, n)) / np.sqrt(n)
    steps = Steps(A, np.zeros((STEPS, n)))
    return 2.0 * n**3 * (STEPS - 1) / best(lambda: monodromy(steps))


def stages(n: int) -> float:
    """Flops a second of a step of Radau's method of order 9 in lanes, its map's product among them."""
    method = solve.Radau().collocation
    rng, s = np.random.default_rng(0), len(method.c)
    entry = np.arange(3 * n**2 + n)
    table = 0.1 * rng.standard_normal((STEPS * s, len(entry)))
    table[:, : n**2] += np.eye(n).ravel()
    tables = GridTables(method, STEPS, 2 * np.pi, Tables(table, entry, n), None)
    points = max(8, POINTS // n)
    ones, engine = np.ones((points, len(entry))), chosen_engine("compiled")[0]
    rows, N = s * n, 2 * n
    flops = 2 / 3 * rows**3 + 2 * rows**2 * N + 2 * N**3
    return flops * STEPS * points / best(lambda: engine.level(tables, ones, False), 3)


def exponent(sizes: list[int], run: Callable[[int], Callable[[], object]]) -> float:
    """Fitted power of the cost in the sizes."""
    return float(np.polyfit(np.log(sizes), np.log([best(run(size), 3) for size in sizes]), 1)[0])


def one_grid(n: int, steps: int) -> Callable[[], object]:
    """Radau's method on one grid of a constant system of n coordinates."""
    rng = np.random.default_rng(n)
    W = np.linalg.qr(rng.standard_normal((n, n)))[0]
    parts = np.eye(n), 0.1 * np.eye(n), W @ np.diag(rng.uniform(1, 9, n)) @ W.T

    def matrices(phase, speed):
        return *(np.broadcast_to(part, (len(phase), n, n)) for part in parts), np.ones((len(phase), n))

    system = solve.PeriodicSystem(matrices, [f"q{k}" for k in range(n)])
    grid = Grid.uniform(steps, system.period)
    return lambda: solve.Radau().solution(system, 1.0, grid, True)


def main() -> None:
    peak = dgemm()
    print(f"dgemm, n = 1000: {peak / 1e9:.1f} GF/s")
    for n in (3, 6, 10, 20, 50):
        rate = products(n)
        print(f"products of maps in NumPy, {n:3d} × {n}: {rate / 1e9:6.1f} GF/s, {100 * rate / peak:4.0f} %")
    for n in (3, 6, 10, 20):
        rate = stages(n)
        print(f"steps of Radau in lanes, n = {n:3d}: {rate / 1e9:6.1f} GF/s, {100 * rate / peak:4.0f} %")
    print(f"cost over n = 20 … 80: power {exponent([20, 28, 40, 56, 80], lambda n: one_grid(n, 16)):.2f}")
    steps = [256, 512, 1024, 2048, 4096]
    print(f"cost over steps, NumPy, n = 3: power {exponent(steps, lambda m: one_grid(3, m + 1)):.2f}")


if __name__ == "__main__":
    main()
