"""Programs compared on one problem: cam, case 1, at 600 rpm, with an error of q3 of at most 1e-6 relative to
the converged reference."""

import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

import solve
from solve.kernel.engines import COMPILED, NUMPY
from solve.period.grid import Grid
from solve.period.points import SinglePoint
from tests.benchmarks import casadi_peers, peers
from tests.benchmarks.timing import REPEATS

ACCURACY = 1e-6
SPECTRAL_RADIUS = 0.0701120372
OURS = 6
"""Of the contenders, the first ones are this package's own calls."""

Result = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Phases (k,), q (3, k) and the multipliers."""


@dataclass(frozen=True)
class Contender:
    name: str
    run: Callable[[], Result]
    repeats: int = REPEATS


@functools.cache
def cam():
    return solve.load("cam", case="1")


@functools.cache
def reference():
    return solve.periodic(cam(), peers.SPEED, solve.Radau(13), rtol=1e-12)


def certified(engine: str) -> Result:
    """Return the result of a user's call with a tolerance, error estimates and warnings."""
    orbit = solve.periodic(cam(), peers.SPEED, rtol=ACCURACY, engine=engine)
    return orbit.phase, orbit.q, orbit.multipliers


def orbit_alone(engine: str) -> Result:
    """Return the same orbit with the multipliers of the monodromy matrix instead of those of its factors."""
    orbit = solve.periodic(cam(), peers.SPEED, rtol=ACCURACY, engine=engine)
    return orbit.phase, orbit.q, orbit.certified.solutions.multipliers.values[0]


def one_grid(engine: str) -> Result:
    """Return the result on one grid without error estimates, as the other programs do."""
    grid = Grid.uniform(304, cam().period)
    solutions = solve.Radau().solutions(SinglePoint(cam(), peers.SPEED), grid, True, engine)
    assert solutions.curve is not None
    phase = grid.nodes[:-1]
    return phase, solutions.curve(phase)[0], solutions.multipliers.values[0]


CONTENDERS = [
    Contender("one grid, Radau, 304 steps: compiled", lambda: one_grid(COMPILED)),
    Contender("one grid, Radau, 304 steps: NumPy", lambda: one_grid(NUMPY)),
    Contender("solve.periodic, certified: compiled", lambda: certified(COMPILED)),
    Contender("solve.periodic, certified: NumPy", lambda: certified(NUMPY)),
    Contender("the orbit alone, certified: compiled", lambda: orbit_alone(COMPILED)),
    Contender("the orbit alone, certified: NumPy", lambda: orbit_alone(NUMPY)),
    Contender("CasADi mapaccum RK4, 9300 steps", lambda: casadi_peers.mapaccum(9300)),
    Contender("CasADi cvodes, matrix equation", lambda: casadi_peers.cvodes(4e-9)),
    Contender("SciPy DOP853 shooting", lambda: peers.dop853_shooting(2e-7)),
    Contender("RK4 loop, 9300 steps", lambda: peers.runge_kutta_loop(9300)),
    Contender("SciPy solve_bvp, orbit alone", lambda: peers.boundary_values(1e-5, 3000), repeats=1),
    Contender("Newmark 3n loop, 800 000 steps", lambda: peers.newmark_loop(800_000), repeats=1),
]


def error(result: Result) -> float:
    """Return max|error| of q3 over its max|q3| at the phases of the contender."""
    phase, q, _ = result
    truth = reference().at(phase)[2]
    return float(np.abs(q[2] - truth).max() / reference().statistics("q3").max_abs)
