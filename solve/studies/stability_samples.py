"""Stability at points of a parameter family, and distances from instability."""

import itertools
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import cached_property, partial

import numpy as np

from solve.arrays import SPLIT, Array
from solve.batch.batch import POINTS, Batch
from solve.batch.gathering import gathered
from solve.period.multipliers import UNDETERMINED, UNIT_CIRCLE
from solve.results.points import Kept, PointResults, kinds_of
from solve.terminal import progress

_STABILITY = Kept(warnings=False, meetings=False)

_UNREACHABLE = 1e6
"""Distance assigned to a kind of instability that cannot occur. Any value far above the distances of
multipliers with a modulus near 1 is suitable."""


@dataclass(frozen=True)
class StabilitySamples:
    """Stability at points (k, v).

    `unstable` (k,) is True if a multiplier lies outside the unit circle by more than its error; `stable` (k,)
    is True if all multipliers, within their errors, lie inside or on the circle. Both are False where the
    point failed or the verdict is undetermined. `multipliers` (k, N) are in descending order of modulus, and
    0 at failed points. For `distances` (k, 4), see `distances_to_instability`.
    """

    points: Array
    stable: Array
    unstable: Array
    multipliers: Array
    distances: Array

    @classmethod
    def from_multipliers(
        cls, points: Array, stable: Array, unstable: Array, multipliers: Array
    ) -> "StabilitySamples":
        """Samples with distances computed from the multipliers."""
        return cls(points, stable, unstable, multipliers, distances_to_instability(multipliers))

    @classmethod
    def from_results(cls, points: Array, results: PointResults) -> "StabilitySamples":
        """Samples from the results of solved points."""
        failed, outside = results.failed, results.kinds != ""
        multipliers = np.where(failed[:, None], 0.0, results.multipliers)
        stable = ~(failed | outside | (results.verdicts == UNDETERMINED))
        return cls.from_multipliers(points, stable, outside, multipliers)

    def __len__(self) -> int:
        return len(self.points)

    def __getitem__(self, rows: Array | slice) -> "StabilitySamples":
        return StabilitySamples(*(column[rows] for column in self._columns))

    def __add__(self, other: "StabilitySamples") -> "StabilitySamples":
        if len(other) == 0:
            return self
        pairs = zip(self._columns, other._columns, strict=True)
        return StabilitySamples(*map(np.concatenate, pairs))

    def replaced(self, rows: Array, others: "StabilitySamples") -> "StabilitySamples":
        """Copy in which the given rows (k,) are replaced by `others`."""
        columns = [column.copy() for column in self._columns]
        for column, new in zip(columns, others._columns, strict=True):
            column[rows] = new
        return StabilitySamples(*columns)

    @property
    def _columns(self) -> tuple[Array, ...]:
        return tuple(getattr(self, column.name) for column in fields(self))

    @property
    def failed(self) -> Array:
        """Mask (k,) of the points that are neither stable nor unstable."""
        return ~(self.stable | self.unstable)

    @property
    def for_plus_one(self) -> "StabilitySamples":
        """Copy in which a point counts as unstable only if a multiplier has passed through +1 along the real
        axis."""
        first, known = self.distances[:, 0], ~self.failed
        distances = np.where(np.arange(self.distances.shape[1]) == 0, self.distances, _UNREACHABLE)
        return replace(self, stable=known & (first > 0), unstable=known & (first < 0), distances=distances)

    @property
    def kinds(self) -> Array:
        """Indices (k,) in KINDS of the kind of the largest multiplier."""
        return kinds_of(self.multipliers)

    @cached_property
    def crossing_values(self) -> Array:
        """Smooth functions (k, 4) that become negative where a point becomes unstable.

        The columns are det(I - Φ), which is negative if a multiplier is beyond +1; det(I + Φ), which is
        negative if a multiplier is beyond -1; 1 - |ρ| of the largest multiplier; and the squared distance
        between two pairs of multipliers on the unit circle, which is negative after they have met and left
        the circle.
        """
        size = np.maximum(np.abs(self.multipliers[:, 0]), SPLIT)
        leaving = np.where(size > 1 + SPLIT, -np.square(size - 1 / size), self.distances[:, 2])
        plus, minus = (np.abs(1 - sign * self.multipliers).prod(axis=1) for sign in (1, -1))
        signed = np.copysign(np.column_stack((plus, minus)), self.distances[:, :2])
        return np.column_stack((signed, 1 - size, leaving))


