"""The design method for high speed (thesis 7.5): limiting critical speeds, quiet bands, the run-up plan.

Ratios are those of stress to allowable stress, the greatest of all links where no link is named.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import Akima1DInterpolator

from models.four_bar.linkage import ADVISED, Linkage
from models.four_bar.run_up.plan import Plan, arrival, least_cap, plan_below
from models.four_bar.run_up.stress_map import StressMap
from solve.arrays import Array
from solve.beams.model import StructureModel
from solve.errors import MissingValueError, SolveError, UnknownNameError, ValueOutOfBoundsError

_RESOLVED, _FINEST, _ROUNDS = 0.01, 0.25, 8
"""Relative error of interpolation over an interval of speeds below which it is left; its relative length
below which it is, as part of ζ, for peaks are 2ζ wide; how often intervals are halved at most."""

RESERVE = 0.03
"""Part of the allowable stress that the speed to run up to leaves, where none is asked for."""

_KEPT = 0.75
"""Part of the greatest possible margin that a plan keeps, so that it need not bend for the rest."""

_HELPS = 0.98
"""Part of the stress needed with L4 fixed below which it is worth while to move it."""

_DAMPING_STEP = 0.1
_LEAD = 0.01
"""Part of the target speed over which corners of a plan are rounded."""

Progress = Callable[[str, int], None]


class DesignError(SolveError):
    """A design that is asked for what this mechanism cannot do at any stress: a length, a speed."""


def silent(what: str, done: int) -> None:
    """No progress is told."""


@dataclass(frozen=True)
class Band:
    """Speeds (rad/s) between which the ratio stays below 1 at the own L4, and the quietest of them."""

    start: float
    end: float
    quietest: float
    ratio: float


@dataclass(frozen=True)
class Peak:
    """A critical speed (rad/s) at the own L4: a maximum of the ratio over the speed, the link that has it."""

    speed: float
    ratio: float
    link: str


@dataclass(frozen=True)
class Damping:
    """Percent by which each link's largest stress changes when ζ grows by one percent, at a speed."""

    speed: float
    sensitivity: Mapping[str, float]


@dataclass(frozen=True)
class Beyond:
    """A quiet speed (rad/s) above a critical speed (`peak`, rad/s), and which part of the allowable
    stresses is needed to reach it when L4 changes on the way and returns, and when it stays (`fixed`)."""

    peak: float
    speed: float
    needed: float
    fixed: float


