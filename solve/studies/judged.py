"""What is known of points of a family: whether they are stable, and how far they are from losing it."""

import itertools
from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import cached_property, partial

import numpy as np

from solve.arrays import Array
from solve.batch.batch import POINTS, Batch
from solve.batch.gathering import gathered
from solve.period.multipliers import UNIT_CIRCLE
from solve.results.points import Kept, PointResults, kinds_of
from solve.terminal import progress

_STABILITY = Kept(warnings=False, meetings=False)

_FAR = 1e6
NOISE = 1e-6
"""Distance from the unit circle up to which it is noise."""


@dataclass(frozen=True)
class Judged:
    """Points (k, v) and what is known of them: unstable (k,), that a multiplier lies outside the unit circle
    by more than its error; stable (k,), that none does; neither where the point failed or its errors leave
    that open. multipliers (k, N), falling in modulus."""

    points: Array
    stable: Array
    unstable: Array
    multipliers: Array

    @classmethod
    def of(cls, points: Array, results: PointResults) -> "Judged":
        failed, outside = results.failed, results.outside
        multipliers = np.where(failed[:, None], 0.0, results.multipliers)
        return cls(points, ~(failed | outside | results.undetermined), outside, multipliers)

    def __getitem__(self, some: Array) -> "Judged":
        chosen = Judged(*(part[some] for part in self._parts))
        if "gaps" in self.__dict__:
            chosen.__dict__["gaps"] = self.gaps[some]
        return chosen

    def __add__(self, other: "Judged") -> "Judged":
        if len(other.points) == 0:
            return self
        found = Judged(*map(np.concatenate, zip(self._parts, other._parts, strict=True)))
        if "gaps" in self.__dict__:
            found.__dict__["gaps"] = np.concatenate((self.gaps, other.gaps))
        return found

    def replaced(self, rows: Array, others: "Judged") -> "Judged":
        """The same with other points in some rows (k,)."""
        changed = [each.copy() for each in self._parts]
        for each, new in zip(changed, others._parts, strict=True):
            each[rows] = new
        return Judged(*changed)

    @property
    def _parts(self) -> tuple[Array, ...]:
        return tuple(getattr(self, each.name) for each in fields(self))

    @property
    def failed(self) -> Array:
        """Where nothing is known (k,)."""
        return ~(self.stable | self.unstable)

    @property
    def by_plus_one(self) -> "Judged":
        """The same where the gap of +1 alone counts and decides what is stable."""
        gap, known = self.gaps[:, 0], ~self.failed
        found = Judged(self.points, known & (gap > 0), known & (gap < 0), self.multipliers)
        found.__dict__["gaps"] = np.where(np.arange(self.gaps.shape[1]) == 0, self.gaps, _FAR)
        return found

    @property
    def kinds(self) -> Array:
        """Positions in KINDS (k,) of what the largest multiplier is."""
        return kinds_of(self.multipliers)

    @cached_property
    def margins(self) -> Array:
        """What falls through zero, smoothly, where points (k,) become unstable in one of the KINDS, (k, 4):
        det(I - Φ) for +1 and det(I + Φ) for -1, but negative wherever a multiplier is beyond; the distance of
        the largest multiplier from the unit circle; behind them, for pairs that meet on the circle, the
        square of their distance."""
        size = np.maximum(np.abs(self.multipliers[:, 0]), NOISE)
        leaving = np.where(size > 1 + NOISE, -np.square(size - 1 / size), self.gaps[:, 2])
        plus, minus = (np.abs(1 - sign * self.multipliers).prod(axis=1) for sign in (1, -1))
        signed = np.copysign(np.column_stack((plus, minus)), self.gaps[:, :2])
        return np.column_stack((signed, 1 - size, leaving))

    @cached_property
    def gaps(self) -> Array:
        """How far stable points (k,) are from each way to lose stability, (k, 4): the least of `passing` for
        +1 and for -1, the distance of two pairs squared, and that of a pair from the unit circle."""
        rho = np.ascontiguousarray(self.multipliers.T)
        upper = np.imag(rho) > 0
        pairs = np.full(rho.shape[1], _FAR)
        for one, other in itertools.combinations(range(len(rho)), 2):
            both = upper[one] & upper[other]
            if both.any():
                distance = np.abs(rho[one, both] - rho[other, both]) ** 2
                pairs[both] = np.minimum(pairs[both], distance)
        inside = 1 - np.abs(np.where(upper, rho, 0.0)).max(axis=0)
        inside = np.where(inside > NOISE, inside, _FAR)
        plus, minus = (passing(self.multipliers, sign)[:, 0] for sign in (1, -1))
        return np.clip(np.column_stack((plus, minus, pairs, inside)), -_FAR, _FAR)


