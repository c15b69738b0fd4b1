"""Points of a branch of orbits, and the parameters that vary along it."""

from dataclasses import dataclass, field, replace

import numpy as np

from solve.arrays import Array
from solve.errors import NoOrbitError
from solve.labels import SPEED, unit_of
from solve.newton.iteration import Task, add, on
from solve.period.curve import Curve
from solve.period.grid import Grid

SAMPLES = 8
"""Phases per step at which orbits are compared. A choice."""

_PHASES = 2048
"""Phases per period at which orbits are compared whose events differ. A choice."""

_MAX_TASKS = 8
"""Number of values of the parameters whose systems are cached. A choice: a point uses one or two."""


@dataclass(frozen=True)
class Place:
    """Point of a continuation: the orbit as a curve with the values (k,) of the parameters, or a difference
    of two such points."""

    curve: Curve
    values: Array

    @property
    def value(self) -> float:
        """Value of the first parameter."""
        return float(self.values[0])

    def plus(self, factor: float, other: "Place") -> "Place":
        """Sum with a multiple of another place, on the nodes of the other."""
        curve, nodes = self.curve, other.curve.nodes
        if not np.array_equal(curve.nodes, nodes):
            curve = on(Grid(nodes, np.zeros(len(nodes) - 1, dtype=bool)), curve)
        return Place(add(curve, factor, other.curve), self.values + factor * other.values)

    def on(self, grid: Grid) -> "Place":
        """Same place on the nodes of a grid."""
        return Place(on(grid, self.curve), self.values)

    def times(self, factor: float) -> "Place":
        """Place multiplied by a factor."""
        curve = self.curve
        drift = None if curve.drift is None else factor * curve.drift
        return Place(Curve(curve.nodes, factor * curve.coefficients, drift=drift), factor * self.values)

    @property
    def amplitudes(self) -> Array:
        """Half of the ranges (n,) of the coordinates at the samples, which an offset of angles by full
        revolutions does not change."""
        return np.ptp(self.curve.sampled(SAMPLES), axis=1) / 2

    @property
    def largest(self) -> Array:
        """Largest moduli (n,) of the coordinates at the samples."""
        return np.abs(self.curve.sampled(SAMPLES)).max(axis=1)


def sampled_together(*places: Place) -> list[Array]:
    """Values (n, k) of several places at the same phases: of steps if they have the same nodes."""
    nodes = places[0].curve.nodes
    if all(np.array_equal(place.curve.nodes, nodes) for place in places[1:]):
        return [place.curve.sampled(SAMPLES) for place in places]
    phase = np.arange(_PHASES) * (nodes[-1] / _PHASES)
    return [place.curve(phase) for place in places]


@dataclass(frozen=True)
class FollowedOrbit:
    """Orbit of a branch: values (k,) of the parameters; figures (q, 7) of coordinates and outputs, the fields
    of `Statistics`, and their relative errors (q,); multipliers (2n,) and spectral radius; errors (2,) of the
    orbit, relative, and of the spectral radius; whether the orbit has fewer periods."""

    values: Array
    figures: Array
    figure_errors: Array
    multipliers: Array
    radius: float
    errors: Array
    repeats: bool

    @property
    def nearest(self) -> float:
        """Distance of the nearest multiplier from +1."""
        return float(np.abs(self.multipliers - 1).min())


@dataclass(frozen=True)
class Point:
    """Point of a branch: its place, converged on a grid; sizes (n,) of the coordinates, which scale steps;
    unit tangents, orthogonal to each other, one per parameter; the orbit on a grid twice as fine; its kind,
    one of `solve.results.branch.KINDS`; periods of the model per period of the orbit."""

    place: Place
    sizes: Array
    tangents: tuple[Place, ...]
    grid: Grid
    orbit: FollowedOrbit
    kind: str = ""
    periods: int = 1

    @property
    def direction(self) -> Place:
        """Unit tangent of a branch with one parameter."""
        return self.tangents[0]

    @property
    def value(self) -> float:
        """Value of the first parameter, as accurate as the orbit."""
        return float(self.orbit.values[0])


@dataclass(frozen=True)
class ContinuationParameters:
    """Parameters of a continuation: "speed" (rad/s), or names of parameters with respect to which the
    equations have derivatives, with the first and last value (k, 2) of each. Everything else is as in the
    task."""

    task: Task
    names: tuple[str, ...]
    ranges: Array
    _tasks: dict[bytes, Task] = field(default_factory=dict, init=False, compare=False, repr=False)

    @property
    def spans(self) -> Array:
        """Lengths (k,) of the ranges, to which values are relative."""
        return np.abs(self.ranges[:, 1] - self.ranges[:, 0])

    def over_periods(self, periods: int) -> "ContinuationParameters":
        """Parameters for orbits with another number of periods."""
        return replace(self, task=replace(self.task, periods=periods))

    def task_at(self, values: Array) -> Task:
        """Task at values (k,). Raises SolveError subclasses for values that the model does not allow."""
        key = np.asarray(values).tobytes()
        if key not in self._tasks:
            if len(self._tasks) >= _MAX_TASKS:
                self._tasks.clear()
            self._tasks[key] = self._task_at(values)
        return self._tasks[key]

    def _task_at(self, values: Array) -> Task:
        given = dict(zip(self.names, map(float, values), strict=True))
        speed = given.pop(SPEED, self.task.speed)
        if not speed > 0:
            raise NoOrbitError("the branch reaches speed 0")
        system = self.task.system.varied(given) if given else self.task.system
        return replace(self.task, system=system, speed=speed)

    def text(self, values: Array) -> str:
        """Text of values with their units."""
        units = (unit_of(self.task.system, name) for name in self.names)
        return ", ".join(unit.text(float(value), ".4g") for unit, value in zip(units, values, strict=True))
