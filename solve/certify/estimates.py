"""Differences of two solutions, and round-off. Errors (P, 2) of orbit and multipliers are relative, like
`rtol`."""

import math
from collections.abc import Callable

import numpy as np

from solve.arrays import Array, across
from solve.kernel import curves as kernel
from solve.kernel.engines import COMPILED, NUMPY
from solve.methods.method import Solutions
from solve.period.curve import Curve, PeriodicCurve
from solve.period.grid import Grid
from solve.period.multipliers import (
    EPS,
    Multipliers,
    accumulated,
    most_rounding,
)
from solve.period.period_map import at_rest

_COMPARED = 4
"""Smallest number of phases per step at which curves are compared."""

NO_DIGIT = 0.1
"""Relative error from which on a number has no digit."""

Burdens = Callable[[Array, Array], Array]
"""`Frozen.burdens` of points at positions (k,), from sizes (k, n)."""


def differences(coarse: Solutions, fine: Solutions, burdens: Burdens, engine: str = NUMPY) -> Array:
    """Differences (P, 2) from better solutions: max|difference|/max|q| of the orbit, the largest of all
    coordinates, and the difference of the multipliers.

    The difference of a coordinate that is zero except for round-off (the mass at a tuned absorber) is
    relative to the displacement that all loads on it would cause."""
    multipliers = coarse.multipliers.difference(fine.multipliers)
    orbit = np.zeros_like(multipliers)
    if coarse.curve is not None and fine.curve is not None:
        apart, largest = _apart(coarse.grid, coarse.curve, fine.grid, fine.curve, engine)
        orbit = in_sizes(apart, largest, closing_rounding(fine), burdens).max(axis=1)
    return np.column_stack((orbit, multipliers))


def _apart(
    coarse: Grid, curve: PeriodicCurve, fine: Grid, better: PeriodicCurve, engine: str
) -> tuple[Array, Array]:
    """Largest moduli (P, n) of the differences of curves, and of the better one, at some phases of every step
    of the coarse grid: at phases evenly spaced in the steps of both grids, if these are few."""
    shared = fine.steps // math.gcd(coarse.steps, fine.steps)
    samples = shared * -(-_COMPARED // shared)
    of_both = samples, samples * coarse.steps // fine.steps
    if max(of_both) > kernel.MOST or not (fine.smooth or coarse.steps == fine.steps):
        fractions = coarse.h[:, None] * (np.arange(_COMPARED) / _COMPARED)
        return moduli(curve.sampled(_COMPARED), better((coarse.nodes[:-1, None] + fractions).ravel()))
    if engine == COMPILED and isinstance(curve, Curve) and isinstance(better, Curve):
        found = kernel.differences(curve.coefficients, better.coefficients, of_both)
        if found is not None:
            return found
    return moduli(curve.sampled(samples), better.sampled(of_both[1]))


def moduli(q: Array, better: Array) -> tuple[Array, Array]:
    """Largest moduli (P, n) of the differences of values (P, n, k), and of the better ones."""
    return np.abs(q - better).max(axis=2), np.abs(better).max(axis=2)


def in_sizes(apart: Array, largest: Array, rounding: Array, burdens: Burdens) -> Array:
    """Differences of coordinates (P, n) relative to their `largest` values, see `differences`. rounding (P,):
    relative round-off."""
    sizes = _sizes(largest, rounding, burdens)
    return apart / np.where(sizes > 0, sizes, 1.0)


def _sizes(largest: Array, rounding: Array, burdens: Burdens) -> Array:
    """Scales (P, n) of the errors of coordinates: their `largest` values, unless these are round-off.

    If forces on a coordinate cancel, the condition number contains the ratio of these to the coordinate. The
    round-off is then relative to the coordinate, which has a digit if the round-off is below `NO_DIGIT`.
    """
    limit = np.maximum(rounding, at_rest(rounding))[:, None]
    resting = largest <= limit * largest.max(axis=1, keepdims=True)
    if not resting.any():
        return largest
    small = np.flatnonzero(resting.any(axis=1))
    sizes, burden = largest.copy(), burdens(small, largest[small])
    own, rounding = largest[small], rounding[small, None]
    cancels = (own * rounding >= EPS * burden) & (rounding < NO_DIGIT)
    sizes[small] = np.where(cancels | (own > limit[small] * burden), own, burden)
    return sizes


def within_reach(solutions: Solutions, errors: Array, wanted: Array) -> Array:
    """Attainable tolerances: the wanted ones, or the round-off if it is larger and the errors are low enough
    for it to matter."""
    missed = across(np.logical_or, errors > wanted)
    if not missed.any():
        return wanted
    radius = solutions.multipliers.spectral_radius
    most = np.maximum(most_rounding(solutions.Phi, radius, solutions.grid.steps), 8 * solutions.rounding)
    limited = errors[:, 1] <= np.maximum(np.maximum(most, wanted[:, 1]), 64 * EPS)
    open_ = np.flatnonzero(missed & limited)
    if len(open_):
        wanted = wanted.copy()
        wanted[open_] = np.maximum(rounding(solutions[open_]), wanted[open_])
    return wanted


def closing_rounding(solutions: Solutions) -> Array:
    """Round-off error (P,) of the orbit, from the condition number."""
    return np.fmax(EPS * accumulated(solutions.grid.steps) * solutions.condition, 64 * EPS)


def rounding(solutions: Solutions) -> Array:
    """Round-off errors (P, 2) of orbit and multipliers."""
    return np.column_stack((closing_rounding(solutions), np.maximum(solutions.multiplier_rounding, 64 * EPS)))


def relative_to_size(errors: Array, sizes: Array) -> Array:
    """Errors (P, 2) relative to the smallest scale that they allow.

    The size of the orbit may be smaller by the error of the orbit, the spectral radius by `sizes` (P,). If
    the scale may be zero, the error is infinite."""
    left = 1 - np.column_stack((errors[:, 0], sizes))
    return np.where(left > 0, errors / np.where(left > 0, left, 1.0), np.inf)


def radius_changes(coarse: Multipliers, fine: Multipliers) -> Array:
    """Difference of the spectral radii (P,), relative to the smaller one."""
    radii = coarse.spectral_radius, fine.spectral_radius
    smaller = np.minimum(*radii)
    known = smaller > 0
    return np.where(known, np.maximum(*radii) / np.where(known, smaller, 1.0) - 1, 0.0)
