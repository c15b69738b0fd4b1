"""Separation of the entries of M, C, K, d into short sums of terms. Each term is a function of the phase with
a coefficient that depends on the point.

The speed and most parameters, for example masses and stiffnesses, are factors of functions of the phase. An
entry at any phase is then a fixed linear combination of its values at a few phases, and a point is sampled at
these phases only. The phases are selected by elimination with complete pivoting, from samples of some points
(M. Barrault, Y. Maday, N. C. Nguyen, A. T. Patera, C. R. Math. 339 (2004) 667-672). Every point is checked at
further phases."""

import numpy as np

from solve.arrays import EPS, ROUND_OFF, Array, across, covers_all
from solve.batch.family import Family, representative
from solve.kernel.engines import NUMPY
from solve.period.grid import pieces
from solve.period.points import Points, Tables

_MAX_TERMS = 10
"""Number of terms per entry above which entries are not separated, and every point is sampled at every phase.
Chosen by judgement."""

_TRAINING_POINTS, _TRAINING_PHASES = 16, 64
"""Number of points and number of phases from which the terms are computed. Chosen by judgement."""

_NEGLIGIBLE = 4e-15
"""Pivot, relative to the largest value of the entry, below which terms are omitted as round-off."""

_CACHE_BYTES = 2**26
"""Memory limit of cached tables in bytes. Chosen by judgement."""

_CHECKS = np.array([0.1357, 0.7311])
"""Phases, as fractions of each piece between two breaks, at which it is checked whether the terms represent a
point. Chosen by judgement."""

_MIN_PHASES = 8
"""Minimum number of training phases per piece. Chosen by judgement."""


class Separation:
    """Terms of the entries of a family, computed from samples at points (T, v); see `training`.

    Each term of an entry has a phase. The term is 1 at this phase, and 0 at the phases of previous terms.
    Therefore, a small term does not reduce the accuracy of the others."""

    def __init__(
        self,
        family: Family,
        points: Array,
        engine: str = NUMPY,
        breaks: tuple[float, ...] = (),
    ):
        self.family, self.engine, self.breaks = family, engine, breaks
        system = family.example
        self.period, self.n, self.first_order = system.period, system.n, len(system.states)
        ends, _ = pieces(self.period, breaks)
        counts = np.maximum(_MIN_PHASES, np.round(_TRAINING_PHASES * np.diff(ends) / self.period)).astype(int)
        self._checks = np.ravel(ends[:-1, None] + np.diff(ends)[:, None] * _CHECKS)
        self._cache: dict[bytes, Array] = {}
        self._points = points
        by_piece = (
            (np.arange(k) + 0.5) * ((b - a) / k) + a for a, b, k in zip(ends, ends[1:], counts, strict=False)
        )
        phases = np.concatenate([*by_piece])
        samples = family.entries(phases, self._points, engine)
        finite = np.isfinite(samples).all(axis=(1, 2))
        # Entries are NaN at points without a system.
        samples, self._points = samples[finite], self._points[finite]
        verified = representative(self._points)
        rows, columns, self._active = _pivots(samples)
        self.separable = len(samples) > 0 and len(rows) < _MAX_TERMS
        row_index, self._rows = _numbered(rows)
        column_index, self._columns = _numbered(columns)
        self._points, self._phases = self._points[row_index], phases[column_index]
        self._compute_terms(samples[np.ix_(row_index, column_index)])
        self.entry, self._stage = np.nonzero(self._active.T)
        self.separable = self.separable and self._represents_every_phase(verified)

    def _compute_terms(self, samples: Array) -> None:
        """Compute the terms by elimination from samples (B, T, E). Store the values `_nested[i]` (T, E) of
        term i, and its coefficients `_factors[j][i]` (E,) in the row that is eliminated at stage j."""
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

    def _represents_every_phase(self, points: Array) -> bool:
        """Whether the terms represent the matrices of points (P, v) at all phases at which the error estimate
        of a single point compares coefficients. No term represents a feature between the training phases."""
        coefficients, is_represented = self.coefficients(points)
        points, coefficients = points[is_represented], coefficients[is_represented]
        errors, largest = [], []
        for phases, samples in self.family.compared_entries(points, self.engine):
            predicted = Tables(self._terms(phases), coefficients, self.entry, self.n, self.first_order)
            errors.append(across(np.maximum, np.abs(samples - predicted.entries()), 1))
            largest.append(across(np.maximum, np.abs(samples), 1))
        return bool(_are_represented(np.max(errors, axis=0), np.max(largest, axis=0), self.n).all())

    def table(self, phase: Array) -> Array:
        """Values (k, R) of the terms at phases (k,). The most recent results are cached, up to a memory
        limit."""
        key = phase.tobytes()
        if key not in self._cache:
            self._cache[key] = self._terms(phase)
            while len(self._cache) > 1 and sum(t.nbytes for t in self._cache.values()) > _CACHE_BYTES:
                self._cache.pop(next(iter(self._cache)))
        return self._cache[key]

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
        """Return values (count, R) of all terms. `stages` contains one array (count, E) for each stage of the
        elimination."""
        return np.array(stages).reshape(-1, count, len(self._active.T))[self._stage, :, self.entry].T

    def tables(self, phase: Array, coefficients: Array) -> Tables:
        """Tables at phases (k,) of points with coefficients (P, R)."""
        return Tables(self.table(phase), coefficients, self.entry, self.n, self.first_order)

    def coefficients(self, points: Array) -> tuple[Array, Array]:
        """Return the coefficients (P, R) of points, and a mask (P,) of the points that the terms
        represent."""
        checks = self._checks
        samples = self.family.entries(np.concatenate((self._phases, checks)), points, self.engine)
        every, nested = np.arange(samples.shape[2]), []
        for stage, columns in enumerate(self._columns):
            rest = samples[:, columns, every]
            for before in range(stage):
                rest = rest - nested[before] * self._nested[before][columns, every]
            nested.append(rest)
        coefficients = self._by_term(nested, len(points))
        predicted = self.tables(checks, coefficients).entries()
        error = across(np.maximum, np.abs(samples[:, -len(checks) :] - predicted), 1)
        largest = across(np.maximum, np.abs(samples), 1)
        return coefficients, _are_represented(error, largest, self.n)


