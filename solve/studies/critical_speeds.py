"""Critical speeds three ways (thesis 7.2.3, 7.3), side by side.

Maxima of the response over speed; maxima of the real part of the dominant Floquet multiplier; integer
divisions of the natural frequencies' means over the cycle.
"""

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from solve.arguments import require_integer, require_size
from solve.arrays import Array
from solve.batch.batch import Batch
from solve.batch.family import over_speed
from solve.batch.gathering import gathered
from solve.batch.task import task_of
from solve.errors import require_name
from solve.methods.choice import Rule
from solve.period.multipliers import UNSTABLE
from solve.results.critical_rows import Critical, Maximum
from solve.results.critical_speeds import CriticalSpeeds
from solve.results.points import FIGURES, Kept, PointResults
from solve.results.sweep import Sweep
from solve.studies.boundaries import Search
from solve.studies.constant import Constant, constant, still
from solve.studies.explained import CLOSE, Explained, Turn, assigned, of_modulus, of_real_part
from solve.studies.judged import Judged, judge, met, passes_one
from solve.studies.known_speeds import ends_with_matrices, without_result
from solve.studies.maxima import Brackets, Trials, peaks, settled, sharpened
from solve.studies.mean_frequencies import (
    MeanFrequencies,
    combinations,
    crossed,
    resonances,
    shifted_by_rates,
)
from solve.studies.tongues import LIGHTLY_DAMPED, Turning, fastest_turning, hidden, parted, rising
from solve.system import PeriodicSystem, of_system
from solve.terminal import progress
from solve.units import checked_tolerance, speeds_between

RESPONSES = ("max_abs", "rms", "max", "min", "mean")
"""Figures of a quantity whose maxima count."""

_A_DIVISION = 24
"""Speeds between two neighbouring integer divisions of the lowest frequency."""

_ASIDE = 0.25
"""Part of the distance between divisions at which a maximum is compared with what lies beside it."""

_BESIDE = 4.0
"""Times the tolerance of a maximum at which it is looked at on either side."""

_ORDERS, _TOLERANCE = 20, 1e-5
"""Highest order of divisions, and relative tolerance of maxima, by default."""

_SHARE = 0.1
"""Part of the largest rise of an order's power from which on that order explains a maximum."""


@of_system
def critical_speeds(
    system: PeriodicSystem,
    speeds: str | Sequence[float | str] | Array,
    quantity: str | None = None,
    figure: str = "max_abs",
    orders: int = _ORDERS,
    method: str | Rule = "auto",
    rtol: float = 1e-8,
    tolerance: float = _TOLERANCE,
    engine: str = "auto",
) -> CriticalSpeeds:
    """Critical speeds between the lowest and the highest of the speeds (rad/s, texts with unit, or one text
    such as "100:900:81 rpm").

    quantity: a coordinate or output, by default the first coordinate; figure: its max_abs, rms, max, min
    or mean. Speeds are added where fewer than 24 lie between two divisions of the lowest frequency of an
    order up to `orders`; below those no maxima are looked for. Maxima are found to `tolerance`, relative.
    engine: as in `sweep`. Raises SolveError subclasses for bad input.
    """
    return _critical_speeds(
        system, speeds, quantity, figure, orders, method, rtol, tolerance, engine, known=None
    )


def critical_speeds_of(sweep: Sweep, method: str | Rule, rtol: float) -> CriticalSpeeds:
    """`critical_speeds` of the first coordinate between the speeds of a sweep by the same method to the same
    rtol, whose orbits are not solved again."""
    return _critical_speeds(
        sweep.system, sweep.speeds.tolist(), None, "max_abs", _ORDERS, method, rtol, _TOLERANCE, "auto", sweep
    )


