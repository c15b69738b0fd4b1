"""Batches of points, represented by samples of their coefficients over the phase. A point is a system at a
speed.

A point has 3n² + n entries: Ω²M, ΩC and K in row order, then d. Derivatives are with respect to the phase."""

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace

import numpy as np

from solve.arrays import Array, solved
from solve.contracts import Matrices
from solve.equations import used_entries_of
from solve.matrices import leading, split_entries
from solve.system import PeriodicSystem

_ENTRY_PHASES = 16
"""Approximate number of phases at which the sizes of entries are determined. Chosen by judgement."""


@dataclass(frozen=True)
class Tables:
    """Entries of M, C, K and d of P points at k phases, as sums of R terms.

    Attributes
    ----------
    table : (k, R) or (P, k, R)
        Values of the terms at the phases. They are shared by all points, or differ between points.
    coefficients : (P, R)
        Coefficients of the terms at each point.
    entry : (R,)
        Index of the entry to which each term belongs, in ascending order.
    n : int
        Number of coordinates.
    first_order : int
        Number of coordinates without second derivatives, which come last.
    """

    table: Array
    coefficients: Array
    entry: Array
    n: int
    first_order: int = 0

    @classmethod
    def from_entries(cls, entries: Array, n: int, first_order: int = 0) -> "Tables":
        """Tables of entries (P, k, 3n² + n) that are sampled for each point separately."""
        count = entries.shape[-1]
        return cls(entries, np.ones((len(entries), count)), np.arange(count), n, first_order)

    def __getitem__(self, points: Array) -> "Tables":
        """Tables of the selected points."""
        table = self.table[points] if self.per_point else self.table
        return Tables(table, self.coefficients[points], self.entry, self.n, self.first_order)

    def multiplied(self, factors: Array) -> "Tables":
        """Multiply the equations by factors (P, n)."""
        equation = np.concatenate((np.tile(np.repeat(np.arange(self.n), self.n), 3), np.arange(self.n)))
        return self.scaled(factors[:, equation])

    def scaled(self, factors: Array) -> "Tables":
        """Multiply the entries by factors (P, 3n² + n), or by the same factors (1, 3n² + n) for all
        points."""
        factors = factors[:, self.entry]
        if self.per_point:
            return replace(self, table=self.table * factors[:, None])
        return replace(self, coefficients=self.coefficients * factors)

    @property
    def per_point(self) -> bool:
        """Whether the terms differ between points."""
        return self.table.ndim == 3

    def fields(self) -> Array:
        """All entries, as an array (3n² + n, P, k)."""
        if self._is_entries:
            return np.ascontiguousarray(np.moveaxis(self.table, -1, 0))
        if len(self.coefficients) == 1 and not self.per_point:
            return (self._weights @ self.table.T)[:, None]
        fields = np.zeros((3 * self.n**2 + self.n, len(self.coefficients), self.table.shape[-2]))
        if self.per_point and (np.diff(self.entry) > 0).all() and (self.coefficients == 1).all():
            fields[self.entry] = np.moveaxis(self.table, -1, 0)
            return fields
        last = -1
        for term, entry in enumerate(self.entry.tolist()):
            factors = self.coefficients[:, term, None], self.table[..., term]
            if entry == last:
                fields[entry] += np.multiply(*factors)
            else:
                np.multiply(*factors, out=fields[entry])
            last = entry
        return fields

    def ranges(self) -> tuple[Array, Array]:
        """Lower and upper bounds (3n² + n, P) of the entries over the phases. They follow from the ranges of
        the shared terms."""
        low, high = self.table.min(axis=0), self.table.max(axis=0)
        bounds = np.zeros((2, 3 * self.n**2 + self.n, len(self.coefficients)))
        for term, entry in enumerate(self.entry.tolist()):
            factor = self.coefficients[:, term]
            bounds[0, entry] += np.minimum(factor * low[term], factor * high[term])
            bounds[1, entry] += np.maximum(factor * low[term], factor * high[term])
        return bounds[0], bounds[1]

    def entries(self) -> Array:
        """All entries, as an array (P, k, 3n² + n)."""
        if self._is_entries:
            return self.table
        if len(self.coefficients) == 1 and not self.per_point:
            return (self.table @ self._weights.T)[None]
        return np.moveaxis(self.fields(), 0, -1)

    @property
    def _weights(self) -> Array:
        """Matrix (3n² + n, R) that combines the terms into the entries of M, C, K and d at the first
        point."""
        every = np.arange(3 * self.n**2 + self.n)
        return np.where(every[:, None] == self.entry, self.coefficients[0], 0.0)

    @property
    def _is_entries(self) -> bool:
        """Whether the terms are the entries themselves, as in `from_entries`."""
        return self.per_point and len(self.entry) == self.table.shape[-1] == 3 * self.n**2 + self.n


