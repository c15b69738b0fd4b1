"""Arclength continuation of nonlinear orbits in the speed or another parameter, also through folds (H. B.
Keller, in P. Rabinowitz (ed.), Applications of Bifurcation Theory, Academic Press, 1977)."""

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np

from solve.arrays import EPS
from solve.equations import events_of, nonlinear_of
from solve.errors import NoOrbitError, SolveError, counted
from solve.newton.branch_points import DAMPING, ContinuationParameters, Point, Unknowns
from solve.newton.branch_store import BranchStep, SavedBranch
from solve.newton.grazing import grazes, grazes_between, points_beyond
from solve.newton.iteration import on
from solve.newton.manifold import Manifold
from solve.newton.special_points import Path, is_located, special_points, zero_between
from solve.period.grid import Grid
from solve.results.branch import FOLD, GRAZING
from solve.results.orbit import Orbit
from solve.terminal import progress
from solve.threads import one_thread

_FIRST_STEP, _MAX_STEP, _MIN_STEP = 0.05, 0.2, 1e-5
"""Initial and largest step length, and the step length below which the continuation stops. Lengths are in
scaled coordinates and fractions of the range of the parameter. Chosen by judgement."""

_FEW, _MANY = 2, 5
"""After a step with at most `_FEW` corrections, the next step is longer; after a step with at least `_MANY`
corrections, it is shorter. Chosen by judgement."""

_MIN_PATH = 1e-6
"""The search for a point within the range, on a path past a grazing orbit, ends at this distance from the
start of the path. The distance is relative to the length of the path. Chosen by judgement."""

_ROUNDOFF = 4 * EPS
"""Relative round-off error of the parameter, which is added to its error."""

_REFINEMENTS = 3
"""Maximum number of interpolations in the search for a prescribed value of the parameter. Chosen by
judgement."""

_MAX_ANGLE, _ANGLE_FRACTION = math.acos(0.85), 0.5
"""Largest permitted angle between a step and the tangents at its ends, and the fraction of this angle at
which the next step aims. The angle is proportional to the step length. Chosen by judgement: on the cam's
branch from 300 rpm, the fraction 1/2 requires 0.79 times as many solutions per length of the branch as the
fraction 0.8, because fewer steps are rejected."""


_CROSSING = 0.01
"""Longest step, in scaled coordinates, in which a branch may change its orientation. Chosen by judgement. In
a longer step, a change of orientation indicates a jump to another branch; in a shorter step, it indicates a
crossing of two branches."""


_RECENT = 8
"""Number of most recent points among which the last regular point is sought. Chosen by judgement: more
special points in succession are rare."""

_SAME = 1e-3
"""Distance, in scaled coordinates, below which two orbits at the same value of the parameter count as the
same orbit. Chosen by judgement: above the errors of orbits, below the distance between different orbits."""


def first_point(parameters: ContinuationParameters, orbit: Orbit, value: float) -> Point:
    """Return the first point of the branch, from an orbit at the parameter value `value`. The tangent of the
    point is directed towards the last value of the range."""
    grid = parameters.task.grid(orbit.steps)
    first, last = parameters.ranges[0]
    unknowns = Unknowns(on(grid, orbit.curve), np.array([value]))
    towards = Unknowns(parameters.task.rest(grid), np.array([last - first]))
    system = parameters.task_at(unknowns.values).system
    if events_of(nonlinear_of(system).along_events(orbit.curve, orbit.speed)).phases:
        unknowns = replace(unknowns, curve=orbit.curve)
    return Manifold(parameters).first(unknowns, towards, grid)


def follow_branch(
    parameters: ContinuationParameters,
    start: Callable[[], Point],
    most: int,
    left: Callable[[Point], bool] = lambda _: False,
    saved: SavedBranch | None = None,
) -> tuple[list[Point], str]:
    """Continue a branch from its first point. Return at most `most` points and the reason why they end inside
    the range of the parameter; the reason is empty if they end at an end of the range, if the branch is
    closed, or if `left` returns True.

    start: function that returns the first point. left: function that is called for successive points, and
    returns True for a point that is no longer on the branch. saved: stored steps, from which the continuation
    resumes."""
    task = parameters.task
    with one_thread(task.system.n), progress.task("points", most) as count:
        follower = _BranchFollower(parameters, saved or SavedBranch())
        found, ended = follower.follow(start, most, count, left)
        return follower.with_radius_errors(found), ended