def _critical_speeds(
    system: PeriodicSystem,
    speeds: str | Sequence[float | str] | Array,
    quantity: str | None,
    figure: str,
    orders: int,
    method: str | Rule,
    rtol: float,
    tolerance: float,
    engine: str,
    known: Sweep | None,
) -> CriticalSpeeds:
    given = speeds_between(speeds, "critical speeds")
    system, omegas = system.shown_in(given[0]), np.array(given)
    (name,) = system.known_quantities(quantity or system.coordinates[0])
    require_name("figure", figure, RESPONSES)
    require_integer("orders", orders, hint=", such as 20")
    require_size("orders", orders, len(omegas) * system.n**2)
    low, high = ends_with_matrices(system, omegas)
    task, notes = task_of(over_speed(system), method, rtol, engine, Kept((name,), warnings=False))
    rest = MeanFrequencies(system, np.array([0.0]))
    # Without matrices at rest, frequencies at a speed are used instead.
    first = rest if np.isfinite(rest.values).all() else MeanFrequencies(system, np.array([low]))
    stability = replace(task, request=replace(task.request, orbit=False))
    steady = constant(stability.batch(omegas[:, None]))
    grid = _refined_grid(omegas, first, orders, combined=steady is None)
    batch, without = (each.batch(grid[:, None]) for each in (task, stability))
    turning = still if steady else fastest_turning(system, (low, high))
    search = _Search(batch, without, task.kept, figure, checked_tolerance(tolerance), turning, steady, known)
    with progress.steps(4) as step:
        step("all speeds")
        found = search.solved(grid)
        found.require_any()
        step("mean natural frequencies")
        frequencies = MeanFrequencies(system, grid)
        with progress.task("speeds", len(grid)):
            frequencies.values  # noqa: B018 - cached from here on
        step("maxima of the dominant multiplier")
        real_part = np.maximum(search.real_part(found), 0.0)
        real_part = np.where(_resolved(frequencies, orders), real_part, np.nan)
        turned = search.multiplier_maxima(grid, real_part, found, search.real_part)
        step("maxima of the response")
        grid, found = search.with_edges(
            grid, found, np.array([top.speed for top in turned if top.height > 1])
        )
        frequencies = replace(frequencies, speeds=grid)
        resolved = _resolved(frequencies, orders)
        tops = search.response_maxima(grid, found, resolved)
        radius = np.where(resolved, search.radius(found), np.nan)
        raised = search.multiplier_maxima(grid, radius, found, search.radius)
        rows = _rows(search, (tops, turned, raised), frequencies, rest, orders)
    return CriticalSpeeds(
        system,
        name,
        figure,
        rows,
        [] if steady else combinations(frequencies, orders),
        grid,
        search.response(found),
        search.real_part(found),
        found.spectral_radius,
        found.verdicts == UNSTABLE,
        frequencies.values,
        orders,
        frequencies.imaginary & ~found.failed,
        [
            *notes,
            *found.notes,
            *shifted_by_rates(frequencies, CLOSE),
            *_left_out(system, grid, frequencies, found, orders),
        ],
        steady is not None,
    )


def _refined_grid(omegas: Array, frequencies: MeanFrequencies, orders: int, combined: bool) -> Array:
    """The speeds, with additional ones that resolve harmonics of the lowest frequency up to `orders`. For
    combination resonances, speeds at the resonances and halfway between them are added, so that two unstable
    ranges are not merged."""
    low, high, lowest = omegas[0], omegas[-1], float(frequencies.lowest[0])
    between = np.empty(0)
    first, last = lowest / high, min(lowest / low, orders + 1.0)
    if last > first > 0:
        count = int(np.ceil((last - first) * _A_DIVISION)) + 1
        require_size("speeds between the divisions up to that order", count, orders)
        between = np.clip(lowest / np.linspace(first, last, count), low, high)
    resonant = np.unique(resonances(frequencies, low, high)) if combined else np.empty(0)
    halfway = (resonant[:-1] + resonant[1:]) / 2
    every = np.unique(np.concatenate((omegas, between, resonant, halfway)))
    # Speeds that differ by round-off: a maximum at both would be bracketed by them.
    return every[np.append(np.diff(every) > 64 * np.finfo(float).eps * every[1:], True)]


def _left_out(
    system: PeriodicSystem, grid: Array, frequencies: MeanFrequencies, found: PointResults, orders: int
) -> Iterator[str]:
    """Where no maxima are looked for, and where there is no result."""
    unit, skipped = system.speed_unit, frequencies.lowest > (orders + 0.5) * grid
    if skipped.any():
        limit = unit.text(float(grid[skipped].max()), ".4g")
        yield f"below {limit} only orders above {orders} lie: no maxima are looked for"
    if found.failures:
        yield without_result(grid, found.failed, unit, next(iter(found.failures.values())))


