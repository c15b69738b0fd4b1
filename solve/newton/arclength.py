"""Continuation of nonlinear orbits in a parameter, such as the speed, through folds: continuation by
arclength (H. B. Keller, in P. Rabinowitz (ed.), Applications of Bifurcation Theory, Academic Press, 1977)."""

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np

from solve.arrays import Array
from solve.certify.correction import CoordinateScale
from solve.errors import NoOrbitError, SolveError
from solve.kernel.formulas import columns_by
from solve.methods.free import free, solutions_on
from solve.methods.method import Solutions
from solve.newton.branch_points import SAMPLES, ContinuationParameter, FollowedOrbit, Place, Point
from solve.newton.iteration import on
from solve.period.curve import Curve
from solve.period.grid import Grid
from solve.period.multipliers import EPS
from solve.period.points import OnePoint
from solve.period.quantities import orbit_figures, output_changes, repeats_early
from solve.period.rigid_body import Free
from solve.results.orbit import Orbit
from solve.system import PeriodicSystem
from solve.terminal import progress
from solve.threads import one_thread

_FIRST_STEP, _MAX_STEP, _MIN_STEP = 0.05, 0.2, 1e-5
"""Step lengths, in scaled coordinates and fractions of the range of the parameter: initial, largest, and
smallest before the continuation stops. Choices."""

_FEW, _MANY, _MAX_CORRECTIONS = 4, 6, 8
"""Numbers of corrections per step: up to the first the next step is longer, from the second it is shorter,
beyond the third the step is halved. Choices."""

_MAX_LAST_CORRECTION, _DIVERGED = 1e-7, 3.0
"""Norms of a correction: upper limit of the last one, and limit beyond which the iteration diverges.
Choices."""

_RTOL_FRACTION, _MIN_LAST_CORRECTION = 0.01, 1e-10
"""Upper limit of the last correction as a fraction of rtol, if that is smaller; norm below which corrections
need not decrease: at a fold with condition number 1e5 they remain at 1e-11."""

_ROUNDOFF = 4 * EPS
"""Minimum relative error of the parameter."""

_ORBIT_ROUNDOFF = 64 * EPS
"""Relative error of an orbit due to round-off, as for single orbits."""

_MAX_STEPS = 2**12
"""Largest number of steps per period; finer grids are not used. A choice, for the time they take."""

_REFINEMENTS = 3
"""Interpolations towards a turning point or the end of the range. A choice."""

_MIN_COSINE = 0.85
"""Least cosine of the angle between a step and the tangents at its ends; a step that bends more is too long.
A choice."""


def follow_branch(
    parameter: ContinuationParameter, ends: tuple[float, float], orbit: Orbit, points: int
) -> tuple[list[Point], str]:
    """Points of the branch of an orbit from the first of two values of a parameter towards the second, up to
    a given number, and the reason if they end between these values."""
    task = parameter.task
    with one_thread(task.system.n), progress.task("points", points) as count:
        follower = _BranchFollower(parameter, ends)
        found, ended = follower.follow(orbit, points, count.add)
        return follower.with_radius_errors(found), ended


