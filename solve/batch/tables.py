"""Entries of M, C, K, d as short sums of products: functions of the phase times numbers of the point.

Speeds and most parameters enter the matrices apart from the phase: powers of Ω, masses, stiffnesses.
An entry is then a fixed combination of its own values at a few phases, so that a point needs samples
there alone. The phases are found by elimination with complete pivoting on samples of some of the points
(M. Barrault, Y. Maday, N. C. Nguyen, A. T. Patera, C. R. Math. 339 (2004) 667-672), and every point is
checked at further phases.
"""

from collections.abc import Hashable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from solve.arrays import Array
from solve.batch.family import Family

_MOST_TERMS = 10
"""Terms an entry may have before sampling every point at every phase costs less."""

_TRAINING_POINTS, _TRAINING_PHASES = 16, 64
_NEGLIGIBLE = 4e-15
"""Part of an entry, relative to its largest value at the point, that is left out."""

_FITS = 1e-12
"""Relative error at the check phases up to which a point is represented."""

_MOST_KEPT = 2**22
"""Bytes of tables up to which they are kept."""

_CHECKS = np.array([0.1357, 0.7311])
"""Where points are checked, in periods."""


@dataclass(frozen=True)
class Tables:
    """R terms at k phases: table (k, R), the same for all points, or (P, k, R) with coefficients of 1;
    entry (R,): to which entry of (Ω²M, ΩC, K, d), flattened, each term belongs; n coordinates."""

    table: Array
    entry: Array
    n: int

    def fields(self, coefficients: Array) -> Array:
        """All entries as fields over points and phases (3n² + n, P, k), for coefficients (P, R)."""
        found = np.zeros((3 * self.n**2 + self.n, len(coefficients), self.table.shape[-2]))
        for term, entry in enumerate(self.entry):
            found[entry] += coefficients[:, term, None] * self.table[..., term]
        return found

    def entries(self, coefficients: Array) -> Array:
        """The same as (P, k, 3n² + n)."""
        return np.moveaxis(self.fields(coefficients), 0, -1)


class Separation:
    """The terms of a family's entries, from samples at some of the points."""

    def __init__(self, family: Family, points: Array, period: float, n: int):
        self.family, self.period, self.n = family, period, n
        self._kept: dict[Hashable, Tables] = {}
        self._points = _spread(points)
        self._phases = (np.arange(_TRAINING_PHASES) + 0.5) * (period / _TRAINING_PHASES)
        samples = family.entries(self._phases, self._points)
        size = np.abs(samples).max(axis=1, keepdims=True)
        scaled = samples / np.where(size > 0, size, 1.0)
        entries, rows, columns, groups = [], [], [], []
        self.separable = bool(np.isfinite(samples).all())
        for entry in range(samples.shape[2]):
            pivots = _pivots(scaled[:, :, entry])
            self.separable &= len(pivots) < _MOST_TERMS
            groups.append(np.arange(len(entries), len(entries) + len(pivots)))
            entries += [entry] * len(pivots)
            rows += [row for row, _ in pivots]
            columns += [column for _, column in pivots]
        self.entry = np.array(entries, dtype=int)
        self._groups = [group for group in groups if len(group)]
        used, self._row = np.unique(rows, return_inverse=True)
        self._basis_points = self._points[used] if len(used) else self._points[:1]
        taken, self._column = np.unique(columns, return_inverse=True)
        self._taken = self._phases[taken]
        self._cardinal = [self._inverse(group, samples[np.ix_(used, taken)]) for group in self._groups]

    def _inverse(self, group: Array, basis: Array) -> Array:
        entry = self.entry[group[0]]
        return np.linalg.inv(basis[np.ix_(self._row[group], self._column[group], [entry])][..., 0])

    def tables(self, phase: Array) -> Tables:
        """At phases (k,): each term is 1 at its own phase and 0 at those of the entry's other terms."""
        samples = self.family.entries(phase, self._basis_points)
        table = np.empty((len(phase), len(self.entry)))
        for group, inverse in zip(self._groups, self._cardinal, strict=True):
            table[:, group] = samples[self._row[group], :, self.entry[group[0]]].T @ inverse.T
        return Tables(table, self.entry, self.n)

    def cached(self, key: Hashable, phase: Array) -> Tables:
        """The same, kept for the next time that the key is given."""
        if key not in self._kept:
            made = self.tables(phase)
            if made.table.nbytes > _MOST_KEPT:
                return made
            self._kept[key] = made
        return self._kept[key]

    def coefficients(self, points: Array) -> tuple[Array, Array]:
        """Coefficients (P, R), and whether each point is represented (P,)."""
        checks = _CHECKS * self.period
        samples = self.family.entries(np.concatenate((self._taken, checks)), points)
        coefficients = samples[:, self._column, self.entry]
        predicted = self.tables(checks).entries(coefficients)
        error = np.abs(samples[:, -len(checks) :] - predicted).max(axis=1)
        fits = error <= _FITS * np.abs(samples).max(axis=1)
        return coefficients, fits.all(axis=1) & np.isfinite(samples).all(axis=(1, 2))


class Chunk(Protocol):
    """Some points of a family, and their entries at any phases."""

    points: Array
    n: int
    period: float

    def tables(self, key: Hashable, phase: Array, positions: Array) -> tuple[Tables, Array]:
        """Tables at the phases and coefficients of the points at the positions (p,); equal keys stand for
        equal phases."""
        ...


class Separated:
    """Points whose entries separate."""

    def __init__(self, separation: Separation, points: Array, coefficients: Array):
        self.points, self.n, self.period = points, separation.n, separation.period
        self._separation, self._coefficients = separation, coefficients

    def tables(self, key: Hashable, phase: Array, positions: Array) -> tuple[Tables, Array]:
        return self._separation.cached(key, phase), self._coefficients[positions]


class Sampled:
    """Points that are sampled at every phase, each for itself."""

    def __init__(self, family: Family, points: Array, n: int, period: float):
        self.points, self.n, self.period = points, n, period
        self._family = family

    def tables(self, key: Hashable, phase: Array, positions: Array) -> tuple[Tables, Array]:
        entry = np.arange(3 * self.n**2 + self.n)
        table = self._family.entries(phase, self.points[positions])
        return Tables(table, entry, self.n), np.ones((len(positions), len(entry)))


def _spread(points: Array) -> Array:
    """Some of the points: the extreme ones, and others all over."""
    extremes = [pick(column) for column in points.T for pick in (np.argmin, np.argmax)]
    others = np.linspace(0, len(points) - 1, _TRAINING_POINTS).astype(int)
    scattered = np.random.default_rng(0).integers(0, len(points), _TRAINING_POINTS)
    return points[np.unique([*extremes, *others, *scattered])]


def _pivots(samples: Array) -> list[tuple[int, int]]:
    """Rows and columns of a cross approximation of samples (T, k), rows of size 1."""
    rest, pivots = samples.copy(), []
    while len(pivots) < _MOST_TERMS:
        row, column = np.unravel_index(np.argmax(np.abs(rest)), rest.shape)
        pivot = rest[row, column]
        if not abs(pivot) > _NEGLIGIBLE:
            break
        pivots.append((int(row), int(column)))
        rest = rest - np.outer(rest[:, column], rest[row]) / pivot
    return pivots
