"""Search for the optimum of a design: rounds of minimisation from several starts, with additional speeds in a
range."""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from solve.arrays import Array
from solve.errors import SolveError
from solve.period.multipliers import KNOWN_ON_CIRCLE, UNIT_CIRCLE
from solve.period.named import RADIUS, Named
from solve.results.optimum import Requirement
from solve.results.orbit import Orbit
from solve.studies.bands import bands
from solve.studies.design_points import Design, DesignPoint
from solve.studies.kept import KeptValues
from solve.studies.minimax import Limited, minimised, restored
from solve.studies.requirements import Bound, Kept
from solve.studies.robust import Robust, Statistic
from solve.studies.tracked import Function, Single, Tracked, tracked
from solve.terminal import progress

ROUNDS = "rounds"
"""Name of the unit in progress reports."""

_MAX_ROUNDS = 30
"""Largest number of rounds, each of which follows the extrema that are largest at its start. A choice: cam
and manipulator take up to 8."""

_SHRINKING, _SMALLEST_REACH = 4.0, 1e-6
"""Factor by which the largest change of x is reduced after a round without gain, and lower limit of this
change. Choices."""

_STATIONARY = 100.0
"""Relative change of the objective in a round, in units of rtol, below which the search ends. With 10, the
search does not end for some optima of the manipulator, because the errors of the orbits differ between
grids."""

_VIOLATION = 1e-7
"""Largest violation of a bound, relative to its scale, with which the bound counts as satisfied. A choice."""

_BETWEEN, _MAX_ADDED = 4, 10
"""Number of parts of each interval of speeds at whose ends the optimum of a range is checked, and largest
number of rounds in which speeds are added. Choices."""

_NEARLY = 0.01
"""Largest relative difference from the largest value with which a maximum between speeds is refined. A
choice."""

_SPEED_TOLERANCE = 1e-5
"""Relative tolerance of a refined speed. A choice: the value at a maximum changes by the square of the speed
error."""

_RADIUS = Named(RADIUS, "1", RADIUS)


@dataclass(frozen=True)
class State:
    """Design with its largest objective value and its violation of the requirements (0 if none)."""

    x: Array
    objective: float
    violation: float

    @property
    def feasible(self) -> bool:
        """Whether all requirements hold."""
        return self.violation <= _VIOLATION

    def better_than(self, other: "State") -> bool:
        """Whether the design violates the requirements less, or equally with a lower objective."""
        if other.feasible:
            return self.feasible and self.objective < other.objective
        lower = self.violation <= other.violation and self.objective < other.objective
        return lower or self.violation < other.violation / 2


