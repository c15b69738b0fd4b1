"""Design method for high speed (section 7.5 of the thesis): critical speeds, quiet bands and run-up plan.

A stress ratio is the stress divided by the allowable stress. If no link is named, it is the largest ratio of
all links.
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
from solve.results.serialization import serializable

RESERVE = 0.03
"""Margin by which the stress ratio is below 1 at the default target speed. Chosen by judgement."""

_MARGIN_FRACTION = 0.75
"""Fraction of the largest possible stress margin that a plan must have. Chosen by judgement: with the full
margin, a plan has more bends."""

_WORTHWHILE = 0.98
"""A variation of L4 is reported as useful if it reduces the stress ratio to less than this fraction of the
ratio with fixed L4. Chosen by judgement."""

_DAMPING_STEP = 0.1
"""Relative step of ζ in the central difference for the effect of damping. Chosen by judgement."""

_ROUNDED = 0.01
"""Length of the speed interval over which a corner of a plan is rounded, relative to the target speed. Chosen
by judgement."""


class Band(NamedTuple):
    """Range of speeds (rad/s) in which the stress ratio is below 1 for the mechanism's own L4, and the
    quietest speed in this range."""

    start: float
    end: float
    quietest: float
    ratio: float


class Peak(NamedTuple):
    """Critical speed (rad/s) for the mechanism's own L4, with the stress ratio and the name of the link that
    has this ratio."""

    speed: float
    ratio: float
    link: str


class QuietSpeed(NamedTuple):
    """Quiet speed (rad/s) above a critical speed (`peak`, rad/s).

    `needed` and `fixed` are the largest stress ratios during a run-up to this speed: `needed` if L4 changes
    and returns, `fixed` if L4 is fixed.
    """

    peak: float
    speed: float
    needed: float
    fixed: float


class DampingEffect(NamedTuple):
    """Effect of damping at a speed (rad/s): relative change of the largest stress of each link, divided by
    the relative change of ζ."""

    speed: float
    sensitivity: Mapping[str, float]


class NeededRatios(NamedTuple):
    """Smallest attainable value of the largest stress ratio on a path from the lowest speed to each speed
    (P,).

    In `fixed`, L4 keeps the mechanism's own length. In `moving`, L4 changes and may end at any length. In
    `returning`, it changes and ends at the mechanism's own length.
    """

    fixed: Array
    moving: Array
    returning: Array


@dataclass(frozen=True)
class Design:
    """Speeds that a four-bar linkage can reach within given allowable stresses.

    `peaks` are the critical speeds for the mechanism's own L4, and `quiet` the quiet bands for this L4. The
    first band begins at rest; the others lie above critical speeds at which the stress exceeds the allowable
    stress. `quiet_of` contains the bands of each link alone. If a variation of L4 is useful, `quiet_above`
    contains, for each critical speed, the speed with the smallest ratio below the next critical speed, for an
    L4 that returns.
    """

    map: DesignMap
    needed: NeededRatios
    peaks: list[Peak]
    quiet: list[Band]
    quiet_of: Mapping[str, list[Band]]
    quiet_above: list[QuietSpeed]

    @property
    def limiting(self) -> list[Peak]:
        """Critical speeds at which the stress exceeds the allowable one."""
        return [peak for peak in self.peaks if peak.ratio > 1]

    @property
    def rate(self) -> float:
        """Largest permitted change of L4 with speed (m per rad/s). Chosen by judgement: L4 can pass through
        its entire range within a tenth of the range of speeds."""
        return float((self.map.L4[-1] - self.map.L4[0]) / (0.1 * self.map.speeds[-1]))


def designed(stresses: DesignMap) -> Design:
    """Derive the design from a map of stresses."""
    needed, peaks = _needed(stresses), _peaks(stresses)
    own_ratio = stresses.ratios[:, stresses.own_index]
    return Design(
        stresses,
        needed,
        peaks,
        quiet_bands(stresses.speeds, own_ratio.max(axis=1)),
        {link: quiet_bands(stresses.speeds, own_ratio[:, at]) for at, link in enumerate(stresses.links)},
        _quiet_above(stresses.speeds, needed, peaks),
    )


def _needed(stresses: DesignMap) -> NeededRatios:
    reached = arrival(stresses.ratio)
    fixed = np.maximum.accumulate(stresses.own_ratio)
    return NeededRatios(fixed, reached.min(axis=1), reached[:, stresses.own_index])


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
    """Return the speed and the value of the maximum, from a parabola through the logarithms of the ratios at
    three points."""
    x, y = (np.log(values / values[1]) for values in (speeds, ratio))
    square, slope, _ = np.polyfit(x, y, 2)
    shift = -slope / (2 * square)
    return float(speeds[1] * np.exp(shift)), float(ratio[1] * np.exp(slope * shift / 2))


def quiet_bands(speeds: Array, ratio: Array) -> list[Band]:
    """Return the bands of ascending speeds (P,) in which the stress ratio (P,) is below 1. The first band
    begins at rest."""
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
    """Compute the effect of damping, d ln σ / d ln ζ, at speeds (rad/s) for the mechanism's own L4."""
    zeta, own_L4 = stresses.model.labels.parameters["zeta"], stresses.own_L4
    less, more = (
        np.log(
            StressMap(stresses.model.varied({"zeta": zeta * (1 + sign * _DAMPING_STEP)}), own_L4, own_L4, 1)
            .peaks(speeds, np.array([own_L4]))
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
    """Return the default target speed (rad/s) of a run-up.

    It is the quietest speed of the highest reachable quiet band above a limiting critical speed or, if there
    is no such band, the highest speed that is reachable with any L4. In both cases, the stress margin is at
    least `RESERVE`.
    """
    speeds = design.map.speeds
    for band in reversed(design.quiet):
        at = int(np.searchsorted(speeds, band.quietest))
        if band.start > 0 and design.needed.returning[at] <= 1 - RESERVE:
            return band.quietest
    reached = np.flatnonzero(design.needed.moving <= 1 - RESERVE)
    return float(speeds[reached[-1] if len(reached) > 1 else 1])


def least_ratio(until: DesignMap, rate: float, returns: bool) -> float:
    """Return the smallest attainable value of the largest stress ratio on a plan up to the last speed of a
    map. L4 changes by at most `rate` (m per rad/s)."""
    return least_cap(until.speeds, until.L4, until.ratio, until.own_index, rate, returns)


def least_ratio_at_any_rate(until: DesignMap) -> float:
    """Return the smallest attainable ratio if L4 may also change at constant speed, and need not return to
    the mechanism's own length."""
    return float(arrival(until.ratio)[-1].min())


def plan_to_last(until: DesignMap, rate: float, returns: bool) -> Plan | None:
    """Return a plan from the lowest to the last speed of a map; None if no plan exists."""
    best = least_ratio(until, rate, returns)
    if best > 1:
        return None
    cap = best + (1 - _MARGIN_FRACTION) * (1 - best)
    plan = plan_below(until.speeds, until.L4, until.ratio, cap, until.own_index, rate, returns)
    assert plan is not None
    return Plan(plan.speed, plan.L4, _ROUNDED * float(until.speeds[-1]))


def ratios_along(until: DesignMap, plan: Plan) -> Array:
    """Return the stress ratios (k, links) of steady motion along a plan, at the k speeds of the map that are
    below the target."""
    rows = zip(plan(until.speeds), until.stress, strict=True)
    stress = [[np.interp(L4, until.L4, of_link) for of_link in row.T] for L4, row in rows]
    return np.array(stress) / until.allowable


for _kind in (Band, DampingEffect, Design, NeededRatios, Peak, QuietSpeed):
    serializable(_kind)
