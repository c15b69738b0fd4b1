"""Orbits over k parameters as a k-dimensional manifold: corrections onto it, and points with errors."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from solve.arrays import Array
from solve.certify.correction import CoordinateScale
from solve.equations import nonlinear_of
from solve.errors import NoOrbitError
from solve.kernel.formulas import columns_by
from solve.newton.branch_points import (
    ContinuationParameters,
    FollowedOrbit,
    Place,
    Point,
    sampled_together,
)
from solve.newton.linear_families import LinearFamily, linear_family, multipliers_of
from solve.period.grid import Grid
from solve.period.multipliers import EPS
from solve.period.quantities import orbit_figures, output_changes, repeats_early

_MAX_CORRECTIONS = 8
"""Number of corrections beyond which a step is too long. A choice."""

_MAX_LAST_CORRECTION, _DIVERGED = 1e-5, 3.0
"""Norms of a correction: upper limit of the last one, and limit beyond which the iteration diverges.
Choices."""

_QUADRATIC, _SAFETY = 1e-2, 10.0
"""Correction below which the iteration is quadratic, and factor on the next one, size³/last², that it
predicts. Choices."""

_RTOL_FRACTION, _MIN_LAST_CORRECTION = 0.01, 1e-10
"""Upper limit of the last correction as a fraction of rtol, if that is smaller; norm below which corrections
need not decrease."""

_LANES = 8
"""Number of segments of a period that the compiled code integrates at a time; the numbers of steps of finer
grids are multiples of it."""

_ORBIT_ROUNDOFF = 64 * EPS
"""Relative error of an orbit due to round-off, as for single orbits."""

_MAY_REST = 1e-10
"""Largest modulus of a coordinate, relative to the largest scale, up to which it is tested for being zero
within round-off. A choice."""

_MIN_SIZE = 0.05
"""Least scale of a coordinate relative to its largest amplitude on the manifold so far. A choice: without it
steps shrink to nothing where a coordinate passes through zero."""

_MAX_STEPS = 2**12
"""Largest number of steps per period; finer grids are not used. A choice, for the time they take."""


@dataclass
class Manifold:
    """Orbits over the parameters. resting: whether a coordinate may be zero within round-off;
    largest (n,): largest amplitudes so far."""

    parameters: ContinuationParameters
    resting: bool = field(default=False, init=False)
    largest: Array = field(default_factory=lambda: np.zeros(1), init=False)

    @property
    def tolerance(self) -> float:
        """Largest last correction."""
        rtol = self.parameters.task.rtol
        return max(_MIN_LAST_CORRECTION, min(_MAX_LAST_CORRECTION, _RTOL_FRACTION * rtol))

    def inner(self, one: Place, other: Place, sizes: Array, base: Place | None = None) -> float:
        """Inner product of a place, relative to a base if there is one, and another, in scaled coordinates
        (n,) and fractions of the ranges."""
        first, second, *third = sampled_together(one, other, *([] if base is None else [base]))
        values = one.values if base is None else one.values - base.values
        first = first - third[0] if third else first
        along = float((values * other.values / self.parameters.spans**2).sum())
        return float((first * second).mean(axis=1) @ sizes**-2.0) + along

    def distance(self, one: Place, other: Place, sizes: Array) -> float:
        """Norm of the difference of two places."""
        first, second = sampled_together(one, other)
        apart = (one.values - other.values) / self.parameters.spans
        return math.sqrt(float(((first - second) ** 2).mean(axis=1) @ sizes**-2.0) + float(apart @ apart))

    def reached(self, before: Point, ways: Sequence[Place], lengths: Sequence[float]) -> tuple[Point, int]:
        """Point at lengths from another along directions, one per parameter, and its number of corrections.
        With lengths 0 the place keeps its components along the directions on finer grids too.
        Raises SolveError subclasses if the iteration does not converge."""
        place, sizes = before.place, before.sizes
        for way, length in zip(ways, lengths, strict=True):
            place = place.plus(length / self.inner(way, way, sizes), way)
        place, family, corrections = self._converged(place, before.place, ways, lengths, sizes, before.grid)
        held = None if any(lengths) else ways
        return self.point(place, before.tangents, before.grid, family, sizes, held), corrections

    def first(self, place: Place, towards: Place, grid: Grid) -> Point:
        """Point near a place at the same value of the only parameter, directed towards another value. Raises
        SolveError subclasses."""
        scale = self._scale(place, grid)
        self.resting = scale.rests(place.largest)
        sizes = self._sizes(scale, place)
        found, family, _ = self._converged(place, place, [towards], [0.0], sizes, grid)
        return self.point(found, [towards], grid, family, sizes, [towards])

    def _converged(
        self,
        place: Place,
        before: Place,
        ways: Sequence[Place],
        lengths: Sequence[float],
        sizes: Array,
        grid: Grid,
    ) -> tuple[Place, LinearFamily, int]:
        """Place at lengths from another along directions, the last linear problem, and the number of
        corrections. Raises SolveError subclasses."""
        last = 1.0
        for corrections in range(1, _MAX_CORRECTIONS + 1):
            after, family = self._corrected(place, before, ways, lengths, sizes, grid)
            size, place = self.distance(after, place, sizes), after
            # The next correction of a quadratic iteration is not needed if it would be small.
            following = _SAFETY * size**3 / last**2 if corrections > 1 and size < _QUADRATIC else math.inf
            last = size
            if min(size, following) < self.tolerance:
                return place, family, corrections
            if not size < _DIVERGED:
                break
        raise NoOrbitError("the step is too long")

    def _corrected(
        self,
        place: Place,
        before: Place,
        ways: Sequence[Place],
        lengths: Sequence[float],
        sizes: Array,
        grid: Grid,
    ) -> tuple[Place, LinearFamily]:
        """Next iterate after a place at lengths from another along directions, and all solutions of the
        linear problem. Raises SolveError."""
        family = linear_family(self.parameters, place, grid, sizes)
        gone = [self.inner(family.place, way, sizes, before) for way in ways]
        missing = np.subtract(lengths, gone)
        matrix = [[self.inner(tangent, way, sizes) for tangent in family.tangents] for way in ways]
        try:
            weights = np.linalg.solve(matrix, missing)
        except np.linalg.LinAlgError:
            raise NoOrbitError(
                "the continuation step is singular: a tangent of the branch is normal to the directions "
                "of the step"
            ) from None
        return _sum(family.place, weights, family.tangents), family

    def point(
        self,
        place: Place,
        towards: Sequence[Place],
        grid: Grid,
        family: LinearFamily | None = None,
        sizes: Array | None = None,
        held: Sequence[Place] | None = None,
    ) -> Point:
        """Point of a place that solves the equations on a grid, with tangents on the side of others. family:
        solutions of the linear problem near the place with scales `sizes`, if known. held: directions in
        which finer grids do not move the place, by default the tangents."""
        known, scale = np.zeros(1) if sizes is None else sizes, self._scale(place, grid)
        if place.largest.min() <= _MAY_REST * known.max() or sizes is None:
            self.resting = self.resting or scale.rests(place.largest)
        if family is None or sizes is None:
            sizes = self._sizes(scale, place)
            family = linear_family(self.parameters, place, grid, sizes)
        while True:
            sizes = self._sizes(self._scale(place, grid), place)
            tangents = self._orthonormal(family, [each.on(grid) for each in towards], sizes)
            fine = self.parameters.task.grid(_finer(grid.steps))
            ways = held or tangents
            better, _ = self._corrected(place, place, ways, [0.0] * len(ways), sizes, fine)
            scale = self._scale(better, fine).of(better.largest, roundoff=self.resting)
            one, other = sampled_together(place, better)
            off = np.abs(other - one).max(axis=1) / scale + _ORBIT_ROUNDOFF
            moved = np.abs(better.values - place.values)
            moved = float((moved / np.maximum(np.abs(place.values), self.parameters.spans)).max())
            error = max(float(off.max()), moved)
            rtol = self.parameters.task.rtol
            if error > rtol and not self.resting and self._scale(better, fine).rests(better.largest):
                self.resting = True
            elif error <= rtol or 2 * fine.steps > _MAX_STEPS:
                break
            else:
                place, grid = better, fine
                family = linear_family(self.parameters, place, grid, sizes)
        there = place.on(Grid(better.curve.nodes, np.zeros(len(better.curve.h), dtype=bool)))
        found = self._orbit(there, better, fine, off, sizes)
        off = abs(found.radius - abs(family.multipliers[0]))
        found = replace(found, errors=np.array([error, off + EPS * found.radius]))
        return Point(place, sizes, tangents, grid, found, periods=self.parameters.task.periods)

    def _orthonormal(self, family: LinearFamily, towards: Sequence[Place], sizes: Array) -> tuple[Place, ...]:
        """Orthonormal tangents, each nearest to one of other directions, if there are any."""
        basis: list[Place] = []
        for tangent in family.tangents:
            basis.append(self.unit(tangent, basis, sizes))
        found: list[Place] = []
        if not towards:
            return tuple(basis)
        for way in towards:
            weights = [self.inner(way, tangent, sizes) for tangent in basis]
            nearest = _sum(basis[0].times(weights[0]), weights[1:], basis[1:])
            found.append(self.unit(nearest, found, sizes))
        return tuple(found)

    def unit(self, way: Place, others: Sequence[Place], sizes: Array) -> Place:
        """Unit vector along a direction without its components along orthonormal others."""
        for _ in range(2):
            for other in others:
                way = way.plus(-self.inner(way, other, sizes), other)
        return way.times(1 / math.sqrt(self.inner(way, way, sizes)))

    def _orbit(self, there: Place, better: Place, grid: Grid, off: Array, sizes: Array) -> FollowedOrbit:
        """More accurate of two places, without the errors of orbit and radius; off: relative differences (n,)
        of the coordinates."""
        task, curve = self.parameters.task_at(better.values), better.curve
        multipliers = multipliers_of(self.parameters, better, grid, sizes)
        figures = orbit_figures(task.system, curve, task.speed, task.engine)
        errors = np.concatenate(
            (off, output_changes(task.system, task.speed, there.curve, curve, task.engine))
        )
        early = task.periods > 1 and repeats_early(curve, task.periods)
        radius = float(abs(multipliers[0]))
        return FollowedOrbit(better.values, figures, errors, multipliers, radius, np.zeros(2), early)

    def _sizes(self, scale: CoordinateScale, place: Place) -> Array:
        """Scales (n,) of the coordinates in lengths of steps."""
        self.largest = np.maximum(self.largest, place.amplitudes)
        return np.maximum(scale.of(place.amplitudes, 1.0, self.resting), _MIN_SIZE * self.largest)

    def _scale(self, place: Place, grid: Grid) -> CoordinateScale:
        task = self.parameters.task_at(place.values)
        along = nonlinear_of(task.system).along(place.curve, columns_by(task.engine))
        return CoordinateScale(along, place.curve, task.speed, grid.steps)


def _finer(steps: int) -> int:
    """Next number of steps: 3/2 times a power of two, 4/3 times another number."""
    finer = 3 * steps // 2 if steps & (steps - 1) == 0 else math.ceil(4 * steps / 3)
    return -(-finer // _LANES) * _LANES


def _sum(place: Place, weights: Sequence[float] | Array, others: Sequence[Place]) -> Place:
    """Place and multiples of others."""
    for weight, other in zip(weights, others, strict=True):
        place = place.plus(float(weight), other)
    return place
