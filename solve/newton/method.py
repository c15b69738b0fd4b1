"""Newton's iteration with the interface of a method, so that nonlinear solutions on several grids are
compared like linear ones."""

import math
from dataclasses import replace

import numpy as np

from solve.arrays import Array
from solve.certify.comparison import SAFETY
from solve.certify.correction import CoordinateScale, correction
from solve.certify.resolution import AIM, first_steps, grid_sizes
from solve.contracts import Matrices, Motion
from solve.errors import NoOrbitError, SolveError, StepsError
from solve.methods.collocated import Collocated
from solve.methods.collocation import Collocation
from solve.methods.method import Method, Solutions, one_by_one
from solve.newton.iteration import Converged, Task, correct, iterate, with_zeros, without_zeros
from solve.period.curve import Curve
from solve.period.frozen import FrozenModes
from solve.period.grid import Grid
from solve.period.points import Points, ScaledEquations, SinglePoint
from solve.system import PeriodicSystem

_FEW_STEPS = 32
"""Number of steps of the grid on which the round-off of the loads is computed. Chosen by judgement: few steps
suffice, because the bound varies smoothly."""

_MAX_GROWTH = 3.0
"""Largest factor by which the predicted number of steps may exceed the number on the first grid. Chosen by
judgement: a larger factor may mean that the first grid is too coarse for the order to hold, or that a
coordinate is zero except for round-off."""

_COARSE = 256
"""Number of steps from which divergence of the iteration is final, so that no finer grid is tried. Chosen by
judgement."""


def _without_roundoff(along: PeriodicSystem, curve: Curve) -> PeriodicSystem:
    """Return the system linearised along a curve, with loads that keep coordinates exactly zero if they are
    zero on the curve. The round-off of the original loads may vary from phase to phase, which no grid
    resolves."""
    is_zero = ~curve.coefficients.any(axis=(1, 2))
    if not is_zero.any():
        return along

    def matrices(phase: Array, speed: float) -> Matrices:
        M, C, K, d = along.at(phase, speed)
        q, v, a = (speed**order * curve(phase, order).T for order in range(3))
        balanced = sum(np.einsum("kij,kj->ki", *term) for term in ((M, a), (C, v), (K, q)))
        return M, C, K, np.where(is_zero, balanced, d)

    return PeriodicSystem(matrices, along.coordinates, along.period, along.breaks)


def _size(curve: Curve, solutions: Solutions) -> float:
    """Return the norm of the correction from a curve to a solution, relative to max|q| of each coordinate."""
    change, largest = correction(curve, solutions)
    return float((change / without_zeros(largest)).max())


def _next(task: Task, curve: Curve, grid: Grid) -> Solutions:
    """Return the next Newton iterate from a curve. Coordinates that are zero on the curve remain zero."""
    solutions = correct(task, curve, grid, True)
    zero = np.array(~curve.coefficients.any(axis=(1, 2)))
    return with_zeros(solutions, zero) if zero.any() else solutions


