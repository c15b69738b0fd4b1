"""Variation of M, C, K and d over the period that the samples of a grid do not resolve."""

import itertools
import weakref
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from solve.arrays import Array
from solve.methods.collocation import Collocation, lagrange
from solve.period.grid import Grid
from solve.period.multipliers import EPS
from solve.period.points import Points, Tables

PHASES = 1001
"""Number of fixed phases at which coefficients are compared: odd, so that few coincide with the stages of a
grid. A feature that is narrower than the distance between all sampled phases may be missed."""

_LEAST_PHASES = 64
"""Fewest phases from which harmonics are computed, however many coordinates there are."""

_MEMORY = 2**27
"""Bytes of the coefficients that are compared, or whose harmonics are computed, at a time."""

_INSIDE = 1e-9
"""Fraction of the period by which the last compared phase lies before the end of the period."""

_ROUND_OFF = 64 * EPS
"""Relative size of coefficients below which they are round-off of the function that computes them."""


class _OfArrays:
    """Cache of values computed from arrays that are kept elsewhere, as long as the first of these exists."""

    def __init__(self, compute: Callable[..., Any]):
        self._compute = compute
        self._known: dict[tuple[int, ...], tuple[list[weakref.ref[Any]], Any]] = {}

    def __call__(self, *arrays: Any) -> Any:
        key = tuple(map(id, arrays))
        references, value = self._known.get(key, ([], None))
        if not references or any(each() is not one for each, one in zip(references, arrays, strict=True)):
            value = self._compute(*arrays)
            first = weakref.ref(arrays[0], lambda _: self._known.pop(key, None))
            self._known[key] = [first, *map(weakref.ref, arrays[1:])], value
        return value


