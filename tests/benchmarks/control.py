"""python -m tests.benchmarks.control: regulators of the cam's drive, relative to a certified solution.

Run it with OMP_NUM_THREADS=1 for one thread.
"""

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

import solve
from tests.benchmarks.timing import best

SPEEDS = "100 rpm", "300 rpm", "600 rpm"
ACCURACY = 1e-8
WEIGHTS = {"q3": 1e12}, {"u": 1e-2}
NOISE = {"u": 1.0}, {"q1": 1e-9}


@dataclass(frozen=True)
class Contender:
    name: str
    run: Callable[[], Any]


@functools.cache
def cam():
    return solve.load("cam")


def contenders(speed: str) -> list[Contender]:
    """Return the certified solution, which is the reference of the ratios, and the designs."""
    return [
        Contender("periodic", lambda: solve.periodic(cam(), speed)),
        Contender("lqr", lambda: solve.lqr(cam(), speed, *WEIGHTS)),
        Contender("kalman", lambda: solve.kalman(cam(), speed, *NOISE)),
        Contender("lqg", lambda: solve.lqg(cam(), speed, *WEIGHTS, *NOISE)),
    ]


def error(speed: str) -> float:
    """Return the difference of the regulator's X from a solution with the tolerance 1e-11, relative to √(X_ii
    X_jj)."""
    phase = np.linspace(0.0, 2 * np.pi, 400)
    X, exact = (solve.lqr(cam(), speed, *WEIGHTS, rtol=rtol).riccati(phase) for rtol in (ACCURACY, 1e-11))
    size = np.sqrt(np.einsum("kii->ki", exact).max(axis=0))
    return float(np.abs((X - exact) / size / size[:, None]).max())


def main() -> None:
    print("cam, case 1: shortest times, one thread; ratio to a certified periodic solution\n")
    print(f"{'':24}{'ms':>9}{'ratio':>9}{'error of X':>12}")
    for speed in SPEEDS:
        periodic, *designs = contenders(speed)
        unit = best(periodic.run)
        print(f"{speed + ', ' + periodic.name:24}{1e3 * unit:9.2f}{1.0:9.1f}")
        for design in designs:
            seconds = best(design.run)
            shown = f"{error(speed):12.1e}" if design.name == "lqr" else ""
            print(f"{speed + ', ' + design.name:24}{1e3 * seconds:9.2f}{seconds / unit:9.1f}{shown}")


if __name__ == "__main__":
    main()