class Separated(Points):
    """Points whose matrix entries are sums of R products of a coefficient and a function of the phase. The
    coefficients (P, R) have one row per point."""

    def __init__(self, separation: Separation, coefficients: Array):
        super().__init__(separation.n, separation.period, separation.breaks, separation.first_order)
        self.separation, self.coefficients = separation, coefficients

    def __len__(self) -> int:
        return len(self.coefficients)

    def __getitem__(self, positions: Array) -> "Separated":
        if covers_all(positions, len(self)):
            return self
        return Separated(self.separation, self.coefficients[positions])

    def tables(self, phase: Array) -> Tables:
        """Tables of the terms at phases (k,)."""
        return self.separation.tables(phase, self.coefficients)


class Sampled(Points):
    """Points (P, v) of a family whose entries are sampled separately at every phase."""

    def __init__(self, family: Family, points: Array, engine: str = NUMPY, breaks: tuple[float, ...] = ()):
        system = family.example
        super().__init__(system.n, system.period, breaks, len(system.states))
        self.family, self.points, self.engine = family, points, engine
        self.bytes_a_phase = 8 * (3 * self.n**2 + self.n)

    def __len__(self) -> int:
        return len(self.points)

    def __getitem__(self, positions: Array) -> "Sampled":
        return Sampled(self.family, self.points[positions], self.engine, self.breaks)

    def tables(self, phase: Array) -> Tables:
        """Tables of the entries at phases (k,)."""
        return Tables.from_entries(
            self.family.entries(phase, self.points, self.engine), self.n, self.first_order
        )


def training(points: Array) -> Array:
    """Points from which the terms are computed: points at the ends of the ranges, equidistant points, and
    random points."""
    extremes = [pick(column) for column in points.T for pick in (np.argmin, np.argmax)]
    equidistant = np.linspace(0, len(points) - 1, _TRAINING_POINTS).astype(int)
    random = np.random.default_rng(0).integers(0, len(points), _TRAINING_POINTS)
    return points[np.unique([*extremes, *equidistant, *random])]


def _are_represented(error: Array, largest: Array, n: int) -> Array:
    """Return a mask (P,) of the points at which all errors are round-off. `error` (P, E) contains the largest
    errors of the entries, `largest` (P, E) their largest values."""
    allowed = ROUND_OFF * largest
    if (error > allowed).any():
        allowed += EPS * _scales(largest, n)
    return across(np.logical_and, (error <= allowed) & np.isfinite(largest))


def _scales(largest: Array, n: int) -> Array:
    """Sizes (P, E) to which the round-off of the entries is proportional.

    The size for an entry is the largest entry of its matrix M, C, K or d, in units in which the diagonal of M
    is 1. It is converted to the unit of the entry."""
    units = np.sqrt(largest[:, : n * n : n + 1])
    both = (units[:, :, None] * units[:, None, :]).reshape(len(largest), -1)
    ends = np.arange(n * n, 3 * n * n + 1, n * n)
    scales = []
    for matrix, unit in zip(np.split(largest, ends, axis=1), (both, both, both, units), strict=True):
        with np.errstate(invalid="ignore"):
            scaled = np.divide(matrix, unit, out=np.zeros_like(matrix), where=unit > 0)
        scales.append(scaled.max(axis=1, keepdims=True) * unit)
    return np.concatenate(scales, axis=1)


def _pivots(samples: Array) -> tuple[Array, Array, Array]:
    """Select pivots of a cross approximation for every entry of `samples` (T, k, E). Return their rows (J, E)
    and columns (J, E), and a mask (J, E) of the significant pivots. Samples are relative to the largest value
    of each row."""
    size = np.abs(samples).max(axis=1, keepdims=True)
    rest = samples / np.where(size > 0, size, 1.0)
    T, k, E = samples.shape
    every, pivots = np.arange(E), []
    while T and len(pivots) < _MAX_TERMS:
        row, column = np.unravel_index(np.abs(rest).reshape(T * k, E).argmax(axis=0), (T, k))
        pivot = rest[row, column, every]
        counts = np.abs(pivot) > _NEGLIGIBLE
        if not counts.any():
            break
        pivots.append((row, column, counts))
        left, upper = rest[:, column, every], rest[row, :, every].T
        rest = rest - np.where(counts, left / np.where(counts, pivot, 1.0), 0.0)[:, None] * upper
    rows, columns, active = np.moveaxis(np.array(pivots, dtype=int).reshape(-1, 3, E), 1, 0)
    return rows, columns, active.astype(bool)


def _numbered(rows: Array) -> tuple[Array, Array]:
    """Return the unique numbers in `rows`, and for each row its index among them."""
    unique, number = np.unique(rows, return_inverse=True)
    return unique, number.reshape(rows.shape)
