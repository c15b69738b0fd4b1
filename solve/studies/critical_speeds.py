"""Critical speeds three ways (thesis 7.2.3, 7.3), side by side.

Maxima of the response over speed; maxima of the real part of the dominant Floquet multiplier; integer
divisions of the natural frequencies' means over the cycle.
"""

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from solve.argument import require_whole
from solve.arrays import Array
from solve.batch.batch import Batch
from solve.batch.family import over_speed
from solve.batch.gathering import gathered
from solve.batch.task import task_of
from solve.errors import require_name
from solve.methods.choice import Rule
from solve.period.multipliers import UNIT_CIRCLE, UNSTABLE
from solve.progress import stage, steps
from solve.results.critical_rows import Combination, Critical, Maximum
from solve.results.critical_speeds import CriticalSpeeds
from solve.results.points import FIGURES, Kept, PointResults
from solve.sizes import require_size
from solve.studies.boundaries import Search
from solve.studies.constant import Constant, constant, still
from solve.studies.explained import CLOSE, Explained, Turn, allowed_distance, of_modulus, of_real_part
from solve.studies.judged import Judged, judge, passing
from solve.studies.known_speeds import ends_with_matrices, without_result
from solve.studies.maxima import peaks, sharpened
from solve.studies.mean_frequencies import (
    MeanFrequencies,
    combinations,
    crossed,
    resonances,
    shifted_by_rates,
)
from solve.studies.tongues import LIGHTLY_DAMPED, Turning, fastest_turning, hidden, parted, rising
from solve.system import PeriodicSystem, of_system
from solve.units import checked_tolerance, speeds_between

RESPONSES = ("max_abs", "rms", "max", "min", "mean")
"""Figures of a quantity whose maxima count."""

_A_DIVISION = 24
"""Speeds between two neighbouring integer divisions of the lowest frequency."""

_ASIDE = 0.25
"""Part of the distance between divisions at which a maximum is compared with what lies beside it."""

_BESIDE = 4.0
"""Times the tolerance of a maximum at which it is looked at on either side."""

_SHARE = 0.1
"""Part of the largest rise of an order's power from which on that order explains a maximum."""

_ALIKE = 1e-3
"""Relative difference of speeds up to which maxima of a multiplier's real part and of its modulus are one."""


@of_system
def critical_speeds(
    system: PeriodicSystem,
    speeds: str | Sequence[float | str] | Array,
    quantity: str | None = None,
    figure: str = "max_abs",
    orders: int = 20,
    method: str | Rule = "auto",
    rtol: float = 1e-8,
    tolerance: float = 1e-5,
    engine: str = "auto",
) -> CriticalSpeeds:
    """Critical speeds between the lowest and the highest of the speeds (rad/s, texts with unit, or one text
    such as "100:900:81 rpm").

    quantity: a coordinate or output, by default the first coordinate; figure: its max_abs, rms, max, min
    or mean. Speeds are added where fewer than 24 lie between two divisions of the lowest frequency of an
    order up to `orders`; below those no maxima are looked for. Maxima are found to `tolerance`, relative.
    engine: as in `sweep`. Raises SolveError subclasses for bad input.
    """
    given = speeds_between(speeds, "critical speeds")
    system, omegas = system.shown_in(given[0]), np.array(given)
    (name,) = system.known_quantities(quantity or system.coordinates[0])
    require_name("figure", figure, RESPONSES)
    require_whole("orders", orders, hint=", such as 20")
    require_size("orders", orders, len(omegas) * system.n**2)
    low, high = ends_with_matrices(system, omegas)
    task, notes = task_of(over_speed(system), method, rtol, engine, Kept((name,), warnings=False))
    rest = MeanFrequencies(system, np.array([0.0]))
    # Without matrices at rest, frequencies at a speed stand for those.
    first = rest if np.isfinite(rest.values).all() else MeanFrequencies(system, np.array([low]))
    stability = replace(task, request=replace(task.request, orbit=False))
    steady = constant(stability.batch(omegas[:, None]))
    grid = _refined_grid(omegas, first, orders, combined=steady is None)
    batch, without = (each.batch(grid[:, None]) for each in (task, stability))
    turning = still if steady else fastest_turning(system, (low, high))
    search = _Search(batch, without, task.kept, figure, checked_tolerance(tolerance), turning, steady)
    with steps(4) as step:
        step("all speeds")
        found = search.solved(grid)
        found.require_any()
        step("mean natural frequencies")
        frequencies = MeanFrequencies(system, grid)
        with stage("speeds", len(grid)):
            frequencies.values  # noqa: B018 - cached from here on
        step("maxima of the dominant multiplier")
        real_part, error = search.real_part(found), found.errors[:, 1] * found.spectral_radius
        real_part = np.where(_resolved(frequencies, orders), np.maximum(real_part, 0.0), np.nan)
        turned = search.maxima(grid, real_part, error, search.real_part)
        step("maxima of the response")
        grid, found = search.with_edges(
            grid, found, np.array([top.speed for top in turned if top.height > 1])
        )
        frequencies = replace(frequencies, speeds=grid)
        tops = search.tops(found, frequencies, orders)
        rows = _rows(search, found, frequencies, rest, tops, turned, orders)
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
        frequencies.imaginary,
        [
            *notes,
            *found.notes,
            *shifted_by_rates(frequencies, CLOSE),
            *_left_out(system, grid, frequencies, found, orders),
        ],
        steady is not None,
    )


