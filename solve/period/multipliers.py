"""Floquet multipliers from monodromy matrices (…, N, N), and the stability verdict.

Every array may have a leading axis of points, here `…`."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from solve.arrays import EPS, Array, across
from solve.kernel.multipliers import Conditioned
from solve.period.eigenvalues import LOST, NEGLIGIBLE, balanced, pair_distance, sorted_eigenvalues

UNIT_CIRCLE = 1e-9
"""Distance from 1 within which a modulus counts as 1, in addition to its error. Chosen by judgement."""

KNOWN_ON_CIRCLE = 1e-6
"""A multiplier counts as on the unit circle if the distance of its modulus from 1, plus its error, is at most
this value. Chosen by judgement."""

SURE = 2.0
"""Factor on the error estimate. A multiplier is outside the unit circle if its modulus exceeds 1 by more than
this multiple of the estimate. Chosen by judgement."""

UNDERFLOW = 1e-30
"""Spectral radius below which multipliers are round-off of the entries of Φ. docs/certificate.md states the
measured range."""

_TIMES_ESTIMATE = 10.0
"""Factor on the error estimate of multipliers that may coincide: the error that splits a double multiplier
also moves it off the unit circle. Chosen by judgement."""

VERDICTS: tuple[str, ...] = ("asymptotically stable", "stable", "unstable", "undetermined")
ASYMPTOTICALLY_STABLE, STABLE, UNSTABLE, UNDETERMINED = range(4)


class StateScales(Protocol):
    """Protocol of the points for which verdicts are determined. Its methods return, for points with indices
    (k,), whether the points drift freely and the units of their states. See `FrozenModes`."""

    def rigid_body_drift(self, points: Array, Phi: Array, errors: Array) -> Array: ...

    def units(self, points: Array) -> Array: ...


@dataclass(frozen=True)
class Multipliers:
    """Floquet multipliers in order of decreasing modulus, positive imaginary part first.

    Attributes
    ----------
    values : (…, N)
        Complex multipliers. Unresolved multipliers, with moduli up to `bound`, are replaced by zero.
    resolved : (…)
        Number of resolved multipliers.
    bound : (…)
        Modulus below which multipliers are round-off.
    """

    values: Array
    resolved: Array
    bound: Array

    @classmethod
    def from_matrices(
        cls, Phi: Array, units: Array | None = None, known: Conditioned | None = None
    ) -> "Multipliers":
        """Eigenvalues of finite monodromy matrices `Phi` (…, N, N).

        The bound is 8 eps‖Φ‖, where Φ is balanced and thus independent of units, but at least 1e-100. units:
        as returned by `balance_matrices`, if known. known: the eigenvalues, if already computed."""
        values, norm = sorted_eigenvalues(Phi, units) if known is None else (known.values, known.sizes)
        bound = np.maximum(LOST * norm, NEGLIGIBLE)
        is_resolved = np.abs(values) > bound[..., None]
        if is_resolved.all():
            return cls(values, np.full(bound.shape, values.shape[-1]), bound)
        return cls(np.where(is_resolved, values, 0.0), across(np.add, is_resolved.astype(int)), bound)

    def __getitem__(self, points: Any) -> "Multipliers":
        return Multipliers(self.values[points], self.resolved[points], self.bound[points])

    @cached_property
    def moduli(self) -> Array:
        """Moduli (…, N)."""
        return np.abs(self.values)

    @property
    def spectral_radius(self) -> Array:
        """Largest modulus (…)."""
        return self.moduli[..., 0]

    @property
    def nearest_one(self) -> Array:
        """Multiplier nearest to +1 (…), with nonnegative imaginary part; 0 if no multiplier is resolved."""
        values = self.values.reshape(-1, self.values.shape[-1])
        value = values[np.arange(len(values)), np.abs(values - 1.0).argmin(axis=1)]
        return (np.real(value) + 1j * np.abs(np.imag(value))).reshape(self.values.shape[:-1])

    @property
    def distance_from_one(self) -> Array:
        """Smallest |ρ - 1| of the resolved multipliers (…). It is 0 at resonance and on a stability boundary
        with a multiplier +1."""
        is_resolved = np.arange(self.values.shape[-1]) < self.resolved[..., None]
        return np.where(is_resolved, np.abs(self.values - 1.0), np.inf).min(axis=-1)

    def distance(self, other: "Multipliers") -> Array:
        """Largest distance (…) between a multiplier and the matching one of `other`, in a one-to-one
        matching."""
        if self.values.shape[-1] == 2:
            return pair_distance(self.values, other.values)
        distance = np.abs(self.values[..., :, None] - other.values[..., None, :])
        nearest, smallest = distance.argmin(axis=-1), distance.min(axis=-1)
        largest, indices = np.asarray(smallest.max(axis=-1)), np.arange(nearest.shape[-1])
        if (nearest == indices).all():
            return largest
        # The largest distance to a nearest neighbour is a lower bound for every matching. Matching by index
        # may attain this bound even if two multipliers share their nearest neighbour.
        is_shared = (np.sort(nearest, axis=-1) != indices).any(axis=-1)
        is_shared &= np.abs(self.values - other.values).max(axis=-1) > largest
        for index in zip(*np.nonzero(np.atleast_1d(is_shared)), strict=True) if is_shared.any() else ():
            point = index if largest.ndim else ()
            largest[point] = distance[point][matched(distance[point])].max()
        return largest

    def difference(self, other: "Multipliers") -> Array:
        """`distance` (…) relative to the spectral radius of `other`, which contains the more accurate
        multipliers. Infinite if the spectral radius is 0 but the distance is not."""
        distance, scale = self.distance(other), other.spectral_radius
        without_scale = np.where(distance == 0, 0.0, np.inf)
        return np.where(scale > 0, distance / np.where(scale > 0, scale, 1.0), without_scale)

    def with_digits(self, error: Array) -> "Multipliers":
        """Set multipliers that are not accurate to one digit to zero.

        error (…): error of the multipliers relative to the spectral radius; infinite if all multipliers are
        below `UNDERFLOW`."""
        has_no_digit = np.isinf(error)
        absolute = np.where(has_no_digit, 0.0, error) * self.spectral_radius
        bounds = np.maximum(np.where(has_no_digit, UNDERFLOW, absolute), self.bound)
        is_resolved = np.abs(self.values) > bounds[..., None]
        return Multipliers(np.where(is_resolved, self.values, 0.0), is_resolved.sum(axis=-1), bounds)


def matched(distance: Array) -> tuple[Array, Array]:
    """Match each row of a distance matrix (k, N), k ≤ N, with a different column so that the sum of distances
    is smallest. Return the indices of the rows and of the columns."""
    nearest, indices = distance.argmin(axis=1), np.arange(len(distance))
    if len(set(nearest.tolist())) == len(nearest):
        return indices, nearest
    if len(distance) == distance.shape[1] and _is_matched_by_places(distance):
        return indices, indices
    # Importing SciPy's optimisation package takes longer than many commands.
    from scipy.optimize import linear_sum_assignment

    return linear_sum_assignment(distance)


def _is_matched_by_places(distance: Array) -> bool:
    """Whether the diagonal of a distance matrix (N, N) is an optimal matching, within round-off: no cyclic
    exchange reduces the sum (R. W. Floyd's shortest paths, Commun. ACM 5 (1962) 345)."""
    paths = distance - np.diagonal(distance)[:, None]
    for k in range(len(paths)):
        paths = np.minimum(paths, paths[:, k, None] + paths[k])
    return bool((np.diagonal(paths) >= -8 * EPS * distance.max()).all())


def verdicts(Phi: Array, multipliers: Multipliers, errors: Array, modes: StateScales) -> Array:
    """Verdicts (P,) as indices in VERDICTS, from monodromy matrices (P, N, N).

    Let e be the absolute error of a multiplier, computed from `errors` (P,), but at least
    `multipliers.bound` for an unresolved multiplier.

    - Asymptotically stable: all |ρ| + e < 1 - 1e-9.
    - Unstable: some |ρ| - 2 e > 1 + 1e-9, or a coordinate drifts freely. The factor 2 is used because e is
      only an estimate.
    - Stable: all multipliers that are not inside the circle have |ρ| - e ≤ 1 + 1e-9 and ||ρ| - 1| + e ≤ 1e-6,
      and none of them can be defective (section 2 of the chapter).
    - Undetermined otherwise.

    If two multipliers may coincide, 10 e is used instead of e in the first condition, and instead of 2 e in
    the second."""
    values, moduli, e = multipliers.values, multipliers.moduli, _absolute_errors(multipliers, errors)
    result = _by_moduli(moduli, e, e, SURE * e)
    rows, coincide = _coinciding(multipliers, errors, e)
    if len(rows):
        is_simple, error = ~coincide.any(axis=-1), e[rows]
        inner, outer = (np.where(is_simple, factor, _TIMES_ESTIMATE) * error for factor in (1.0, SURE))
        result[rows] = _by_moduli(moduli[rows], error, inner, outer)
    is_open = np.flatnonzero((result == STABLE) | (result == UNDETERMINED))
    # A drift requires two multipliers near +1. The distance 1e-3 is chosen by judgement.
    is_near_one = (np.abs(values[is_open] - 1) <= 1e-3).astype(int)
    is_open = is_open[across(np.add, is_near_one) > 1]
    if len(is_open):
        drifts = modes.rigid_body_drift(is_open, Phi[is_open], errors[is_open])
        result[is_open] = np.where(drifts, UNSTABLE, result[is_open])
    stable = np.flatnonzero(result[rows] == STABLE)
    units = modes.units(rows[stable]) if len(stable) else ()
    for row, pairs, unit in zip(rows[stable].tolist(), coincide[stable], units, strict=True):
        in_units = balanced(Phi[row] * unit[:, None] / unit)
        if _may_be_defective(in_units, values[row], pairs, float(errors[row])):
            result[row] = UNDETERMINED
    return result


def verdicts_by_moduli(multipliers: Multipliers, errors: Array) -> Array:
    """Verdicts (P,) by the rules of `verdicts`, but without the tests for multiple multipliers and for
    drift."""
    e = _absolute_errors(multipliers, errors)
    return _by_moduli(multipliers.moduli, e, e, e)


def _absolute_errors(multipliers: Multipliers, errors: Array) -> Array:
    """Absolute errors (P, N) of the multipliers, as defined in `verdicts`."""
    values, resolved = multipliers.values, multipliers.resolved
    if (resolved == values.shape[-1]).all():
        return np.broadcast_to(errors[:, None], values.shape)
    is_unresolved = np.arange(values.shape[-1]) >= resolved[:, None]
    return np.where(is_unresolved, np.maximum(multipliers.bound[:, None], errors[:, None]), errors[:, None])


def radius_verdicts(radius: Array, errors: Array) -> list[str]:
    """Verdicts, as strings, from spectral radii (P,) and their absolute errors (P,); undetermined near the
    unit circle."""
    beyond = np.where(radius - SURE * errors > 1 + UNIT_CIRCLE, UNSTABLE, UNDETERMINED)
    inside = radius + errors < 1 - UNIT_CIRCLE
    return [VERDICTS[verdict] for verdict in np.where(inside, ASYMPTOTICALLY_STABLE, beyond).tolist()]


def _by_moduli(moduli: Array, e: Array, inner: Array, outer: Array) -> Array:
    """Verdicts (P,) from moduli (P, N) with errors e (P, N). `inner` and `outer` (P, N) are the margins by
    which a modulus must be below or above 1 to count as inside or outside the unit circle."""
    is_inside, is_outside = moduli + inner < 1 - UNIT_CIRCLE, moduli - outer > 1 + UNIT_CIRCLE
    may_be_on_circle = ~is_inside & ~is_outside
    result = np.where(across(np.logical_or, may_be_on_circle), STABLE, ASYMPTOTICALLY_STABLE)
    is_on_circle = (np.abs(moduli - 1) + e <= KNOWN_ON_CIRCLE) & (moduli - e <= 1 + UNIT_CIRCLE)
    result = np.where(across(np.logical_or, may_be_on_circle & ~is_on_circle), UNDETERMINED, result)
    return np.where(across(np.logical_or, is_outside), UNSTABLE, result)


def _coinciding(multipliers: Multipliers, errors: Array, e: Array) -> tuple[Array, Array]:
    """Find points with multipliers near the unit circle that may coincide. Return their indices (k,) and
    masks (k, N, N) of the pairs.

    A perturbation ε splits the double multiplier of a defective block by about √ε, which `errors` (P,) may
    not include. Two multipliers may coincide if their distance exceeds neither the square root of the error
    nor a thousand times the error. The factor is chosen by judgement. e (P, N): error of each multiplier."""
    is_near = np.abs(multipliers.moduli - 1) <= _TIMES_ESTIMATE * e + UNIT_CIRCLE
    rows, N = np.flatnonzero(across(np.add, is_near.astype(int)) > 1), is_near.shape[1]
    if not len(rows):
        return rows, np.zeros((0, N, N), dtype=bool)
    values, is_near, error = multipliers.values[rows], is_near[rows], np.maximum(errors[rows], UNIT_CIRCLE)
    limit = np.minimum(np.sqrt(error), 1e3 * error)
    i, j = np.triu_indices(N, 1)
    is_close = (np.abs(values[:, i] - values[:, j]) <= limit[:, None]) & is_near[:, i] & is_near[:, j]
    has_pair = across(np.logical_or, is_close)
    rows, is_close = rows[has_pair], is_close[has_pair]
    pairs = np.zeros((len(rows), N, N), dtype=bool)
    pairs[:, i, j] = pairs[:, j, i] = is_close
    return rows, pairs


def _may_be_defective(Phi: Array, values: Array, pairs: Array, error: float) -> bool:
    """Whether any of the multipliers `values` (N,) may be defective. `pairs` (N, N): mask of the pairs that
    may coincide.

    A multiplier ρ is not defective if Φ - ρ has as many zero singular values as there are multipliers that
    coincide with ρ. Singular values count as zero within the errors of the multipliers and the distances
    between them.
    """
    for row in np.flatnonzero(pairs.any(axis=-1)):
        singular = np.linalg.svd(Phi - values[row] * np.eye(len(Phi)), compute_uv=False)
        distance = float(np.abs(values[pairs[row]] - values[row]).max())
        limit = _TIMES_ESTIMATE * max(error, UNIT_CIRCLE, distance) * max(float(singular[0]), 1.0)
        if np.sum(singular <= limit) < 1 + np.sum(pairs[row]):
            return True
    return False
