"""One correction of Newton's method: a linear periodic problem."""

import numpy as np

from solve.arrays import Array
from solve.certify.estimates import moduli
from solve.certify.scale import CoordinateScale
from solve.contracts import Motion
from solve.errors import SolveError
from solve.kernel.formulas import columns_by
from solve.methods.free import free, solutions_on
from solve.methods.method import Method, Solutions
from solve.period.grid import Grid
from solve.period.points import Multiplied, OnePoint
from solve.system import PeriodicSystem

_COMPARED = 4
"""Phases a step at which a correction is measured."""

DOUBTFUL = 1e-2
"""Relative correction above which it may be one of round-off: of noise it is about 1."""


def corrected(
    system: PeriodicSystem,
    motion: Motion,
    speed: float,
    method: Method,
    grid: Grid,
    engine: str,
    factors: Array | None = None,
) -> Solutions:
    """The next iterate after a motion, on a grid over the motion's period: what solves the system linearised
    along the motion, its equations multiplied by factors (1, n). Raises SolveError where that has no
    solution, LinearModelError for linear systems."""
    point = OnePoint(system.along(motion, columns_by(engine)), speed)
    scaled = point if factors is None else Multiplied(point, factors)
    found = solutions_on(method, scaled, grid, True, engine, free(point))
    for reason in found.failures.values():
        raise reason
    return found


def correction(motion: Motion, found: Solutions) -> tuple[Array, Array]:
    """Largest moduli (n,) of a correction to a motion, and of the corrected motion."""
    assert found.curve is not None
    steps = found.grid.h[:, None] * ((np.arange(_COMPARED) + 0.5) / _COMPARED)
    phase = (found.grid.nodes[:-1, None] + steps).ravel()
    change, largest = moduli(motion(phase), found.curve(phase))
    return change[0], largest[0]


def relative_correction(
    system: PeriodicSystem, motion: Motion, speed: float, found: Solutions, engine: str
) -> Array:
    """The correction (n,) relative to the scale of each coordinate."""
    change, largest = correction(motion, found)
    along = system.along(motion, columns_by(engine))
    scale = CoordinateScale(along, motion, speed, found.grid.steps)
    sizes = change / scale.of(largest)
    return change / scale.of(largest, roundoff=True) if sizes.max() > DOUBTFUL else sizes


def linearisation_error(
    system: PeriodicSystem, motion: Motion, speed: float, method: Method, grid: Grid, engine: str
) -> Array:
    """Estimated distance (n,) of the nonlinear orbit from a linear one: one correction relative to the scale
    of each coordinate; NaN if the correction has no solution."""
    try:
        further = corrected(system, motion, speed, method, grid, engine)
    except SolveError:
        return np.full(system.n, np.nan)
    return relative_correction(system, motion, speed, further, engine)