@dataclass
class _Search:
    """Solver at speeds and search for maxima between them. multipliers: the batch without orbits; turning:
    rotation rate of the multipliers with the speed; steady: where matrices are constant; known: a sweep that
    keeps the same figure."""

    batch: Batch
    multipliers: Batch
    kept: Kept
    figure: str
    tolerance: float
    turning: Turning
    steady: Constant | None
    known: Sweep | None

    def solved(self, speeds: Array) -> PointResults:
        if self.known is None:
            return gathered(self.batch, speeds[:, None], self.kept)
        _, at, places = np.intersect1d(speeds, self.known.speeds, return_indices=True)
        others = np.setdiff1d(np.arange(len(speeds)), at)
        found = PointResults.blank(len(speeds), self.batch.family.example.n, self.kept)
        found.insert(others, gathered(self.batch, speeds[others, None], self.kept))
        found.insert(at, self.known.results.of_some(places, self.kept))
        return found

    def without_orbits(self, speeds: Array) -> PointResults:
        """Multipliers alone."""
        steady, points = self.steady, speeds[:, None]
        return steady.results(points) if steady else gathered(self.multipliers, points, Kept(warnings=False))

    def response(self, found: PointResults) -> Array:
        return found.figures[:, 0, FIGURES.index(self.figure)]

    def radius(self, found: PointResults) -> Array:
        """The spectral radius; NaN where a turn forgets most of the one before."""
        radius = found.spectral_radius
        return np.where(radius >= LIGHTLY_DAMPED, radius, np.nan)

    def real_part(self, found: PointResults) -> Array:
        """The largest real part of the multipliers that are dominant but for their errors."""
        largest = np.where(found.leading, np.real(found.multipliers), -np.inf).max(axis=1)
        return np.where(found.failed, np.nan, largest)

    def multiplier_maxima(
        self, speeds: Array, values: Array, found: PointResults, value: Callable[[PointResults], Array]
    ) -> list[Maximum]:
        """Maxima of a function `values` (P,) of the multipliers at the speeds (P,)."""
        places = peaks(values, found.errors[:, 1] * found.spectral_radius)
        trials = Trials(self.multipliers, Kept(warnings=False), found, places)

        def solved(speeds: Array, numbers: Array) -> tuple[Array, Array]:
            here = trials.solved(speeds, numbers)
            return value(here), self.meeting(here)

        brackets = Brackets(speeds[places], values[places])
        return sharpened(brackets, self.meeting(found)[places], solved, self.tolerance).maxima

    def meeting(self, found: PointResults) -> Array:
        """Distance from coalescence (P,), `met`, of the pair of the dominant multiplier with the largest real
        part."""
        leads = np.where(found.leading, np.real(found.multipliers), -np.inf).argmax(axis=1)
        return np.where(found.failed, np.nan, met(found.multipliers, leads))

    def response_maxima(self, speeds: Array, found: PointResults, known: Array) -> Brackets:
        """Brackets of the maxima of the response at the speeds (P,), where it is known."""
        values = np.where(known, self.response(found), np.nan)
        places = peaks(values, found.errors[:, 0] * np.abs(values))
        trials = Trials(self.batch, self.kept, found, places)

        def solved(speeds: Array, numbers: Array) -> tuple[Array, Array]:
            return self.response(trials.solved(speeds, numbers)), np.full(len(speeds), np.nan)

        brackets = Brackets(speeds[places], values[places])
        return sharpened(brackets, np.full(places.shape, np.nan), solved, self.tolerance)

    def settled(self, tops: Brackets) -> list[Maximum]:
        """Maxima of the response with certified heights, however narrow."""

        def solved(speeds: Array, _: Array) -> tuple[Array, Array]:
            return self.response(self.solved(speeds)), np.full(len(speeds), np.nan)

        return settled(tops, solved).maxima

    def risen(self, tops: Brackets, orders: int) -> list[Explained]:
        """Maxima of the response that are reached, beside an unstable range at the nearest, each with the
        orders up to `orders` whose power rises there above that on either side."""
        if not len(tops):
            return []
        system, (name,) = self.batch.family.example, self.kept.names
        turns = system.period / (2 * np.pi)
        at = tops.x[:, 1]
        aside = _ASIDE / np.maximum(MeanFrequencies(system, at).lowest / at, _ASIDE / CLOSE)
        near = np.full(len(at), _BESIDE * self.tolerance)
        trials = at * (1 + np.stack([-aside, -near, 0 * near, near, aside]))
        kept = Kept((name,), (name,), math.ceil(orders * turns), warnings=False)
        found = gathered(self.batch, trials.reshape(-1, 1), kept)
        reached = (found.verdicts != UNSTABLE).reshape(trials.shape)[1:4].any(axis=0)
        unbounded = self._unbounded(trials[1:4], found)
        known = np.flatnonzero(~unbounded)
        narrow = self.settled(tops.with_heights(self.response(found).reshape(trials.shape)[2])[known])
        maxima = [Maximum(speed, math.inf) for speed in at.tolist()]
        for place, maximum in zip(known.tolist(), narrow, strict=True):
            maxima[place] = maximum
        power = np.nan_to_num(found.amplitudes[:, 0] ** 2).reshape(*trials.shape, -1)
        rises = power[2] - (power[0] + power[4]) / 2
        return [
            Explained(maximum, _risen(rise, orders, turns, system.n))
            for maximum, rise, is_reached in zip(maxima, rises, reached, strict=True)
            if is_reached
        ]

    def _unbounded(self, trials: Array, found: PointResults) -> Array:
        """Whether the response is unbounded (k,), since a multiplier is +1, about the maxima between speeds
        `trials` (3, k). found: results at these speeds, with the outermost first and last."""
        rho, errors = (
            each.reshape(5, trials.shape[1], -1)[1:4].copy() for each in (found.multipliers, found.errors)
        )
        failed = found.failed.reshape(5, -1)[1:4]
        if failed.any():
            # Multipliers exist even without an orbit.
            others = self.without_orbits(trials[failed])
            rho[failed], errors[failed] = others.multipliers, others.errors
        return passes_one(rho, errors[..., 1] * np.abs(rho[..., 0]))

    def with_edges(self, speeds: Array, found: PointResults, others: Array) -> tuple[Array, PointResults]:
        """The speeds (P,) and what was found there, with others (k,), and those at and beside which a
        multiplier passes +1 along the real axis between these, the first or the last of those beyond: the
        response may grow beyond all bounds there, however narrow its maximum."""
        speeds, found = self._with(speeds, found, others)
        judging = self.steady.judge if self.steady else judge(self.multipliers)

        def judged(points: Array) -> Judged:
            return judging(points).by_plus_one

        first = judging(speeds[:, None]) if self.steady else Judged.of(speeds[:, None], found)
        known = parted(judged, first.by_plus_one, self.turning, (1,))
        known = rising(known + hidden(judged, known, np.arange(1, len(known.points) - 1)))
        side = known.stable.astype(int) - known.unstable
        changes = np.flatnonzero(side[:-1] * side[1:] < 0)
        brackets = Search(judged, speeds[:1], self.tolerance)
        low, high = (end.points[:, 0] for end in brackets.passages(known[changes], known[changes + 1], 0))
        aside = _BESIDE * self.tolerance
        return self._with(speeds, found, np.concatenate((low * (1 - aside), low, high, high * (1 + aside))))

    def _with(self, speeds: Array, found: PointResults, others: Array) -> tuple[Array, PointResults]:
        """The speeds (P,) and what was found there, with others (k,)."""
        others = np.setdiff1d(others, speeds)
        every = np.union1d(speeds, others)
        results = PointResults.blank(len(every), self.batch.family.example.n, self.kept)
        for some, those in ((speeds, found), (others, self.solved(others))):
            results.insert(np.searchsorted(every, some), those)
        return every, results

    def turned(self, maxima: list[Maximum], orders: int) -> list[Explained]:
        """Maxima of the real part of the dominant multiplier, each with its explanation, except edges of
        unstable ranges at which another multiplier becomes dominant."""
        at, count = np.array([one.speed for one in maxima]), len(maxima)
        near = 1 + _BESIDE * self.tolerance * np.array([0, -1, 1])
        every = self.without_orbits((near[:, None] * at).ravel())
        unstable, rho = (every.verdicts == UNSTABLE).reshape(3, count), every.multipliers[:count]
        leads = np.where(every.leading[:count], np.real(rho), -np.inf).argmax(axis=1)
        maxima = _certified(maxima, self.real_part(every)[:count])
        return [
            explained
            for one, lead, (turn, grows), is_edge in zip(
                maxima, leads, self._turns(maxima, rho, unstable[0]), unstable[1] != unstable[2], strict=True
            )
            if any((explained := of_real_part(turn, one, int(lead), orders, unstable=grows))[1:])
            or not is_edge
        ]

    def raised(self, maxima: list[Maximum], orders: int) -> list[Explained]:
        """Maxima of the spectral radius, each with its explanation. Unexplained maxima of stable motion are
        left out: the spectral radius falls on either side where a mode meets one that decays faster."""
        found = self.without_orbits(np.array([one.speed for one in maxima]))
        maxima = _certified(maxima, found.spectral_radius)
        return [
            explained
            for one, (turn, grows) in zip(
                maxima, self._turns(maxima, found.multipliers, found.verdicts == UNSTABLE), strict=True
            )
            if any((explained := of_modulus(turn, one, orders))[1:]) or grows
        ]

    def _turns(
        self, maxima: list[Maximum], multipliers: Array, unstable: Array
    ) -> Iterator[tuple[Turn, bool]]:
        """Change of the modes over a period (k,), from the multipliers (k, N), and whether the motion is
        unstable (k,)."""
        system = self.batch.family.example
        for one, grows, rho in zip(maxima, unstable.tolist(), multipliers, strict=True):
            ratios = MeanFrequencies(system, np.array([one.speed])).values[0] / one.speed
            yield Turn(system, one.speed, rho, ratios), grows


