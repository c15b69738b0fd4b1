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
from solve.newton.iteration import Task, correct, curve_of, iterate, without_zeros
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

_SHARED = 1e-12
"""Largest norm of a correction that changes the multipliers by little more than round-off. Chosen by
judgement: near a fold, the multipliers changed by 16 times the correction."""

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


class Newton(Method):
    """Newton's iteration with the interface of a method for one point, so that `certified` can compare grids.
    On each grid, the iteration starts from the curve on the finest grid so far, or from the curve of `lower`.

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
        Iteration by the method with one stage fewer, whose curves are the starts of this iteration.
    better : Curve or None
        Curve by the method with one more stage on the predicted grid, if this grid suffices.
    """

    first_order = True

    def __init__(
        self, task: Task, start: Motion, first: int = 0, predicts: bool = False, lower: "Newton | None" = None
    ):
        method = task.method
        self.task, self.start, self.first, self.finest = task, start, first, first
        self.predicts, self.lower, self.better = predicts, lower, None
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
        """Return the equations linearised along the solution of the single point."""
        curve, speed = curve_of(solutions), self.task.speed
        return SinglePoint(_without_roundoff(self.task.along(curve), curve), speed)

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
            higher = task.with_method(task.method.with_another_stage)
            better = correct(higher, curve, grid, True)
        except SolveError:
            return self.first
        change, largest = correction(curve, better)
        error = SAFETY * float((change / without_zeros(largest)).max())
        self.start, self.finest = curve, steps
        if error <= task.rtol:
            self.better = curve_of(better)
            return steps
        growth = (error / (AIM * task.rtol)) ** (1 / self.curve_order)
        if growth > _MAX_GROWTH:
            return steps
        self.start = curve_of(better)
        return min(int(growth * steps), task.method.most_steps(len(largest)))

    def bytes_a_step(self, n: int, orbit: bool = True, engine: str = "numpy") -> int:
        return self.task.method.bytes_a_step(n, orbit, engine)

    def most_steps(self, n: int, first_order: int = 0) -> int:
        return self.task.method.most_steps(n, first_order)

    def solutions(self, points: Points, grid: Grid, orbit: bool, engine: str = "numpy") -> Solutions:
        return one_by_one(points, lambda point: self._converged(point, grid))

    def _converged(self, point: Points, grid: Grid) -> Solutions:
        task = self.task
        if isinstance(point, ScaledEquations):
            task = replace(task, factors=point.factors)
        try:
            found = iterate(task, self._start_on(grid), grid)
            if self.lower is not None and found.last > _SHARED:
                # Otherwise, the multipliers would be those along the curve before the last correction, which
                # has kinks at the events of an earlier curve. Both solutions would share its error, so that
                # their difference would not show it.
                found = replace(found, solutions=correct(task, found.curve, grid, True))
        except NoOrbitError as reason:
            if grid.steps < _COARSE:
                raise StepsError(str(reason)) from None
            raise
        if grid.steps >= self.finest:
            self.start, self.finest = found.curve, grid.steps
        if self.lower is not None:
            # The error estimate includes the defect only of the solution with fewer stages.
            return found.solutions
        along = task.along(found.curve)
        scale = CoordinateScale(along, found.curve, task.speed, _FEW_STEPS)
        defect = max(found.last, scale.load_roundoff(np.abs(found.curve.sampled(1)).max(axis=1)))
        return replace(found.solutions, defect=np.array([defect]))

    def _start_on(self, grid: Grid) -> Motion:
        if self.lower is None:
            return self.start
        better = self.lower.better
        return self.lower.start if better is None or len(better.h) != grid.steps else better

    def point(self) -> SinglePoint:
        """Return the system linearised along the curve from which the iteration starts."""
        return SinglePoint(self.task.along(self.start), self.task.speed)
