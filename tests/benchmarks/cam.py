"""The contenders on one problem: cam, case 1, 600 rpm, q3 to 1e-6 of the converged reference."""

import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

import solve
from solve.methods import segments
from solve.period.grid import Grid
from tests.benchmarks import casadi_peers, peers

ACCURACY = 1e-6
SPECTRAL_RADIUS = 0.0701120372
REPEATS = 5
OURS = 4
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


def certified() -> Result:
    """The user's own call: accuracy asked for, error estimated, warnings and all."""
    orbit = solve.periodic(cam(), peers.SPEED, rtol=ACCURACY)
    return orbit.phase, orbit.q, orbit.multipliers


def one_grid() -> Result:
    """The same method on one grid, its error unjudged as the peers' are."""
    grid = Grid.uniform(304, cam().period)
    solution = solve.Radau().solution(cam(), peers.SPEED, grid, True)
    assert solution.curve is not None
    phase = grid.nodes[:-1]
    return phase, solution.curve(phase), solution.multipliers.values


def by(engine: bool, run: Callable[[], Result]) -> Callable[[], Result]:
    """The run in NumPy alone, or in compiled segments from the first grid on."""

    def chosen() -> Result:
        ready = segments.ready
        segments.ready = lambda method, n, steps: engine and steps % 8 == 0 and segments.prepare(method, n)
        try:
            return run()
        finally:
            segments.ready = ready

    return chosen


CONTENDERS = [
    Contender("one grid, Radau, 304 steps: compiled", by(True, one_grid)),
    Contender("one grid, Radau, 304 steps: NumPy", by(False, one_grid)),
    Contender("solve.periodic, certified: compiled", by(True, certified)),
    Contender("solve.periodic, certified: NumPy", by(False, certified)),
    Contender("CasADi mapaccum RK4, 9300 steps", lambda: casadi_peers.mapaccum(9300)),
    Contender("CasADi cvodes, matrix equation", lambda: casadi_peers.cvodes(4e-9)),
    Contender("SciPy DOP853 shooting", lambda: peers.dop853_shooting(2e-7)),
    Contender("RK4 loop, 9300 steps", lambda: peers.runge_kutta_loop(9300)),
    Contender("SciPy solve_bvp, orbit alone", lambda: peers.boundary_values(1e-5, 3000), repeats=1),
    Contender("Newmark 3n loop, 800 000 steps", lambda: peers.newmark_loop(800_000), repeats=1),
]


def error(result: Result) -> float:
    """max|error| of q3 over its max|q3|, at the contender's own phases."""
    phase, q, _ = result
    truth = reference().at(phase)[2]
    return float(np.abs(q[2] - truth).max() / reference().statistics("q3").max_abs)