def passing(multipliers: Array, sign: int) -> Array:
    """How far each pair of multipliers (k, N) is from +1, or from -1: (1 ∓ ρ)(1 ∓ ρ′), rising, (k, N / 2). It
    falls through zero, smoothly, where one of the two passes. Pairs are conjugate, or real ones of one sign,
    the largest with the smallest."""
    rho, order = sign * multipliers, np.arange(multipliers.shape[1])
    if len(order) == 2:
        return np.real((1 - rho[:, :1]) * (1 - rho[:, 1:]))
    real = np.imag(rho) == 0
    negative, every = ((real & (np.real(rho) < least)).sum(axis=1)[:, None] for least in (0, np.inf))
    sorted_ = np.sort(np.where(real, np.real(rho), np.nan), axis=1)
    partner = np.where(order < negative, negative, negative + every) - 1 - order
    # Of an odd number the one in the middle is left alone.
    other = np.take_along_axis(sorted_, np.clip(partner, 0, order[-1]), axis=1) * (partner != order)
    met = np.where(order < every, (1 - sorted_) * (1 - other), np.nan)
    turning = np.where(real, np.nan, np.square(np.abs(1 - rho)))
    return np.sort(np.concatenate((met, turning), axis=1), axis=1)[:, : len(order) : 2]


def met(multipliers: Array, leads: Array) -> Array:
    """Distance from coalescence (k,) of multipliers (k, N) at positions `leads` (k,) and their partners (k,):
    the square of half their difference divided by their product. It is negative for conjugate pairs, positive
    for real ones, and passes smoothly through zero where they meet on the real axis."""
    every = np.arange(len(leads))
    rho = multipliers[every, leads]
    apart = np.where(np.imag(multipliers) == 0, np.abs(multipliers - rho[:, None]), np.inf)
    apart[every, leads] = np.inf
    partner = multipliers[every, apart.argmin(axis=1)]
    partner = np.where(
        np.imag(rho) != 0, np.conj(rho), np.where(np.isfinite(apart.min(axis=1)), partner, rho)
    )
    product = np.abs(rho * partner)
    return np.real(np.square(rho - partner)) / (4 * np.where(product > 0, product, 1.0))


def passes_one(multipliers: Array, error: Array) -> Array:
    """Whether a multiplier passes +1 (k,) at the second of three neighbouring points.

    multipliers (3, k, N) with absolute errors (3, k). It passes along the real axis at the edge of an
    unstable range. It passes along the unit circle at an undamped resonance, with or without a narrow
    unstable range around it.
    """
    off, modulus = np.abs(1 - multipliers), np.abs(multipliers)
    least = off.argmin(axis=2)[..., None]
    size, modulus = (np.take_along_axis(each, least, 2)[..., 0] for each in (off, modulus))
    on_circle = (np.abs(modulus - 1) <= error + UNIT_CIRCLE)[::2].all(axis=0)
    # det(I - Φ) changes its sign where a multiplier passes +1 along the real axis; the sign is unknown where
    # a multiplier is +1 within its error.
    signs = np.sign([passing(each, 1)[:, 0] for each in multipliers])
    side = np.where(size > error, signs, 0.0)
    return (side[0] * side[2] < 0) | on_circle & (size[1] < size[::2].min(axis=0))


Judge = Callable[[Array], Judged]
"""From points (k, v) to what is known of them."""


def judge(batch: Batch) -> Judge:
    """The judge that solves."""
    return partial(_solved, batch)


def _solved(batch: Batch, points: Array) -> Judged:
    with progress.subtask(POINTS, len(points)):
        return Judged.of(points, gathered(batch, points, _STABILITY))
