"""Detection of harmonics and narrow features of M, C, K and d that the samples of a grid do not resolve."""

import weakref
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from solve.arrays import EPS, Array
from solve.errors import NoLoadError
from solve.methods.collocation import Collocation, lagrange
from solve.period.grid import Grid, pieces
from solve.period.points import DerivedPoints, Points, Tables
from solve.system import PeriodicSystem

PHASES = 1001
"""Number of fixed phases at which coefficients are compared with their interpolant. It is odd, so that few of
these phases coincide with the stages of a grid. A feature narrower than the spacing of all sampled phases may
be missed. docs/certificate.md states the measured range."""

COEFFICIENT_ROUND_OFF = 512 * EPS
"""Relative size below which harmonics, and differences between coefficients and their interpolant, count as
round-off. Measured round-off: at most 4e-14 for the models of this project, and 2e-13 for 3000 steps and
coefficients with noise in the last digit."""

_MEMORY = 2**27
"""Memory, in bytes, of the coefficients that are processed in one chunk."""


class _ArrayCache:
    """Cache of values that are computed from arrays. A value is kept as long as the first of its arrays
    exists."""

    def __init__(self, compute: Callable[..., Any]):
        self._compute = compute
        self._values: dict[tuple[int, ...], tuple[list[weakref.ref[Any]], Any]] = {}

    def __call__(self, *arrays: Any) -> Any:
        key = tuple(map(id, arrays))
        references, value = self._values.get(key, ([], None))
        if not references or any(ref() is not array for ref, array in zip(references, arrays, strict=True)):
            value = self._compute(*arrays)
            first = weakref.ref(arrays[0], lambda _: self._values.pop(key, None))
            self._values[key] = [first, *map(weakref.ref, arrays[1:])], value
        return value


