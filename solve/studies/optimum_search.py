"""Search for the optimum of a design, by rounds of minimisation from several starting points."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from solve.arrays import Array
from solve.errors import SolveError
from solve.period.multipliers import KNOWN_ON_CIRCLE, UNIT_CIRCLE
from solve.period.named import RADIUS, Named
from solve.results.formatting import measured
from solve.results.optimum import Requirement
from solve.results.orbit import Orbit
from solve.studies.design_points import Design, DesignPoint
from solve.studies.kept import KeptValues
from solve.studies.minimax import Excess, minimised, restored
from solve.studies.over_speed import SPECTRAL_RADIUS, BandEdge, Peak, PeakSpeed, safe_radius
from solve.studies.requirements import Bound, Kept
from solve.studies.robust import Robust, Statistic
from solve.studies.tracked import Extrema, Function, Single, Tracked, tracked
from solve.terminal import progress

ROUNDS = "rounds"
"""Name of the unit in progress reports."""

_MAX_ROUNDS = 30
"""Maximum number of rounds, each of which follows the extrema that are largest at its start. Chosen by
judgement: the models `cam` and `manipulator` take up to 8."""

_SHRINKING, _SMALLEST_REACH = 4.0, 1e-6
"""Factor by which the permitted change of x is reduced after a round without improvement, and permitted
change below which the search ends. Chosen by judgement."""

STATIONARY = 100.0
"""The search ends if a round changes the objective by less than this multiple of rtol, relative to the
objective. With 10, the search does not end for some optima of the model `manipulator`, because the errors of
the orbits differ from grid to grid."""

_MAX_RESTORATIONS, _GAIN = 6, 0.01
"""Maximum number of successive minimisations of the violation, and relative reduction below which the
violation counts as a local minimum. Chosen by judgement."""

_RESTARTS = 4
"""Number of random designs from which the violation is minimised if the search finds no feasible design
nearby. Chosen by judgement."""

_VIOLATION = 1e-7
"""A bound counts as satisfied if its violation, divided by the scale of the bound, is at most this number.
Chosen by judgement."""


@dataclass(frozen=True)
class State:
    """Design `x`. `objective` is the largest value at any speed. `violation` is the largest violation of a
    requirement, or 0 if no requirement is violated."""

    x: Array
    objective: float
    violation: float

    @property
    def feasible(self) -> bool:
        """Whether the design satisfies all requirements."""
        return self.violation <= _VIOLATION

    def better_than(self, other: "State") -> bool:
        """Whether this design is preferred to `other`. If `other` is feasible, this design must be feasible
        and have a lower objective. Otherwise, this design must have less than half the violation of `other`,
        or a lower objective without a larger violation."""
        if other.feasible:
            return self.feasible and self.objective < other.objective
        lower = self.violation <= other.violation and self.objective < other.objective
        return lower or self.violation < other.violation / 2


@dataclass(eq=False)
class Search:
    """Search for the optimum of a quantity, or of a function of the orbits at all speeds.

    For a robust objective, `machines` are the deviating machines and `statistic` is the statistic of their
    values. `limit` is the largest permitted spectral radius. `failures` contains the reason for each trial
    without a solution. `peaks` are the followed local maxima versus speed; `given` are the speeds without
    those of the peaks. `edges` are the edges of unstable bands that must stay outside the range. `rng`
    generates new random designs in each search for a feasible design.
    """

    design: Design
    minimise: Named | Callable[[Sequence[Orbit]], float]
    bounds: Sequence[Bound]
    kept: Sequence[Kept]
    machines: Sequence[Design] = ()
    statistic: Statistic | None = None
    failures: list[str] = field(default_factory=list)
    peaks: Sequence[PeakSpeed] = ()
    edges: Sequence[BandEdge] = ()
    rng: np.random.Generator = field(default_factory=partial(np.random.default_rng, 1))

    def __post_init__(self) -> None:
        verdicts = {point.solved.verdict for point in self.design.points(self.design.start)}
        # If all solutions at the start are stable but not asymptotically, the model is undamped and all
        # multipliers remain on the unit circle.
        self.limit = 1 + KNOWN_ON_CIRCLE if verdicts == {"stable"} else 1 - UNIT_CIRCLE
        self.given = tuple(self.design.speeds)
        self._evaluate_kept()

    def _evaluate_kept(self) -> None:
        """Evaluate the quantities to be kept unchanged. Their initial values depend only on the start and the
        speeds."""
        self.kept_values = KeptValues(self.design, self.kept)
        self.equations, self.kept_limits = self.kept_values.equations(), self.kept_values.limits()

    def best(self, starts: int) -> State:
        """Return the best local optimum found from the parameters of the model and from `starts - 1` random
        designs. Raises SolveError subclasses if the search from the parameters of the model fails."""
        best = self.descended(self.design.start)
        for x in np.random.default_rng(0).random((starts - 1, len(best.x))):
            try:
                state = self.descended(x)
            except SolveError as reason:
                self.failures.append(str(reason))
            else:
                best = state if state.better_than(best) else best
        return best

    def follow(self, peaks: Sequence[PeakSpeed], edges: Sequence[BandEdge]) -> None:
        """Replace the local maxima versus speed, and the edges of bands, that the search follows."""
        self.peaks, self.edges = list(peaks), list(edges)
        self.design.speeds[:] = sorted({*self.given, *(speed for peak in peaks for speed in peak.speeds)})
        self._evaluate_kept()

    def values(self, points: Sequence[DesignPoint]) -> Array:
        """Values (k,) of the minimised quantity at the speeds. If a function is minimised, its single value
        is repeated."""
        if isinstance(self.minimise, Named):
            return np.array([point.value(self.minimise) for point in points])
        return np.full(len(points), Function(self.design, self.minimise).value(points))

    def values_at(self, x: Array, points: Sequence[DesignPoint]) -> Array:
        """Values (k,) of the objective at the speeds. For a robust objective, they are statistics over the
        deviating machines. `points` are the solutions at x."""
        if self.statistic is None:
            return self.values(points)
        return np.concatenate([each.values(x) for each in self._objective(x)])

    def requirements(self, points: Sequence[DesignPoint]) -> list[Requirement]:
        """Requirements with their worst values at any of the speeds."""
        changes = [
            Requirement(f"change of {each.text}", change, allowed)
            for each, change, allowed in self.kept_values.changes(points)
        ]
        return [requirement for requirement, _ in self.bounded(points)] + changes

    def bounded(self, points: Sequence[DesignPoint]) -> list[tuple[Requirement, float]]:
        """For the spectral radius and for each bound: a requirement with the worst value at any of the
        speeds, and the violation, which is negative if the bound is satisfied."""
        radius = max(map(safe_radius, points))
        bounded = [(Requirement(RADIUS, radius, self.limit), radius - self.limit)]
        for each in self.bounds:
            values = [each.sign * point.value(each.quantity) for point in points]
            worst = int(np.argmax(values))
            violation = (values[worst] - each.sign * each.value) / _scale(each, points[worst])
            bounded.append((Requirement(each.text, each.sign * values[worst], each.value), violation))
        return bounded

    def _state(self, x: Array) -> State:
        points = self.design.points(x)
        violations = [violation for _, violation in self.bounded(points)]
        violations += [float(each.values(x)[0]) / each.end for each in self.edges]
        # If a quantity to be kept changes by twice the allowed change, this counts as much as a bound
        # violated by 1e-7.
        violations += [
            _VIOLATION * (change / allowed - 1) for _, change, allowed in self.kept_values.changes(points)
        ]
        if self.peaks and isinstance(self.minimise, Named):
            objective = max(float(each.values(x).max()) for each in self._objective(x))
        else:
            objective = float(self.values_at(x, points).max())
        return State(x, objective, max(0.0, *violations))

    def descended(self, x: Array) -> State:
        """Return a local optimum, from the design x. Raises SolveError subclasses if x has no solution."""
        state, reach = self._state(x), 0.5
        for _ in range(_MAX_ROUNDS):
            if reach < _SMALLEST_REACH:
                break
            try:
                with progress.subtask(ROUNDS):
                    x, change = self._round(state.x, reach)
                    trial = self._state(x)
                if not trial.better_than(state) and not state.feasible:
                    trial = self._feasible_near(state)
                    if not trial.feasible:
                        return trial
            except SolveError as reason:
                self.failures.append(str(reason))
                reach /= _SHRINKING
                continue
            is_last = state.feasible and abs(change) <= STATIONARY * self.design.rtol
            if trial.better_than(state):
                state = trial
            else:
                reach /= _SHRINKING
            if is_last:
                break
        return state

    def _feasible_near(self, state: State) -> State:
        """Return a feasible design near an infeasible design or near random designs; if none is found, the
        design of least violation. Random designs help if an unstable band moves across the speeds, because
        the violation then has several local minima. Raises SolveError subclasses."""
        best = self._least_violation(state)
        for x in self.rng.random((_RESTARTS, len(best.x))):
            if best.feasible:
                break
            try:
                best = min(best, self._least_violation(self._state(x)), key=lambda each: each.violation)
            except SolveError as reason:
                self.failures.append(str(reason))
        return best

    def _least_violation(self, state: State) -> State:
        """Minimise the largest violation of the limits locally, starting from an infeasible design. Return
        the best design. Raises SolveError subclasses."""
        for _ in range(_MAX_RESTORATIONS):
            with progress.subtask(ROUNDS):
                limits = self._limits(state.x)
                x, _ = minimised(limits, [], self.equations, state.x, 1.0, STATIONARY * self.design.rtol)
                trial = self._state(x if self.equations is None else restored(self.equations, x))
            is_last = trial.feasible or trial.violation > (1 - _GAIN) * state.violation
            state = min(state, trial, key=lambda each: each.violation)
            if is_last:
                break
        return state

    def unmet(self, points: Sequence[DesignPoint]) -> list[tuple[str, str]]:
        """Texts of the violated requirements, each with its value and unit."""
        units = ["1", *(each.quantity.unit for each in self.bounds)]
        bounded = zip(self.bounded(points), units, strict=True)
        found = [(each, unit) for (each, violation), unit in bounded if violation > _VIOLATION]
        if found and found[0][0].name == RADIUS:
            found[0] = found[0][0]._replace(name=f"{RADIUS} < 1"), "1"
        for kept, change, allowed in self.kept_values.changes(points):
            if change > 2 * allowed:
                unit = self.design.model.labels.units.get(kept.name, "1")
                found.append((Requirement(f"keep {kept.text}", change, allowed), unit))
        return [(each.name, measured(each.value, unit)) for each, unit in found]

    def _round(self, x: Array, reach: float) -> tuple[Array, float]:
        """Minimise near x, taking into account the extrema that are largest at x. Return the new x and the
        relative change of the objective."""
        rtol = STATIONARY * self.design.rtol
        x, change = minimised(self._objective(x), self._limits(x), self.equations, x, reach, rtol)
        return (x if self.equations is None else restored(self.equations, x)), change

    def _limits(self, x: Array) -> list[Excess]:
        """Limits on all bounded quantities, taking into account the extrema that are largest at x."""
        design, limits = self.design, [*self.kept_limits]
        for at, point in enumerate(design.points(x)):
            for each in self.bounds:
                values = tracked(design, x, at, each.quantity, each.sign)
                limits.append(Excess(values, each.sign * each.value, _scale(each, point)))
            factor = 1 + point.solved.error_estimate.multipliers
            radius = Single(design, at, SPECTRAL_RADIUS, factor=factor)
            limits.append(Excess(radius, self.limit, 1.0))
        return limits + [Excess(each, 0.0, each.end) for each in self.edges]

    def _objective(self, x: Array) -> list[Tracked]:
        if not isinstance(self.minimise, Named):
            return [Function(self.design, self.minimise)]
        if self.statistic:
            return [
                Robust(self.machines, at, self.minimise, self.statistic)
                for at in range(len(self.design.speeds))
            ]
        speed_indices = range(len(self.design.speeds))
        return [self._at_speed(tracked(self.design, x, at, self.minimise)) for at in speed_indices]

    def _at_speed(self, values: Single | Extrema) -> Tracked:
        """Values at a design speed or, if a local maximum at this speed is followed, the maximum near this
        speed.

        For bounds, maxima are not followed: when an unstable band moves, its largest spectral radius does not
        change.
        """
        speeds = self.design.speeds
        for peak in self.peaks:
            if speeds[values.at] == peak.speed:
                return Peak([replace(values, at=speeds.index(speed)) for speed in peak.speeds])
        return values


def _scale(bound: Bound, point: DesignPoint) -> float:
    return abs(bound.value) or abs(point.value(bound.quantity)) or 1.0
