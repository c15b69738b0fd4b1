"""Optimum over a range of speeds: local maxima between the given speeds are followed, and unstable bands
between them are closed or moved out of the range."""

import itertools
import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from solve.errors import SolveError
from solve.period.named import Named
from solve.results.bands import Band
from solve.studies.bands import bands
from solve.studies.design_points import DesignPoint
from solve.studies.optimum_search import STATIONARY, Search, State
from solve.studies.over_speed import BandEdge, PeakSpeed

_BETWEEN, _MAX_ROUNDS = 4, 10
"""Number of parts into which each interval of speeds is divided when an optimum is checked between the
speeds; and maximum number of rounds in which maxima are added. Chosen by judgement."""

_MAX_BANDS = 4
"""Maximum number of unstable bands that are removed, one after another. Chosen by judgement."""

_NEARLY = 0.01
"""A maximum between speeds is refined if it is lower than the largest value by at most this fraction of the
largest value. Chosen by judgement."""

_SPEED_TOLERANCE = 1e-5
"""Relative tolerance of the speed of a refined maximum. The value at the maximum changes only with the square
of the error of the speed. Chosen by judgement."""

_DROP = 1e-3
"""Relative decrease of the value from a maximum to the two neighbouring speeds that are used to follow it.
This decrease applies while maxima are added. Afterwards, √rtol is used, which balances the errors of the
orbits and of the parabola. Chosen by judgement."""

_SPACING, _WIDER = (1e-4, 1e-2), 10.0
"""Smallest and largest distance, relative to the speed, between a maximum and the two neighbouring speeds
that are used to follow it. The decrease of the value is computed at the smallest distance multiplied by the
third number. Chosen by judgement."""

_SAME_PEAK = 4.0
"""A new maximum replaces a previous one if the distance between them is at most this multiple of the spacing
of the previous one. Chosen by judgement."""

_Trial = tuple[State, tuple[Sequence[PeakSpeed], Sequence[BandEdge]]]
"""Optimum, and the maxima and edges that were followed to find it."""


def over_range(search: Search, state: State) -> tuple[State, list[str]]:
    """Return the optimum for a range of speeds, and reasons for doubt. `state` is the optimum at the given
    speeds."""
    state, doubts = _with_peaks(search, state)
    for _ in range(_MAX_BANDS):
        missed, unsearched = _missed_bands(search, state)
        if not missed:
            return state, doubts + unsearched
        trials = list(_without_band(search, state, missed))
        if not trials:
            break
        state, followed = min(trials, key=lambda trial: trial[0].objective)
        search.follow(*followed)
        state, doubts = _with_peaks(search, state)
    text = search.design.model.labels.speed_unit.text
    return state, doubts + [
        f"unstable from {text(band.low)} to {text(band.high)}, between the speeds; no design without this "
        "band was found: widen the bounds, or give other speeds"
        for band in _missed_bands(search, state)[0]
    ]


def _with_peaks(search: Search, state: State) -> tuple[State, list[str]]:
    """Return an optimum, and reasons for doubt. The search for the optimum follows the local maxima between
    the given speeds that are worse than the values at the given speeds."""
    drop, fine = _DROP, min(_DROP, math.sqrt(search.design.rtol))
    for _ in range(_MAX_ROUNDS):
        found = _worse_between(search, state, drop)
        if not found and (drop == fine or not search.peaks):
            return state, []
        if found:
            rest = [
                peak
                for peak in search.peaks
                if all(abs(peak.speed - new.speed) > _SAME_PEAK * peak.spacing for new in found)
            ]
            search.follow([*rest, *found], search.edges)
        else:
            closer = math.sqrt(fine / drop)
            search.follow(
                [PeakSpeed(peak.speed, closer * peak.spacing) for peak in search.peaks], search.edges
            )
            drop = fine
        state = search.descended(state.x)
    found = _worse_between(search, state, drop)
    if not found:
        return state, []
    texts = ", ".join(search.design.model.labels.speed_unit.text(peak.speed) for peak in found)
    return state, [f"at {texts} values are worse than at the optimised speeds; give more speeds"]