class Newton(Method):
    """Newton's iteration with the interface of a method for one point, so that `certified` can compare grids.
    On each grid, the iteration uses the method with one more stage, and starts from the curve on the finest
    grid so far. The solution by the method itself is one further correction of the result.

    The multipliers of the two solutions belong to different curves. The multipliers of the more accurate
    solution belong to the curve before its last correction. The difference between the multipliers therefore
    includes the effect of this correction.

    Attributes
    ----------
    start : Motion
        Curve from which the iteration starts.
    first : int
        Number of steps of the grid on which the start was computed. On coarser grids, there may be no orbit
        near the start.
    predicts : bool
        Whether the number of steps of the first grid is predicted; otherwise, it is `first`.
    lower : Newton or None
        Iteration whose more accurate solution, with one more stage, this method returns.
    """

    first_order = True

    def __init__(
        self, task: Task, start: Motion, first: int = 0, predicts: bool = False, lower: "Newton | None" = None
    ):
        method = task.method
        self.task, self.start, self.first, self.finest = task, start, first, first
        self.predicts, self.lower = predicts, lower
        self._better: tuple[int, Converged] | None = None
        # The multipliers follow from the linearisation along the curve, and are not more accurate than the
        # curve.
        self._set(name=method.name, l_stable=method.l_stable, follows=method.follows, samples_evenly=False)
        self._set(order=method.curve_order, curve_order=method.curve_order)

    @property
    def linear(self) -> bool:
        return False

    @property
    def with_another_stage(self) -> "Newton":
        """Newton's iteration by the method with one more stage."""
        task = self.task.with_method(self.task.method.with_another_stage)
        return Newton(task, self.start, self.first, lower=self)

    @property
    def stages(self) -> Collocation:
        return self.task.method.stages

    @property
    def error_constant(self) -> float:
        return self.task.method.error_constant

    def linearised(self, points: Points, solutions: Solutions) -> Points:
        """Return the equations of the last solution of the single point, linearised along the more accurate
        curve."""
        assert self._better is not None
        curve = self._better[1].curve
        return SinglePoint(_without_roundoff(self.task.along(curve), curve), self.task.speed)

    @property
    def corrector(self) -> Collocated:
        return self.task.method

    def least_steps(self, modes: FrozenModes) -> Array:
        if self.predicts:
            self.predicts, self.first = False, self._predicted(modes)
        return np.full(len(modes), int(self.first / 1.2))

    def _predicted(self, modes: FrozenModes) -> int:
        """Return a number of steps that is expected to suffice. On a first grid, the orbit is corrected by
        the method with one more stage. The error is estimated as twice the change, and is assumed to decrease
        with the order of the method."""
        most = self.most_steps(self.task.system.n)
        first, _ = first_steps(self, self.point(), modes, True, self.task.rtol, most)
        (steps,) = grid_sizes(np.maximum(first, self.first)).tolist()
        task, grid = self.task, self.task.grid(steps)
        try:
            # With this limit, the next correction would be about rtol. It is included in the change below.
            curve = iterate(task, self.start, grid, last=math.sqrt(task.rtol)).curve
            better = _next(self._higher(task), curve, grid)
        except SolveError:
            return self.first
        size = _size(curve, better)
        self._keep(steps, Converged(better, 1, size))
        growth = (SAFETY * size / (AIM * task.rtol)) ** (1 / self.curve_order)
        if SAFETY * size <= task.rtol or growth > _MAX_GROWTH:
            return steps
        return min(int(growth * steps), self.most_steps(task.system.n))

    def _keep(self, steps: int, better: Converged) -> None:
        """Store the more accurate solution on a grid. Iterations on finer grids start from its curve."""
        self._better = steps, better
        if steps >= self.finest:
            self.start, self.finest = better.curve, steps

    @staticmethod
    def _higher(task: Task) -> Task:
        return task.with_method(task.method.with_another_stage)

    def bytes_a_step(self, n: int, orbit: bool = True, engine: str = "numpy") -> int:
        return self.task.method.bytes_a_step(n, orbit, engine)

    def most_steps(self, n: int, first_order: int = 0) -> int:
        return self.task.method.most_steps(n, first_order)

    def solutions(self, points: Points, grid: Grid, orbit: bool, engine: str = "numpy") -> Solutions:
        return one_by_one(points, lambda point: self._solution(point, grid))

    def _solution(self, point: Points, grid: Grid) -> Solutions:
        if self.lower is None:
            return self._pair(point, grid)[0]
        steps, better = self.lower._better or (0, None)
        if better is None or steps != grid.steps:
            _, better = self.lower._pair(point, grid)
        return better.solutions

    def _pair(self, point: Points, grid: Grid) -> tuple[Solutions, Converged]:
        """Return the solution by the method, and the more accurate solution.

        The error of the more accurate solution is about the square of its last correction, because
        convergence is quadratic. A further correction is necessary only if the last one may be the reason why
        the two solutions differ by more than the tolerance."""
        task, (steps, better) = self.task, self._better or (0, None)
        if isinstance(point, ScaledEquations):
            # The prediction does not scale the equations.
            task, better = replace(task, factors=point.factors), None
        higher, limit = self._higher(task), math.sqrt(task.last_correction)
        try:
            if better is None or steps != grid.steps or better.last > limit:
                better = iterate(higher, self.start, grid, last=limit)
            solutions, defect = _next(task, better.curve, grid), min(better.last, task.last_correction)
            if better.last > defect and self._apart(solutions, better) > task.rtol / SAFETY:
                better = iterate(higher, better.curve, grid)
                solutions, defect = _next(task, better.curve, grid), better.last
        except NoOrbitError as reason:
            if grid.steps < _COARSE:
                raise StepsError(str(reason)) from None
            raise
        self._keep(grid.steps, better)
        scale = CoordinateScale(task.along(better.curve), better.curve, task.speed, _FEW_STEPS)
        roundoff = scale.load_roundoff(np.abs(better.curve.sampled(1)).max(axis=1))
        return replace(solutions, defect=np.array([max(defect, roundoff)])), better

    @staticmethod
    def _apart(solutions: Solutions, better: Converged) -> float:
        """Return the largest relative difference between two solutions, of orbits or of multipliers."""
        multipliers = solutions.multipliers.difference(better.solutions.multipliers)
        return max(_size(better.curve, solutions), float(multipliers[0]))

    def point(self) -> SinglePoint:
        """Return the system linearised along the curve from which the iteration starts."""
        return SinglePoint(self.task.along(self.start), self.task.speed)
