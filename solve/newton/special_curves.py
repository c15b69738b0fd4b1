"""Curves of folds and of period doublings in two parameters.

The orbits at all values of both parameters form a surface. A function g on this surface is zero at the
special points. For folds, g is the determinant of the parameter components of two tangents: if it is zero,
both parameters are stationary in one direction on the surface. For doublings, g = Π (1 + ρ)/(1 + |ρ|). The
curve g = 0 is followed on the surface, where it is smooth even at cusps (Y. A. Kuznetsov, Elements of Applied
Bifurcation Theory, 10.3)."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from solve.arrays import Array
from solve.errors import NoOrbitError, SolveError, counted
from solve.newton.branch_points import ContinuationParameters, Point, Unknowns
from solve.newton.manifold import Manifold
from solve.newton.special_points import doubling_test, is_located, zero_between
from solve.results.branch import DOUBLING
from solve.results.special_curves import CUSP
from solve.terminal import progress
from solve.threads import one_thread

_FIRST_STEP, _MAX_STEP, _MIN_STEP, _GROWTH = 0.03, 0.15, 1e-4, 1.5
"""Initial and largest step length, step length below which the curve ends, and factor by which the step
length grows after a success. Lengths are in scaled coordinates and fractions of the parameter ranges. Chosen
by judgement."""

_FEW, _MAX_CORRECTIONS = 4, 12
"""Number of evaluations of g in a step up to which the next step is longer, and largest permitted number of
evaluations in a step. Chosen by judgement."""

_MIN_COSINE = 0.9
"""Smallest permitted cosine of the angle between a step and the preceding tangent. Chosen by judgement."""

_EDGE = 1e-9
"""Distance beyond the end of a range, relative to the length of the range, up to which a point counts as
inside. Chosen by judgement: above round-off."""

_DIFFERENCE = 1e-3
"""Step of the central differences of g. Chosen by judgement: their truncation error is about 1e-6, and their
round-off error about 1e-10."""


@dataclass(frozen=True)
class _OnCurve:
    """Point of a curve of special points.

    along (2,): components of the tangent of the curve in the directions of the two tangents of the surface.
    slope: derivative of g normal to the curve."""

    point: Point
    along: Array
    slope: float

    @property
    def rates(self) -> Array:
        """Rates (2,) of both parameters along the tangent of the curve."""
        return self.along @ np.array([each.values for each in self.point.tangents])


def follow_curve(
    parameters: ContinuationParameters, start: Point, kind: str, most: int
) -> tuple[list[Point], str]:
    """Follow a curve of folds or period doublings from the point `start`. Return at most `most` points of the
    curve, and the reason if they end inside the ranges of the parameters (otherwise an empty string)."""
    with one_thread(parameters.task.system.n), progress.task("points", most) as count:
        return _CurveFollower(parameters, kind).follow(start, most, count.add)


class _CurveFollower:
    """Continuation of a curve of special points of the kind `kind`."""

    def __init__(self, parameters: ContinuationParameters, kind: str):
        self.manifold, self.kind = Manifold(parameters), kind
        self.ranges = np.sort(parameters.ranges, axis=1)
        self.spans = parameters.spans

    def follow(self, start: Point, most: int, count: Callable[[], None]) -> tuple[list[Point], str]:
        """Implementation of `follow_curve`; `count` is called after each step."""
        current, length = self._first(start), _FIRST_STEP
        points = [current.point]
        while len(points) < most:
            try:
                after, length, evaluations = self._step(current, length)
                if not self._inside(after.point):
                    return [*points, self._at_the_edge(current, length, after)], ""
                if float((current.rates * after.rates / self.spans**2).sum()) < 0:
                    points.append(self._cusp(current, length))
            except NoOrbitError as reason:
                return points, str(reason)
            points.append(after.point)
            count()
            current = after
            length = min(length * (_GROWTH if evaluations <= _FEW else 1.0), _MAX_STEP)
        asked = counted(most, "point")
        return points[:most], f"the curve continues beyond the {asked} requested; request more"

    def test(self, point: Point) -> float:
        """Return the value of the test function g at a point. The tangents of the point must have the same
        orientation as those of the neighbouring points."""
        if self.kind == DOUBLING:
            return doubling_test(point)
        return float(np.linalg.det(np.array([each.values / self.spans for each in point.tangents])))

    def _first(self, start: Point) -> _OnCurve:
        """Return the first point of the curve, from a point of a branch in which only the first parameter
        varies."""
        second = self.manifold.parameters.ranges[1]
        unknowns = Unknowns(start.unknowns.curve, np.array([start.unknowns.value, second[0]]))
        point = replace(self.manifold.point(unknowns, (), start.grid), kind=self.kind)
        found = self._with_tangent(point)
        back = found.rates[1] * (second[1] - second[0]) < 0
        return replace(found, along=-found.along, slope=-found.slope) if back else found

    def _with_tangent(self, point: Point) -> _OnCurve:
        """Return the point of the curve with its tangent, from central differences of g."""
        gradient = np.zeros(2)
        for axis in range(2):
            for sign in (-1, 1):
                moved = [sign * _DIFFERENCE if axis == each else 0.0 for each in range(2)]
                beside, _ = self.manifold.reached(point, point.tangents, moved)
                gradient[axis] += sign * self.test(beside) / (2 * _DIFFERENCE)
        size = float(np.linalg.norm(gradient))
        if size == 0:
            raise NoOrbitError("the curve has no tangent")
        return _OnCurve(point, np.array([-gradient[1], gradient[0]]) / size, -size)

    def _step(self, before: _OnCurve, length: float) -> tuple[_OnCurve, float, int]:
        """Return the next point, the step length to it, and the number of evaluations of g. The step length
        is halved until the step succeeds."""
        while length > _MIN_STEP:
            try:
                after, evaluations = self._corrected(before, length)
                return after, length, evaluations
            except SolveError:
                length /= 2
        at = self.manifold.parameters.text(before.point.orbit.values)
        raise NoOrbitError(f"the curve cannot be continued beyond {at}")

    def _corrected(self, before: _OnCurve, length: float) -> tuple[_OnCurve, int]:
        """Return the point of the curve at a given length along the tangent at `before`, and the number of
        evaluations of g. The secant method determines the distance normal to this tangent. Raises SolveError
        subclasses."""
        normal, slope = np.array([before.along[1], -before.along[0]]), before.slope
        point, aside = self._beside(before, length * before.along), 0.0
        value = self.test(point)
        for evaluation in range(2, _MAX_CORRECTIONS + 1):
            step = -value / slope
            if not abs(step) <= length:
                break
            aside += step
            last, previous = value, point
            point = self._beside(before, length * before.along + aside * normal)
            value = self.test(point)
            if value == last or is_located(self.manifold, previous, point):
                return self._on_curve(before, point, slope), evaluation
            slope = (value - last) / step
        raise NoOrbitError("the step is too long")

    def _beside(self, before: _OnCurve, lengths: Array) -> Point:
        point, _ = self.manifold.reached(before.point, before.point.tangents, lengths.tolist())
        return replace(point, kind=self.kind)

    def _on_curve(self, before: _OnCurve, point: Point, slope: float) -> _OnCurve:
        """Return the point of the curve with its tangent. This tangent is the tangent at `before`, reflected
        about the chord between the points. Raises NoOrbitError if the curve bends too much."""
        first = before.point
        along = np.array([self.manifold.component(first, point, each) for each in first.tangents])
        along /= np.linalg.norm(along)
        cosine = float(along @ before.along)
        if cosine < _MIN_COSINE:
            raise NoOrbitError("the curve bends too much within the step")
        after = 2 * cosine * along - before.along
        return _OnCurve(point, after / np.linalg.norm(after), slope)

    def _cusp(self, before: _OnCurve, length: float) -> Point:
        """Return the point, within a step, at which both parameters are stationary along the curve."""
        towards = before.rates / self.spans**2

        def at(part: float) -> tuple[float, Point]:
            found, _ = self._corrected(before, part)
            exact = self._with_tangent(found.point)
            side = math.copysign(1.0, float(exact.along @ found.along))
            return side * float(exact.rates @ towards), found.point

        value, _ = at(length)
        ends = (0.0, length), (float(before.rates @ towards), value)
        _, point = zero_between(at, *ends, lambda *two: is_located(self.manifold, *two), before.point)
        return replace(point, kind=CUSP)

    def _inside(self, point: Point) -> bool:
        """Whether the parameters of a point are within their ranges."""
        within = _EDGE * self.spans
        values, (low, high) = point.orbit.values, self.ranges.T
        return bool(((values >= low - within) & (values <= high + within)).all())

    def _at_the_edge(self, before: _OnCurve, length: float, after: _OnCurve) -> Point:
        """Return the point, within a step, at which the curve leaves the parameter ranges."""
        first, last = before.point.orbit.values, after.point.orbit.values
        edges = np.where(last > first, self.ranges[:, 1], self.ranges[:, 0])
        with np.errstate(divide="ignore", invalid="ignore"):
            parts = np.where((last - edges) * (last - first) > 0, (edges - first) / (last - first), np.inf)
        axis = int(np.argmin(parts))

        def at(part: float) -> tuple[float, Point]:
            found, _ = self._corrected(before, part)
            return float(found.point.orbit.values[axis] - edges[axis]), found.point

        ends = (0.0, length), (float(first[axis] - edges[axis]), float(last[axis] - edges[axis]))
        if ends[1][0] * ends[1][1] >= 0:
            return after.point
        return zero_between(at, *ends, lambda *two: is_located(self.manifold, *two), before.point)[1]
