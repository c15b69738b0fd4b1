"""Entries of M, C, K, d as short sums of products: functions of the phase times numbers of the point.

Speeds and most parameters enter the matrices apart from the phase: powers of Ω, masses, stiffnesses.
An entry is then a fixed combination of its own values at a few phases, so that a point needs samples
there alone. The phases are found by elimination with complete pivoting on samples of some of the points
(M. Barrault, Y. Maday, N. C. Nguyen, A. T. Patera, C. R. Math. 339 (2004) 667-672), and every point is
checked at further phases.
"""

from dataclasses import dataclass

import numpy as np

from solve.arrays import Array, across, covers_all
from solve.batch.family import Family
from solve.kernel.engines import NUMPY
from solve.period.grid import pieces
from solve.period.multipliers import EPS
from solve.period.points import Tables

_MOST_TERMS = 10
"""Terms an entry may have before sampling every point at every phase costs less."""

_TRAINING_POINTS, _TRAINING_PHASES = 16, 64
_NEGLIGIBLE = 4e-15
"""Part of an entry, relative to its largest value at the point, that is left out."""

_FITS = 1e-12
"""Relative error at the check phases up to which a point is represented."""

_MOST_KEPT = 2**26
"""Bytes that the tables kept for the next points may take together."""

_CHECKS = np.array([0.1357, 0.7311])
"""Where points are checked, in parts of each piece between two jumps."""

_LEAST_PHASES = 8
"""Training phases of a piece, however short."""


class Separation:
    """The terms of a family's entries, from samples at some points (T, v), see `training`.

    An entry's terms are nested: the j-th is 1 at its own phase and 0 at those of the terms before it, so
    that a small term costs no digits of the others.
    """

    def __init__(
        self,
        family: Family,
        points: Array,
        period: float,
        n: int,
        engine: str = NUMPY,
        breaks: tuple[float, ...] = (),
    ):
        self.family, self.period, self.n, self.engine, self.breaks = family, period, n, engine, breaks
        ends, _ = pieces(period, breaks)
        counts = np.maximum(_LEAST_PHASES, np.round(_TRAINING_PHASES * np.diff(ends) / period)).astype(int)
        self._checks = np.ravel(ends[:-1, None] + np.diff(ends)[:, None] * _CHECKS)
        self._kept: dict[bytes, Array] = {}
        self._points = points
        evenly = (
            (np.arange(k) + 0.5) * ((b - a) / k) + a for a, b, k in zip(ends, ends[1:], counts, strict=False)
        )
        phases = np.concatenate([*evenly])
        samples = family.entries(phases, self._points, engine)
        finite = np.isfinite(samples).all(axis=(1, 2))
        # Points without a system have NaN for entries.
        samples, self._points = samples[finite], self._points[finite]
        rows, columns, self._active = _pivots(samples)
        self.separable = len(samples) > 0 and len(rows) < _MOST_TERMS
        used, self._rows = _numbered(rows)
        taken, self._columns = _numbered(columns)
        self._points, self._taken = self._points[used], phases[taken]
        self._learn(samples[np.ix_(used, taken)])
        self.entry, self._stage = np.nonzero(self._active.T)

    def _learn(self, samples: Array) -> None:
        """What nests the terms: factors [j][i] (E,) of term i in row j, and terms [i] (T, E) at the phases
        of all terms, from samples (B, T, E)."""
        every = np.arange(samples.shape[2])
        self._factors, self._nested = [], []
        for stage, row in enumerate(self._rows):
            rest, factors = samples[row, :, every].T, []
            for before in range(stage):
                factors.append(rest[self._columns[before], every])
                rest = rest - factors[-1] * self._nested[before]
            factors.append(np.where(self._active[stage], rest[self._columns[stage], every], np.inf))
            self._factors.append(factors)
            self._nested.append(rest / factors[-1])

    def table(self, phase: Array) -> Array:
        """The terms (k, R) at phases (k,), kept in memory up to a limit, the latest ones."""
        key = phase.tobytes()
        if key not in self._kept:
            self._kept[key] = self._terms(phase)
            while len(self._kept) > 1 and sum(kept.nbytes for kept in self._kept.values()) > _MOST_KEPT:
                self._kept.pop(next(iter(self._kept)))
        return self._kept[key]

    def _terms(self, phase: Array) -> Array:
        samples, terms = self.family.entries(phase, self._points, self.engine), []
        every = np.arange(samples.shape[2])
        for row, (*factors, pivot) in zip(self._rows, self._factors, strict=True):
            rest = samples[row, :, every].T
            for factor, term in zip(factors, terms, strict=True):
                rest = rest - factor * term
            terms.append(rest / pivot)
        return np.ascontiguousarray(self._by_term(terms, len(phase)))

    def _by_term(self, stages: list[Array], count: int) -> Array:
        """Those of values (count, E) of each stage that belong to a term: (count, R)."""
        return np.array(stages).reshape(-1, count, len(self._active.T))[self._stage, :, self.entry].T

    def coefficients(self, points: Array) -> tuple[Array, Array]:
        """Coefficients (P, R), and whether each point is represented (P,)."""
        checks = self._checks
        samples = self.family.entries(np.concatenate((self._taken, checks)), points, self.engine)
        every, nested = np.arange(samples.shape[2]), []
        for stage, columns in enumerate(self._columns):
            rest = samples[:, columns, every]
            for before in range(stage):
                rest = rest - nested[before] * self._nested[before][columns, every]
            nested.append(rest)
        coefficients = self._by_term(nested, len(points))
        predicted = Tables(self.table(checks), coefficients, self.entry, self.n).entries()
        error = across(np.maximum, np.abs(samples[:, -len(checks) :] - predicted), 1)
        largest = across(np.maximum, np.abs(samples), 1)
        allowed = _FITS * largest
        if (error > allowed).any():
            allowed += EPS * _scales(largest, self.n)
        return coefficients, across(np.logical_and, (error <= allowed) & np.isfinite(largest))