class _BranchFollower:
    """Continuation of a branch from the first value of a parameter to the last."""

    def __init__(self, parameter: ContinuationParameter, ends: tuple[float, float]):
        self.parameter, self.task = parameter, parameter.task
        self.first, self.last = ends
        self.ends, self.span = sorted(ends), abs(self.last - self.first)
        self._tolerance = max(
            _MIN_LAST_CORRECTION, min(_MAX_LAST_CORRECTION, _RTOL_FRACTION * self.task.rtol)
        )
        # Whether a coordinate may be zero within round-off.
        self._resting = False

    def follow(self, orbit: Orbit, most: int, count: Callable[[], None]) -> tuple[list[Point], str]:
        """See `follow_branch`."""
        grid = self.task.grid(orbit.steps)
        place, direction = Place(on(grid, orbit.curve), self.first), self._parameter_direction(grid)
        points, length = [self._point(place, direction, grid, direction)], _FIRST_STEP
        while len(points) < most:
            count()
            before = points[-1]
            try:
                after, length, corrections = self._step(before, length)
                new_points = [after]
                if before.direction.value * after.direction.value < 0:
                    new_points = [*self._turning_point(before, after), after]
                for one, other in pairwise([before, *new_points]):
                    if not self.ends[0] <= other.value <= self.ends[1]:
                        return [*points, self._at_the_end(one, other)], ""
                    points.append(other)
            except NoOrbitError as reason:
                return points, str(reason)
            growth = 1.5 if corrections <= _FEW else 1.0 if corrections < _MANY else 0.7
            length = min(growth * length, _MAX_STEP)
        return points[:most], f"the branch continues beyond the {most} points requested; request more"

    def with_radius_errors(self, points: list[Point]) -> list[Point]:
        """Points whose errors of the spectral radius include the effect of errors of the parameter, which
        move the orbit along the branch. At a turning point they also include the distance from +1 of the
        multiplier that is +1 there.

        With derivatives with respect to the arclength s, an error e of the parameter p moves the orbit by
        e/|p'|, but at a turning point, where p' = 0, by √(2e/|p''|).
        """
        none = np.zeros(2)
        rates = [none]
        for before, after in pairwise(points):
            chord = after.place.on(before.grid).plus(-1.0, before.place)
            length = math.sqrt(self._inner(chord, chord, before.sizes))
            changes = after.orbit.radius - before.orbit.radius, after.direction.value - before.direction.value
            rates.append(np.abs(changes) / length if length > 0 else none)
        with_errors = []
        for point, rates_beside in zip(points, pairwise([*rates, none]), strict=True):
            orbit, (slope, bend) = point.orbit, np.max(rates_beside, axis=0)
            error, radius_error = orbit.errors
            moved = abs(orbit.value - point.place.value) + _ROUNDOFF * max(abs(orbit.value), self.span)
            with np.errstate(divide="ignore"):
                along = min(moved / np.abs(point.direction.value), np.sqrt(2 * moved / bend))
            radius_error = max(radius_error, slope * along, orbit.nearest if point.turns else 0.0)
            with_errors.append(replace(point, orbit=replace(orbit, errors=np.array([error, radius_error]))))
        return with_errors

    def _step(self, before: Point, length: float) -> tuple[Point, float, int]:
        """Next point, the length of the step to it, and its number of corrections."""
        while length > _MIN_STEP:
            try:
                after, corrections = self._reached(before, before.direction, length)
                self._require_same_branch(before, after)
                return after, length, corrections
            except SolveError:
                length /= 2
        at = self.parameter.text(before.value)
        raise NoOrbitError(f"the branch cannot be continued beyond the orbit at {at}")

    def _require_same_branch(self, before: Point, after: Point) -> None:
        """Raise NoOrbitError if the branch curves so much within a step that the step may have left the
        branch or passed two folds."""
        chord = after.place.on(before.grid).plus(-1.0, before.place)
        ends = before.direction, after.direction.on(before.grid)
        long = math.sqrt(self._inner(chord, chord, before.sizes))
        for end in ends:
            along = self._inner(chord, end, before.sizes)
            if along < _MIN_COSINE * long * math.sqrt(self._inner(end, end, before.sizes)):
                raise NoOrbitError("the branch curves too much within the step")
        if max(end.value * chord.value for end in ends) < 0:
            raise NoOrbitError("the step passes over two folds")

    def _reached(self, before: Point, way: Place, length: float) -> tuple[Point, int]:
        """Point at a length from another along a direction, and its number of corrections; length 0:
        correction at the same value. Raises SolveError subclasses if the iteration does not converge."""
        square = self._inner(way, way, before.sizes)
        place, grid = before.place.plus(length / square, way), before.grid
        for corrections in range(1, _MAX_CORRECTIONS + 1):
            after, _, _ = self._corrected(place, before.place, way, length, before.sizes, grid)
            change = after.plus(-1.0, place)
            size, place = math.sqrt(self._inner(change, change, before.sizes)), after
            if size < self._tolerance:
                return self._point(place, before.direction, grid, None if length else way), corrections
            if not size < _DIVERGED:
                break
        raise NoOrbitError("the step is too long")

    def _at_the_end(self, before: Point, after: Point) -> Point:
        """Point between two others at which the branch first leaves the range."""
        edge, near = self.ends[int(after.value > self.ends[1])], before
        for _ in range(_REFINEMENTS):
            length, change, slopes = self._between(before, after)
            at = _crossing(length, change, slopes, edge - before.place.value)
            near, _ = self._reached(before, before.direction, at)
            if self.ends[0] <= near.value <= self.ends[1]:
                before = near
            else:
                after = near
        along = near.place.plus((edge - near.place.value) / near.direction.value, near.direction)
        near = replace(near, place=replace(along, value=edge))
        return self._reached(near, self._parameter_direction(near.grid), 0.0)[0]

    def _turning_point(self, before: Point, after: Point) -> list[Point]:
        """Turning point between two points; none if no step converges to it."""
        found: list[Point] = []
        for _ in range(_REFINEMENTS):
            try:
                length, change, slopes = self._between(before, after)
                middle, _ = self._reached(before, before.direction, _flat(length, change, *slopes))
            except SolveError:
                break
            found = [replace(middle, turns=True)]
            if middle.direction.value * before.direction.value > 0:
                before = middle
            else:
                after = middle
        return found

    def _between(self, before: Point, after: Point) -> tuple[float, float, tuple[float, float]]:
        """Length between two points along the direction at the first, change of the value, and derivatives of
        the value with respect to that length at both. Raises NoOrbitError if the branch bends too much."""
        way = after.place.on(before.grid).plus(-1.0, before.place)
        length = self._inner(way, before.direction, before.sizes)
        slope = self._inner(after.direction.on(before.grid), before.direction, before.sizes)
        if not (length > 0 and slope > 0):
            raise NoOrbitError("the step bends too much")
        return length, way.value, (before.direction.value, after.direction.value / slope)

    def _parameter_direction(self, grid: Grid) -> Place:
        """Direction of the parameter towards the last value."""
        return Place(self.task.rest(grid), self.last - self.first)

    def _inner(self, one: Place, other: Place, sizes: Array) -> float:
        """Inner product of two places, in scaled coordinates (n,) and fractions of the range of the
        parameter."""
        first, second = (each.curve.sampled(SAMPLES) / sizes[:, None] for each in (one, other))
        return float((first * second).mean(axis=1).sum() + one.value * other.value / self.span**2)

    def _along(self, place: Place) -> tuple[PeriodicSystem, float]:
        """Equations linearised along a place, and the speed."""
        task = self.parameter.task_at(place.value)
        return task.system.along(place.curve, columns_by(task.engine)), task.speed

    def _corrected(
        self, place: Place, before: Place, way: Place, length: float, sizes: Array, grid: Grid
    ) -> tuple[Place, Place, Solutions]:
        """Next iterate after a place at a length from another along a direction, the derivative of curve and
        value with respect to the value, and the solutions that gave the iterate. Raises SolveError."""
        along, speed = self._along(place)
        held = free(OnePoint(along, speed))
        next_one, by_value = (
            self._solved(OnePoint(each, speed), grid, held)
            for each in (along, self.parameter.slope(along, place.curve))
        )
        assert isinstance(next_one.curve, Curve)
        assert isinstance(by_value.curve, Curve)
        same, slope = Place(next_one.curve[0], place.value), Place(by_value.curve[0], 1.0)
        gone = self._inner(same.plus(-1.0, before), way, sizes)
        return same.plus((length - gone) / self._inner(slope, way, sizes), slope), slope, next_one

    def _solved(self, point: OnePoint, grid: Grid, held: Free | None, orbit: bool = True) -> Solutions:
        found = solutions_on(self.task.method, point, grid, orbit, self.task.engine, held)
        for reason in found.failures.values():
            raise reason
        return found

    def _point(self, place: Place, towards: Place, grid: Grid, held: Place | None = None) -> Point:
        """Point of a place that solves the equations on a grid, with its tangent on the side of another's.
        held: direction in which corrections vanish, by default that of the branch."""
        while True:
            sizes = self._scale(place, grid).of(place.largest, 1.0, self._resting)
            _, slope, solutions = self._corrected(
                place, place, self._parameter_direction(grid), 0.0, sizes, grid
            )
            side = math.copysign(1.0, self._inner(slope, towards.on(grid), sizes))
            direction = slope.times(side / math.sqrt(self._inner(slope, slope, sizes)))
            fine = self.task.grid(2 * grid.steps)
            there, way = place.on(fine), (held or direction).on(fine)
            better, _, _ = self._corrected(there, there, way, 0.0, sizes, fine)
            scale = self._scale(better, fine).of(better.largest, roundoff=self._resting)
            off = better.plus(-1.0, there).largest / scale + _ORBIT_ROUNDOFF
            moved = abs(better.value - place.value) / max(abs(place.value), self.span)
            error = max(float(off.max()), moved)
            if (
                error > self.task.rtol
                and not self._resting
                and self._scale(better, fine).rests(better.largest)
            ):
                self._resting = True
            elif error <= self.task.rtol or 2 * fine.steps > _MAX_STEPS:
                break
            else:
                place, grid = better, fine
        found = self._orbit(there, better, fine, off)
        off = abs(found.radius - float(solutions.multipliers.spectral_radius[0]))
        off = max(off, float(solutions.multiplier_rounding[0]) * found.radius)
        return Point(place, sizes, direction, grid, replace(found, errors=np.array([error, off])))

    def _orbit(self, there: Place, better: Place, grid: Grid, off: Array) -> FollowedOrbit:
        """More accurate of two places, without the errors of orbit and radius; off: relative differences (n,)
        of the coordinates."""
        (along, speed), curve = self._along(better), better.curve
        point = OnePoint(along, speed)
        rho = self._solved(point, grid, free(point), False).multipliers
        system = self.parameter.task_at(better.value).system
        figures = orbit_figures(system, curve, speed, self.task.engine)
        errors = np.concatenate((off, output_changes(system, speed, there.curve, curve)))
        nearest = abs(complex(rho.nearest_one[0]) - 1)
        early = self.task.periods > 1 and repeats_early(curve, self.task.periods)
        radius = float(rho.spectral_radius[0])
        return FollowedOrbit(better.value, figures, errors, radius, nearest, np.zeros(2), early)

    def _scale(self, place: Place, grid: Grid) -> CoordinateScale:
        along, speed = self._along(place)
        return CoordinateScale(along, place.curve, speed, grid.steps)


def _flat(length: float, change: float, first: float, last: float) -> float:
    """Stationary point of Hermite's cubic over a length, from 0 to a change and with these slopes at its
    ends."""
    mean = change / length
    a, b = 3 * (first + last - 2 * mean), 2 * (3 * mean - 2 * first - last)
    # Zero of a u² + b u + first between 0 and 1, where the slopes have different signs.
    root = math.sqrt(max(b * b - 4 * a * first, 0.0))
    return length * 2 * first / (-b + math.copysign(root, first))


def _crossing(length: float, change: float, slopes: tuple[float, float], level: float) -> float:
    """First point at which the same cubic reaches a level between 0 and the change."""
    first, last = (length * slope for slope in slopes)
    found = np.roots([first + last - 2 * change, 3 * change - 2 * first - last, first, -level])
    real = found[np.isreal(found)].real
    within = real[(real > 0) & (real <= 1)]
    return length * float(within.min(initial=1.0))