def distances_to_instability(multipliers: Array) -> Array:
    """Return the distances (k, 4) of multipliers (k, N) from four kinds of instability. The first two columns
    are the smallest values of `crossing_function` for +1 and for -1. The third is the squared distance
    between two pairs, and the fourth is the distance of a pair from the unit circle."""
    rho = np.ascontiguousarray(multipliers.T)
    upper = np.imag(rho) > 0
    pairs = np.full(rho.shape[1], _UNREACHABLE)
    for first, second in itertools.combinations(range(len(rho)), 2):
        both = upper[first] & upper[second]
        if both.any():
            distance = np.abs(rho[first, both] - rho[second, both]) ** 2
            pairs[both] = np.minimum(pairs[both], distance)
    inside = 1 - np.abs(np.where(upper, rho, 0.0)).max(axis=0)
    inside = np.where(inside > SPLIT, inside, _UNREACHABLE)
    plus, minus = (crossing_function(multipliers, sign)[:, 0] for sign in (1, -1))
    return np.clip(np.column_stack((plus, minus, pairs, inside)), -_UNREACHABLE, _UNREACHABLE)


def crossing_function(multipliers: Array, sign: int) -> Array:
    """Return (1 ∓ ρ)(1 ∓ ρ′) for each pair ρ, ρ′ of multipliers (k, N), as an array (k, N / 2) in ascending
    order.

    The value passes smoothly through zero where one of the two multipliers passes through +1 (`sign` 1) or -1
    (`sign` -1). Pairs are conjugate, or consist of real multipliers of the same sign: the largest with the
    smallest, and so on.
    """
    rho, order = sign * multipliers, np.arange(multipliers.shape[1])
    if len(order) == 2:
        return np.real((1 - rho[:, :1]) * (1 - rho[:, 1:]))
    real = np.imag(rho) == 0
    negative, total = ((real & (np.real(rho) < limit)).sum(axis=1)[:, None] for limit in (0, np.inf))
    ascending = np.sort(np.where(real, np.real(rho), np.nan), axis=1)
    partner = np.where(order < negative, negative, negative + total) - 1 - order
    # The middle multiplier of an odd number has no partner.
    other = np.take_along_axis(ascending, np.clip(partner, 0, order[-1]), axis=1) * (partner != order)
    of_real = np.where(order < total, (1 - ascending) * (1 - other), np.nan)
    of_complex = np.where(real, np.nan, np.square(np.abs(1 - rho)))
    return np.sort(np.concatenate((of_real, of_complex), axis=1), axis=1)[:, : len(order) : 2]


def coalescence_distance(multipliers: Array, leading: Array) -> Array:
    """Return the signed distance (k,) from coalescence of two multipliers: the one with the index `leading`
    (k,) among `multipliers` (k, N), and its partner. The distance is the square of half their difference,
    divided by the modulus of their product.

    The distance is negative for conjugate pairs, positive for real pairs, and passes smoothly through zero
    where the two multipliers meet on the real axis.
    """
    rows = np.arange(len(leading))
    rho = multipliers[rows, leading]
    separation = np.where(np.imag(multipliers) == 0, np.abs(multipliers - rho[:, None]), np.inf)
    separation[rows, leading] = np.inf
    partner = multipliers[rows, separation.argmin(axis=1)]
    partner = np.where(
        np.imag(rho) != 0, np.conj(rho), np.where(np.isfinite(separation.min(axis=1)), partner, rho)
    )
    product = np.abs(rho * partner)
    return np.real(np.square(rho - partner)) / (4 * np.where(product > 0, product, 1.0))


def crosses_plus_one(multipliers: Array, error: Array) -> Array:
    """Return a mask (k,) that is True if a multiplier passes through +1 at the second of three neighbouring
    points.

    `multipliers` is (3, k, N), with absolute errors `error` (3, k). At the edge of an unstable range, a
    multiplier passes through +1 along the real axis. At an undamped resonance, it passes through +1 along the
    unit circle; a narrow unstable range may surround this resonance.
    """
    distance, modulus = np.abs(1 - multipliers), np.abs(multipliers)
    nearest = distance.argmin(axis=2)[..., None]
    distance, modulus = (np.take_along_axis(values, nearest, 2)[..., 0] for values in (distance, modulus))
    on_circle = (np.abs(modulus - 1) <= error + UNIT_CIRCLE)[::2].all(axis=0)
    # det(I - Φ) changes its sign where a multiplier passes through +1 along the real axis. The sign is
    # unknown where a multiplier equals +1 within its error.
    signs = np.sign([crossing_function(rho, 1)[:, 0] for rho in multipliers])
    side = np.where(distance > error, signs, 0.0)
    return (side[0] * side[2] < 0) | on_circle & (distance[1] < distance[::2].min(axis=0))


Evaluate = Callable[[Array], StabilitySamples]
"""Type of functions that evaluate the stability at points (k, v)."""


def evaluator(batch: Batch) -> Evaluate:
    """Return a function that evaluates the stability of points by solving them with a batch."""
    return partial(_solve, batch)


def _solve(batch: Batch, points: Array) -> StabilitySamples:
    with progress.subtask(POINTS, len(points)):
        return StabilitySamples.from_results(points, gathered(batch, points, _STABILITY))
