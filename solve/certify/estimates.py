"""Differences between two solutions, and round-off errors of solutions.

Errors (P, 2) of orbit and multipliers are relative: to the largest value of each coordinate, and to the
spectral radius."""

import numpy as np

from solve.arrays import Array
from solve.kernel import curves as kernel
from solve.kernel.engines import COMPILED, NUMPY
from solve.methods.method import Solutions
from solve.period.curve import Curve, PeriodicCurve
from solve.period.eigenvalues import EPS, roundoff_growth
from solve.period.frozen import FrozenModes
from solve.period.grid import Grid
from solve.period.period_map import at_rest

PHASES_PER_STEP = 4
"""Smallest number of phases per step at which curves are compared. With 2 or 8, 65 results on 14 systems of
both populations remain honest with the same verdicts."""

SAFETY = 2.0
"""Ratio of the error estimate to the difference from a better solution. The difference equals the error to
first order, and is at least half of it in 99.8 % of the stored population."""

NO_DIGIT = 0.1
"""Relative error above which a value is not accurate to even one digit."""

ROUND_OFF = 64 * EPS
"""Relative size below which a value is the round-off of its computation: a choice, some ten operations above
the unit round-off."""


def differences(coarse: Solutions, fine: Solutions, modes: FrozenModes, engine: str = NUMPY) -> Array:
    """Differences (P, 2) of solutions from more accurate ones, for points with these frozen modes.

    The difference of the orbits is max|difference|/max|q|, the largest of all coordinates. A coordinate that
    is zero except for round-off (the mass at a tuned absorber) is compared with the displacement that all
    loads on it would cause."""
    multipliers = coarse.multipliers.difference(fine.multipliers)
    orbit = np.zeros_like(multipliers)
    if coarse.curve is not None and fine.curve is not None:
        change, largest = _curve_differences(coarse.grid, coarse.curve, fine.grid, fine.curve, engine)
        scales = _coordinate_scales(largest, orbit_roundoff(fine), modes)
        orbit = (change / np.where(scales > 0, scales, 1.0)).max(axis=1)
    return np.array((orbit, multipliers)).T


def _curve_differences(
    coarse: Grid, curve: PeriodicCurve, fine: Grid, better: PeriodicCurve, engine: str
) -> tuple[Array, Array]:
    """Largest moduli (P, n) of the differences of two curves, and of the better curve, at phases that are
    evenly spaced in the steps of the coarse grid."""
    per_fine_step, rest = divmod(PHASES_PER_STEP * coarse.steps, fine.steps)
    is_shared = not rest and per_fine_step <= PHASES_PER_STEP
    if not (is_shared and (fine.smooth or coarse.steps == fine.steps)):
        fractions = coarse.h[:, None] * (np.arange(PHASES_PER_STEP) / PHASES_PER_STEP)
        phases = (coarse.nodes[:-1, None] + fractions).ravel()
        return largest_moduli(curve.sampled(PHASES_PER_STEP), better(phases))
    per_step = PHASES_PER_STEP, per_fine_step
    if engine == COMPILED and isinstance(curve, Curve) and isinstance(better, Curve):
        compiled = kernel.differences(curve.coefficients, better.coefficients, per_step)
        if compiled is not None:
            return compiled
    return largest_moduli(
        *(each.sampled(count) for each, count in zip((curve, better), per_step, strict=True))
    )


def largest_moduli(q: Array, better: Array) -> tuple[Array, Array]:
    """Largest moduli (P, n) of the differences between values (P, n, k), and of the more accurate values."""
    return np.abs(q - better).max(axis=2), np.abs(better).max(axis=2)


def _coordinate_scales(largest: Array, roundoff: Array, modes: FrozenModes) -> Array:
    """Scales (P, n) for the errors of coordinates: the `largest` moduli, or the load scale where these are
    round-off.

    If forces on a coordinate cancel, the condition number contains the ratio of these forces to the
    coordinate. The `roundoff` (P,) is then relative to the coordinate, which is accurate to one digit if
    `roundoff` is below `NO_DIGIT`."""
    limit = np.maximum(roundoff, at_rest(roundoff))[:, None]
    is_small = largest <= limit * largest.max(axis=1, keepdims=True)
    if not is_small.any():
        return largest
    rows = is_small.any(axis=1).nonzero()[0]
    scales, loads = largest.copy(), modes[rows].load_scale(largest[rows])
    size, roundoff = largest[rows], roundoff[rows, None]
    cancels = (size * roundoff >= EPS * loads) & (roundoff < NO_DIGIT)
    scales[rows] = np.where(cancels | (size > limit[rows] * loads), size, loads)
    return scales


def orbit_roundoff(solutions: Solutions) -> Array:
    """Round-off error (P,) of the orbit, from the condition number of the periodic system."""
    return np.fmax(EPS * roundoff_growth(solutions.grid.steps) * solutions.condition, ROUND_OFF)


def roundoff_errors(solutions: Solutions) -> Array:
    """Round-off errors (P, 2) of orbit and multipliers."""
    return np.array((orbit_roundoff(solutions), np.maximum(solutions.multiplier_rounding, ROUND_OFF))).T