@dataclass(frozen=True)
class Separated:
    """Points whose entries separate, by their coefficients (P, R)."""

    separation: Separation
    coefficients: Array
    bytes_a_phase: int = 0
    alone: bool = False

    @property
    def breaks(self) -> tuple[float, ...]:
        return self.separation.breaks

    @property
    def n(self) -> int:
        return self.separation.n

    @property
    def period(self) -> float:
        return self.separation.period

    def __len__(self) -> int:
        return len(self.coefficients)

    def __getitem__(self, positions: Array) -> "Separated":
        if covers_all(positions, len(self)):
            return self
        return Separated(self.separation, self.coefficients[positions])

    def tables(self, phase: Array) -> Tables:
        separation = self.separation
        return Tables(separation.table(phase), self.coefficients, separation.entry, separation.n)


@dataclass(frozen=True)
class Sampled:
    """Points (P, v) of a family that are sampled at every phase, each for itself."""

    family: Family
    points: Array
    engine: str = NUMPY
    breaks: tuple[float, ...] = ()
    alone: bool = False

    @property
    def n(self) -> int:
        return self.family.example.n

    @property
    def period(self) -> float:
        return self.family.example.period

    @property
    def bytes_a_phase(self) -> int:
        return 8 * (3 * self.n**2 + self.n)

    def __len__(self) -> int:
        return len(self.points)

    def __getitem__(self, positions: Array) -> "Sampled":
        return Sampled(self.family, self.points[positions], self.engine, self.breaks)

    def tables(self, phase: Array) -> Tables:
        return Tables.of(self.family.entries(phase, self.points, self.engine), self.n)


def training(points: Array) -> Array:
    """Some of the points, from which the terms are learnt: the extreme ones, and others all over."""
    extremes = [pick(column) for column in points.T for pick in (np.argmin, np.argmax)]
    others = np.linspace(0, len(points) - 1, _TRAINING_POINTS).astype(int)
    scattered = np.random.default_rng(0).integers(0, len(points), _TRAINING_POINTS)
    return points[np.unique([*extremes, *others, *scattered])]


def _scales(largest: Array, n: int) -> Array:
    """The largest entry of M, C, K or d (P, E) that each of theirs stands for in coordinates whose inertias
    are alike: that times the smallest unit of rounding is what sums that cancel leave of it."""
    units = np.sqrt(largest[:, : n * n : n + 1])
    both = (units[:, :, None] * units[:, None, :]).reshape(len(largest), -1)
    ends = np.arange(n * n, 3 * n * n + 1, n * n)
    scales = []
    for part, unit in zip(np.split(largest, ends, axis=1), (both, both, both, units), strict=True):
        with np.errstate(invalid="ignore"):
            alike = np.divide(part, unit, out=np.zeros_like(part), where=unit > 0)
        scales.append(alike.max(axis=1, keepdims=True) * unit)
    return np.concatenate(scales, axis=1)


def _pivots(samples: Array) -> tuple[Array, Array, Array]:
    """Rows and columns (J, E) of cross approximations of every entry of samples (T, k, E), and which of
    them count (J, E); each row is measured by its largest value."""
    size = np.abs(samples).max(axis=1, keepdims=True)
    rest = samples / np.where(size > 0, size, 1.0)
    T, k, E = samples.shape
    every, found = np.arange(E), []
    while T and len(found) < _MOST_TERMS:
        row, column = np.unravel_index(np.abs(rest).reshape(T * k, E).argmax(axis=0), (T, k))
        pivot = rest[row, column, every]
        counts = np.abs(pivot) > _NEGLIGIBLE
        if not counts.any():
            break
        found.append((row, column, counts))
        left, upper = rest[:, column, every], rest[row, :, every].T
        rest = rest - np.where(counts, left / np.where(counts, pivot, 1.0), 0.0)[:, None] * upper
    rows, columns, active = np.moveaxis(np.array(found, dtype=int).reshape(-1, 3, E), 1, 0)
    return rows, columns, active.astype(bool)


def _numbered(places: Array) -> tuple[Array, Array]:
    """The different ones among the places, and for each place its number among these."""
    used, number = np.unique(places, return_inverse=True)
    return used, number.reshape(places.shape)
