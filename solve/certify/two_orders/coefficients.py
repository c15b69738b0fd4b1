"""Variation of M, C, K and d over the period that the samples of a grid do not resolve."""

import itertools
import weakref
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Self

import numpy as np

from solve.arrays import Array
from solve.methods.collocation import Collocation, lagrange
from solve.period.grid import Grid
from solve.period.multipliers import EPS
from solve.period.points import Points, Tables

PHASES = 1001
"""Number of fixed phases at which coefficients are compared: odd, so that few coincide with the stages of a
grid. A feature that is narrower than the distance between all sampled phases may be missed."""

_MEMORY = 2**27
"""Bytes of coefficients that are compared at a time."""

_ROUND_OFF = 64 * EPS
"""Relative size of coefficients below which they are round-off of the function that gives them."""


class _OfTable:
    """Values computed from a table, which a model keeps, so that the next solutions need not repeat them."""

    def __init__(self, compute: Callable[..., Any]):
        self._compute = compute
        self._known: dict[tuple[int, ...], tuple[weakref.ref[Array], Any]] = {}

    def __call__(self, table: Array, *others: Any) -> Any:
        key = id(table), *map(id, others)
        known = self._known.get(key)
        if known is None or known[0]() is not table:
            if len(self._known) > _KEPT:
                self._known.clear()
            known = self._known[key] = weakref.ref(table), self._compute(table, *others)
        return known[1]


_KEPT = 64
"""Tables of which values are kept: more than a sweep uses."""


def harmonics(points: Points) -> Array:
    """Relative amplitudes (k,) of the harmonics 0, 1, … of the coefficients over the period.

    Each is the largest of all entries, relative to the largest harmonic of the entry. One point in many
    stands for all that share their terms. Systems with jumps have none but the mean: their harmonics decay
    too slowly.
    """
    if points.breaks:
        return np.ones(1)
    tables = points.tables(_fixed_phases(points.period))
    amplitudes = _amplitudes(tables.table) if not tables.own else _transformed(tables.table)
    if not tables.own:
        amplitudes = (amplitudes * np.abs(tables.coefficients).max(axis=0))[None]
    largest = np.zeros((len(amplitudes), int(tables.entry.max()) + 1))
    of_entries: Any = (slice(None), tables.entry)
    np.maximum.at(largest, of_entries, amplitudes.max(axis=-2))
    largest = np.where(largest > 0, largest, 1.0)
    found = (amplitudes / largest[:, None, tables.entry]).max(axis=(0, 2))
    return np.where(found > _ROUND_OFF, found, 0.0)


def _transformed(table: Array) -> Array:
    with np.errstate(over="ignore", invalid="ignore"):
        return np.abs(np.fft.rfft(table, axis=-2, norm="forward"))


_amplitudes = _OfTable(_transformed)


@lru_cache(maxsize=8)
def _fixed_phases(period: float) -> Array:
    return (np.arange(PHASES) + 0.5) * (period / PHASES)


