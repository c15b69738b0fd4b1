"""Newton's iteration in the form of a method, so that nonlinear solutions on several grids are compared like
linear ones."""

from dataclasses import replace

import numpy as np

from solve.arrays import Array
from solve.certify.correction import CoordinateScale
from solve.contracts import Matrices, Motion
from solve.errors import NoOrbitError, StepsError
from solve.methods.collocated import Collocated
from solve.methods.collocation import Collocation
from solve.methods.method import Method, Solutions, one_by_one
from solve.newton.iteration import Converged, Task, iterate
from solve.period.curve import Curve
from solve.period.frozen import FrozenModes
from solve.period.grid import Grid
from solve.period.points import Points, ScaledEquations, SinglePoint
from solve.system import PeriodicSystem

_FEW_STEPS = 32
"""Number of steps of the grid on which the round-off of the loads is computed. A choice: few suffice, because
the bound varies smoothly."""

_COARSE = 256
"""Number of steps above which no finer grid is tried if the iteration diverges. A choice."""


def _without_roundoff(along: PeriodicSystem, curve: Curve) -> PeriodicSystem:
    """System linearised along a curve, with loads corrected so that coordinates that are zero remain exactly
    zero. Round-off of uncorrected loads may vary from phase to phase, and no grid resolves it."""
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
    """Newton's iteration in the form of a method for one point, so that `certified` can compare grids. On
    each grid it starts from the last curve of the finest grid so far, or from the curve of `lower`, the
    iteration with one stage fewer. found: converged iteration by the task's method on the first grid, if
    available."""

    first_order = True

    def __init__(
        self,
        task: Task,
        start: Motion,
        steps: int = 0,
        found: Converged | None = None,
        lower: "Newton | None" = None,
    ):
        method = task.method
        self.task, self.start, self.first, self.finest, self.found = task, start, steps, steps, found
        self.lower = lower
        # The next step linearises about this curve, so its solution is not more accurate than the curve.
        self._set(name=method.name, l_stable=method.l_stable, follows=method.follows, samples_evenly=False)
        self._set(order=method.curve_order, curve_order=method.curve_order)

    @property
    def linear(self) -> bool:
        return False

    @property
    def with_another_stage(self) -> "Newton":
        """The same iteration by the method with one more stage."""
        task = replace(self.task, method=self.task.method.with_another_stage)
        return Newton(task, self.start, self.first, lower=self)

    @property
    def stages(self) -> Collocation:
        return self.task.method.stages

    @property
    def error_constant(self) -> float:
        return self.task.method.error_constant

    def linearised(self, points: Points, solutions: Solutions) -> Points:
        """Equations linearised along the solution of the single point."""
        assert isinstance(solutions.curve, Curve)
        curve, speed = solutions.curve[0], self.task.speed
        return SinglePoint(_without_roundoff(self.task.along(curve), curve), speed)

    @property
    def corrector(self) -> Collocated:
        return self.task.method

    def least_steps(self, modes: FrozenModes) -> Array:
        """Number of steps of the grid on which the first orbit was found. On coarser grids there may be no
        orbit nearby."""
        return np.full(len(modes), int(self.first / 1.2))

    def bytes_a_step(self, n: int, orbit: bool = True, engine: str = "numpy") -> int:
        return self.task.method.bytes_a_step(n, orbit, engine)

    def most_steps(self, n: int, first_order: int = 0) -> int:
        return self.task.method.most_steps(n, first_order)

    def solutions(self, points: Points, grid: Grid, orbit: bool, engine: str = "numpy") -> Solutions:
        return one_by_one(points, lambda point: self._converged(point, grid))

    def _converged(self, point: Points, grid: Grid) -> Solutions:
        found, task = self.found, self.task
        if isinstance(point, ScaledEquations):
            found, task = None, replace(task, factors=point.factors)
        try:
            if found is None or not np.array_equal(found.solutions.grid.nodes, grid.nodes):
                found = iterate(task, self.start if self.lower is None else self.lower.start, grid)
                if found.iterations == 1 and self.lower is not None:
                    # Multipliers computed about the curve with fewer stages would hide the effect of the
                    # error of that curve.
                    found = iterate(task, found.curve, grid)
        except NoOrbitError as reason:
            if grid.steps < _COARSE:
                raise StepsError(str(reason)) from None
            raise
        if grid.steps >= self.finest:
            self.start, self.finest = found.curve, grid.steps
        if self.lower is not None:
            # The error estimate contains only the defect of the solution with fewer stages.
            return found.solutions
        along = task.along(found.curve)
        scale = CoordinateScale(along, found.curve, task.speed, _FEW_STEPS)
        defect = max(found.last, scale.load_roundoff(np.abs(found.curve.sampled(1)).max(axis=1)))
        return replace(found.solutions, defect=np.array([defect]))

    def point(self) -> SinglePoint:
        """The system linearised along the curve from which the iteration starts."""
        return SinglePoint(self.task.along(self.start), self.task.speed)
