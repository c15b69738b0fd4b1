"""Continuation parameter of a branch of orbits: the speed, or a parameter of the model."""

from dataclasses import dataclass, replace

import numpy as np

from solve.arrays import Array
from solve.contracts import Columns, Matrices, Motion
from solve.errors import NoOrbitError
from solve.kernel.formulas import columns_by
from solve.labels import SPEED
from solve.newton.iteration import Task
from solve.system import PeriodicSystem, derivatives_of


@dataclass(frozen=True)
class ContinuationParameter:
    """Continuation parameter: "speed" (rad/s), or the name of a parameter with respect to which the equations
    have derivatives. Everything else is as in the task."""

    task: Task
    name: str = SPEED

    def task_at(self, value: float) -> Task:
        """Task at a value. Raises SolveError subclasses for values that the model does not allow."""
        if self.name != SPEED:
            return replace(self.task, system=self.task.system.varied({self.name: value}))
        if not value > 0:
            raise NoOrbitError("the branch reaches speed 0")
        return replace(self.task, speed=value)

    def in_words(self, value: float) -> str:
        """Text of a value with its unit."""
        return self.task.system.unit_of(self.name).text(value, ".4g")

    def slope(self, along: PeriodicSystem, motion: Motion) -> PeriodicSystem:
        """Linear system whose orbit is the derivative of the next iterate after a motion with respect to the
        parameter; along: the equations linearised along the motion."""
        return _ByParameter(along, motion, self.name, columns_by(self.task.engine))


class _ByParameter(PeriodicSystem):
    """Equations linearised along a motion under the load -∂r/∂θ."""

    def __init__(self, along: PeriodicSystem, motion: Motion, name: str, compiled: Columns | None):
        super().__init__(self._loaded, along.coordinates, along.period, along.breaks)
        self._along, self._motion, self._dependence = (
            along,
            motion,
            derivatives_of(along).by([name], compiled),
        )

    def _loaded(self, phase: Array, speed: float) -> Matrices:
        M, C, K, _ = self._along.at(phase, speed)
        states = np.stack([self._motion(phase, derivative).T for derivative in (2, 1, 0)], axis=1)
        return M, C, K, -self._dependence.residual(phase, speed, states)[..., 0]
