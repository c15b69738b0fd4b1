"""One correction of Newton's method: a linear periodic problem."""

import numpy as np

from solve.arrays import Array
from solve.certify.estimates import closing_rounding, in_sizes, moduli
from solve.contracts import Motion
from solve.kernel.formulas import columns_by
from solve.methods.free import free, solutions_on
from solve.methods.method import Method, Solutions
from solve.period.grid import Grid
from solve.period.points import Multiplied, OnePoint
from solve.system import PeriodicSystem

_COMPARED = 4
"""Phases a step at which a correction is measured."""


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


def correction(motion: Motion, found: Solutions) -> Array:
    """Size (n,) of a correction, per coordinate max|change|/max|q|; one that rests but for rounding is
    measured by the largest."""
    assert found.curve is not None
    steps = found.grid.h[:, None] * ((np.arange(_COMPARED) + 0.5) / _COMPARED)
    phase = (found.grid.nodes[:-1, None] + steps).ravel()
    apart, largest = moduli(motion(phase), found.curve(phase))
    return in_sizes(apart, largest, closing_rounding(found), _by_the_largest)[0]


def _by_the_largest(_: Array, sizes: Array) -> Array:
    return np.broadcast_to(sizes.max(axis=1, keepdims=True), sizes.shape)
