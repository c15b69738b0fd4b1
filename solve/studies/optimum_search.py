"""Search of the optimum of a design: rounds of minimisation from several starts, and further speeds of a
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
from solve.studies.design_points import Design, DesignPoint
from solve.studies.kept import KeptValues
from solve.studies.minimax import Limited, minimised, restored
from solve.studies.requirements import Bound, Kept
from solve.studies.robust import Robust
from solve.studies.tracked import Function, Single, Tracked, tracked
from solve.terminal import progress

ROUNDS = "rounds"
"""Name of the unit in progress reports."""

_MAX_ROUNDS = 30
"""Most rounds, each of which follows the extrema that lead at its start. A choice: cam and manipulator take
up to 8."""

_SHRINKING, _SMALLEST_REACH = 4.0, 1e-6
"""Reduction of the largest change of x after a round that gained nothing, and its limit. Choices."""

_STATIONARY = 100.0
"""Change of the objective in a round, relative and in units of rtol, below which the search ends. With 10 the
errors of the orbits, which differ from grid to grid, prevent the end for some optima of the manipulator."""

_VIOLATION = 1e-7
"""Violation of a bound, relative to its scale, that counts as none. A choice."""

_BETWEEN, _MAX_ADDED = 4, 10
"""Parts of each interval of speeds, at whose ends the optimum of a range is checked, and most rounds in which
speeds are added. Choices."""

_NEARLY = 0.01
"""Distance below the largest value, relative to it, from which on a maximum between speeds is refined. A
choice."""

_SPEED_TOLERANCE = 1e-5
"""Tolerance of a refined speed, relative to it: the value at a maximum changes by its square. A choice."""

_RADIUS = Named(RADIUS, "1", RADIUS)


@dataclass(frozen=True)
class State:
    """A design with the largest value of the objective, and its violation of requirements; 0 for none."""

    x: Array
    objective: float
    violation: float

    @property
    def feasible(self) -> bool:
        """Whether all requirements hold."""
        return self.violation <= _VIOLATION

    def better_than(self, other: "State") -> bool:
        """Whether requirements hold better, or equally well with a lower objective."""
        if other.feasible:
            return self.feasible and self.objective < other.objective
        lower = self.violation <= other.violation and self.objective < other.objective
        return lower or self.violation < other.violation / 2


@dataclass(eq=False)
class Search:
    """Search of the optimum of a quantity, or of a function of the orbits at all speeds.

    machines, multiple: deviating machines of a robust objective, and its multiple of the standard deviation.
    limit: of the spectral radius. failures: reasons of trials without a solution.
    """

    design: Design
    minimise: Named | Callable[[Sequence[Orbit]], float]
    bounds: Sequence[Bound]
    kept: Sequence[Kept]
    machines: Sequence[Design] = ()
    multiple: float = 0.0
    failures: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        verdicts = {point.solved.verdict for point in self.design.points(self.design.start)}
        # Without damping, multipliers remain on the unit circle.
        self.limit = 1 + KNOWN_ON_CIRCLE if verdicts == {"stable"} else 1 - UNIT_CIRCLE
        self.kept_values = KeptValues(self.design, self.kept)
        self._evaluate_kept()

    def _evaluate_kept(self) -> None:
        """Equations and limits of the kept quantities, which depend on the start and on the speeds only."""
        self.equations, self.kept_limits = self.kept_values.equations(), self.kept_values.limits()

    def best(self, starts: int) -> State:
        """Best local optimum from the start and from random ones. Raises the error of the start."""
        best = self._descended(self.design.start)
        for x in np.random.default_rng(0).random((starts - 1, len(best.x))):
            try:
                state = self._descended(x)
            except SolveError as reason:
                self.failures.append(str(reason))
            else:
                best = state if state.better_than(best) else best
        return best

    def over_range(self, state: State) -> tuple[State, list[str]]:
        """Optimum with further speeds where values between those given are worse, and what is doubtful."""
        for _ in range(_MAX_ADDED):
            added = self._worse_between(state)
            if not added:
                return state, []
            for speed in added:
                at = int(np.searchsorted(self.design.speeds, speed))
                (start,) = self.design.at(self.design.start, [speed])
                self.design.speeds.insert(at, speed)
                self.kept_values.insert(at, start)
            self._evaluate_kept()
            state = self._descended(state.x)
        remaining = self._worse_between(state)
        if not remaining:
            return state, []
        texts = ", ".join(map(self.design.model.labels.speed_unit.text, remaining))
        return state, [f"at {texts} values are worse than at the optimised speeds; give more speeds"]

    def values(self, points: Sequence[DesignPoint]) -> Array:
        """Minimised quantity (k,) at each speed; the value of a function at each."""
        if isinstance(self.minimise, Named):
            return np.array([point.value(self.minimise) for point in points])
        return np.full(len(points), Function(self.design, self.minimise).of(points))

    def values_at(self, x: Array, points: Sequence[DesignPoint]) -> Array:
        """Objective (k,) at each speed, with the deviations of a robust one; points: the solutions at x."""
        if not self.machines:
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
        """Bounds with the worst values over speeds, and their violations; negative if they hold."""
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
        # Twice what is allowed violates a kept quantity as much as 1e-7 a bound.
        violations += [
            _VIOLATION * (change / allowed - 1) for _, change, allowed in self.kept_values.changes(points)
        ]
        return State(x, float(self.values_at(x, points).max()), max(0.0, *violations))

    def _descended(self, x: Array) -> State:
        """Local optimum from a start. Raises the error of a start without a solution."""
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
        """Optimum near x of the extrema that lead there, and the relative change of the objective."""
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
        if self.machines:
            return [
                Robust(self.machines, at, self.minimise, self.multiple)
                for at in range(len(self.design.speeds))
            ]
        return [tracked(self.design, x, at, self.minimise) for at in range(len(self.design.speeds))]

    def _worse_between(self, state: State) -> list[float]:
        """Speeds of local maxima between those of the design at which the objective or a bound is worse."""
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


def _safe_radius(point: DesignPoint) -> float:
    """Spectral radius plus its error."""
    return point.solved.spectral_radius * (1 + point.solved.error_estimate.multipliers)


def _scale(bound: Bound, point: DesignPoint) -> float:
    return abs(bound.value) or abs(point.value(bound.quantity)) or 1.0