def _refined_grid(omegas: Array, frequencies: MeanFrequencies, orders: int, combined: bool) -> Array:
    """The speeds, others so that orders of the lowest frequency up to `orders` are resolved, and of combined
    modes those of resonances and halfway between these, so that no two unstable ranges are taken for one."""
    low, high, lowest = omegas[0], omegas[-1], float(frequencies.lowest[0])
    between = np.empty(0)
    first, last = lowest / high, min(lowest / low, orders + 1.0)
    if last > first > 0:
        count = int(np.ceil((last - first) * _A_DIVISION)) + 1
        require_size("speeds between the divisions up to that order", count, orders)
        between = np.clip(lowest / np.linspace(first, last, count), low, high)
    resonant = np.unique(resonances(frequencies, low, high)) if combined else np.empty(0)
    halfway = (resonant[:-1] + resonant[1:]) / 2
    return np.unique(np.concatenate((omegas, between, resonant, halfway)))


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
    """Solves speeds and finds maxima between them. multipliers: the batch that leaves out orbits; turning:
    how fast multipliers turn over the speed; steady: where matrices are constant."""

    batch: Batch
    multipliers: Batch
    kept: Kept
    figure: str
    tolerance: float
    turning: Turning
    steady: Constant | None

    def solved(self, speeds: Array) -> PointResults:
        return gathered(self.batch, speeds[:, None], self.kept)

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

    def maxima(
        self, speeds: Array, values: Array, errors: Array, value: Callable[[PointResults], Array]
    ) -> list[Maximum]:
        """Prominent local maxima of those of the values (P,), with errors, that are known, zoomed into."""
        known = np.isfinite(values)
        speeds, values = speeds[known], values[known]
        solved = self.solved if value == self.response else self.without_orbits
        top = peaks(values, errors[known])
        return sharpened(speeds, values, top, lambda trials: value(solved(trials)), self.tolerance)

    def tops(self, found: PointResults, frequencies: MeanFrequencies, orders: int) -> list[Maximum]:
        """Maxima of the response at the speeds of the frequencies."""
        values = np.where(_resolved(frequencies, orders), self.response(found), np.nan)
        return self.maxima(frequencies.speeds, values, found.errors[:, 0] * np.abs(values), self.response)

    def risen(self, maxima: list[Maximum], orders: int) -> list[Explained]:
        """Maxima of the response that are reached, beside an unstable range at the nearest, each with the
        orders up to `orders` whose power rises there above that on either side."""
        if not maxima:
            return []
        system, (name,) = self.batch.family.example, self.kept.names
        turns = system.period / (2 * np.pi)
        at = np.array([one.speed for one in maxima])
        unbounded = self._unbounded(at)
        aside = _ASIDE / np.maximum(MeanFrequencies(system, at).lowest / at, _ASIDE / CLOSE)
        near = np.full(len(at), _BESIDE * self.tolerance)
        trials = at * (1 + np.stack([-aside, -near, 0 * near, near, aside]))
        kept = Kept((name,), (name,), math.ceil(orders * turns), warnings=False)
        found = gathered(self.batch, trials.reshape(-1, 1), kept)
        reached = (found.verdicts != UNSTABLE).reshape(trials.shape)[1:4].any(axis=0)
        power = np.nan_to_num(found.amplitudes[:, 0] ** 2).reshape(*trials.shape, -1)
        rises = power[2] - (power[0] + power[4]) / 2
        whole = {
            k: round(k * turns) for k in range(1, orders + 1) if math.isclose(k * turns, round(k * turns))
        }
        modes = range(1, system.n + 1)
        return [
            Explained(
                replace(maximum, height=math.inf) if grows else maximum,
                {
                    (mode, k)
                    for mode, (k, number) in itertools.product(modes, whole.items())
                    if rise[number] >= _SHARE * rise[1:].max() > 0
                },
            )
            for maximum, rise, is_reached, grows in zip(maxima, rises, reached, unbounded, strict=True)
            if is_reached
        ]

    def _unbounded(self, at: Array) -> Array:
        """Whether the response grows beyond all bounds about speeds (k,), since a multiplier is +1 there: one
        that goes along the real axis, as at the edge of an unstable range, or along the unit circle, as where
        nothing damps a resonance, whether or not there is a narrow unstable range about it."""
        near = 1 + _BESIDE * self.tolerance * np.array([-1, 0, 1])
        found = self.without_orbits((at[:, None] * near).ravel())
        off, side = np.abs(1 - found.multipliers), _side(found).reshape(-1, 3)
        least = off.argmin(axis=1)[:, None]
        size, modulus = (
            np.take_along_axis(each, least, 1).reshape(-1, 3) for each in (off, np.abs(found.multipliers))
        )
        error = (found.errors[:, 1] * found.spectral_radius).reshape(-1, 3)
        turned = (np.abs(modulus - 1) <= error + UNIT_CIRCLE)[:, ::2].all(axis=1)
        return (side[:, 0] * side[:, 2] < 0) | turned & (size[:, 1] < size[:, ::2].min(axis=1))

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
        """Maxima of the dominant multiplier's real part, each with what explains it; but for edges of
        unstable ranges, at which another multiplier takes the lead."""
        at = np.array([one.speed for one in maxima])
        near = 1 + _BESIDE * self.tolerance * np.array([-1, 1])
        sides = self.without_orbits((at[:, None] * near).ravel()).verdicts.reshape(-1, 2) == UNSTABLE
        found = self.without_orbits(at)
        leads = np.where(found.leading, np.real(found.multipliers), -np.inf).argmax(axis=1)
        return [
            explained
            for one, lead, (turn, grows), (below, above) in zip(
                maxima, leads, self._turns(maxima, found), sides, strict=True
            )
            if any((explained := of_real_part(turn, one, int(lead), orders, unstable=grows))[1:])
            or below == above
        ]

    def raised(self, maxima: list[Maximum], orders: int) -> list[Explained]:
        """Maxima of the spectral radius, each with what explains it; but for those of stable motions that
        nothing explains, for it falls on either side where a mode meets one that decays faster."""
        found = self.without_orbits(np.array([one.speed for one in maxima]))
        return [
            explained
            for one, (turn, grows) in zip(maxima, self._turns(maxima, found), strict=True)
            if any((explained := of_modulus(turn, one, orders))[1:]) or grows
        ]

    def _turns(self, maxima: list[Maximum], found: PointResults) -> Iterator[tuple[Turn, bool]]:
        """What a period does to the modes at each, and whether the motion is unstable."""
        system, unstable = self.batch.family.example, found.verdicts == UNSTABLE
        for one, grows, rho in zip(maxima, unstable.tolist(), found.multipliers, strict=True):
            ratios = MeanFrequencies(system, np.array([one.speed])).values[0] / one.speed
            yield Turn(system, one.speed, rho, ratios), grows


