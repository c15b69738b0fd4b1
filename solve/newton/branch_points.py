"""Points of a branch of orbits, and the continuation parameter: the speed, or a parameter of the model."""

from dataclasses import dataclass, replace

import numpy as np

from solve.arrays import Array
from solve.contracts import Columns, Matrices, Motion
from solve.errors import NoOrbitError
from solve.kernel.formulas import columns_by
from solve.labels import SPEED
from solve.newton.iteration import Task, add, on
from solve.period.curve import Curve
from solve.period.grid import Grid
from solve.system import PeriodicSystem, derivatives_of

SAMPLES = 8
"""Phases per step at which orbits are compared. A choice."""


@dataclass(frozen=True)
class Place:
    """Orbit as a curve and the value of the parameter, or differences of both."""

    curve: Curve
    value: float

    def plus(self, factor: float, other: "Place") -> "Place":
        """Sum with a multiple of another place."""
        return Place(add(self.curve, factor, other.curve), self.value + factor * other.value)

    def on(self, grid: Grid) -> "Place":
        """Same place on the nodes of a grid."""
        return Place(on(grid, self.curve), self.value)

    def times(self, factor: float) -> "Place":
        """Multiple of the place."""
        curve = self.curve
        drift = None if curve.drift is None else factor * curve.drift
        return Place(Curve(curve.nodes, factor * curve.coefficients, drift=drift), factor * self.value)

    @property
    def largest(self) -> Array:
        """Largest moduli (n,) of the coordinates at the samples."""
        return np.abs(self.curve.sampled(SAMPLES)).max(axis=1)


@dataclass(frozen=True)
class FollowedOrbit:
    """Orbit of a branch: value of the parameter; figures (q, 7) of coordinates and outputs, the fields of
    `Statistics`, and their relative errors (q,); spectral radius; distance of the nearest multiplier from +1;
    errors (2,) of the orbit, relative, and of the spectral radius; whether the orbit has fewer periods."""

    value: float
    figures: Array
    figure_errors: Array
    radius: float
    nearest: float
    errors: Array
    repeats: bool


@dataclass(frozen=True)
class Point:
    """Point of a branch: its place, converged on a grid; sizes (n,) of the coordinates, which scale steps;
    unit tangent `direction` of the branch; the orbit on a grid twice as fine; whether it is a turning
    point."""

    place: Place
    sizes: Array
    direction: Place
    grid: Grid
    orbit: FollowedOrbit
    turns: bool = False

    @property
    def value(self) -> float:
        """Value of the parameter, as accurate as the orbit."""
        return self.orbit.value


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

    def text(self, value: float) -> str:
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
        self._along, self._motion = along, motion
        self._dependence = derivatives_of(along).by([name], compiled)

    def _loaded(self, phase: Array, speed: float) -> Matrices:
        M, C, K, _ = self._along.at(phase, speed)
        states = np.stack([self._motion(phase, derivative).T for derivative in (2, 1, 0)], axis=1)
        return M, C, K, -self._dependence.residual(phase, speed, states)[..., 0]
