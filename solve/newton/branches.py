"""Nonlinear orbits followed over the speed and through the speeds where they turn back: continuation by
arclength (H. B. Keller, in P. Rabinowitz (ed.), Applications of Bifurcation Theory, Academic Press, 1977)."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from solve.argument import require_whole
from solve.arrays import Array
from solve.contracts import Matrices, Motion
from solve.errors import NoOrbitError, SolveError, ValueOutOfBoundsError
from solve.kernel.engines import chosen_engine
from solve.kernel.formulas import columns_by
from solve.labels import SPEED
from solve.methods.method import Solutions
from solve.methods.radau import Radau
from solve.newton.iteration import Task, on, summed
from solve.newton.orbits import nonlinear
from solve.period.curve import Curve
from solve.period.grid import Grid
from solve.period.points import OnePoint
from solve.progress import stage
from solve.results.branch import Branch
from solve.results.orbit import Orbit
from solve.system import PeriodicSystem, of_system
from solve.threads import one_thread
from solve.units import checked_rtol, ramp_in_si

_FIRST, _LARGEST, _LEAST = 0.05, 0.2, 1e-5
"""Lengths of steps, in sizes of the orbit and parts of the range of speeds: the first, the largest, and that
below which the branch is given up."""

_FEW, _MANY, _MOST = 4, 6, 8
"""Corrections of a step: after few the next is longer, after many shorter; beyond most it is halved."""

_CONVERGED, _LOST = 1e-7, 3.0
"""Sizes of a correction: of the last, and of one that leads away."""

_SAMPLES = 8
"""Phases a step at which orbits are measured."""

_FINEST = 2**12
"""Steps of a period beyond which grids do not grow."""

_ROUNDS = 3
"""Steps to a speed where the branch turns back."""

_STRAIGHT = 0.85
"""Cosine of the angles between a step and the directions at its ends below which it is too long."""

_REST = 1e-12
"""Part of the largest modulus of all coordinates below which one counts as at rest."""

_FIELDS = "speed", "peaks", "radius", "errors", "turns"


@of_system
def branch(
    system: PeriodicSystem,
    speeds: str | tuple[float | str, float | str],
    start: Orbit | Motion | None = None,
    points: int = 200,
    rtol: float = 1e-3,
    engine: str = "auto",
) -> Branch:
    """The branch of nonlinear orbits from the first of two speeds ("300:600 rpm") towards the second, through
    the speeds where it turns back, until it leaves their range or has so many points.

    It begins on the orbit that `solve.nonlinear` finds at the first speed, from a start where one is given.
    Every orbit is converged on one grid and corrected once on another of twice the steps, which gives what is
    returned, and the errors; grids grow where these exceed rtol. Raises ValueOutOfBoundsError for bad input,
    LinearModelError for linear systems, NoOrbitError where there is no first orbit, NoDerivativeError where
    the equations have no derivative by the speed.
    """
    first, last = ramp_in_si(speeds)
    if not (first > 0 and last > 0) or first == last:
        raise ValueOutOfBoundsError(
            f"speeds are {speeds!r}; give two different ones above 0, such as '300:600 rpm'"
        )
    require_whole("points", points, 2)
    rtol, (used, notes) = checked_rtol(rtol), chosen_engine(engine)
    orbit = nonlinear(system, first, start, rtol=rtol, engine=engine)
    task = Task(system.shown_in(first), float(first), 1, Radau(), used, rtol)
    with one_thread(system.n), stage("points", points) as count:
        found, ended = _Follower(task, float(last)).followed(orbit, int(points), count.add)
    fields = (np.array([getattr(each, name) for each in found]) for name in _FIELDS)
    return Branch(task.system, *fields, rtol=rtol, ended=ended, notes=notes)


@dataclass(frozen=True)
class _Place:
    """A curve and a speed (rad/s), or differences of both."""

    curve: Curve
    speed: float

    def plus(self, part: float, other: "_Place") -> "_Place":
        return _Place(summed(self.curve, part, other.curve), self.speed + part * other.speed)

    def on(self, grid: Grid) -> "_Place":
        return _Place(on(grid, self.curve), self.speed)


@dataclass(frozen=True)
class _Point:
    """An orbit of the branch on its grid, the direction of the branch there, of length 1, and what is known
    of the orbit: speed, largest moduli (n,), spectral radius, errors of orbit and radius (2,), whether the
    branch turns back here."""

    place: _Place
    direction: _Place
    grid: Grid
    speed: float
    peaks: Array
    radius: float
    errors: Array
    turns: bool = False

    @property
    def sizes(self) -> Array:
        return _sizes(self.peaks)


class _BySpeed(PeriodicSystem):
    """Equations linearised along a motion under the load -∂r/∂Ω, which give its derivative by the speed."""

    def __init__(self, along: PeriodicSystem, motion: Motion):
        super().__init__(self._by_speed, along.coordinates, along.period, along.breaks)
        self._along, self._motion, self._dependence = along, motion, along.dependence([SPEED])

    def _by_speed(self, phase: Array, speed: float) -> Matrices:
        M, C, K, _ = self._along.at(phase, speed)
        states = np.stack([self._motion(phase, derivative).T for derivative in (2, 1, 0)], axis=1)
        return M, C, K, -self._dependence.residual(phase, speed, states)[..., 0]


class _Follower:
    """Steps along the branch of a task, from its speed towards the last (rad/s)."""

    def __init__(self, task: Task, last: float):
        self.task, self.last, self.span = task, last, abs(last - task.speed)
        self.ends = sorted((task.speed, last))

    def followed(self, orbit: Orbit, most: int, count: Callable[[], None]) -> tuple[list[_Point], str]:
        """The points one after another, and in words why they end within the range of speeds, if they do."""
        grid = self.task.grid(orbit.steps)
        place = _Place(on(grid, orbit.motion), self.task.speed)
        found, length = [self._point(place, self._speed_alone(grid), grid)], _FIRST
        while len(found) < most:
            count()
            before = found[-1]
            try:
                after, length, corrections = self._step(before, length)
                if not self.ends[0] <= after.speed <= self.ends[1]:
                    return [*found, self._at_the_end(before, after)], ""
            except NoOrbitError as reason:
                return found, str(reason)
            if before.direction.speed * after.direction.speed < 0:
                found += self._turning(before, after)
            found.append(after)
            growth = 1.5 if corrections <= _FEW else 1.0 if corrections < _MANY else 0.7
            length = min(growth * length, _LARGEST)
        return found[:most], f"the branch goes on beyond the {most} points asked for; ask for more"

    def _step(self, before: _Point, length: float) -> tuple[_Point, float, int]:
        """The next point, the length of the step that led to it, and its corrections."""
        while length > _LEAST:
            try:
                after, corrections = self._reached(before, before.direction, length)
                self._require_the_same_branch(before, after)
                return after, length, corrections
            except SolveError:
                length /= 2
        raise NoOrbitError(
            f"the branch cannot be followed beyond the orbit at {self.task.in_words(before.speed)}"
        )

    def _require_the_same_branch(self, before: _Point, after: _Point) -> None:
        """Raise NoOrbitError where a step bends so much that it may have left the branch, or passed over two
        places where it turns back."""
        chord = after.place.on(before.grid).plus(-1.0, before.place)
        ends = before.direction, after.direction.on(before.grid)
        long = math.sqrt(self._inner(chord, chord, before.sizes))
        for end in ends:
            along = self._inner(chord, end, before.sizes)
            if along < _STRAIGHT * long * math.sqrt(self._inner(end, end, before.sizes)):
                raise NoOrbitError("the step bends too much")
        if max(end.speed * chord.speed for end in ends) < 0:
            raise NoOrbitError("the step passes over two places where the branch turns back")

    def _reached(self, before: _Point, way: _Place, length: float) -> tuple[_Point, int]:
        """The point at a length from another along a way, and its corrections. Raises SolveError subclasses
        where the iteration does not lead there."""
        square = self._inner(way, way, before.sizes)
        place, grid = before.place.plus(length / square, way), before.grid
        for corrections in range(1, _MOST + 1):
            if place.speed <= 0:
                break
            after, _, _ = self._corrected(place, before.place, way, length, before.sizes, grid)
            change = after.plus(-1.0, place)
            size, place = math.sqrt(self._inner(change, change, before.sizes)), after
            if size < _CONVERGED:
                return self._point(place, before.direction, grid), corrections
            if not size < _LOST:
                break
        raise NoOrbitError("the step is too long")

    def _at_the_end(self, before: _Point, after: _Point) -> _Point:
        """The point at the speed at which the branch leaves the range."""
        edge = self.ends[int(after.speed > self.ends[1])]
        grid = before.grid
        chord = after.place.on(grid).plus(-1.0, before.place)
        part = (edge - before.place.speed) / chord.speed
        near = replace(before, place=before.place.plus(part, chord))
        return self._reached(near, self._speed_alone(grid), 0.0)[0]

    def _turning(self, before: _Point, after: _Point) -> list[_Point]:
        """The point between two others where the branch turns back; none where no step leads to it."""
        found: list[_Point] = []
        for _ in range(_ROUNDS):
            direction = before.direction
            way = after.place.on(before.grid).plus(-1.0, before.place)
            length = self._inner(way, direction, before.sizes)
            slope = self._inner(after.direction.on(before.grid), direction, before.sizes)
            if not (length > 0 and slope > 0):
                break
            slopes = before.direction.speed, after.direction.speed / slope
            try:
                middle, _ = self._reached(before, direction, _flat(length, way.speed, *slopes))
            except SolveError:
                break
            found = [replace(middle, turns=True)]
            if middle.direction.speed * direction.speed > 0:
                before = middle
            else:
                after = middle
        return found

    def _speed_alone(self, grid: Grid) -> _Place:
        """The direction of the speed towards the last."""
        return _Place(self.task.rest(grid), self.last - self.task.speed)

    def _inner(self, one: _Place, other: _Place, sizes: Array) -> float:
        """The product of two places, in sizes (n,) of the orbit and parts of the range of speeds."""
        first, second = (each.curve.sampled(_SAMPLES) / sizes[:, None] for each in (one, other))
        return float((first * second).mean(axis=1).sum() + one.speed * other.speed / self.span**2)

    def _corrected(
        self, place: _Place, before: _Place, way: _Place, length: float, sizes: Array, grid: Grid
    ) -> tuple[_Place, _Place, Solutions]:
        """The next iterate after a place at a length from another along a way, the derivative of both curve
        and speed by the speed, and the solutions that gave the iterate. Raises SolveError."""
        task = self.task
        along = task.system.along(place.curve, columns_by(task.engine))
        next_one, by_speed = (
            task.method.solutions(OnePoint(each, place.speed), grid, True, task.engine)
            for each in (along, _BySpeed(along, place.curve))
        )
        for reason in (*next_one.failures.values(), *by_speed.failures.values()):
            raise reason
        assert isinstance(next_one.curve, Curve)
        assert isinstance(by_speed.curve, Curve)
        same, slope = _Place(next_one.curve[0], place.speed), _Place(by_speed.curve[0], 1.0)
        gone = self._inner(same.plus(-1.0, before), way, sizes)
        return same.plus((length - gone) / self._inner(slope, way, sizes), slope), slope, next_one

    def _point(self, place: _Place, towards: _Place, grid: Grid) -> _Point:
        """The point of a place that solves the equations on a grid, its direction towards another's side."""
        while True:
            sizes = _sizes(_peaks(place))
            _, slope, solutions = self._corrected(place, place, self._speed_alone(grid), 0.0, sizes, grid)
            side = math.copysign(1.0, self._inner(slope, towards.on(grid), sizes))
            direction = _scaled(slope, side / math.sqrt(self._inner(slope, slope, sizes)))
            fine = Grid.uniform(2 * grid.steps, grid.period, self.task.system.breaks)
            there, way = place.on(fine), direction.on(fine)
            better, _, judged = self._corrected(there, there, way, 0.0, sizes, fine)
            radii = [each.multipliers.spectral_radius[0] for each in (solutions, judged)]
            peaks, change = _peaks(better), better.plus(-1.0, there)
            off = _peaks(change) / _sizes(peaks)
            error = max(float(off.max()), abs(better.speed / place.speed - 1))
            if error <= self.task.rtol or 2 * fine.steps > _FINEST:
                break
            place, grid = better, fine
        errors = np.array([error, abs(radii[1] - radii[0])])
        return _Point(place, direction, grid, better.speed, peaks, float(radii[1]), errors)


def _peaks(place: _Place) -> Array:
    """Largest moduli (n,) of an orbit."""
    return np.abs(place.curve.sampled(_SAMPLES)).max(axis=1)


def _sizes(peaks: Array) -> Array:
    """What changes of coordinates (n,) are measured in: the largest of all for those that rest."""
    largest = peaks.max() or 1.0
    return np.where(peaks > _REST * largest, peaks, largest)


def _scaled(place: _Place, part: float) -> _Place:
    return _Place(Curve(place.curve.nodes, part * place.curve.coefficients), part * place.speed)


def _flat(length: float, change: float, first: float, last: float) -> float:
    """Where Hermite's cubic over a length, from 0 to a change and with these slopes at its ends, is flat."""
    mean = change / length
    a, b = 3 * (first + last - 2 * mean), 2 * (3 * mean - 2 * first - last)
    # Of the two zeros of a u² + b u + first the one between 0 and 1, where the slopes have different signs.
    root = math.sqrt(max(b * b - 4 * a * first, 0.0))
    return length * 2 * first / (-b + math.copysign(root, first))
