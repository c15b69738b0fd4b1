"""The design method for high speed (thesis 7.5): critical speeds, quiet bands and plans for the run-up.

Ratios are those of stress to allowable stress; without a link, the largest ratio of all links.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from models.four_bar.design_map import DesignMap
from models.four_bar.plan import Plan, arrival, least_cap, plan_below
from models.four_bar.stress_map import StressMap
from solve.arrays import Array

RESERVE = 0.03
"""Reserve of the ratio at the default target speed: a choice."""

_MARGIN_FRACTION = 0.75
"""Fraction of the largest possible margin that a plan keeps: a choice; a full margin needs more bends."""

_WORTHWHILE = 0.98
"""Ratio with L4 moving over that with L4 fixed, below which moving L4 is reported as useful: a choice."""

_DAMPING_STEP = 0.1
"""Relative change of ζ to either side in the central difference of the effect of damping: a choice."""

_ROUNDED = 0.01
"""Interval of speeds, over the target speed, in which corners of a plan are rounded: a choice."""


class Band(NamedTuple):
    """Range of speeds (rad/s) with a ratio below 1 at the mechanism's own L4, and its quietest speed."""

    start: float
    end: float
    quietest: float
    ratio: float


class Peak(NamedTuple):
    """A critical speed (rad/s) at the mechanism's own L4, the ratio there, and its link."""

    speed: float
    ratio: float
    link: str


class QuietSpeed(NamedTuple):
    """A quiet speed (rad/s) above a critical speed (`peak`, rad/s).

    needed, fixed: ratio on the way there when L4 changes and returns, and when L4 is fixed.
    """

    peak: float
    speed: float
    needed: float
    fixed: float


class DampingEffect(NamedTuple):
    """Relative change of the largest stress of each link over that of ζ, at a speed (rad/s)."""

    speed: float
    sensitivity: Mapping[str, float]


class NeededRatios(NamedTuple):
    """Smallest possible value of the largest ratio on a path from the lowest speed to each speed (P,).

    L4 keeps the mechanism's own length (`fixed`), ends at any length (`moving`), or ends at the mechanism's
    own length (`returning`).
    """

    fixed: Array
    moving: Array
    returning: Array


@dataclass(frozen=True)
class Design:
    """Speeds that a four-bar can reach under allowable stresses.

    peaks: critical speeds at the mechanism's own L4. quiet: bands there; the first begins at rest, the others
    lie above critical speeds that exceed the allowable stress. quiet_of: bands of each link alone.
    quiet_above: for each critical speed, the speed between it and the next with the smallest ratio when L4
    returns, if moving the pivot is useful.
    """

    map: DesignMap
    needed: NeededRatios
    peaks: list[Peak]
    quiet: list[Band]
    quiet_of: Mapping[str, list[Band]]
    quiet_above: list[QuietSpeed]

    @property
    def limiting(self) -> list[Peak]:
        """Critical speeds that exceed the allowable stress."""
        return [peak for peak in self.peaks if peak.ratio > 1]

    @property
    def rate(self) -> float:
        """Largest change of L4 with speed (m per rad/s): its range within a tenth of the speeds, a choice."""
        return float((self.map.L4[-1] - self.map.L4[0]) / (0.1 * self.map.speeds[-1]))


def designed(stresses: DesignMap) -> Design:
    """Design that follows from a map of stresses."""
    needed, peaks = _needed(stresses), _peaks(stresses)
    own = stresses.ratios[:, stresses.own]
    return Design(
        stresses,
        needed,
        peaks,
        quiet_bands(stresses.speeds, own.max(axis=1)),
        {link: quiet_bands(stresses.speeds, own[:, at]) for at, link in enumerate(stresses.links)},
        _quiet_above(stresses.speeds, needed, peaks),
    )


def _needed(stresses: DesignMap) -> NeededRatios:
    reached = arrival(stresses.ratio)
    fixed = np.maximum.accumulate(stresses.own_ratio)
    return NeededRatios(fixed, reached.min(axis=1), reached[:, stresses.own])


def _peaks(stresses: DesignMap) -> list[Peak]:
    ratio, speeds = stresses.own_ratio, stresses.speeds
    inner = np.flatnonzero((ratio[1:-1] > ratio[:-2]) & (ratio[1:-1] >= ratio[2:])) + 1
    return [
        Peak(
            *_vertex(speeds[at - 1 : at + 2], ratio[at - 1 : at + 2]), stresses.worst_link(float(speeds[at]))
        )
        for at in inner
    ]