def _side(found: PointResults) -> Array:
    """Sign (P,) of det(I - Φ), of whose changes each is a multiplier that passes +1 along the real axis; 0
    where one is +1 but for its error."""
    off = 1 - found.multipliers
    sure = np.abs(off).min(axis=1) > found.errors[:, 1] * found.spectral_radius
    return np.where(sure, np.sign(passing(found.multipliers, 1)[:, 0]), 0.0)


def _resolved(frequencies: MeanFrequencies, orders: int) -> Array:
    """Speeds (P,) at which the lowest frequency is of an order up to `orders`."""
    return frequencies.lowest <= (orders + 0.5) * frequencies.speeds


def _rows(
    search: _Search,
    found: PointResults,
    frequencies: MeanFrequencies,
    rest: MeanFrequencies,
    tops: list[Maximum],
    turned: list[Maximum],
    orders: int,
) -> list[Critical]:
    """Maxima of all kinds, each beside the integer division that it belongs to. tops: those of the response;
    turned: of the dominant multiplier's real part."""
    grid, resolved = frequencies.speeds, _resolved(frequencies, orders)
    rows = [
        Critical(None, None, speed, mode + 1, order, float(rest.values[0, mode] / order))
        for mode, weights in enumerate(np.eye(frequencies.values.shape[1]))
        for order, speed in crossed(frequencies, weights, orders)
    ]
    error = found.errors[:, 1] * found.spectral_radius
    radius = np.where(resolved, search.radius(found), np.nan)
    rows = _assigned(rows, search.risen(tops, orders), frequencies, "response")
    rows = _assigned(rows, search.turned(turned, orders), frequencies, "multiplier")
    tops = search.maxima(grid, radius, error, search.radius)
    rows = _assigned(rows, search.raised(tops, orders), frequencies, "radius")
    rows = [replace(row, ratios=(frequencies.at(row.speed) / row.speed).tolist()) for row in rows]
    return sorted(rows, key=lambda row: -row.speed)