def harmonics(points: Points, loads: bool) -> Array:
    """Return the relative amplitudes (P, k) of the harmonics 0, 1, … of the coefficients; 0 for round-off.

    The amplitudes of each entry of M, C and K (and d, if `loads` is True) are relative to the largest
    harmonic of this entry. The returned amplitude is the maximum over the entries. For systems with jumps,
    whose harmonics decay too slowly, only harmonic 0 is returned.
    """
    if points.breaks:
        return np.ones((len(points), 1))
    count = min(PHASES, _MEMORY // (8 * _entry_count(points.n)) | 1)
    tables = points.tables(_fixed_phases(points.period, count))
    spectrum = _spectrum(tables.table) if tables.per_point else _cached_spectrum(tables.table)
    # The entries of d are the last ones.
    terms = slice(None if loads else int((tables.entry < 3 * points.n**2).sum()))
    entries, starts = _entries(tables.entry[terms])
    relative = np.empty((len(points), spectrum.shape[-2]))
    chunk = max(1, _MEMORY // (16 * spectrum.shape[-2] * len(tables.entry)))
    for rows in (slice(first, first + chunk) for first in range(0, len(points), chunk)):
        parts = (spectrum[rows] if tables.per_point else spectrum) * tables.coefficients[rows, None]
        amplitudes = np.abs(np.add.reduceat(parts[..., terms], starts, axis=-1))
        relative[rows] = _relative(amplitudes, amplitudes.max(axis=1), entries, points.n)
    return relative


def aliased_harmonics(points: Points, loads: bool, resolved: int) -> Array:
    """Return the sum (P,) of the relative amplitudes of the harmonics above `resolved`; see `harmonics`.

    If `resolved` exceeds the highest harmonic of the fixed phases, and this harmonic is above round-off, as
    for undeclared jumps, the amplitude is extrapolated by the power law of the last two octaves."""
    amplitudes, highest = harmonics(points, loads), PHASES // 2
    if resolved < highest or amplitudes.shape[1] <= highest:
        return amplitudes[:, resolved + 1 :].sum(axis=1)
    lower = amplitudes[:, highest // 4 : highest // 2].max(axis=1)
    higher = amplitudes[:, highest // 2 :].max(axis=1)
    ratio = np.divide(lower, higher, out=np.ones_like(lower), where=higher > 0)
    return higher * (highest / resolved) ** np.log2(np.maximum(ratio, 1.0))


def _entries(entry: Array) -> tuple[Array, Array]:
    """Return the indices (E,) of the distinct entries, and the position (E,) of the first term of each entry.
    `entry` (R,): index of the entry to which each term belongs, in ascending order."""
    starts = np.concatenate(([0], (entry[1:] != entry[:-1]).nonzero()[0] + 1))
    return entry[starts], starts


def _relative(values: Array, largest: Array, entries: Array, n: int) -> Array:
    """Divide `values` (P, k, E) by the largest value of each entry, `largest` (P, E), and return the maximum
    (P, k) over the entries. Values within round-off count as 0."""
    scale = np.where(largest > 0, largest, 1.0)[:, None]
    is_visible = values > COEFFICIENT_ROUND_OFF * _entry_sizes(largest, entries, n)[:, None]
    return np.where(is_visible, values / scale, 0.0).max(axis=-1)


def _entry_count(n: int) -> int:
    """Return the number of entries of M, C, K and d."""
    return 3 * n**2 + n


def _entry_sizes(largest: Array, entries: Array, n: int) -> Array:
    """Return reference magnitudes (P, E) for the round-off of entries whose largest values are `largest` (P,
    E).

    An entry that is zero in exact arithmetic, such as a sum of products, has the round-off of its terms. The
    terms of a matrix entry are bounded by the diagonal, as in a positive definite matrix: |X_ij| ≤ (X_ii
    X_jj)^½. A load d_i is bounded by max_j |d_j| (D_ii / D_jj)^½, where D_ii is the largest of M_ii, C_ii and
    K_ii. entries (E,): indices of the entries.
    """
    every_entry = np.zeros((len(largest), _entry_count(n)))
    every_entry[:, entries] = largest
    matrices, loads = every_entry[:, :-n].reshape(-1, 3, n, n), every_entry[:, -n:]
    roots = np.sqrt(matrices.diagonal(axis1=2, axis2=3))
    matrix_sizes = (roots[..., None] * roots[:, :, None]).reshape(len(largest), -1)
    root = roots.max(axis=1)
    is_positive = root > 0
    scaled_loads = np.where(is_positive, loads / np.where(is_positive, root, 1.0), 0.0)
    load_sizes = scaled_loads.max(axis=1, keepdims=True) * root
    return np.maximum(largest, np.concatenate((matrix_sizes, load_sizes), axis=1)[:, entries])


def _spectrum(table: Array) -> Array:
    """Return the harmonics (…, k, R) of the terms of a table, up to the last harmonic above round-off."""
    with np.errstate(over="ignore", invalid="ignore"):
        spectrum = np.fft.rfft(table, axis=-2, norm="forward")
        sizes = np.abs(spectrum)
        is_resolved = sizes > COEFFICIENT_ROUND_OFF * sizes.max(axis=-2, keepdims=True)
    is_resolved = is_resolved.reshape(-1, *spectrum.shape[-2:]).any(axis=(0, 2))
    return spectrum[..., : int(np.flatnonzero(is_resolved).max(initial=0)) + 1, :]


_cached_spectrum = _ArrayCache(_spectrum)


@lru_cache(maxsize=8)
def _fixed_phases(period: float, count: int) -> Array:
    return (np.arange(count) + 0.5) * (period / count)


def compared_phases(period: float, breaks: tuple[float, ...]) -> Array:
    """Return the fixed phases, followed by the middle of each piece between neighbouring breaks. Coefficients
    that are equal, or zero, at all these phases count as constant, or zero."""
    ends, _ = pieces(period, breaks)
    return np.concatenate((_fixed_phases(period, PHASES), (ends[1:] + ends[:-1]) / 2))


def require_load(system: PeriodicSystem, speed: float) -> None:
    """Raise NoLoadError if d, and hence the periodic vibration, is zero at all compared phases."""
    if not system.at(compared_phases(system.period, system.breaks), speed)[3].any():
        raise NoLoadError(f"{system.labels.name} has no load: its periodic vibration is zero at every speed")


@dataclass(frozen=True, eq=False)
class SampledPhases:
    """Phases of consecutive steps at which coefficients are sampled, and further phases at which the
    coefficients are compared with their interpolant.

    Attributes
    ----------
    lower, higher : (m, s), (m, s + 1)
        Phases of the stages of the two methods.
    compared : (Q,)
        Further phases, in ascending order.
    step, place : (Q,)
        Step of each compared phase, and the number of the phase within this step.
    basis : (m, c, 2 s + 1)
        Lagrange polynomials of all stages, evaluated at the compared phases of each step; c is the largest
        number of compared phases in a step.
    weights : (m, s, c)
        Increments of the coefficients at the stages of the lower method that result from a unit difference at
        each compared phase of a step.
    """

    lower: Array
    higher: Array
    compared: Array
    step: Array
    place: Array
    basis: Array
    weights: Array

    @classmethod
    def on_steps(
        cls, grid: Grid, first: int, end: int, lower: Collocation, higher: Collocation
    ) -> "SampledPhases":
        """Return the sampled and the compared phases of the steps from `first` to `end` - 1 of a grid. The
        solution by the method `lower` is compared with the solution by `higher`."""
        nodes = np.union1d(lower.c, higher.c)
        stages, more_stages = (grid.stages(np.array(each.c))[first:end] for each in (lower, higher))
        compared, step = _compared_phases(grid, first, end)
        fraction = np.clip((compared - grid.nodes[step]) / grid.h[step], 0.0, 1.0)
        order = np.lexsort((fraction, step))
        compared, step, fraction = compared[order], step[order] - first, fraction[order]
        quadrature = _trapezoidal(step, fraction, nodes)[:, None] / lower.b
        place = np.arange(len(step)) - np.searchsorted(step, step)
        weights = np.zeros((*stages.shape, place.max() + 1))
        weights[step, :, place] = lagrange(np.array(lower.c), fraction) * quadrature
        # A node that both methods share counts once.
        is_counted = np.concatenate((np.ones(len(lower.c), dtype=bool), ~np.isin(higher.c, lower.c)))
        columns = np.searchsorted(nodes, np.concatenate((lower.c, higher.c)))
        basis = np.zeros((len(stages), place.max() + 1, len(columns)))
        basis[step, place] = lagrange(nodes, fraction)[:, columns] * is_counted
        return cls(stages, more_stages, compared, step, place, basis, weights)

    def increments(self, differences: Array) -> Array:
        """Return the increments (…, m s, R) of the coefficients at the stages that result from `differences`
        (…, Q, R)."""
        m, s = self.lower.shape
        by_step = np.zeros((*differences.shape[:-2], m, self.weights.shape[-1], differences.shape[-1]))
        by_step[..., self.step, self.place, :] = differences
        return (self.weights @ by_step).reshape(*differences.shape[:-2], m * s, -1)


def _compared_phases(grid: Grid, first: int, end: int) -> tuple[Array, Array]:
    """Return the phases (Q,) at which coefficients are compared, and the step of each phase. The fixed phases
    inside the steps come first, followed by both ends of each step."""
    fixed, steps = _fixed_phases(grid.period, PHASES), np.arange(first, end)
    ends = grid.stages(np.array([0.0, 1.0]))
    step = np.searchsorted(grid.nodes, fixed, side="right") - 1
    is_inside = (step >= first) & (step < end) & (fixed > ends[step, 0]) & (fixed < ends[step, 1])
    # The end of the period belongs to the next period: coefficients may jump there.
    ends = np.minimum(ends[first:end], grid.period * (1 - 1e-9))
    return np.concatenate((fixed[is_inside], ends.T.ravel())), np.concatenate((step[is_inside], steps, steps))


def _differences(
    compared: Array, lower: Array, higher: Array, phases: SampledPhases
) -> tuple[Array, Array, Array]:
    by_step = [
        each.reshape(*each.shape[:-2], len(phases.lower), -1, each.shape[-1]) for each in (lower, higher)
    ]
    stages = phases.lower.shape[1]
    interpolated = phases.basis[..., :stages] @ by_step[0]
    interpolated += phases.basis[..., stages:] @ by_step[1]
    differences = compared - interpolated[..., phases.step, phases.place, :]
    largest = np.maximum(_largest(lower), _largest(higher))
    return differences, _largest(differences), largest


def _largest(values: Array) -> Array:
    """Return the largest modulus (…, R), over the k phases, of values (…, k, R)."""
    return np.maximum(values.max(axis=-2), -values.min(axis=-2))


_cached_differences = _ArrayCache(_differences)


@lru_cache(maxsize=32)
def _sampled_phases(
    steps: int, period: float, breaks: tuple[float, ...], rules: tuple[Collocation, Collocation], memory: int
) -> tuple[SampledPhases, ...]:
    """Return the sampled and compared phases of a uniform grid. The grid is divided into parts whose
    coefficients fit into memory. memory: bytes of the coefficients per phase."""
    grid = Grid.uniform(steps, period, breaks)
    per_step = 2 * len(rules[0].c) + 3 + PHASES / grid.steps
    size = max(1, int(_MEMORY / (memory * per_step)))
    return tuple(
        SampledPhases.on_steps(grid, first, min(first + size, grid.steps), *rules)
        for first in range(0, grid.steps, size)
    )


class ResampledPoints(DerivedPoints):
    """Points whose coefficients at the stages of a grid are replaced by local averages over further phases.

    A collocation method weights the residual in a step by the Lagrange polynomials of its stages. The
    averages have the same weights. A feature of the coefficients between two stages therefore contributes its
    integral. Polynomial coefficients that the stages resolve exactly do not change."""

    def __init__(self, points: Points, steps: int, rules: tuple[Collocation, Collocation]):
        super().__init__(points)
        self.steps, self.rules = steps, rules
        memory = 8 * _entry_count(self.n) * (len(points) if self.bytes_a_phase else 1)
        self._parts = _sampled_phases(steps, self.period, self.breaks, rules, memory)
        self._last: tuple[SampledPhases, Any] | None = None

    def __getitem__(self, positions: Array) -> "ResampledPoints":
        return ResampledPoints(self.points[positions], self.steps, self.rules)

    def tables(self, phase: Array) -> Tables:
        """Return tables at phases (k,). They contain averages if the phases are the stages of consecutive
        steps, and the original coefficients otherwise."""
        stages, averaged = self._averaged
        first = int(np.searchsorted(stages, phase[0]))
        rows = slice(first, first + len(phase))
        if not np.array_equal(phase, stages[rows]):
            return self.points.tables(phase)
        return replace(averaged, table=averaged.table[..., rows, :])

    @cached_property
    def _averaged(self) -> tuple[Array, Tables]:
        """Phases (k,) of all stages, and tables of the averages at these phases."""
        stages = np.concatenate([part.lower.ravel() for part in self._parts])
        averaged, lower = [], None
        for part in self._parts:
            lower, (differences, *_) = self._differences(part)
            averaged.append(lower.table + part.increments(differences))
        assert lower is not None
        return stages, replace(lower, table=np.concatenate(averaged, axis=-2))

    @cached_property
    def relative_difference(self) -> Array:
        """Largest difference (P,) between the entries and their interpolants, relative to the largest value
        of each entry; 0 for round-off."""
        sizes, entry = [], np.zeros(0)
        for part in self._parts:
            lower, (_, *largest) = self._differences(part)
            sizes.append([np.abs(lower.coefficients) * each for each in largest])
            entry = lower.entry
        entries, starts = _entries(entry)
        differences, largest = np.maximum.reduce(sizes)
        sums = np.add.reduceat(differences, starts, axis=-1)
        largest = np.maximum.reduceat(largest, starts, axis=-1)
        return _relative(sums[:, None], largest, entries, self.n)[:, 0]

    def _differences(self, part: SampledPhases) -> tuple[Tables, tuple[Array, Array, Array]]:
        """Return the tables at the stages of the lower method, followed by a tuple for their R terms: the
        differences (…, Q, R) from the interpolant, the largest differences (…, R) and the largest values (…,
        R). The result for the last part is cached, because most grids have a single part."""
        if self._last is None or self._last[0] is not part:
            compared, lower, higher = (
                self.points.tables(each.ravel()) for each in (part.compared, part.lower, part.higher)
            )
            compute = _differences if lower.per_point else _cached_differences
            self._last = part, (lower, compute(compared.table, lower.table, higher.table, part))
        return self._last[1]


def _trapezoidal(step: Array, fraction: Array, nodes: Array) -> Array:
    """Return trapezoidal weights (Q,) at the fractions `fraction` (Q,) of the steps with indices `step` (Q,).
    Steps and fractions are in ascending order. The weights are for a quadrature over each step that also uses
    `nodes`, whose weights are not returned."""
    m = int(step[-1]) + 1
    every_step = np.concatenate((step, np.repeat(np.arange(m), len(nodes))))
    every_fraction = np.concatenate((fraction, np.tile(nodes, m)))
    order = np.lexsort((every_fraction, every_step))
    same_step = np.diff(every_step[order]) == 0
    gaps = np.where(same_step, np.diff(every_fraction[order]), 0.0) / 2
    weights = np.empty(len(order))
    weights[order] = np.append(gaps, 0.0) + np.append(0.0, gaps)
    return weights[: len(fraction)]