def entry_phases(count: int) -> slice:
    """Return a slice that selects about `_ENTRY_PHASES` of `count` phases. The sizes of entries are evaluated
    at the selected phases."""
    return slice(None, None, max(1, count // _ENTRY_PHASES))


class Points(ABC):
    """Batch of P points with n coordinates. A batch has a period in phase, and breaks: the phases at which
    the matrices jump.

    first_order: number of coordinates without second derivatives. These coordinates come last. The state x =
    (q, q′) contains all n coordinates, and the rates of those with second derivatives.
    bytes_a_phase: bytes per point and phase of tables that are not shared. alone: whether this is a single
    point that is not part of a batch."""

    bytes_a_phase: int = 0
    alone: bool = False

    def __init__(self, n: int, period: float, breaks: tuple[float, ...] = (), first_order: int = 0):
        self.n, self.period, self.breaks, self.first_order = n, period, breaks, first_order

    @abstractmethod
    def __len__(self) -> int:
        """Number of points."""

    @abstractmethod
    def __getitem__(self, positions: Array) -> "Points":
        """Points with the indices `positions` (k,)."""

    @abstractmethod
    def tables(self, phase: Array) -> Tables:
        """Tables at phases (k,)."""


class SinglePoint(Points):
    """One system at one speed in rad/s."""

    alone = True

    def __init__(self, system: PeriodicSystem, speed: float):
        super().__init__(system.n, system.period, system.breaks, len(system.states))
        self.system, self.speed, self._evaluation = system, speed, system.capabilities.evaluation

    def __len__(self) -> int:
        return 1

    def __getitem__(self, positions: Array) -> "SinglePoint":
        return self

    def tables(self, phase: Array) -> Tables:
        speeds = np.array([self.speed])
        terms = None if self._evaluation is None else self._evaluation.terms(phase, speeds)
        if terms is None:
            entries, numbers = used_entries_of(self.system, phase, self.speed)
            return Tables(entries[None], np.ones((1, len(numbers))), numbers, self.n, self.first_order)
        return Tables(*terms, self.n, self.first_order)


class SpeedPoints(Points):
    """One system at speeds (P,) in rad/s. Its entries must be sums of terms that do not depend on the speed.
    The coefficients of the terms depend on the speed."""

    def __init__(self, system: PeriodicSystem, speeds: Array):
        super().__init__(system.n, system.period, system.breaks, len(system.states))
        self.system, self.speeds, self._evaluation = system, speeds, system.capabilities.evaluation

    def __len__(self) -> int:
        return len(self.speeds)

    def __getitem__(self, positions: Array) -> "SpeedPoints":
        return SpeedPoints(self.system, self.speeds[positions])

    def tables(self, phase: Array) -> Tables:
        assert self._evaluation is not None
        terms = self._evaluation.terms(phase, self.speeds)
        assert terms is not None
        return Tables(*terms, self.n, self.first_order)


class DerivedPoints(Points):
    """Base class of points whose tables are computed from the tables of other points."""

    def __init__(self, points: Points):
        super().__init__(points.n, points.period, points.breaks, points.first_order)
        self.points, self.alone, self.bytes_a_phase = points, points.alone, points.bytes_a_phase

    def __len__(self) -> int:
        return len(self.points)


class ScaledEquations(DerivedPoints):
    """Points whose equations are multiplied by factors (P, n). The factors do not change the solutions."""

    def __init__(self, points: Points, factors: Array):
        super().__init__(points)
        self.factors = factors

    def __getitem__(self, positions: Array) -> "ScaledEquations":
        return ScaledEquations(self.points[positions], self.factors[positions])

    def tables(self, phase: Array) -> Tables:
        return self.points.tables(phase).multiplied(self.factors)


class ScaledEntries(DerivedPoints):
    """Points whose entries are multiplied by factors (1, 3n² + n), the same for all points."""

    def __init__(self, points: Points, factors: Array):
        super().__init__(points)
        self.factors = factors

    def __getitem__(self, positions: Array) -> "ScaledEntries":
        return ScaledEntries(self.points[positions], self.factors)

    def tables(self, phase: Array) -> Tables:
        return self.points.tables(phase).scaled(self.factors)


def matrices(points: Points, phase: Array) -> Matrices:
    """Ω²M, ΩC, K (P, k, n, n) and d (P, k, n) at phases (k,)."""
    return split_entries(points.tables(phase).entries(), points.n)


def state_rate(points: Points, phase: Array) -> Array:
    """Matrices (A | f) (P, k, N, N+1) of x′ = A x + f for x = (q, dq/dphase), chapter Eq. (5). They contain
    NaN if M is singular."""
    return rate_of(*matrices(points, phase), points.first_order)


def rate_of(M: Array, C: Array, K: Array, d: Array, first_order: int = 0) -> Array:
    """Matrices (A | f) (…, N, N+1) as in `state_rate`, from M, C, K (…, n, n) and d (…, n), with N = 2n -
    first_order."""
    n = d.shape[-1]
    p = n - first_order
    rate = np.zeros((*d.shape[:-1], n + p, n + p + 1))
    rate[..., :p, n : n + p] = np.eye(p)
    highest = solved(leading(M, C, first_order), np.concatenate((-K, -C[..., :p], d[..., None]), axis=-1))
    rate[..., n:, :], rate[..., p:n, :] = highest[..., :p, :], highest[..., p:, :]
    return rate


def state_size(points: Points) -> int:
    """Number N of states: all coordinates, and the rates of the coordinates with second derivatives."""
    return 2 * points.n - points.first_order


def affine(maps: Array, x: Array) -> Array:
    """Apply maps (A | b) (…, k, N+1) to states x (…, N): A x + b (…, k)."""
    return np.squeeze(maps[..., :-1] @ x[..., None], -1) + maps[..., -1]
