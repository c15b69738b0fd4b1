"""Points of a branch of orbits, and the parameters that vary along it."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from solve.arrays import Array
from solve.errors import NoOrbitError
from solve.labels import SPEED, unit_of
from solve.newton.iteration import Task, add, on
from solve.period.curve import Curve
from solve.period.grid import Grid
from solve.results.serialization import serializable

SAMPLES = 8
"""Number of phases per step at which orbits are compared. Chosen by judgement."""

DAMPING = "artificial damping"
"""Name of the parameter ε of an artificial damping term ε Ω M q̇. The parameter is zero on every orbit; see
`solve.newton.unforced`."""

_PHASES = 1024
"""Number of phases per period at which orbits with different events are compared. Chosen by judgement."""

_MAX_TASKS = 8
"""Number of cached tasks, one for each combination of parameter values. Chosen by judgement: the computation
of a point uses one or two tasks."""


@serializable
@dataclass(frozen=True)
class Unknowns:
    """Unknowns of a continuation: an orbit as a curve, and the values (k,) of the parameters. Differences of
    unknowns are stored in the same form."""

    curve: Curve
    values: Array

    @property
    def value(self) -> float:
        """Value of the first parameter."""
        return float(self.values[0])

    def plus(self, factor: float, other: "Unknowns") -> "Unknowns":
        """Return the sum of these unknowns and `factor` times `other`, on the nodes of `other`."""
        curve = add(self.beside(other).curve, factor, other.curve)
        return Unknowns(curve, self.values + factor * other.values)

    def on(self, grid: Grid) -> "Unknowns":
        """Interpolate these unknowns on the nodes of `grid`."""
        return Unknowns(on(grid, self.curve), self.values)

    def beside(self, other: "Unknowns") -> "Unknowns":
        """Interpolate these unknowns on the nodes of `other`."""
        nodes = other.curve.nodes
        return self.on(Grid(nodes, np.zeros(len(nodes) - 1, dtype=bool)))

    def times(self, factor: float) -> "Unknowns":
        """Return these unknowns multiplied by `factor`."""
        curve = self.curve
        drift = None if curve.drift is None else factor * curve.drift
        return Unknowns(Curve(curve.nodes, factor * curve.coefficients, drift=drift), factor * self.values)

    @cached_property
    def samples(self) -> Array:
        """Coordinates (n, k) at `SAMPLES` phases per step."""
        return self.curve.sampled(SAMPLES)

    @cached_property
    def uniform_samples(self) -> Array:
        """Coordinates (n, `_PHASES`) at equally spaced phases of the period."""
        return self.curve(np.arange(_PHASES) * (self.curve.nodes[-1] / _PHASES))

    @property
    def amplitudes(self) -> Array:
        """Half the peak-to-peak range (n,) of each coordinate at the samples. Adding a full revolution to an
        angle does not change its range."""
        return np.ptp(self.samples, axis=1) / 2

    @property
    def largest(self) -> Array:
        """Maximum modulus (n,) of each coordinate at the samples."""
        return np.abs(self.samples).max(axis=1)


def sampled_together(*vectors: Unknowns) -> tuple[list[Array], Array]:
    """Return the values (n, k) of each curve at k common phases, and weights (k,) for means over the period.
    If the curves share their nodes, there are `SAMPLES` phases in each step; otherwise the phases are
    uniform."""
    curve = vectors[0].curve
    nodes = curve.nodes
    if all(np.array_equal(unknowns.curve.nodes, nodes) for unknowns in vectors[1:]):
        return [unknowns.samples for unknowns in vectors], np.repeat(curve.h / (nodes[-1] * SAMPLES), SAMPLES)
    return [unknowns.uniform_samples for unknowns in vectors], np.full(_PHASES, 1 / _PHASES)


@serializable
@dataclass(frozen=True)
class FollowedOrbit:
    """Orbit of a branch.

    values (k,): values of the parameters. figures (q, 7): statistics of the q coordinates and outputs, in the
    order of `Statistics`. figure_errors (q,): relative errors of these coordinates and outputs. multipliers
    (2n,): Floquet multipliers. radius: spectral radius. errors (2,): relative error of the orbit, and error
    of the spectral radius. repeats: whether the orbit already repeats after fewer periods."""

    values: Array
    figures: Array
    figure_errors: Array
    multipliers: Array
    radius: float
    errors: Array
    repeats: bool

    @property
    def nearest(self) -> float:
        """Smallest distance between a multiplier and +1."""
        return float(np.abs(self.multipliers - 1).min())


@serializable
@dataclass(frozen=True)
class Point:
    """Point of a branch.

    unknowns: converged unknowns on `grid`. sizes (n,): scales of the coordinates for step lengths. tangents:
    orthonormal tangents, one per parameter. orbit: orbit computed by the method with one more stage. kind:
    kind of a special point, one of `solve.results.branch.KINDS`; empty for a regular point. periods: number
    of periods of the model in the period of the orbit."""

    unknowns: Unknowns
    sizes: Array
    tangents: tuple[Unknowns, ...]
    grid: Grid
    orbit: FollowedOrbit
    kind: str = ""
    periods: int = 1

    @property
    def direction(self) -> Unknowns:
        """Unit tangent of a branch with one parameter; with more parameters, the first tangent."""
        return self.tangents[0]

    @property
    def value(self) -> float:
        """Value of the first parameter, as accurate as the orbit."""
        return float(self.orbit.values[0])

    @property
    def orientation(self) -> float:
        """Sign of the product of det(I - Φ) and the parameter component of the tangent. It is constant along
        a branch without branch points (Y. A. Kuznetsov, Elements of Applied Bifurcation Theory, 10.2). It
        also remains the same at grazing orbits, where either both factors or neither change their sign (M. di
        Bernardo et al., Piecewise-smooth Dynamical Systems, 3.2)."""
        return float(np.sign(np.prod(1 - self.orbit.multipliers).real * self.direction.value))


@dataclass(frozen=True)
class ContinuationParameters:
    """Names of the parameters of a continuation, and the first and last value of each one.

    task: settings apart from the values of the parameters. names: "speed" (rad/s), or parameters by which the
    equations can be differentiated. ranges (k, 2): first and last values."""

    task: Task
    names: tuple[str, ...]
    ranges: Array
    _tasks: dict[bytes, Task] = field(default_factory=dict, init=False, compare=False, repr=False)

    @property
    def spans(self) -> Array:
        """Length (k,) of each range, by which the parameter is scaled."""
        return np.abs(self.ranges[:, 1] - self.ranges[:, 0])

    def over_periods(self, periods: int) -> "ContinuationParameters":
        """Return the same parameters for orbits of `periods` periods."""
        return replace(self, task=replace(self.task, periods=periods))

    def task_at(self, values: Array) -> Task:
        """Return the task at the parameter values `values` (k,). Raises SolveError subclasses for values that
        the model does not permit."""
        key = np.asarray(values).tobytes()
        if key not in self._tasks:
            if len(self._tasks) >= _MAX_TASKS:
                self._tasks.clear()
            self._tasks[key] = self._task_at(values)
        return self._tasks[key]

    def _task_at(self, values: Array) -> Task:
        given = dict(zip(self.names, map(float, values), strict=True))
        speed = given.pop(SPEED, self.task.speed)
        # The parameter of the artificial damping is zero on every orbit; only its derivative is needed.
        given.pop(DAMPING, None)
        if not speed > 0:
            raise NoOrbitError("the branch reaches speed 0")
        system = self.task.system.varied(given) if given else self.task.system
        return replace(self.task, system=system, speed=speed)

    def text(self, values: Array) -> str:
        """Format parameter values with their units. The names are included unless the speed is the only
        parameter."""
        shown = [pair for pair in zip(self.names, values, strict=True) if pair[0] != DAMPING]
        named = [name for name, _ in shown] != [SPEED]
        return ", ".join(
            f"{name} = " * named + unit_of(self.task.system, name).text(float(value), ".6g")
            for name, value in shown
        )