@dataclass(frozen=True, eq=False)
class Phases:
    """Phases of the steps of a grid at which coefficients are sampled and compared.

    nodes (r,): fractions of a step, the stages of two methods; sampled (m, r): their phases. lower (s,) and
    higher (s + 1,): which of them are the stages of each method. compared (Q,), rising: further phases, the
    step of each, `step` (Q,), and the Lagrange polynomials of the nodes there, basis (Q, r). weights (Q, s):
    what a unit at a compared phase adds to the coefficients at the stages of the lower method.
    """

    sampled: Array
    lower: Array
    higher: Array
    compared: Array
    step: Array
    basis: Array
    weights: Array

    @classmethod
    def of(cls, grid: Grid, lower: Collocation, higher: Collocation) -> "Phases":
        """On a grid, for two methods of which the first gives the solution."""
        nodes, c = np.unique((*lower.c, *higher.c)), np.array(lower.c)
        fixed, every = _fixed_phases(grid.period), np.arange(grid.steps)
        ends = grid.stages(np.array([0.0, 1.0]))
        step = np.searchsorted(grid.nodes, fixed, side="right") - 1
        inside = (fixed > ends[step, 0]) & (fixed < ends[step, 1])
        compared = np.concatenate((fixed[inside], ends.T.ravel()))
        step = np.concatenate((step[inside], every, every))
        theta = np.clip((compared - grid.nodes[step]) / grid.h[step], 0.0, 1.0)
        order = np.lexsort((theta, step))
        compared, step, theta = compared[order], step[order], theta[order]
        weights = lagrange(c, theta) * (_trapezoidal(step, theta, nodes)[:, None] / lower.b)
        first, second = (np.searchsorted(nodes, each.c) for each in (lower, higher))
        return cls(grid.stages(nodes), first, second, compared, step, lagrange(nodes, theta), weights)

    def __len__(self) -> int:
        return len(self.sampled)

    def of_steps(self, first: int, end: int) -> "Phases":
        """Those of neighbouring steps."""
        some = slice(*np.searchsorted(self.step, (first, end)).tolist())
        inside = self.compared[some], self.step[some] - first
        sampled = self.sampled[first:end]
        return Phases(sampled, self.lower, self.higher, *inside, self.basis[some], self.weights[some])

    def relative_difference(self, points: Points) -> Array:
        """Largest difference (P,) of coefficients at the compared phases to their interpolation, relative to
        the largest coefficient of the same term."""
        size = 8 * (3 * points.n**2 + points.n) * (self.sampled.size + len(self.compared)) * _rows(points)
        parts = min(len(self), -(-size // _MEMORY))
        ends = np.linspace(0, len(self), parts + 1).astype(int).tolist()
        found = [self.of_steps(*some) if parts > 1 else self for some in itertools.pairwise(ends)]
        made = [part.differences(points)[1:] for part in found]
        differences, largest = (np.max(each, axis=0) for each in zip(*made, strict=True))
        relative = (differences / np.where(largest > 0, largest, 1.0)).max(axis=-1)
        return np.broadcast_to(relative, len(points))

    def differences(self, points: Points) -> tuple[Array, Array, Array]:
        """Coefficients at the compared phases less their interpolation (…, Q, R), the largest of these (…,
        R) and the largest coefficients (…, R)."""
        compared, sampled = points.tables(self.compared).table, points.tables(self.sampled.ravel()).table
        return (_known_differences if compared.ndim == 2 else _differences)(compared, sampled, self)

    def added(self, differences: Array) -> Array:
        """What the differences (…, Q, R) add to the coefficients at the stages (…, m s, R)."""
        m, s = len(self), len(self.lower)
        made = np.zeros((*differences.shape[:-2], m, s, differences.shape[-1]))
        parts = self.weights[:, :, None] * differences[..., :, None, :]
        of_steps: Any = (..., self.step, slice(None), slice(None))
        np.add.at(made, of_steps, parts)
        return made.reshape(*made.shape[:-3], m * s, -1)


def _rows(points: Points) -> int:
    return len(points) if points.bytes_a_phase else 1


def _differences(compared: Array, sampled: Array, phases: Phases) -> tuple[Array, Array, Array]:
    by_step = sampled.reshape(*sampled.shape[:-2], *phases.sampled.shape, sampled.shape[-1])
    found = compared.copy()
    for node, values in enumerate(phases.basis.T):
        found -= values[:, None] * by_step[..., phases.step, node, :]
    return found, np.abs(found).max(axis=-2), np.abs(sampled).max(axis=-2)


_known_differences = _OfTable(_differences)


class _Wrapped:
    """Points whose tables at the stages of a grid come in another way."""

    def __init__(self, points: Points, phases: Phases):
        self.points, self.phases = points, phases
        self.n, self.period, self.breaks = points.n, points.period, points.breaks
        self.bytes_a_phase, self.alone = points.bytes_a_phase, points.alone

    def __len__(self) -> int:
        return len(self.points)

    def __getitem__(self, positions: Array) -> Self:
        return type(self)(self.points[positions], self.phases)


class SharedSamples(_Wrapped):
    """Points sampled once for the stages of two methods."""

    def tables(self, phase: Array) -> Tables:
        m = len(self.phases)
        for chosen in (self.phases.lower, self.phases.higher):
            if len(phase) == m * len(chosen) and np.array_equal(
                phase, self.phases.sampled[:, chosen].ravel()
            ):
                tables = self.points.tables(self.phases.sampled.ravel())
                table = tables.table.reshape(*tables.table.shape[:-2], *self.phases.sampled.shape, -1)
                table = table[..., chosen, :].reshape(*table.shape[:-3], len(phase), -1)
                return Tables(table, tables.coefficients, tables.entry, tables.n)
        return self.points.tables(phase)


class Resampled(_Wrapped):
    """Points of which the coefficients at the stages of a grid take those at further phases into account.

    A collocation method weights the residual of a step by the Lagrange polynomials of its stages. The
    coefficients here are local averages with the same weights, so that a feature between two stages acts as
    its integral does; nothing changes where coefficients are polynomials of the degree that stages resolve.
    """

    def tables(self, phase: Array) -> Tables:
        tables, stages = self.points.tables(phase), self.phases.sampled[:, self.phases.lower]
        first, m = int(np.searchsorted(stages[:, 0], phase[0])), len(phase) // stages.shape[1]
        if not np.array_equal(phase, stages[first : first + m].ravel()):
            return tables
        phases = self.phases if m == len(stages) else self.phases.of_steps(first, first + m)
        table = tables.table + phases.added(phases.differences(self.points)[0])
        return Tables(table, tables.coefficients, tables.entry, tables.n)


def _trapezoidal(step: Array, theta: Array, nodes: Sequence[float] | Array) -> Array:
    """Weights (Q,) of the fractions θ (Q,) of steps (Q,), rising, among these and the nodes of the steps."""
    m = int(step[-1]) + 1
    owner = np.concatenate((step, np.repeat(np.arange(m), len(nodes))))
    fraction = np.concatenate((theta, np.tile(nodes, m)))
    order = np.lexsort((fraction, owner))
    gaps = np.where(np.diff(owner[order]) == 0, np.diff(fraction[order]), 0.0) / 2
    width = np.empty(len(order))
    width[order] = np.append(gaps, 0.0) + np.append(0.0, gaps)
    return width[: len(theta)]