def _assigned(
    rows: list[Critical], explained: list[Explained], frequencies: MeanFrequencies, way: str
) -> list[Critical]:
    """The rows with each maximum at the division that explains it: one that does, and near; the higher first.
    A row of its own where there is none, or where frozen frequencies mean nothing, one for a combination."""
    rows = list(rows)
    for one in sorted(explained, key=lambda one: -one.maximum.height):
        here = replace(frequencies, speeds=np.array([one.maximum.speed]))
        ratios = here.values[0] / one.maximum.speed
        several = () if here.imaginary[0] else one.combinations
        combination = several[0] if len(several) == 1 else None
        places = [
            (abs(ratios[(row.mode or 0) - 1] - (row.order or 0)), place)
            for place, row in enumerate(rows)
            if (row.mode, row.order) in one.divisions and getattr(row, way) is None and not here.imaginary[0]
        ]
        distance, place = min(places, default=(np.inf, 0))
        if not places or distance >= allowed_distance(rows[place].order or 0):
            place = next((at for at, row in enumerate(rows) if _tells(row, one, combination, way)), len(rows))
            candidates = several if len(several) > 1 else ()
            rows += [Critical(combination=combination, candidates=candidates)] * (place == len(rows))
        rows[place] = replace(rows[place], **{way: one.maximum})
    return rows


def _tells(row: Critical, one: Explained, combination: Combination | None, way: str) -> bool:
    """Whether a row stands for this maximum of that way already."""
    if getattr(row, way) is not None:
        return False
    apart = abs(row.speed - one.maximum.speed) / one.maximum.speed
    if combination is not None and row.combination is not None:
        return combination.same(row.combination) and apart < CLOSE
    return way == "radius" and row.multiplier is not None and apart < _ALIKE
