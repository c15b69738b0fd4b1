"""Errors of solutions from two grids, and what no two grids show. Errors are relative, as `rtol` is; those
of orbit and multipliers stand beside each other: (P, 2)."""

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
    KNOWN_ON_CIRCLE,
    UNDETERMINED,
    Multipliers,
    accumulated,
    most_rounding,
    roughly,
)
from solve.period.period_map import at_rest

_AT_ONE = 0.1
"""Part of a method's own error within which its extrapolated multiplier must meet +1 to be taken for it."""

_COMPARED = 4
"""Phases a step at which curves are compared at least."""

_NOT_FOLLOWED = 0.3
"""Part of the highest power in a step from which on half as many steps more tell no digit either."""

Burdens = Callable[[Array, Array], Array]
"""`Frozen.burdens` of points at positions (k,), from sizes (k, n)."""


def differences(coarse: Solutions, fine: Solutions, burdens: Burdens, engine: str = NUMPY) -> Array:
    """To the better solutions, (P, 2): of the orbit, per coordinate max|difference|/max|q|, and of the
    multipliers.

    A coordinate that rests but for rounding (the mass that a tuned absorber quiets) has no size of its
    own to compare with; it is measured by what all that acts on it would make of it.
    """
    multipliers = coarse.multipliers.difference(fine.multipliers)
    orbit = np.zeros_like(multipliers)
    if coarse.curve is not None and fine.curve is not None:
        apart, largest = _apart(coarse.grid, coarse.curve, fine.grid, fine.curve, engine)
        orbit = in_sizes(apart, largest, closing_rounding(fine), burdens).max(axis=1)
    return np.column_stack((orbit, multipliers))


def monodromy_differences(coarse: Array, fine: Solutions, at: Array | slice) -> Array:
    """Square roots (k,) of |tr Δ²|, relative to the spectral radius, with Δ the differences of monodromy
    matrices, coarse ones (k, N, N) and those of solutions at positions (k,): the same in all coordinates, and
    as large as those of multipliers, but where these meet by chance."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        # Long rows to go along instead of many short ones.
        apart = np.moveaxis(fine.Phi[at] - coarse, 0, -1) / fine.multipliers.spectral_radius[at]
        return np.sqrt(np.abs(np.einsum("ijk,jik->k", apart, apart)))


def _apart(
    coarse: Grid, curve: PeriodicCurve, fine: Grid, better: PeriodicCurve, engine: str
) -> tuple[Array, Array]:
    """Largest moduli (P, n) of the differences of curves, and of the better one, at some phases of every step
    of the coarse grid: at such as lie evenly in the steps of both, if these are few."""
    shared = fine.steps // math.gcd(coarse.steps, fine.steps)
    samples = shared * -(-_COMPARED // shared)
    of_both = samples, samples * coarse.steps // fine.steps
    if max(of_both) > kernel.MOST or not fine.smooth:
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
    """Differences of coordinates (P, n) relative to their `largest` values, as `differences` has it; rounding
    (P,): relative error that is none."""
    sizes = _sizes(largest, rounding, burdens)
    return apart / np.where(sizes > 0, sizes, 1.0)


def _sizes(largest: Array, rounding: Array, burdens: Burdens) -> Array:
    """By which errors of coordinates (P, n) are measured: their `largest` values, unless that is rounding."""
    limit = np.maximum(rounding, at_rest(rounding))[:, None]
    resting = largest <= limit * largest.max(axis=1, keepdims=True)
    if not resting.any():
        return largest
    small = np.flatnonzero(resting.any(axis=1))
    sizes, burden = largest.copy(), burdens(small, largest[small])
    sizes[small] = np.where(largest[small] > limit[small] * burden, largest[small], burden)
    return sizes


def not_followed(solutions: Solutions) -> Array:
    """Points (P,) with curves of which the steps are sure to tell no digit."""
    curve = solutions.curve
    if not isinstance(curve, Curve):
        return np.zeros(len(solutions), dtype=bool)
    with np.errstate(all="ignore"):
        return curve.last_power >= _NOT_FOLLOWED


def at_one(coarse: Multipliers, fine: Multipliers, ratio: Array | float, order: float, steps: int) -> Array:
    """Whether the multipliers nearest to +1 (P,) of two grids, the finer one of `steps`, go there as the
    steps get finer."""
    nearest = fine.nearest_one
    change = (nearest - coarse.nearest_one) / (ratio**order - 1)
    rounding = EPS * max(8, steps) / (1 - ratio**-order)
    return np.abs(nearest + change - 1) <= np.maximum(_AT_ONE * np.abs(change), rounding)


def within_reach(solutions: Solutions, errors: Array, wanted: Array) -> Array:
    """Errors to ask for: the wanted ones, or what rounding leaves where that is more and errors are low
    enough for it to matter."""
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


def nearly_decided(
    done: Array, fine: Solutions, errors: Array, found: Array, before: Array, order: float
) -> Array:
    """Which points among those `done` (k,) have multipliers that leave the verdict open only because they are
    not known to be on the unit circle, which twice the steps will tell if differences, `found` and `before`
    (k, 2), go on to fall."""
    with np.errstate(over="ignore"):
        e = np.where(np.isfinite(errors[:, 1]), errors[:, 1], 0.0) * fine.multipliers.spectral_radius
    near = done & (e > KNOWN_ON_CIRCLE / 2) & (e <= KNOWN_ON_CIRCLE * 2**order)
    near &= found[:, 1] < before[:, 1] / 2
    at = np.flatnonzero(near)
    if len(at):
        near[at] = roughly(fine.multipliers[at], e[at]) == UNDETERMINED
    return near


def closing_rounding(solutions: Solutions) -> Array:
    """Error of the orbit (P,) that rounding leaves in a problem of this condition."""
    return np.fmax(EPS * accumulated(solutions.grid.steps) * solutions.condition, 64 * EPS)


def rounding(solutions: Solutions) -> Array:
    """Errors that rounding leaves, of orbit and multipliers."""
    return np.column_stack((closing_rounding(solutions), np.maximum(solutions.multiplier_rounding, 64 * EPS)))


def raised(errors: Array, floors: Array, alias: Array, hidden: Array, sizes: Array) -> Array:
    """Errors (P, 2) estimated from two grids, raised by what no two grids show: rounding, orders that they
    see alike, and modes that neither follows, (P, 2) each.

    They are relative to a size that is itself known to its error only: the orbit's to that of the orbit,
    the spectral radius to `sizes` (P,). Of what this leaves of the size they are a larger part; where it
    leaves nothing, no error is known.
    """
    errors = np.maximum(np.maximum(errors, floors), np.maximum(alias, hidden))
    left = 1 - np.column_stack((errors[:, 0], sizes))
    return np.where(left > 0, errors / np.where(left > 0, left, 1.0), np.inf)


def radius_changes(coarse: Multipliers, fine: Multipliers) -> Array:
    """Difference of the spectral radii (P,), relative to the smaller one."""
    radii = coarse.spectral_radius, fine.spectral_radius
    smaller = np.minimum(*radii)
    known = smaller > 0
    return np.where(known, np.maximum(*radii) / np.where(known, smaller, 1.0) - 1, 0.0)


def enough_steps(reach: float, follows: float) -> int:
    """Steps that follow a mode which turns `reach` in a period."""
    return math.ceil(reach / follows)