class Design:
    """What a four-bar can do under an allowable stress (Pa) of each link.

    speeds (P,), L4 (g,): rad/s and m, where the map is known; stress (P, g, links) in Pa, error (P,) and
    growth (P,) as in `Peaks`; missed: the largest relative error of interpolation between the speeds, found
    where an interval was halved last; own: the number of the mechanism's own L4.
    """

    def __init__(
        self,
        model: StructureModel,
        allowable: Mapping[str, float],
        speeds: Array,
        lengths: tuple[float, float],
        count: int = 48,
        progress: Progress = silent,
    ):
        """`speeds` at first, to be refined; `count` lengths beside the own. Raises DesignError and
        ValueOutOfBoundsError for what cannot be."""
        self.model, self.own_L4 = model, model.parameters["L4"]
        self.allowable = np.array([allowable[link.name] for link in model.beams.freedoms.links])
        if model.parameters["zeta"] <= 0:
            raise DesignError("zeta is 0: undamped critical speeds have no finite stress; set zeta > 0")
        if not lengths[0] < lengths[1]:
            raise DesignError(
                f"L4 from {lengths[0]:g} to {lengths[1]:g} m leaves the pivot nowhere to go; widen the range"
            )
        if not lengths[0] <= self.own_L4 <= lengths[1]:
            raise DesignError(
                f"the mechanism's own L4, {self.own_L4:g} m, is not between {lengths[0]:.4f} and "
                f"{lengths[1]:.4f} m, the lengths allowed; widen --L4"
            )
        self.map = StressMap(model, *lengths)
        self.L4 = np.unique([*np.linspace(*lengths, count), self.own_L4])
        self.own = int(np.searchsorted(self.L4, self.own_L4))
        self.missed = 0.0
        self.speeds, self.stress, self.error, self.growth = self._refined(speeds, progress)
        if self.ratio[0, self.own] > 1:
            raise DesignError(
                f"at {self.speeds[0]:.4g} rad/s, the lowest speed, the stress is already "
                f"{self.ratio[0, self.own]:.4g} times the allowable one; begin --speeds lower or allow more"
            )

    @property
    def links(self) -> list[str]:
        return self.map.links

    @cached_property
    def ratio(self) -> Array:
        """(P, g)."""
        return (self.stress / self.allowable).max(axis=2)

    @cached_property
    def reached(self) -> Array:
        """Least greatest ratio (P, g) on the way from the lowest speed."""
        return arrival(self.ratio)

    @property
    def with_pivot(self) -> Array:
        """Least greatest ratio (P,) to reach each speed with L4 anywhere at the end."""
        return self.reached.min(axis=1)

    @property
    def with_return(self) -> Array:
        """The same with L4 back at its own length at the end."""
        return self.reached[:, self.own]

    @property
    def without_pivot(self) -> Array:
        """The same with L4 at its own length throughout."""
        return np.maximum.accumulate(self.ratio[:, self.own])

    @cached_property
    def peaks(self) -> list[Peak]:
        """Critical speeds at the own L4."""
        values = self.ratio[:, self.own]
        inner = np.flatnonzero((values[1:-1] > values[:-2]) & (values[1:-1] >= values[2:])) + 1
        found = []
        for at in map(int, inner):
            found.append(Peak(*self._vertex(at, values), self.worst_link(float(self.speeds[at]))))
        return found

    def _vertex(self, at: int, values: Array) -> tuple[float, float]:
        """Speed and value of the maximum of a parabola through the logarithms of a maximum and its
        neighbours."""
        x, y = (np.log(part[at - 1 : at + 2] / part[at]) for part in (self.speeds, values))
        square, slope, _ = np.polyfit(x, y, 2)
        shift = -slope / (2 * square)
        return float(self.speeds[at] * np.exp(shift)), float(values[at] * np.exp(slope * shift / 2))

    def worst_link(self, speed: float) -> str:
        """The link with the greatest ratio at a speed of the map, at the own L4."""
        at = int(np.searchsorted(self.speeds, speed))
        return self.links[int((self.stress[at, self.own] / self.allowable).argmax())]

    @property
    def limiting(self) -> list[Peak]:
        """Critical speeds that exceed the allowable stress."""
        return [peak for peak in self.peaks if peak.ratio > 1]

    @property
    def beyond(self) -> list[Beyond]:
        """Above each critical speed, before a higher peak, the speed that is reached with the least
        allowable stress when L4 returns, where moving the pivot helps."""
        ends, found = [*(peak.speed for peak in self.peaks), float(self.speeds[-1])], []
        for peak, end in zip(self.peaks, ends[1:], strict=True):
            inside = np.flatnonzero((self.speeds > peak.speed) & (self.speeds <= end))
            best = inside[self.with_return[inside].argmin()] if len(inside) else 0
            part, fixed = float(self.with_return[best]), float(self.without_pivot[best])
            if part < _HELPS * fixed:
                found.append(Beyond(peak.speed, float(self.speeds[best]), part, fixed))
        return found

    def bands(self, ratio: Array) -> list[Band]:
        """Bands of a ratio (P,) over the speeds below 1."""
        speeds, edges = self.speeds, [0.0]
        for at in np.flatnonzero((ratio[:-1] <= 1) != (ratio[1:] <= 1)):
            part = math.log(ratio[at]) / (math.log(ratio[at]) - math.log(ratio[at + 1]))
            edges.append(float(speeds[at] + part * (speeds[at + 1] - speeds[at])))
        edges.append(float(speeds[-1]))
        quiet = bool(ratio[0] <= 1)
        found = []
        for start, end in zip(edges[not quiet :: 2], edges[1 + (not quiet) :: 2], strict=False):
            inside = np.flatnonzero((speeds >= start) & (speeds <= end))
            if len(inside):
                best = inside[ratio[inside].argmin()]
                found.append(Band(start, end, float(speeds[best]), float(ratio[best])))
        return found

    @cached_property
    def quiet(self) -> list[Band]:
        """Bands at the own L4: the first begins at rest, the others lie above limiting critical speeds."""
        return self.bands(self.ratio[:, self.own])

    def quiet_of(self, link: str) -> list[Band]:
        """Those of one link alone."""
        number = self.links.index(link)
        return self.bands(self.stress[:, self.own, number] / self.allowable[number])

    def damping(self, speeds: Array) -> list[Damping]:
        """Whether damping helps at speeds, at the own L4: d ln σ / d ln ζ."""
        zeta = self.model.parameters["zeta"]
        less, more = (
            np.log(self._own_map({"zeta": zeta * (1 + sign * _DAMPING_STEP)}).peaks(speeds, self._own).stress)
            for sign in (-1, 1)
        )
        rates = (more - less)[:, 0] / math.log((1 + _DAMPING_STEP) / (1 - _DAMPING_STEP))
        return [
            Damping(float(speed), dict(zip(self.links, map(float, row), strict=True)))
            for speed, row in zip(speeds, rates, strict=True)
        ]

    def _own_map(self, changed: Mapping[str, float]) -> StressMap:
        return StressMap(self.model.varied(changed), self.own_L4, self.own_L4, 1)

    @property
    def _own(self) -> Array:
        return np.array([self.own_L4])

    @cached_property
    def rate(self) -> float:
        """Largest change of L4 with speed (m a rad/s): the whole range within a tenth of the speeds."""
        return float((self.L4[-1] - self.L4[0]) / (0.1 * self.speeds[-1]))

    def goal(self) -> float:
        """The speed (rad/s) to run up to where none is asked for: the quietest of the highest quiet band
        above a limiting critical speed that can be reached; else the greatest speed that can, if need be
        with another L4. Both with a reserve."""
        for band in reversed(self.quiet):
            at = int(np.searchsorted(self.speeds, band.quietest))
            if band.start > 0 and self.with_return[at] <= 1 - RESERVE:
                return band.quietest
        fits = np.flatnonzero(self.with_pivot <= 1 - RESERVE)
        return float(self.speeds[fits[-1] if len(fits) > 1 else 1])

    def least_allowable(self, target: float, returns: bool) -> float:
        """The part of the allowable stresses that a plan to the target speed needs at least."""
        part = self.until(target)
        return least_cap(part, self.L4, self._ratio_until(target), self.own, self.rate, returns)

    def doubt(self, target: float) -> float:
        """Relative error of the stresses up to a speed, of the greater of the map's two kinds."""
        return max(self.missed, float(np.nanmax(self.error[self.speeds <= target])))

    def least_resting(self, target: float) -> float:
        """As `least_allowable` without return, where L4 may also change as far as it likes at one speed."""
        return float(arrival(self._ratio_until(target))[-1].min())

    def plan(self, target: float, returns: bool) -> Plan | None:
        """The plan from the lowest speed to the target (rad/s), or None where there is none."""
        best = self.least_allowable(target, returns)
        if best > 1:
            return None
        cap, part = best + (1 - _KEPT) * (1 - best), self.until(target)
        found = plan_below(part, self.L4, self._ratio_until(target), cap, self.own, self.rate, returns)
        assert found is not None
        return Plan(found.speed, found.L4, _LEAD * target)

    def along(self, plan: Plan) -> Array:
        """Steady ratios (k, links) along a plan, at the map's speeds (k,) up to its last."""
        speeds = self.until(float(plan.speed[-1]))
        rows = zip(plan(speeds), self._stress_until(speeds[-1]), strict=True)
        found = [[np.interp(L4, self.L4, link) for link in row.T] for L4, row in rows]
        return np.array(found) / self.allowable

    def until(self, target: float) -> Array:
        """The speeds of the map up to the target, and this."""
        below = self.speeds[self.speeds < target * (1 - 1e-9)]
        return np.append(below, target)

    def _stress_until(self, target: float) -> Array:
        """Stresses (k, g, links) at these speeds."""
        below = len(self.until(target)) - 1
        if target in self.speeds:
            return self.stress[: below + 1]
        return np.concatenate((self.stress[:below], self.map.peaks(np.array([target]), self.L4).stress))

    def _ratio_until(self, target: float) -> Array:
        return (self._stress_until(target) / self.allowable).max(axis=2)

    def _refined(self, speeds: Array, progress: Progress) -> tuple[Array, Array, Array, Array]:
        """Speeds, stresses, errors, growths; intervals are halved where the map between is not resolved."""
        narrow, found = np.ones(len(speeds) - 1, dtype=bool), self._points(speeds, 0, progress)
        for _ in range(_ROUNDS):
            at = np.log(found[0])
            narrow &= np.diff(at) > _FINEST * self.model.parameters["zeta"]
            if not narrow.any():
                break
            middle = ((at[:-1] + at[1:]) / 2)[narrow]
            added = self._points(np.exp(middle), len(at), progress)
            guess = np.exp(Akima1DInterpolator(at, np.log(found[1]))(middle))
            guess, exact = ((part / self.allowable).max(axis=2) for part in (guess, added[1]))
            missed = np.abs(guess / exact - 1).max(axis=1)
            rough = np.zeros(len(narrow), dtype=bool)
            rough[narrow] = missed > _RESOLVED
            self.missed = float(missed.max())
            place, narrow = 1 + np.flatnonzero(narrow), np.repeat(rough, 1 + narrow)
            found = [np.insert(old, place, new, axis=0) for old, new in zip(found, added, strict=True)]
        return found[0], found[1], found[2], found[3]

    def _points(self, speeds: Array, before: int, progress: Progress) -> list[Array]:
        peaks = self.map.peaks(speeds, self.L4, lambda done: progress("stress map", before + done))
        return [speeds, peaks.stress, peaks.error, peaks.growth.max(axis=1)]