def orbits_at(parameters: ContinuationParameters, points: Sequence[Point], value: float) -> list[Point]:
    """Return the orbits of a branch at the parameter value `value`. Orbits that cannot be computed are
    omitted."""
    follower, found = _BranchFollower(parameters, SavedBranch()), list[Point]()
    for before, after in pairwise(points):
        if (before.value - value) * (after.value - value) <= 0:
            with suppress(SolveError):
                found.append(follower.between(before, after, value))
    return found


class _BranchFollower:
    """Continuation of one branch from its first point."""

    def __init__(self, parameters: ContinuationParameters, saved: SavedBranch):
        self.parameters, self.manifold, self.saved = parameters, Manifold(parameters), saved
        self.angle = 0.0
        self.ends, self.span = sorted(parameters.ranges[0].tolist()), float(parameters.spans[0])

    def follow(
        self,
        start: Callable[[], Point],
        most: int,
        count: progress.Task,
        left: Callable[[Point], bool],
    ) -> tuple[list[Point], str]:
        """Implementation of `follow_branch`; `count` is the task whose progress is displayed."""
        points, length, number = list[Point](), _FIRST_STEP, 0
        while len(points) < most:
            step = self.saved.read(number)
            if step is None:
                step = self._next(points, length) if points else self._stored((start(),), length)
                self.saved.write(number, step)
            self.manifold.largest, self.manifold.resting = step.largest, step.resting
            if step.ended is None and left(step.points[-1]):
                return points, ""
            points += step.points
            for _ in step.points:
                count.add()
            if step.ended is not None:
                return points[:most], step.ended
            length, number = step.length, number + 1
        asked = counted(most, "point")
        return points[:most], f"the branch continues beyond the {asked} requested; request more"

    def _stored(self, points: Sequence[Point], length: float, ended: str | None = None) -> BranchStep:
        return BranchStep(tuple(points), length, self.manifold.largest, self.manifold.resting, ended)

    def _next(self, points: Sequence[Point], length: float) -> BranchStep:
        """Return the next step of the branch whose points so far are `points`."""
        try:
            return self._within_range(points, *self._step(points, length))
        except NoOrbitError as reason:
            try:
                return self._within_range(points, *self._beyond_grazing(points))
            except SolveError:
                with suppress(NoOrbitError):
                    return self._within_range(points, *self._step(points, length, True))
                words = ", which grazes a switch" if grazes(self.manifold, points[-1]) else ""
                return self._stored((), length, f"{reason}{words}")

    def _within_range(
        self, points: Sequence[Point], step: Sequence[Point], length: float, path: Path | None = None
    ) -> BranchStep:
        """Return the points of a step up to the point at which the branch is closed or leaves the range.
        length: length of the following step. path: path of the step; by default along its tangents."""
        before, found = points[-1], list[Point]()
        try:
            start = self._closing_point(points[0], before, step[-1])
            for one, other in pairwise([before, *step]):
                if start is not None and self._is_beyond(start, before, other):
                    return self._stored((*found, start), length, "")
                if not self.ends[0] <= other.value <= self.ends[1]:
                    edge = self.ends[int(other.value > self.ends[1])]
                    at_edge = self.between(one, other, edge) if path is None else self._on(path, edge)
                    return self._stored((*found, at_edge), length, "")
                found.append(other)
        except NoOrbitError as reason:
            return self._stored(found, length, str(reason))
        return self._stored(found, length)

    def _beyond_grazing(self, points: Sequence[Point]) -> tuple[list[Point], float, Path]:
        """Step past a grazing orbit near the last point of the branch. Return the first points beyond this
        orbit, the length of the next step, and the path of the step. The returned points begin with a copy of
        the last point, labelled as a grazing point, unless there is a special point near the grazing orbit.
        Raises SolveError if no point beyond the grazing orbit is found."""
        before = points[-1]
        beyond, path = points_beyond(self.manifold, before)
        length = self.manifold.distance(beyond[-1].unknowns, before.unknowns, before.sizes)
        near = [
            point
            for point in points[-_RECENT:]
            if self.manifold.distance(point.unknowns, before.unknowns, before.sizes) <= length
        ]
        if any(point.kind for point in (*near, *beyond)):
            return beyond, length, path
        return [replace(before, kind=GRAZING), *beyond], length, path

    def _closing_point(self, start: Point, before: Point, after: Point) -> Point | None:
        """Return the first point of the branch if the step from `before` to `after` returns to it, so that
        the branch is closed; otherwise None."""
        direction, sizes = before.direction, before.sizes
        along = self.manifold.component(before, start, direction)
        length = self.manifold.component(before, after, direction)
        if not 0 < along <= length or self.manifold.inner(start.direction, direction, sizes) <= 0:
            return None
        if self.manifold.distance(start.unknowns, before.unknowns, sizes) > along / math.cos(_MAX_ANGLE):
            return None
        try:
            there, _ = self.manifold.along(before, along)
        except SolveError:
            return None
        apart = self.manifold.distance(start.unknowns, there.unknowns, sizes)
        return start if apart <= _SAME else None

    def _is_beyond(self, start: Point, before: Point, other: Point) -> bool:
        """Whether the point `other` lies beyond the first point `start` of the branch, in the direction of
        the step from `before`."""
        along, there = (self.manifold.component(before, each, before.direction) for each in (start, other))
        return there >= along

    def with_radius_errors(self, points: list[Point]) -> list[Point]:
        """Return copies of the points in which the error of the spectral radius includes the effect of the
        error of the parameter. The error of the parameter moves the orbit along the branch.

        At a fold, the error of the spectral radius is at least the distance from +1 of the nearest
        multiplier. At grazing orbits, the error is infinite.

        Let p' and p'' be the derivatives of the parameter p with respect to the arclength. An error e of p
        moves the orbit by e/|p'| along the branch. At a turning point, where p' = 0, it moves the orbit by
        √(2e/|p''|).
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
            if point.kind == GRAZING or grazes(self.manifold, point):
                radius_error = math.inf
            with_errors.append(replace(point, orbit=replace(orbit, errors=np.array([error, radius_error]))))
        return with_errors

    def _step(
        self, points: Sequence[Point], length: float, may_cross: bool = False
    ) -> tuple[list[Point], float]:
        """Return the special points of the next step followed by its end point, and the length of the
        following step. may_cross: whether the orientation may change next to a grazing orbit, as where the
        branch of symmetric orbits grazes two switches."""
        unforced, first, before = DAMPING in self.parameters.names, length, points[-1]
        regular = [point for point in points[-_RECENT:-1] if not point.kind]
        curvature = self.manifold.curvature(regular[-1], before) if regular else None
        while length > _MIN_STEP:
            try:
                after, corrections = self.manifold.along(
                    before, length, partial(self._check, before), curvature
                )
                turns = before.orientation != after.orientation and not unforced
                near = self._is_near_grazing if not may_cross else partial(grazes_between, self.manifold)
                if turns and (length > _CROSSING or near(before, after)):
                    raise NoOrbitError("the step may have left the branch")
                special, are_located = special_points(
                    self.manifold, before, after, branches_cross=turns and not may_cross
                )
                if not are_located and (length > _CROSSING or self._is_near_grazing(before, after)):
                    raise NoOrbitError("a special point within the step cannot be located")
                growth = self._growth(corrections, length == first)
                return [*special, after], min(growth * length, _MAX_STEP)
            except SolveError:
                length /= 2
        at = self.parameters.text(before.orbit.values)
        raise NoOrbitError(f"the branch cannot be continued beyond the orbit at {at}")

    def _is_near_grazing(self, before: Point, after: Point) -> bool:
        """Whether an orbit at either end of a step, or between the ends, grazes a switch."""
        ends = before, after
        return grazes_between(self.manifold, *ends) or any(grazes(self.manifold, end) for end in ends)

    def _growth(self, corrections: int, not_shortened: bool) -> float:
        """Return the ratio of the next step length to the length of a step that took `corrections`
        corrections."""
        growth = 0.7 if corrections >= _MANY else 1.5 if corrections <= _FEW and not_shortened else 1.0
        return min(growth, _ANGLE_FRACTION * _MAX_ANGLE / max(self.angle, EPS))

    def _check(self, before: Point, unknowns: Unknowns, tangent: Unknowns) -> None:
        """Raise NoOrbitError if the branch curves so much within a step to `unknowns` that the step may have
        jumped to another branch or passed two folds. Store the angle of the step in `self.angle`."""
        long = self.manifold.distance(unknowns, before.unknowns, before.sizes)
        ends, cosines = (before.direction, tangent), list[float]()
        for end in ends:
            along = self.manifold.inner(unknowns, end, before.sizes, before.unknowns)
            cosines.append(along / (long * math.sqrt(self.manifold.inner(end, end, before.sizes))))
        self.angle = math.acos(min(1.0, *map(float, cosines)))
        if self.angle > _MAX_ANGLE:
            raise NoOrbitError("the branch curves too much within the step")
        change = unknowns.value - before.unknowns.value
        if max(end.value * change for end in ends) < 0:
            raise NoOrbitError("the step passes over two folds")

    def between(self, before: Point, after: Point, value: float) -> Point:
        """Return the first point of the branch between the points `before` and `after` at which the parameter
        has the value `value`."""
        near, rises = before, after.value > before.value
        for _ in range(_REFINEMENTS):
            length, change, slopes = self._between(before, after)
            at = _crossing(length, change, slopes, value - before.unknowns.value)
            near, _ = self.manifold.along(before, at)
            if (near.value <= value) == rises:
                before = near
            else:
                after = near
        return self._at(near, value)

    def _on(self, path: Path, value: float) -> Point:
        """Return the last point, on a path past a grazing orbit, at which the parameter has the value
        `value`."""
        at, end = path

        def apart(length: float) -> tuple[float, Point]:
            point = at(length)
            return point.value - value, point

        outside, last = apart(end)
        start, inside = end, outside
        while inside * outside >= 0:
            start /= 2
            inside, _ = apart(start)
            if start < _MIN_PATH * end:
                raise NoOrbitError("the branch curves too much within the step")
        ends = (start, end), (inside, outside)
        _, near = zero_between(apart, *ends, lambda *two: is_located(self.manifold, *two), last)
        return self._at(near, value)

    def _at(self, near: Point, value: float) -> Point:
        """Return the point of the branch next to the point `near` at which the parameter has the value
        `value`."""
        along = near.unknowns.plus((value - near.unknowns.value) / near.direction.value, near.direction)
        near = replace(near, unknowns=replace(along, values=np.array([value, *along.values[1:]])))
        ways = [self._parameter_direction(near.grid), *near.tangents[1:]]
        found, _ = self.manifold.reached(near, ways, [0.0] * len(ways))
        # The corrections have changed the value of the parameter by round-off.
        return replace(found, orbit=replace(found.orbit, values=near.unknowns.values))

    def _between(self, before: Point, after: Point) -> tuple[float, float, tuple[float, float]]:
        """Return the distance between two points along the tangent at the first point, the change of the
        parameter, and the derivatives of the parameter with respect to this distance at both points. Raises
        NoOrbitError if the branch curves too much."""
        length = self.manifold.component(before, after, before.direction)
        slope = self.manifold.inner(after.direction, before.direction, before.sizes)
        if not (length > 0 and slope > 0):
            raise NoOrbitError("the branch curves too much within the step")
        change = after.unknowns.value - before.unknowns.value
        return length, change, (before.direction.value, after.direction.value / slope)

    def _parameter_direction(self, grid: Grid) -> Unknowns:
        """Return the direction in which only the first parameter changes, towards its last value."""
        (first, last), *others = self.parameters.ranges
        return Unknowns(self.parameters.task.rest(grid), np.array([last - first, *[0.0] * len(others)]))


def _crossing(length: float, change: float, slopes: tuple[float, float], level: float) -> float:
    """Return the distance at which the change of the parameter first reaches `level`, according to its cubic
    Hermite interpolant over the distances from 0 to `length`. If the interpolant does not reach the level,
    return `length`. The change is 0 at the start and `change` at the end; `slopes` are its derivatives there.
    """
    first, last = (length * slope for slope in slopes)
    found = np.roots([first + last - 2 * change, 3 * change - 2 * first - last, first, -level])
    real = found[np.isreal(found)].real
    within = real[(real > 0) & (real <= 1)]
    return length * float(within.min(initial=1.0))