def _vertex(speeds: Array, ratio: Array) -> tuple[float, float]:
    """Speed and value of the maximum of the parabola through the logarithms of three points."""
    x, y = (np.log(values / values[1]) for values in (speeds, ratio))
    square, slope, _ = np.polyfit(x, y, 2)
    shift = -slope / (2 * square)
    return float(speeds[1] * np.exp(shift)), float(ratio[1] * np.exp(slope * shift / 2))


def quiet_bands(speeds: Array, ratio: Array) -> list[Band]:
    """Bands of rising speeds (P,) with a ratio (P,) below 1; the first begins at rest."""
    edges = [0.0]
    for at in np.flatnonzero((ratio[:-1] <= 1) != (ratio[1:] <= 1)):
        fraction = math.log(ratio[at]) / (math.log(ratio[at]) - math.log(ratio[at + 1]))
        edges.append(float(speeds[at] + fraction * (speeds[at + 1] - speeds[at])))
    edges.append(float(speeds[-1]))
    loud_first = int(ratio[0] > 1)
    bands = []
    for start, end in zip(edges[loud_first::2], edges[1 + loud_first :: 2], strict=False):
        inside = np.flatnonzero((speeds >= start) & (speeds <= end))
        if len(inside):
            best = inside[ratio[inside].argmin()]
            bands.append(Band(start, end, float(speeds[best]), float(ratio[best])))
    return bands


def _quiet_above(speeds: Array, needed: NeededRatios, peaks: list[Peak]) -> list[QuietSpeed]:
    ends, above = [*(peak.speed for peak in peaks), float(speeds[-1])], []
    for peak, end in zip(peaks, ends[1:], strict=True):
        inside = np.flatnonzero((speeds > peak.speed) & (speeds <= end))
        best = inside[needed.returning[inside].argmin()] if len(inside) else 0
        returning, fixed = float(needed.returning[best]), float(needed.fixed[best])
        if returning < _WORTHWHILE * fixed:
            above.append(QuietSpeed(peak.speed, float(speeds[best]), returning, fixed))
    return above


def damping_effects(stresses: DesignMap, speeds: Array) -> list[DampingEffect]:
    """Effect of damping, d ln σ / d ln ζ, at speeds (rad/s) at the mechanism's own L4."""
    zeta, own = stresses.model.parameters["zeta"], stresses.own_L4
    less, more = (
        np.log(
            StressMap(stresses.model.varied({"zeta": zeta * (1 + sign * _DAMPING_STEP)}), own, own, 1)
            .peaks(speeds, np.array([own]))
            .stress
        )
        for sign in (-1, 1)
    )
    effects = (more - less)[:, 0] / math.log((1 + _DAMPING_STEP) / (1 - _DAMPING_STEP))
    return [
        DampingEffect(float(speed), dict(zip(stresses.links, map(float, row), strict=True)))
        for speed, row in zip(speeds, effects, strict=True)
    ]


def default_target(design: Design) -> float:
    """Default target speed (rad/s).

    It is the quietest speed of the highest reachable quiet band above a limiting critical speed, otherwise
    the highest speed reachable with any L4. Both have a reserve.
    """
    speeds = design.map.speeds
    for band in reversed(design.quiet):
        at = int(np.searchsorted(speeds, band.quietest))
        if band.start > 0 and design.needed.returning[at] <= 1 - RESERVE:
            return band.quietest
    reached = np.flatnonzero(design.needed.moving <= 1 - RESERVE)
    return float(speeds[reached[-1] if len(reached) > 1 else 1])


def least_ratio(until: DesignMap, rate: float, returns: bool) -> float:
    """Smallest ratio of a plan to the last speed of a map, with L4 changing by up to `rate` (m per rad/s)."""
    return least_cap(until.speeds, until.L4, until.ratio, until.own, rate, returns)


def least_ratio_at_any_rate(until: DesignMap) -> float:
    """Smallest ratio without return, where L4 may change at constant speed."""
    return float(arrival(until.ratio)[-1].min())


def plan_to_last(until: DesignMap, rate: float, returns: bool) -> Plan | None:
    """Plan from the lowest to the last speed of a map; None if none exists."""
    best = least_ratio(until, rate, returns)
    if best > 1:
        return None
    cap = best + (1 - _MARGIN_FRACTION) * (1 - best)
    plan = plan_below(until.speeds, until.L4, until.ratio, cap, until.own, rate, returns)
    assert plan is not None
    return Plan(plan.speed, plan.L4, _ROUNDED * float(until.speeds[-1]))


def ratios_along(until: DesignMap, plan: Plan) -> Array:
    """Steady ratios (k, links) along a plan at the speeds (k,) of a map that ends at its target."""
    rows = zip(plan(until.speeds), until.stress, strict=True)
    stress = [[np.interp(L4, until.L4, of_link) for of_link in row.T] for L4, row in rows]
    return np.array(stress) / until.allowable