def allowed_lengths(linkage: Linkage, angles: tuple[float, float] = ADVISED) -> tuple[float, float]:
    """Least and greatest L4 (m) at which the crank turns fully and the transmission angle stays between
    two angles (rad; thesis 3.3 advises 40° to 140°). Raises DesignError where there is none."""
    L1, L2, L3 = linkage.L1, linkage.L2, linkage.L3
    near, far = (math.sqrt(L2**2 + L3**2 - 2 * L2 * L3 * math.cos(angle)) for angle in angles)
    low, high = L1 + near, far - L1
    if not low < high:
        least, most = (math.degrees(angle) for angle in angles)
        raise DesignError(
            f"no L4 keeps the transmission angle between {least:g}° and {most:g}° with L1, L2, L3 = "
            f"{L1:g}, {L2:g}, {L3:g} m; shorten the crank or give --L4"
        )
    return low, high


def checked_allowable(links: list[str], given: Mapping[str, float]) -> dict[str, float]:
    """Allowable stresses (Pa) by link. Raises UnknownNameError, MissingValueError, ValueOutOfBoundsError."""
    for link, stress in given.items():
        if link not in links:
            raise UnknownNameError("link", link, links)
        if not (math.isfinite(stress) and stress > 0):
            raise ValueOutOfBoundsError(
                f"allowable stress of the {link} is {stress / 1e6:g} MPa; allowed: finite, > 0, like 100 MPa"
            )
    missing = [link for link in links if link not in given]
    if missing:
        raise MissingValueError(
            f"no allowable stress for {', '.join(missing)}; give one for each link or one for all"
        )
    return dict(given)
