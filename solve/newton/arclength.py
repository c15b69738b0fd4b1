"""Continuation of nonlinear orbits in a parameter, such as the speed, also through folds, by arclength (H. B.
Keller, in P. Rabinowitz (ed.), Applications of Bifurcation Theory, Academic Press, 1977)."""

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np

from solve.equations import events_of, nonlinear_of
from solve.errors import NoOrbitError, SolveError
from solve.newton.branch_points import DAMPING, ContinuationParameters, Point, Unknowns
from solve.newton.iteration import on
from solve.newton.manifold import Manifold
from solve.newton.special_points import special_points
from solve.period.grid import Grid
from solve.period.multipliers import EPS
from solve.results.branch import FOLD
from solve.results.orbit import Orbit
from solve.terminal import progress
from solve.threads import one_thread

_FIRST_STEP, _MAX_STEP, _MIN_STEP = 0.05, 0.2, 1e-5
"""Step lengths, in scaled coordinates and fractions of the range of the parameter: initial, largest, and
smallest before the continuation stops. Choices."""

_FEW, _MANY = 3, 5
"""Numbers of corrections per step: up to the first the next step is longer, from the second it is shorter.
Choices."""

_ROUNDOFF = 4 * EPS
"""Minimum relative error of the parameter."""

_REFINEMENTS = 3
"""Interpolations towards the end of the range. A choice."""

_MIN_COSINE = 0.85
"""Least cosine of the angle between a step and the tangents at its ends; a step that bends more is too long.
A choice."""


_CROSSING = 0.01
"""Length of a step, in scaled coordinates, up to which a branch may change its orientation. A choice: where
it does, another branch crosses it, or the step has left it, which a shorter step does not."""


def first_point(parameters: ContinuationParameters, orbit: Orbit) -> Point:
    """First point of the branch, from an orbit at the first value of the parameter. Its tangent points
    towards the last value."""
    grid = parameters.task.grid(orbit.steps)
    first, last = parameters.ranges[0]
    unknowns = Unknowns(on(grid, orbit.curve), np.array([first]))
    towards = Unknowns(parameters.task.rest(grid), np.array([last - first]))
    system = parameters.task_at(unknowns.values).system
    if events_of(nonlinear_of(system).along_events(orbit.curve, orbit.speed)).phases:
        unknowns = replace(unknowns, curve=orbit.curve)
    return Manifold(parameters).first(unknowns, towards, grid)


def follow_branch(
    parameters: ContinuationParameters,
    start: Point,
    most: int,
    left: Callable[[Point], bool] = lambda _: False,
) -> tuple[list[Point], str]:
    """Continue a branch from its first point. Returns at most `most` points, and the reason if they end
    inside the range of the parameter. left: returns True for a point that has left the branch."""
    task = parameters.task
    with one_thread(task.system.n), progress.task("points", most) as count:
        follower = _BranchFollower(parameters)
        found, ended = follower.follow(start, most, count.add, left)
        return follower.with_radius_errors(found), ended


