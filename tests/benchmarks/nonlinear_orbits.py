"""python -m tests.benchmarks.nonlinear_orbits: nonlinear orbits compared with time integration by CVODES, and
branches. CVODES integrates one period after another from the state of the linear orbit, until the state at
the start of a period is within 1e-6 of that of the nonlinear orbit. Its tolerance is the power of ten with
which this takes the least time. Run it with OMP_NUM_THREADS=1.
"""

import time
from collections.abc import Callable

import numpy as np

import solve
from solve.system import PeriodicSystem
from tests.benchmarks.timing import median
from tests.solve.newton.mechanisms import duffing, model_of

ACCURACY = 1e-6
TOLERANCES = 1e-5, 1e-6, 1e-7, 1e-8, 1e-9


def marched(system: PeriodicSystem, orbit: solve.Orbit, rtol: float, most: int) -> int | None:
    """Return the number of periods after which the state is within the accuracy of that of the nonlinear
    orbit; None if `most` periods do not suffice."""
    sizes = np.concatenate([np.abs(part).max(axis=1) for part in (orbit.q, orbit.qd / orbit.speed)])
    march, linear = system.marcher(sizes[: system.n], 1, rtol), solve.periodic(system, orbit.speed, rtol=1e-3)
    state = np.concatenate((linear.q[:, 0], linear.qd[:, 0] / orbit.speed))
    end = np.concatenate((orbit.q[:, 0], orbit.qd[:, 0] / orbit.speed))
    for turn in range(most):
        if (np.abs(state - end) <= ACCURACY * sizes).all():
            return turn
        state = march(state, 0.0, orbit.speed)[:2, :, -1].ravel()
    return None


def compared(name: str, system: PeriodicSystem, speed: float | str, most: int) -> None:
    linear, _ = median(lambda: solve.periodic(system, speed, rtol=ACCURACY))
    seconds, orbit = median(lambda: solve.nonlinear(system, speed, rtol=ACCURACY))
    finer, _ = median(lambda: solve.nonlinear(system, speed, rtol=1e-8))
    truth = solve.nonlinear(system, speed, start=orbit, rtol=1e-9)
    arrived = [tolerance for tolerance in TOLERANCES if marched(system, truth, tolerance, most)]
    timed = [(*median(lambda each=each: marched(system, truth, each, most), 1), each) for each in arrived]
    theirs, turns, rtol = min(timed)
    nonlinear = f"nonlinear {1e3 * seconds:.1f} ms, to 1e-8 {1e3 * finer:.1f} ms"
    print(f"{name}: linear {1e3 * linear:.1f} ms, {nonlinear}")
    print(f"  spectral radius {orbit.spectral_radius:.4f}, found by the {orbit.found_by}")
    print(f"  CVODES, rtol {rtol:g}: {turns} turns, {1e3 * theirs:.1f} ms, ratio {theirs / seconds:.1f}")


def branches(first: str, last: str = "460 rpm") -> None:
    """Print the processor time of 200 points of the cam's branch, relative to that of its first orbit."""
    cam = solve.load("cam", case="1")
    solve.branch(cam, (first, last), points=3)
    before = [cpu(lambda: solve.nonlinear(cam, first)) for _ in range(6)]
    branch = cpu(lambda: solve.branch(cam, (first, last), points=200))
    after = [cpu(lambda: solve.nonlinear(cam, first)) for _ in range(5)]
    orbit = float(np.median([*before[1:], *after]))
    times = f"{branch:.1f} s, orbit {1e3 * orbit:.0f} ms, ratio {branch / orbit:.0f}"
    print(f"cam, 200 points from {first}: {times}")


def cpu(task: Callable[[], object]) -> float:
    """Return the processor time of a task in seconds."""
    began = time.process_time()
    task()
    return time.process_time() - began


def main() -> None:
    for first in ("300 rpm", "400 rpm"):
        branches(first)
    compared("cam, 300 rpm", solve.load("cam", case="1"), "300 rpm", 30)
    for zeta, most in ((0.0015, 3000), (0.00025, 18000)):
        numbers = {"zeta": zeta, "k": 1.0, "alpha": 1.0, "f": 0.4}
        compared(f"Duffing, zeta {zeta}", model_of(duffing(), **numbers), 1.6, most)


if __name__ == "__main__":
    main()
