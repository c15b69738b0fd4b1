"""Orbits as points of a k-dimensional manifold over k parameters: corrections towards the manifold, and
points with error estimates."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from solve.arrays import EPS, Array
from solve.certify.correction import CoordinateScale
from solve.equations import nonlinear_of
from solve.errors import NoOrbitError
from solve.kernel.formulas import columns_by
from solve.newton.branch_points import (
    ContinuationParameters,
    FollowedOrbit,
    Point,
    Unknowns,
    sampled_together,
)
from solve.newton.linear_families import LinearFamily
from solve.period.grid import Grid
from solve.period.quantities import orbit_figures, output_changes, repeats_early

_MAX_CORRECTIONS = 8
"""Maximum number of corrections of a step; a step that needs more is too long. Chosen by judgement."""

_MAX_LAST_CORRECTION, _DIVERGED = 1e-4, 3.0
"""Upper limits of the norms of the last and of the first correction. Each further correction must be smaller
than the one before. Chosen by judgement."""

_QUADRATIC, _SAFETY = 1e-2, 10.0
"""Norm of a correction below which the convergence counts as quadratic, and safety factor on the predicted
norm of the next correction. The prediction is size³/last², where `last` and `size` are the norms of the last
two corrections. Chosen by judgement."""

_RTOL_FRACTION, _MIN_LAST_CORRECTION = 0.1, 1e-10
"""Upper limit of the last correction as a fraction of rtol, if this is smaller than `_MAX_LAST_CORRECTION`;
and the norm of a correction below which the iteration always counts as converged. Chosen by judgement: the
remaining correction is part of the error estimate, and the correction with one more stage removes it from the
orbit."""

_LANES = 8
"""Number of segments of a period that the compiled code integrates simultaneously. The numbers of steps of
finer grids are multiples of this number."""

_ORBIT_ROUNDOFF = 64 * EPS
"""Relative error of an orbit due to round-off. The same value is used for single orbits
(`solve.certify.comparison`)."""

_MAY_REST = 1e-10
"""Largest modulus of a coordinate, relative to the largest scale, up to which the coordinate is tested for
being zero within round-off. Chosen by judgement."""

_MIN_SIZE = 0.05
"""Smallest scale of a coordinate, relative to its largest amplitude on the manifold so far. Chosen by
judgement: without this limit, step lengths would tend to zero where the amplitude of a coordinate passes
through zero."""

_MAX_STEPS = 2**12
"""Largest number of steps per period. Chosen by judgement, to limit the computing time."""


@dataclass
class Manifold:
    """Manifold of orbits over the parameters.

    resting: whether some coordinate stays zero (within round-off) throughout an orbit. largest (n,): largest
    amplitude of each coordinate so far."""

    parameters: ContinuationParameters
    resting: bool = field(default=False, init=False)
    largest: Array = field(default_factory=lambda: np.zeros(1), init=False)

    @property
    def tolerance(self) -> float:
        """Norm of a correction below which the iteration counts as converged."""
        rtol = self.parameters.task.rtol
        return max(_MIN_LAST_CORRECTION, min(_MAX_LAST_CORRECTION, _RTOL_FRACTION * rtol))

    def inner(self, one: Unknowns, other: Unknowns, sizes: Array, base: Unknowns | None = None) -> float:
        """Return the inner product of two vectors of unknowns. The coordinates are divided by `sizes` (n,),
        and the parameters by the lengths of their ranges. If `base` is given, it is subtracted from the first
        vector."""
        (first, second, *third), weights = sampled_together(one, other, *([] if base is None else [base]))
        values = one.values if base is None else one.values - base.values
        first = first - third[0] if third else first
        along = float((values * other.values / self.parameters.spans**2).sum())
        return float((first * second) @ weights @ sizes**-2.0) + along

    def distance(self, one: Unknowns, other: Unknowns, sizes: Array) -> float:
        """Return the norm of the difference of two vectors of unknowns, scaled as in `inner`."""
        (first, second), weights = sampled_together(one, other)
        apart = (one.values - other.values) / self.parameters.spans
        return math.sqrt(float((first - second) ** 2 @ weights @ sizes**-2.0) + float(apart @ apart))

    def component(self, before: Point, after: Point, direction: Unknowns) -> float:
        """Return the inner product of `direction` and the step from `before` to `after`. Curves are
        subtracted at sampled phases: between grids with different events, interpolation errors could exceed a
        short step."""
        return self.inner(after.unknowns, direction, before.sizes, before.unknowns)

    def reached(
        self,
        before: Point,
        directions: Sequence[Unknowns],
        lengths: Sequence[float],
        check: Callable[[Unknowns, Unknowns], None] | None = None,
        curvature: Unknowns | None = None,
    ) -> tuple[Point, int]:
        """Return the point at the distances `lengths` from `before` along `directions`, one per parameter.
        Also return the number of corrections. If all lengths are 0, the components along the directions also
        remain fixed when the grid is refined.

        check: function that is called with the converged unknowns and their first tangent. It raises
        SolveError to reject the point before the errors are estimated, which takes as long as the iteration.
        curvature: derivative of the first direction with respect to the length; it improves the initial
        guess.

        Raises SolveError subclasses if the iteration does not converge."""
        unknowns, sizes = before.unknowns, before.sizes
        for direction, length in zip(directions, lengths, strict=True):
            unknowns = unknowns.plus(length / self.inner(direction, direction, sizes), direction)
        if curvature is not None:
            unknowns = unknowns.plus(lengths[0] ** 2 / 2, curvature)
        step = _Step(before.unknowns, directions, lengths, sizes)
        unknowns, family, corrections = self._converged(unknowns, step, before.grid)
        if check is not None:
            check(unknowns, self._orthonormal(family, before.tangents, sizes)[0])
        held = None if any(lengths) else directions
        return self.point(unknowns, before.tangents, before.grid, family, sizes, held), corrections

    def first(self, unknowns: Unknowns, towards: Unknowns, grid: Grid) -> Point:
        """Return the point near `unknowns` at the same value of the only parameter. The tangent of the point
        is directed along `towards`. Raises SolveError subclasses."""
        self.resting = self._scale(unknowns, grid).rests(unknowns.largest)
        return self.held(unknowns, [towards], grid)

    def held(self, unknowns: Unknowns, ways: Sequence[Unknowns], grid: Grid) -> Point:
        """Return the point near `unknowns` with the same components along the directions `ways`, one per
        parameter. Raises SolveError subclasses."""
        sizes = self._sizes(self._scale(unknowns, grid), unknowns)
        found, family, _ = self._converged(unknowns, _Step.none(unknowns, ways, sizes), grid)
        return self.point(found, ways, grid, family, sizes, ways)

    def along(
        self,
        before: Point,
        length: float,
        check: Callable[[Unknowns, Unknowns], None] | None = None,
        curvature: Unknowns | None = None,
    ) -> tuple[Point, int]:
        """Return the point at the distance `length` along the first tangent of `before`, and the number of
        corrections; see `reached` for the other arguments."""
        lengths = [length, *[0.0] * (len(before.tangents) - 1)]
        return self.reached(before, before.tangents, lengths, check, curvature)

    def curvature(self, one: Point, other: Point) -> Unknowns:
        """Return the derivative of the first tangent with respect to the arclength, from the difference
        between two points."""
        length = self.distance(other.unknowns, one.unknowns, other.sizes)
        return one.direction.times(-1.0).plus(1.0, other.direction).times(1 / length)

    def _converged(self, unknowns: Unknowns, step: "_Step", grid: Grid) -> tuple[Unknowns, LinearFamily, int]:
        """Return the converged unknowns of a step, a linear problem near them, and the number of corrections.
        Raises SolveError subclasses."""
        last = _DIVERGED
        for corrections in range(1, _MAX_CORRECTIONS + 1):
            family = LinearFamily(self.parameters, unknowns, grid, step.sizes)
            after = self._corrected(family.unknowns, family.tangents, step)
            size, unknowns = self.distance(after, unknowns, step.sizes), after
            # With quadratic convergence, the next correction is omitted if its predicted size is small.
            following = _SAFETY * size**3 / last**2 if corrections > 1 and size < _QUADRATIC else math.inf
            if min(size, following) < self.tolerance:
                return unknowns, family, corrections
            if not size < last:
                break
            last = size
        raise NoOrbitError("the step is too long")

    def _corrected(self, solution: Unknowns, tangents: Sequence[Unknowns], step: "_Step") -> Unknowns:
        """Add multiples of the tangents to `solution`, a solution of the linear problem, so that the sum
        meets the conditions of a step. Return the sum. Raises NoOrbitError."""
        gone = [self.inner(solution, each, step.sizes, step.before) for each in step.directions]
        matrix = [[self.inner(tangent, each, step.sizes) for tangent in tangents] for each in step.directions]
        try:
            weights = np.linalg.solve(matrix, np.subtract(step.lengths, gone))
        except np.linalg.LinAlgError:
            raise NoOrbitError(
                "the continuation step is singular: a tangent of the branch is normal to the directions "
                "of the step"
            ) from None
        return _sum(solution, weights, tangents)

    def point(
        self,
        unknowns: Unknowns,
        towards: Sequence[Unknowns],
        grid: Grid,
        family: LinearFamily | None = None,
        sizes: Array | None = None,
        held: Sequence[Unknowns] | None = None,
    ) -> Point:
        """Return the point of the manifold whose unknowns solve the equations on a grid. The grid is refined
        if the estimated error exceeds rtol.

        towards: directions with which the tangents of the point form acute angles. family: solutions of the
        linear problem near the unknowns, for the scales `sizes`, if already computed. held: directions along
        which the point does not move when the grid is refined; by default its tangents."""
        known, scale = np.zeros(1) if sizes is None else sizes, self._scale(unknowns, grid)
        if unknowns.largest.min() <= _MAY_REST * known.max() or sizes is None:
            self.resting = self.resting or scale.rests(unknowns.largest)
        if family is None or sizes is None:
            sizes = self._sizes(scale, unknowns)
            family = LinearFamily(self.parameters, unknowns, grid, sizes)
        while True:
            sizes = self._sizes(scale, unknowns)
            step = _Step.none(unknowns, held or self._orthonormal(family, towards, sizes), sizes)
            better = self._better(unknowns, step, grid, family)
            largest = scale.scales(better.largest, roundoff=self.resting)
            (one, other), _ = sampled_together(unknowns, better)
            off = np.abs(other - one).max(axis=1) / largest + _ORBIT_ROUNDOFF
            moved = np.abs(better.values - unknowns.values)
            moved = float((moved / np.maximum(np.abs(unknowns.values), self.parameters.spans)).max())
            error = max(float(off.max()), moved)
            rtol = self.parameters.task.rtol
            if error > rtol and not self.resting and self._scale(better, grid).rests(better.largest):
                self.resting = True
            elif error <= rtol or 2 * _finer(grid.steps) > _MAX_STEPS:
                break
            else:
                grid = self.parameters.task.grid(_finer(grid.steps))
                family = LinearFamily(self.parameters, better, grid, sizes)
                unknowns = self._corrected(family.unknowns, family.tangents, step)
                scale = self._scale(unknowns, grid)
        there = LinearFamily(self.parameters, better, grid, sizes, more_stages=True)
        tangents = tuple(each.beside(unknowns) for each in self._orthonormal(there, towards, sizes))
        found = self._orbit(unknowns.beside(better), better, there.multipliers, off)
        off = abs(found.radius - abs(family.multipliers[0]))
        found = replace(found, errors=np.array([error, off + EPS * found.radius]))
        return Point(unknowns, sizes, tangents, grid, found, periods=self.parameters.task.periods)

    def _better(self, unknowns: Unknowns, step: "_Step", grid: Grid, nearby: LinearFamily) -> Unknowns:
        """Correct converged unknowns by the method with one more stage, and return the result. nearby: linear
        problem near these unknowns; its tangents are used if both problems are regular. Raises SolveError."""
        family = LinearFamily(self.parameters, unknowns, grid, step.sizes, more_stages=True)
        solution = family.unknowns
        if not (nearby.is_regular and family.is_regular):
            return self._corrected(solution, family.tangents, step)
        return self._corrected(solution, [each.beside(solution) for each in nearby.tangents], step)

    def _orthonormal(
        self, family: LinearFamily, towards: Sequence[Unknowns], sizes: Array
    ) -> tuple[Unknowns, ...]:
        """Return orthonormal tangents, each nearest to one of the directions `towards`. If `towards` is
        empty, return any orthonormal tangents."""
        basis: list[Unknowns] = []
        for tangent in family.tangents:
            basis.append(self.unit(tangent, basis, sizes))
        if not towards:
            return tuple(basis)
        if len(basis) == 1:
            (only,), (direction,) = basis, towards
            return (only.times(math.copysign(1.0, self.inner(direction, only, sizes))),)
        found: list[Unknowns] = []
        for direction in towards:
            weights = [self.inner(direction, tangent, sizes) for tangent in basis]
            nearest = _sum(basis[0].times(weights[0]), weights[1:], basis[1:])
            found.append(self.unit(nearest, found, sizes))
        return tuple(found)

    def unit(self, direction: Unknowns, others: Sequence[Unknowns], sizes: Array) -> Unknowns:
        """Return the component of `direction` that is orthogonal to the orthonormal vectors `others`, scaled
        to unit length."""
        for _ in range(2):
            for other in others:
                direction = direction.plus(-self.inner(direction, other, sizes), other)
        return direction.times(1 / math.sqrt(self.inner(direction, direction, sizes)))

    def _orbit(self, there: Unknowns, better: Unknowns, multipliers: Array, off: Array) -> FollowedOrbit:
        """Return the orbit of the more accurate unknowns `better`, with zeros as the errors of orbit and
        radius.

        there: less accurate unknowns. off (n,): relative differences between the coordinates of `there` and
        of `better`."""
        task, curve = self.parameters.task_at(better.values), better.curve
        figures = orbit_figures(task.system, curve, task.speed, task.engine)
        errors = np.concatenate(
            (off, output_changes(task.system, task.speed, there.curve, curve, task.engine))
        )
        early = task.periods > 1 and repeats_early(curve, task.periods)
        radius = float(abs(multipliers[0]))
        return FollowedOrbit(better.values, figures, errors, multipliers, radius, np.zeros(2), early)

    def _sizes(self, scale: CoordinateScale, unknowns: Unknowns) -> Array:
        """Return the scales (n,) of the coordinates for step lengths. Update `largest`."""
        self.largest = np.maximum(self.largest, unknowns.amplitudes)
        return np.maximum(scale.scales(unknowns.amplitudes, 1.0, self.resting), _MIN_SIZE * self.largest)

    def _scale(self, unknowns: Unknowns, grid: Grid) -> CoordinateScale:
        task = self.parameters.task_at(unknowns.values)
        along = nonlinear_of(task.system).along(unknowns.curve, columns_by(task.engine))
        return CoordinateScale(along, unknowns.curve, task.speed, grid.steps)


@dataclass(frozen=True)
class _Step:
    """Conditions of a step: its lengths along directions, one per parameter, measured from the unknowns
    `before`. sizes (n,): scales of the coordinates."""

    before: Unknowns
    directions: Sequence[Unknowns]
    lengths: Sequence[float]
    sizes: Array

    @classmethod
    def none(cls, unknowns: Unknowns, directions: Sequence[Unknowns], sizes: Array) -> "_Step":
        """Return the conditions of a step of length 0 along all directions. Corrections are then normal to
        the directions."""
        return cls(unknowns, directions, [0.0] * len(directions), sizes)


def _finer(steps: int) -> int:
    """Return the next grid size: 5/4 of the number of steps, rounded up to a multiple of `_LANES`. The factor
    divides the error of Radau's method of order 13 by about twenty."""
    return math.ceil(5 * steps / 4 / _LANES) * _LANES


def _sum(unknowns: Unknowns, weights: Sequence[float] | Array, others: Sequence[Unknowns]) -> Unknowns:
    """Return the unknowns plus the weighted sum of the vectors `others`."""
    for weight, other in zip(weights, others, strict=True):
        unknowns = unknowns.plus(float(weight), other)
    return unknowns