def _without_band(search: Search, state: State, missed: Sequence[Band]) -> Iterator[_Trial]:
    """Yield up to three optima, with the maxima and edges followed to find each. In one, the first of the
    missed bands is closed; in another, it lies above the range; in another, below the range. Optima that are
    not found are omitted. At the end, the search follows the same maxima and edges as before."""
    (peaks, edges), design = (search.peaks, search.edges), search.design
    band, low, high = missed[0], search.given[0], search.given[-1]
    width = band.high - band.low
    for way in ("closed", "above", "below"):
        try:
            if way == "closed":
                search.follow([*peaks, PeakSpeed((band.low + band.high) / 2, width / 4)], edges)
            else:
                is_above = way == "above"
                end, start = (high, band.low) if is_above else (low, band.high)
                edge = BandEdge(design, is_above, end, state.x, start, width, search.limit)
                if not edge.may_leave:
                    continue
                search.follow(peaks, [*edges, edge])
            found = search.descended(state.x)
            if found.feasible and len(_missed_bands(search, found)[0]) < len(missed):
                yield found, (search.peaks, search.edges)
        except SolveError as reason:
            search.failures.append(str(reason))
    search.follow(peaks, edges)


def _worse_between(search: Search, state: State, drop: float) -> list[PeakSpeed]:
    """Return the local maxima versus speed, of the objective or of a bounded quantity, that are worse than
    all values at the design speeds. The spacing of each maximum is the distance, in speed, within which the
    value decreases by `drop`."""
    from scipy.optimize import minimize_scalar

    found = []

    def violation_of(point: DesignPoint) -> float:
        return max(violation for _, violation in search.bounded([point]))

    def excess_of(point: DesignPoint) -> float:
        if not isinstance(search.minimise, Named) or not state.objective:
            return violation_of(point)
        return max(violation_of(point), point.value(search.minimise) / state.objective - 1)

    def excess(speed: float) -> float:
        return excess_of(*search.design.at(state.x, [float(speed)]))

    def spacing(speed: float, top: float) -> float:
        """Return the distance, in speed, within which the excess decreases from its maximum `top` by
        `drop`."""
        near = _SPACING[0] * _WIDER * speed
        decrease = top - (excess(speed - near) + excess(speed + near)) / 2
        wanted = near * math.sqrt(drop / decrease) if decrease > 0 else math.inf
        return min(max(wanted, _SPACING[0] * speed), _SPACING[1] * speed)

    speeds = search.design.speeds
    given = [excess_of(point) for point in search.design.points(state.x)]
    # If no design satisfies a requirement, it is also violated near its worst speed.
    known = max(0.0, *given)
    for (low, first), (high, last) in itertools.pairwise(zip(speeds, given, strict=True)):
        between = np.linspace(low, high, _BETWEEN + 1)
        values = np.array([first, *map(excess, between[1:-1]), last])
        top = int(np.argmax(values))
        if values[top] < -_NEARLY:
            continue
        best: Any = minimize_scalar(
            lambda speed: -excess(speed),
            bounds=(between[max(top - 1, 0)], between[min(top + 1, _BETWEEN)]),
            method="bounded",
            options={"xatol": _SPEED_TOLERANCE * high},
        )
        if -best.fun > known + STATIONARY * search.design.rtol:
            speed = float(best.x)
            (point,), distance = (
                search.design.at(state.x, [speed]),
                min(speed - speeds[0], speeds[-1] - speed),
            )
            is_bound = excess_of(point) == violation_of(point)
            found.append(PeakSpeed(speed, 0.0 if is_bound else min(spacing(speed, -best.fun), distance)))
    return found


def _missed_bands(search: Search, state: State) -> tuple[list[Band], list[str]]:
    """Return the unstable bands in the range that contain no design speed, the one with the largest growth
    first; and a sentence if bands could not be searched for."""
    speeds, model = search.design.speeds, search.design.varied(state.x)
    try:
        found = bands(model, speeds, search.design.method, search.design.rtol)
    except SolveError as reason:
        return [], [f"unstable bands between the speeds were not searched for: {reason}"]
    missed = [band for band in found if not any(band.low <= speed <= band.high for speed in speeds)]
    return sorted(missed, key=lambda band: -band.spectral_radius), []
