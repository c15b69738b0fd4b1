"""python -m tests.benchmarks.large [ELEMENTS …]: certified orbits of the four-bar versus the number of
coordinates. The processor time of one orbit with its dominant multipliers, at 30 rad/s with an error of at
most 1e-6, is compared with that of LAPACK's dgesv for the stage systems of the final grid. A program that is
given the number of steps and does no other work would take the latter time. The power of n is fitted from 27
coordinates on.
"""

import resource
import sys

import numpy as np
from scipy.linalg.lapack import dgesv  # pyright: ignore[reportAttributeAccessIssue]

import solve
from tests.benchmarks.four_bar import model
from tests.benchmarks.timing import best, median

RTOL = 1e-6
SPEED = 30.0
ELEMENTS = (1, 3, 5, 8, 12, 22)
_LARGE = 27


def orbit(elements: int) -> tuple[float, solve.Orbit]:
    """Return the processor time in seconds, and the orbit. Short solutions are first run once without timing,
    because the first run compiles."""
    system = model(elements)
    return median(lambda: solve.periodic(system, SPEED, rtol=RTOL), 3 if system.n < _LARGE else 1)


def by_lapack(n: int, stages: int, steps: int) -> float:
    """Return the processor time in seconds of `steps` stage systems with 2n + 1 right-hand sides."""
    rng, order = np.random.default_rng(1), stages * n
    A = np.asfortranarray(rng.standard_normal((order, order)) + 2 * order**0.5 * np.eye(order))
    right = np.asfortranarray(rng.standard_normal((order, 2 * n + 1)))
    return steps * best(lambda: dgesv(A, right), 2)


def main() -> None:
    chosen = [int(each) for each in sys.argv[1:]] or ELEMENTS
    print(f"{'n':>4}{'method':>9}{'steps':>7}{'s':>9}{'of LAPACK':>11}{'orbit':>9}{'multipliers':>13}")
    times = {}
    for elements in chosen:
        seconds, computed = orbit(elements)
        n, error = computed.system.n, computed.error_estimate
        peer = by_lapack(n, (computed.certified.method.order + 1) // 2, computed.steps)
        print(
            f"{n:4}{computed.method:>9}{computed.steps:7}{seconds:9.2f}{seconds / peer:11.1f}"
            f"{error.orbit:9.1e}{error.multipliers:13.1e}",
            flush=True,
        )
        times[n] = seconds
    large = [n for n in times if n >= _LARGE]
    if len(large) > 1:
        power = np.polyfit(np.log(large), np.log([times[n] for n in large]), 1)[0]
        print(f"time from {large[0]} to {large[-1]} coordinates: n^{power:.2f}")
    print(f"largest resident memory: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MiB")


if __name__ == "__main__":
    main()