def _certified(maxima: list[Maximum], heights: Array) -> list[Maximum]:
    """The maxima with the certified heights (k,) at their speeds, where available."""
    known = zip(maxima, heights.tolist(), np.isfinite(heights).tolist(), strict=True)
    return [replace(one, height=height) if finite else one for one, height, finite in known]


def _risen(rise: Array, orders: int, turns: float, modes: int) -> set[tuple[int, int]]:
    """Modes and harmonics up to `orders` whose power rises, from `rise` (k,) by harmonics of a period of that
    many revolutions."""
    whole = {k: round(k * turns) for k in range(1, orders + 1) if math.isclose(k * turns, round(k * turns))}
    enough = _SHARE * rise[1:].max()
    risen = [k for k, number in whole.items() if rise[number] >= enough > 0]
    return set(itertools.product(range(1, modes + 1), risen))


def _resolved(frequencies: MeanFrequencies, orders: int) -> Array:
    """Speeds (P,) at which the lowest frequency is of an order up to `orders`."""
    return frequencies.lowest <= (orders + 0.5) * frequencies.speeds


def _rows(
    search: _Search,
    maxima: tuple[Brackets, list[Maximum], list[Maximum]],
    frequencies: MeanFrequencies,
    rest: MeanFrequencies,
    orders: int,
) -> list[Critical]:
    """Maxima of the response, of the real part of the dominant multiplier and of the spectral radius, each
    with its integer division."""
    tops, turned, raised = maxima
    rows = [
        Critical(None, None, speed, mode + 1, order, float(rest.values[0, mode] / order))
        for mode, weights in enumerate(np.eye(frequencies.values.shape[1]))
        for order, speed in crossed(frequencies, weights, orders)
    ]
    rows = assigned(rows, search.risen(tops, orders), frequencies, "response")
    rows = assigned(rows, search.turned(turned, orders), frequencies, "multiplier")
    rows = assigned(rows, search.raised(raised, orders), frequencies, "radius")
    rows = [replace(row, ratios=(frequencies.at(row.speed) / row.speed).tolist()) for row in rows]
    return sorted(rows, key=lambda row: -row.speed)