@dataclass(eq=False)
class Search:
    """Search for the optimum of a quantity, or of a function of the orbits at all speeds.

    machines, statistic: deviating machines of a robust objective, and the statistic of their values that is
    minimised. limit: limit of the spectral radius. failures: reasons of trials without a solution.
    """

    design: Design
    minimise: Named | Callable[[Sequence[Orbit]], float]
    bounds: Sequence[Bound]
    kept: Sequence[Kept]
    machines: Sequence[Design] = ()
    statistic: Statistic | None = None
    failures: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        verdicts = {point.solved.verdict for point in self.design.points(self.design.start)}
        # Without damping, all multipliers remain on the unit circle.
        self.limit = 1 + KNOWN_ON_CIRCLE if verdicts == {"stable"} else 1 - UNIT_CIRCLE
        self.kept_values = KeptValues(self.design, self.kept)
        self._evaluate_kept()

    def _evaluate_kept(self) -> None:
        """Evaluate equations and limits of the kept quantities, which depend only on the start and the
        speeds."""
        self.equations, self.kept_limits = self.kept_values.equations(), self.kept_values.limits()

    def best(self, starts: int) -> State:
        """Best local optimum from the given start and from random ones. Raises the exception of the given
        start."""
        best = self._local_optimum(self.design.start)
        for x in np.random.default_rng(0).random((starts - 1, len(best.x))):
            try:
                state = self._local_optimum(x)
            except SolveError as reason:
                self.failures.append(str(reason))
            else:
                best = state if state.better_than(best) else best
        return best

    def over_range(self, state: State) -> tuple[State, list[str]]:
        """Optimum after insertion of speeds, between the given ones, at which values are worse; and reasons
        for doubt."""
        for _ in range(_MAX_ADDED):
            added = self._worse_between(state)
            if not added:
                return state, self._missed_bands(state)
            for speed in added:
                at = int(np.searchsorted(self.design.speeds, speed))
                (start,) = self.design.at(self.design.start, [speed])
                self.design.speeds.insert(at, speed)
                self.kept_values.insert(at, start)
            self._evaluate_kept()
            state = self._local_optimum(state.x)
        remaining, doubts = self._worse_between(state), self._missed_bands(state)
        if remaining:
            texts = ", ".join(map(self.design.model.labels.speed_unit.text, remaining))
            doubts.append(f"at {texts} values are worse than at the optimised speeds; give more speeds")
        return state, doubts

    def values(self, points: Sequence[DesignPoint]) -> Array:
        """Value (k,) of the minimised quantity at each speed. If a function is minimised, its single value is
        repeated."""
        if isinstance(self.minimise, Named):
            return np.array([point.value(self.minimise) for point in points])
        return np.full(len(points), Function(self.design, self.minimise).of(points))

    def values_at(self, x: Array, points: Sequence[DesignPoint]) -> Array:
        """Objective (k,) at each speed, over the deviating machines if it is robust. points: the solutions at
        x."""
        if self.statistic is None:
            return self.values(points)
        return np.concatenate([each.values(x) for each in self._objective(x)])

    def requirements(self, points: Sequence[DesignPoint]) -> list[Requirement]:
        """Requirements with their worst values over the speeds."""
        changes = [
            Requirement(f"change of {each.text}", change, allowed)
            for each, change, allowed in self.kept_values.changes(points)
        ]
        return [requirement for requirement, _ in self._bounded(points)] + changes

    def _bounded(self, points: Sequence[DesignPoint]) -> list[tuple[Requirement, float]]:
        """Bounds with the worst values over the speeds, and their violations (negative if satisfied)."""
        radius = max(map(_safe_radius, points))
        bounded = [(Requirement(RADIUS, radius, self.limit), radius - self.limit)]
        for each in self.bounds:
            values = [each.sign * point.value(each.quantity) for point in points]
            worst = int(np.argmax(values))
            violation = (values[worst] - each.sign * each.value) / _scale(each, points[worst])
            bounded.append((Requirement(each.text, each.sign * values[worst], each.value), violation))
        return bounded

    def _state(self, x: Array) -> State:
        points = self.design.points(x)
        violations = [violation for _, violation in self._bounded(points)]
        # Twice the allowed change of a kept quantity counts as a violation of a bound by 1e-7.
        violations += [
            _VIOLATION * (change / allowed - 1) for _, change, allowed in self.kept_values.changes(points)
        ]
        return State(x, float(self.values_at(x, points).max()), max(0.0, *violations))

    def _local_optimum(self, x: Array) -> State:
        """Local optimum from a start. Raises the exception of the start if it has no solution."""
        state, reach = self._state(x), 0.5
        for _ in range(_MAX_ROUNDS):
            try:
                with progress.subtask(ROUNDS):
                    x, change = self._round(state.x, reach)
                    trial = self._state(x)
            except SolveError as reason:
                self.failures.append(str(reason))
                reach /= _SHRINKING
            else:
                is_last = state.feasible and abs(change) <= _STATIONARY * self.design.rtol
                if trial.better_than(state):
                    state = trial
                else:
                    reach /= _SHRINKING
                if is_last:
                    break
            if reach < _SMALLEST_REACH:
                break
        return state

    def _round(self, x: Array, reach: float) -> tuple[Array, float]:
        """Optimum near x, for the extrema that are largest near x, and the relative change of the
        objective."""
        design, limits = self.design, [*self.kept_limits]
        for at, point in enumerate(design.points(x)):
            for each in self.bounds:
                values = tracked(design, x, at, each.quantity, each.sign)
                limits.append(Limited(values, each.sign * each.value, _scale(each, point)))
            factor = 1 + point.solved.error_estimate.multipliers
            limits.append(Limited(Single(design, at, _RADIUS, factor=factor), self.limit, 1.0))
        rtol = _STATIONARY * design.rtol
        x, change = minimised(self._objective(x), limits, self.equations, x, reach, rtol)
        return (x if self.equations is None else restored(self.equations, x)), change

    def _objective(self, x: Array) -> list[Tracked]:
        if not isinstance(self.minimise, Named):
            return [Function(self.design, self.minimise)]
        if self.statistic:
            return [
                Robust(self.machines, at, self.minimise, self.statistic)
                for at in range(len(self.design.speeds))
            ]
        return [tracked(self.design, x, at, self.minimise) for at in range(len(self.design.speeds))]

    def _worse_between(self, state: State) -> list[float]:
        """Speeds between those of the design at which the objective or a bound has a local maximum and is
        worse than at the design's speeds."""
        from scipy.optimize import minimize_scalar

        found = []

        def excess_of(point: DesignPoint) -> float:
            excesses = [violation for _, violation in self._bounded([point])]
            if isinstance(self.minimise, Named):
                value = point.value(self.minimise)
                excesses.append(value / state.objective - 1 if state.objective else 0.0)
            return max(excesses)

        def excess(speed: float) -> float:
            return excess_of(*self.design.at(state.x, [float(speed)]))

        given = zip(self.design.speeds, map(excess_of, self.design.points(state.x)), strict=True)
        for (low, first), (high, last) in itertools.pairwise(given):
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
            if -best.fun > _STATIONARY * self.design.rtol:
                found.append(float(best.x))
        return found

    def _missed_bands(self, state: State) -> list[str]:
        """Sentence on each unstable band of the range that contains no speed of the design."""
        speeds, model = self.design.speeds, self.design.varied(state.x)
        text = model.labels.speed_unit.text
        try:
            found = bands(model, speeds, self.design.method, self.design.rtol)
        except SolveError as reason:
            return [f"unstable bands between the speeds were not searched for: {reason}"]
        return [
            f"unstable from {text(band.low)} to {text(band.high)}, between the speeds; give more speeds"
            for band in found
            if not any(band.low <= speed <= band.high for speed in speeds)
        ]


def _safe_radius(point: DesignPoint) -> float:
    """Spectral radius plus its error."""
    return point.solved.spectral_radius * (1 + point.solved.error_estimate.multipliers)


def _scale(bound: Bound, point: DesignPoint) -> float:
    return abs(bound.value) or abs(point.value(bound.quantity)) or 1.0
