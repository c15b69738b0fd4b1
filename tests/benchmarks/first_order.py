"""python -m tests.benchmarks.first_order: systems of second order compared with the same systems in
first-order form. Both have the same states: n coordinates and their velocities. Run it with
OMP_NUM_THREADS=1.
"""

from functools import partial

import numpy as np

import solve
from solve import FirstOrderSystem, PeriodicSystem
from tests.benchmarks.timing import best

SIZES = 1, 2, 3, 4, 6
SPEED, SEEDS = 1.3, 5


def pair(n: int, seed: int = 0) -> tuple[PeriodicSystem, FirstOrderSystem]:
    """Return a random system of n coordinates with unit inertia, and the same system with 2n states."""
    rng = np.random.default_rng([n, seed])
    K0 = np.diag(1.0 + np.arange(n)) + 0.2 * rng.standard_normal((n, n))
    K1, load = 0.3 * rng.standard_normal((n, n)), rng.standard_normal(n)

    def second(phase, speed):
        wave = np.cos(phase)[:, None, None]
        one = np.broadcast_to(np.eye(n), (len(phase), n, n))
        return one, 0.1 * one, K0 + K1 * wave, np.cos(phase)[:, None] * load

    def first(phase, speed):
        A, b = np.zeros((len(phase), 2 * n, 2 * n)), np.zeros((len(phase), 2 * n))
        A[:, :n, n:], A[:, n:, n:] = np.eye(n), -0.1 * np.eye(n)
        A[:, n:, :n], b[:, n:] = -K0 - K1 * np.cos(phase)[:, None, None], np.cos(phase)[:, None] * load
        return A, b

    q, v = ([f"{kind}{k + 1}" for k in range(n)] for kind in "qv")
    return PeriodicSystem(second, q), FirstOrderSystem(first, [*q, *v])


def main() -> None:
    print(f"{'states':>6}    {'':9}{'second ms':>10}{'first ms':>10}{'ratio':>7}{'least':>7}{'most':>7}")
    for n in SIZES:
        pairs = [pair(n, seed) for seed in range(SEEDS)]
        for run in (solve.floquet, solve.periodic):
            times = np.array([[1e3 * best(partial(run, one, SPEED)) for one in both] for both in pairs])
            ratios = times[:, 1] / times[:, 0]
            row = *np.median(times, axis=0), np.median(ratios), ratios.min(), ratios.max()
            columns = zip(row, (10, 10, 7, 7, 7), strict=True)
            print(f"{2 * n:6}    {run.__name__:9}" + "".join(f"{x:{width}.2f}" for x, width in columns))


if __name__ == "__main__":
    main()