class _BranchFollower:
    """Continuation of a branch from its first point."""

    def __init__(self, parameters: ContinuationParameters):
        self.parameters, self.manifold = parameters, Manifold(parameters)
        self.ends, self.span = sorted(parameters.ranges[0].tolist()), float(parameters.spans[0])

    def follow(
        self,
        start: Point,
        most: int,
        count: Callable[[], None],
        left: Callable[[Point], bool],
    ) -> tuple[list[Point], str]:
        """See `follow_branch`."""
        points, length = [start], _FIRST_STEP
        while len(points) < most:
            before = points[-1]
            try:
                after, length, corrections = self._step(before, length)
                if left(after):
                    return points, ""
                new_points = [*special_points(self.manifold, before, after), after]
                for one, other in pairwise([before, *new_points]):
                    if not self.ends[0] <= other.value <= self.ends[1]:
                        return [*points, self._at_end_of_range(one, other)], ""
                    points.append(other)
                    count()
            except NoOrbitError as reason:
                return points, str(reason)
            growth = 1.5 if corrections <= _FEW else 1.0 if corrections < _MANY else 0.7
            length = min(growth * length, _MAX_STEP)
        return points[:most], f"the branch continues beyond the {most} points requested; request more"

    def with_radius_errors(self, points: list[Point]) -> list[Point]:
        """Add the effect of the parameter's error, which moves the orbit along the branch, to the errors of
        the spectral radius. At a fold, also add the distance from +1 of the multiplier that is +1 there.
        Returns the points.

        With derivatives with respect to the arclength s, an error e of the parameter p moves the orbit by
        e/|p'|, but at a turning point, where p' = 0, by √(2e/|p''|).
        """
        none = np.zeros(2)
        rates = [none]
        for before, after in pairwise(points):
            length = self.manifold.distance(after.unknowns, before.unknowns, before.sizes)
            changes = after.orbit.radius - before.orbit.radius, after.direction.value - before.direction.value
            rates.append(np.abs(changes) / length if length > 0 else none)
        with_errors = []
        for point, rates_beside in zip(points, pairwise([*rates, none]), strict=True):
            orbit, (slope, bend) = point.orbit, np.max(rates_beside, axis=0)
            error, radius_error = orbit.errors
            moved = abs(point.value - point.unknowns.value) + _ROUNDOFF * max(abs(point.value), self.span)
            with np.errstate(divide="ignore"):
                along = min(moved / np.abs(point.direction.value), np.sqrt(2 * moved / bend))
            radius_error = max(radius_error, slope * along, orbit.nearest if point.kind == FOLD else 0.0)
            with_errors.append(replace(point, orbit=replace(orbit, errors=np.array([error, radius_error]))))
        return with_errors

    def _step(self, before: Point, length: float) -> tuple[Point, float, int]:
        """Next point, the length of the step to it, and its number of corrections."""
        unforced = DAMPING in self.parameters.names
        while length > _MIN_STEP:
            try:
                after, corrections = self.manifold.along(before, length)
                self._require_same_branch(before, after)
                if length > _CROSSING and _orientation(before) != _orientation(after) and not unforced:
                    raise NoOrbitError("the step may have left the branch")
                return after, length, corrections
            except SolveError:
                length /= 2
        at = self.parameters.text(before.orbit.values)
        raise NoOrbitError(f"the branch cannot be continued beyond the orbit at {at}")

    def _require_same_branch(self, before: Point, after: Point) -> None:
        """Raise NoOrbitError if the branch curves so much within a step that the step may have jumped to
        another branch or passed two folds."""
        long = self.manifold.distance(after.unknowns, before.unknowns, before.sizes)
        ends = before.direction, after.direction
        for end in ends:
            along = self.manifold.component(before, after, end)
            if along < _MIN_COSINE * long * math.sqrt(self.manifold.inner(end, end, before.sizes)):
                raise NoOrbitError("the branch curves too much within the step")
        change = after.unknowns.value - before.unknowns.value
        if max(end.value * change for end in ends) < 0:
            raise NoOrbitError("the step passes over two folds")

    def _at_end_of_range(self, before: Point, after: Point) -> Point:
        """Point between two points of the branch at which the parameter first reaches the end of its
        range."""
        edge, near = self.ends[int(after.value > self.ends[1])], before
        for _ in range(_REFINEMENTS):
            length, change, slopes = self._between(before, after)
            at = _crossing(length, change, slopes, edge - before.unknowns.value)
            near, _ = self.manifold.along(before, at)
            if self.ends[0] <= near.value <= self.ends[1]:
                before = near
            else:
                after = near
        along = near.unknowns.plus((edge - near.unknowns.value) / near.direction.value, near.direction)
        near = replace(near, unknowns=replace(along, values=np.array([edge, *along.values[1:]])))
        ways = [self._parameter_direction(near.grid), *near.tangents[1:]]
        return self.manifold.reached(near, ways, [0.0] * len(ways))[0]

    def _between(self, before: Point, after: Point) -> tuple[float, float, tuple[float, float]]:
        """Distance between two points along the tangent at the first point, change of the parameter, and
        derivatives of the parameter with respect to this distance at both points. Raises NoOrbitError if
        the branch bends too much."""
        length = self.manifold.component(before, after, before.direction)
        slope = self.manifold.inner(after.direction, before.direction, before.sizes)
        if not (length > 0 and slope > 0):
            raise NoOrbitError("the branch curves too much within the step")
        change = after.unknowns.value - before.unknowns.value
        return length, change, (before.direction.value, after.direction.value / slope)

    def _parameter_direction(self, grid: Grid) -> Unknowns:
        """Direction of the parameter towards the last value."""
        (first, last), *others = self.parameters.ranges
        return Unknowns(self.parameters.task.rest(grid), np.array([last - first, *[0.0] * len(others)]))


def _orientation(point: Point) -> float:
    """Sign of det(I - Φ) times the direction of the parameter. It is constant along a branch without branch
    points (Y. A. Kuznetsov, Elements of Applied Bifurcation Theory, 10.2)."""
    return float(np.sign(np.prod(1 - point.orbit.multipliers).real * point.direction.value))


def _crossing(length: float, change: float, slopes: tuple[float, float], level: float) -> float:
    """First argument at which the cubic Hermite interpolant of the parameter reaches a level between 0 and
    its change."""
    first, last = (length * slope for slope in slopes)
    found = np.roots([first + last - 2 * change, 3 * change - 2 * first - last, first, -level])
    real = found[np.isreal(found)].real
    within = real[(real > 0) & (real <= 1)]
    return length * float(within.min(initial=1.0))