def harmonics(points: Points, loads: bool) -> Array:
    """Relative amplitudes (P, k) of the harmonics 0, 1, … of the coefficients, 0 if they are round-off.

    Each is the maximum over all entries, with or without the `loads`, relative to the largest harmonic of the
    entry. For systems with jumps only the mean is returned, since their harmonics decay too slowly.
    """
    if points.breaks:
        return np.ones((len(points), 1))
    count = min(PHASES, max(_LEAST_PHASES, _MEMORY // (8 * (3 * points.n**2 + points.n))) | 1)
    tables = points.tables(_fixed_phases(points.period, count))
    spectrum = _spectrum(tables.table) if tables.own else _known_spectrum(tables.table)
    terms = tables.entry < (3 * points.n**2 + points.n if loads else 3 * points.n**2)
    entries, starts = np.unique(tables.entry[terms], return_index=True)
    found = np.empty((len(points), spectrum.shape[-2]))
    most = max(1, _MEMORY // (16 * spectrum.shape[-2] * len(tables.entry)))
    for some in (slice(first, first + most) for first in range(0, len(points), most)):
        of_terms = (spectrum[some] if tables.own else spectrum) * tables.coefficients[some, None]
        amplitudes = np.abs(np.add.reduceat(of_terms[..., terms], starts, axis=-1))
        largest = amplitudes.max(axis=1)
        amplitudes[amplitudes <= _ROUND_OFF * _sizes(largest, entries, points.n)[:, None]] = 0.0
        found[some] = (amplitudes / np.where(largest > 0, largest, 1.0)[:, None]).max(axis=-1)
    return found


def _sizes(largest: Array, entries: Array, n: int) -> Array:
    """Sizes (P, E) to which the round-off of entries with the `largest` values (P, E) is relative.

    An entry that vanishes in exact arithmetic, a sum of products, has the round-off of its terms. These are
    bounded by the diagonals as in a positive definite matrix: |X_ij| ≤ (X_ii X_jj)^½, and a load d_i by
    max_j |d_j| (D_ii / D_jj)^½ with the largest diagonal of M, C and K. entries (E,): numbers of the entries.
    """
    full = np.zeros((len(largest), 3 * n**2 + n))
    full[:, entries] = largest
    matrices, loads = full[:, :-n].reshape(-1, 3, n, n), full[:, -n:]
    roots = np.sqrt(np.einsum("pkii->pki", matrices))
    of_matrices = (roots[..., None] * roots[:, :, None]).reshape(len(largest), -1)
    root = roots.max(axis=1)
    known = root > 0
    most = np.where(known, loads / np.where(known, root, 1.0), 0.0).max(axis=1, keepdims=True)
    return np.maximum(largest, np.concatenate((of_matrices, most * root), axis=1)[:, entries])


def _spectrum(table: Array) -> Array:
    """Harmonics (…, k, R) of the terms of a table, up to the last that is not round-off."""
    with np.errstate(over="ignore", invalid="ignore"):
        made = np.fft.rfft(table, axis=-2, norm="forward")
        size = np.abs(made)
        size = (size > _ROUND_OFF * size.max(axis=-2, keepdims=True)).reshape(-1, *made.shape[-2:])
    return made[..., : int(np.flatnonzero(size.any(axis=(0, 2))).max(initial=0)) + 1, :]


_known_spectrum = _OfArrays(_spectrum)


@lru_cache(maxsize=8)
def _fixed_phases(period: float, count: int) -> Array:
    return (np.arange(count) + 0.5) * (period / count)


@dataclass(frozen=True, eq=False)
class Phases:
    """Phases of the steps of a grid at which coefficients are sampled and compared.

    lower (m, s) and higher (m, s + 1): stages of two methods. compared (Q,), rising: further phases, of which
    each is number `place` (Q,) in its step, `step` (Q,). of_lower (m, c, s) and of_higher (m, c, s + 1):
    Lagrange polynomials of all stages at the phases of each step, at most c. weights (Q, s): increments of
    the coefficients at the stages of the lower method per unit difference at a compared phase."""

    lower: Array
    higher: Array
    compared: Array
    step: Array
    place: Array
    of_lower: Array
    of_higher: Array
    weights: Array

    @classmethod
    def of(cls, grid: Grid, lower: Collocation, higher: Collocation) -> "Phases":
        """On a grid, for two methods of which the first gives the solution."""
        c = np.array(lower.c), np.array(higher.c)
        nodes = np.union1d(*c)
        fixed, every = _fixed_phases(grid.period, PHASES), np.arange(grid.steps)
        ends = grid.stages(np.array([0.0, 1.0]))
        step = np.searchsorted(grid.nodes, fixed, side="right") - 1
        inside = (fixed > ends[step, 0]) & (fixed < ends[step, 1])
        # The last end is not that of the next period, whose coefficients may jump.
        ends = np.minimum(ends, grid.period * (1 - _INSIDE))
        compared = np.concatenate((fixed[inside], ends.T.ravel()))
        step = np.concatenate((step[inside], every, every))
        theta = np.clip((compared - grid.nodes[step]) / grid.h[step], 0.0, 1.0)
        order = np.lexsort((theta, step))
        compared, step, theta = compared[order], step[order], theta[order]
        weights = lagrange(c[0], theta) * (_trapezoidal(step, theta, nodes)[:, None] / lower.b)
        basis = lagrange(nodes, theta)
        place = np.arange(len(step)) - np.searchsorted(step, step)
        of_lower, of_higher = (np.zeros((grid.steps, place.max() + 1, len(each))) for each in c)
        of_lower[step, place] = basis[:, np.searchsorted(nodes, c[0])]
        # A node of both methods counts once.
        of_higher[step, place] = basis[:, np.searchsorted(nodes, c[1])] * ~np.isin(c[1], c[0])
        stages = grid.stages(c[0]), grid.stages(c[1])
        return cls(*stages, compared, step, place, of_lower, of_higher, weights)

    def __len__(self) -> int:
        return len(self.lower)

    def of_steps(self, first: int, end: int) -> "Phases":
        """Those of neighbouring steps."""
        some = slice(*np.searchsorted(self.step, (first, end)).tolist())
        steps = slice(first, end)
        return Phases(
            self.lower[steps],
            self.higher[steps],
            self.compared[some],
            self.step[some] - first,
            self.place[some],
            self.of_lower[steps],
            self.of_higher[steps],
            self.weights[some],
        )

    def relative_difference(self, points: Points, round_off: float) -> Array:
        """Largest difference (P,) of entries at the compared phases from their interpolation, relative to the
        largest value of the entry; 0 where it is round-off. round_off: relative to the sizes of entries."""
        size = 8 * (3 * points.n**2 + points.n) * _rows(points)
        size *= self.lower.size + self.higher.size + len(self.compared)
        parts = min(len(self), -(-size // _MEMORY))
        ends = np.linspace(0, len(self), parts + 1).astype(int).tolist()
        found = [self.of_steps(*some) if parts > 1 else self for some in itertools.pairwise(ends)]
        made = [part.differences(points)[1:] for part in found]
        differences, largest = (np.max(each, axis=0) for each in zip(*made, strict=True))
        terms = points.tables(self.compared[:1])
        entries, starts = np.unique(terms.entry, return_index=True)
        weights = np.abs(terms.coefficients)
        differences = np.add.reduceat(weights * differences, starts, axis=-1)
        largest = np.maximum.reduceat(weights * largest, starts, axis=-1)
        visible = differences > round_off * _sizes(largest, entries, points.n)
        relative = differences / np.where(largest > 0, largest, 1.0)
        return np.asarray(np.where(visible, relative, 0.0).max(axis=-1))

    def differences(self, points: Points) -> tuple[Array, Array, Array]:
        """Differences (…, Q, R) of coefficients at the compared phases from their interpolation, the largest
        differences (…, R) and the largest coefficients (…, R)."""
        compared, lower, higher = (
            points.tables(phase.ravel()).table for phase in (self.compared, self.lower, self.higher)
        )
        return (_known_differences if compared.ndim == 2 else _differences)(compared, lower, higher, self)

    def added(self, differences: Array) -> Array:
        """Increments (…, m s, R) of the coefficients at the stages due to the differences (…, Q, R)."""
        m, s = self.lower.shape
        made = np.zeros((*differences.shape[:-2], m, s, differences.shape[-1]))
        parts = self.weights[:, :, None] * differences[..., :, None, :]
        of_steps: Any = (..., self.step, slice(None), slice(None))
        np.add.at(made, of_steps, parts)
        return made.reshape(*made.shape[:-3], m * s, -1)


def _rows(points: Points) -> int:
    return len(points) if points.bytes_a_phase else 1


def _differences(compared: Array, lower: Array, higher: Array, phases: Phases) -> tuple[Array, Array, Array]:
    found = compared.copy()
    for samples, basis in ((lower, phases.of_lower), (higher, phases.of_higher)):
        by_step = samples.reshape(*samples.shape[:-2], len(phases), -1, samples.shape[-1])
        found -= np.matmul(basis, by_step)[..., phases.step, phases.place, :]
    largest = np.maximum(np.abs(lower).max(axis=-2), np.abs(higher).max(axis=-2))
    return found, np.abs(found).max(axis=-2), largest


_known_differences = _OfArrays(_differences)


class Resampled:
    """Points whose coefficients at the stages of a grid take those at further phases into account.

    A collocation method weights the residual of a step by the Lagrange polynomials of its stages. These
    coefficients are local averages with the same weights, so that a feature between two stages contributes
    its integral. Polynomial coefficients of the degree that the stages resolve do not change.
    """

    def __init__(self, points: Points, phases: Phases):
        self.points, self.phases = points, phases
        self.n, self.period, self.breaks = points.n, points.period, points.breaks
        self.bytes_a_phase = points.bytes_a_phase

    @property
    def alone(self) -> bool:
        return self.points.alone

    def __len__(self) -> int:
        return len(self.points)

    def __getitem__(self, positions: Array) -> "Resampled":
        return Resampled(self.points[positions], self.phases)

    def tables(self, phase: Array) -> Tables:
        tables, stages = self.points.tables(phase), self.phases.lower
        first, m = int(np.searchsorted(stages[:, 0], phase[0])), len(phase) // stages.shape[1]
        if not np.array_equal(phase, stages[first : first + m].ravel()):
            return tables
        phases = self.phases if m == len(stages) else self.phases.of_steps(first, first + m)
        table = tables.table + phases.added(phases.differences(self.points)[0])
        return Tables(table, tables.coefficients, tables.entry, tables.n)


def _trapezoidal(step: Array, theta: Array, nodes: Array) -> Array:
    """Weights (Q,) of the fractions θ (Q,) of steps (Q,), rising, among these and the nodes of the steps."""
    m = int(step[-1]) + 1
    owner = np.concatenate((step, np.repeat(np.arange(m), len(nodes))))
    fraction = np.concatenate((theta, np.tile(nodes, m)))
    order = np.lexsort((fraction, owner))
    gaps = np.where(np.diff(owner[order]) == 0, np.diff(fraction[order]), 0.0) / 2
    width = np.empty(len(order))
    width[order] = np.append(gaps, 0.0) + np.append(0.0, gaps)
    return width[: len(theta)]
