"""Systems that differ by numbers: the speed, and parameters of a model."""

import copy
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from solve.arrays import Array
from solve.errors import SolveError, UnknownNameError, ValueOutOfBoundsError
from solve.loading import Model
from solve.model.sampling import OutputSampler, PointSampler
from solve.system import PeriodicSystem

SPEED = "speed"
"""The name under which the speed Ω (rad/s) varies like a parameter."""

_POWERS = 3
"""Speeds from which matrices of a structure follow at all others: Ω²M, ΩC, K, d go with 1, Ω and Ω²."""

_KEPT = 8
"""Models of a structure that are kept, one for each of the latest values of the parameters."""


class Family(Protocol):
    """Systems over points (P, v), a row the values of `names`."""

    names: tuple[str, ...]
    speed: float | None
    """In rad/s, held where it is not among the names."""

    example: PeriodicSystem
    """A system of the family: its coordinates, outputs, units and period are those of all."""

    def system(self, point: Array) -> tuple[PeriodicSystem, float]:
        """The system at a point (v,) and its speed in rad/s. Raises SolveError subclasses."""
        ...

    def entries(self, phase: Array, points: Array) -> Array:
        """Ω²M, ΩC, K by rows and d at phases (k,): (P, k, 3n² + n); NaN at points without a system."""
        ...

    def outputs(self, phase: Array, points: Array, q: Array, qd: Array, qdd: Array) -> Array:
        """Outputs (P, o, k) at phases (P, k) and states (P, n, k), derivatives by time."""
        ...

    def twin(self) -> "Family":
        """The same for another thread."""
        ...


class Speeds:
    """One system over its speed."""

    names: tuple[str, ...] = (SPEED,)
    speed: float | None = None

    def __init__(self, system: PeriodicSystem):
        self.example = system

    def system(self, point: Array) -> tuple[PeriodicSystem, float]:
        return self.example, float(point[0])

    def entries(self, phase: Array, points: Array) -> Array:
        return _entries_one_by_one(self, phase, points)

    def outputs(self, phase: Array, points: Array, q: Array, qd: Array, qdd: Array) -> Array:
        return _outputs_one_by_one(self, phase, points, q, qd, qdd)

    def twin(self) -> "Speeds":
        return Speeds(copy.copy(self.example))


class Built:
    """Systems that a function of a user's own builds from values by name."""

    def __init__(
        self,
        build: Callable[..., PeriodicSystem],
        names: Sequence[str],
        points: Array,
        speed: float | None = None,
    ):
        """`points` (P, v): the first that can be built is the example; `speed` (rad/s) holds where the speed
        is not among the names."""
        self.names, self.speed = tuple(names), speed
        self._build, self._points = build, points
        self.example = self._first()

    def _first(self) -> PeriodicSystem:
        for point in self._points[:-1]:
            try:
                return self.system(point)[0]
            except SolveError:
                continue
        return self.system(self._points[-1])[0]

    def system(self, point: Array) -> tuple[PeriodicSystem, float]:
        values = dict(zip(self.names, map(float, point), strict=True))
        speed = values.pop(SPEED, self.speed)
        assert speed is not None
        return self._build(**values), speed

    def entries(self, phase: Array, points: Array) -> Array:
        return _entries_one_by_one(self, phase, points)

    def outputs(self, phase: Array, points: Array, q: Array, qd: Array, qdd: Array) -> Array:
        return _outputs_one_by_one(self, phase, points, q, qd, qdd)

    def twin(self) -> "Built":
        return Built(self._build, self.names, self._points, self.speed)


class Variants:
    """A model over the speed, its parameters, or both: one whose matrices are assembled, not printed."""

    def __init__(self, model: Model, names: Sequence[str], speed: float | None = None):
        """`speed` (rad/s) holds where the speed is not among the names. Raises UnknownNameError,
        ValueOutOfBoundsError."""
        known = [SPEED, *model.parameters]
        for name in names:
            if name not in known:
                raise UnknownNameError(f"quantity of {model.name}", name, known)
        if len(set(names)) < len(names):
            raise ValueOutOfBoundsError(f"{names[0]} is given twice; vary different quantities")
        self.names, self.speed = tuple(names), speed
        self._model = model
        self.example: PeriodicSystem = model
        self._free = [name for name in names if name != SPEED]
        self._recent: dict[tuple[float, ...], Model] = {}

    def twin(self) -> "Variants":
        return type(self)(copy.copy(self._model), self.names, self.speed)

    def __reduce__(self) -> tuple[Any, ...]:
        """Copies and pickles are built anew: CasADi's memory serves one thread of one process."""
        return type(self), (self._model, self.names, self.speed)

    def system(self, point: Array) -> tuple[Model, float]:
        (speed,), (values,) = self._numbers(point[None])
        return self._varied(values), float(speed)

    def entries(self, phase: Array, points: Array) -> Array:
        n = self._model.n
        found = np.full((len(points), len(phase), 3 * n**2 + n), np.nan)
        speeds, free = self._numbers(points)
        different, group = np.unique(free, axis=0, return_inverse=True)
        for number, values in enumerate(different):
            members = np.flatnonzero(group.ravel() == number)
            try:
                found[members] = _over_speed(self._varied(values), phase, speeds[members])
            except SolveError:
                continue
        return found

    def outputs(self, phase: Array, points: Array, q: Array, qd: Array, qdd: Array) -> Array:
        return _outputs_one_by_one(self, phase, points, q, qd, qdd)

    def _varied(self, values: Array) -> Model:
        if not self._free:
            return self._model
        key = tuple(values.tolist())
        if key not in self._recent:
            made = self._model.varied(dict(zip(self._free, key, strict=True)))
            while len(self._recent) >= _KEPT:
                del self._recent[next(iter(self._recent))]
            self._recent[key] = made
        return self._recent[key]

    def _numbers(self, points: Array) -> tuple[Array, Array]:
        """Speeds (P,) and free parameters (P, v)."""
        free = points[:, [self.names.index(name) for name in self._free]]
        if SPEED in self.names:
            return points[:, self.names.index(SPEED)], free
        return np.full(len(points), self.speed), free


class PrintedVariants(Variants):
    """The same where generated code gives the matrices: CasADi evaluates all points at once."""

    def __init__(self, model: Model, names: Sequence[str], speed: float | None = None):
        super().__init__(model, names, speed)
        parameters = list(model.parameters)
        self._fixed = (
            np.array(list(model.parameters.values())),
            [parameters.index(name) for name in self._free],
        )
        self._sampler = PointSampler(model.module.linearised(**model.options), *self._fixed)

    def entries(self, phase: Array, points: Array) -> Array:
        P, k, n = len(points), len(phase), self._sampler.n
        speed, free = self._numbers(points)
        found = self._sampler(np.tile(phase, P), np.repeat(speed, k), np.repeat(free, k, axis=0))
        found = found.reshape(P, k, 3 * n**2 + n)
        found[:, :, : n**2] *= (speed**2)[:, None, None]
        found[:, :, n**2 : 2 * n**2] *= speed[:, None, None]
        if self._free:
            found[~self._model.admits(self._free, free)] = np.nan
        return found

    def outputs(self, phase: Array, points: Array, q: Array, qd: Array, qdd: Array) -> Array:
        P, n, k = q.shape
        speed, free = self._numbers(points)
        states = (np.swapaxes(part, 1, 2).reshape(P * k, n) for part in (q, qd, qdd))
        found = self._output_sampler(phase.ravel(), np.repeat(speed, k), np.repeat(free, k, axis=0), *states)
        return np.swapaxes(found.reshape(P, k, -1), 1, 2)

    @cached_property
    def _output_sampler(self) -> OutputSampler:
        return OutputSampler(self._model.module.outputs(**self._model.options), *self._fixed)


def variants(model: Model, names: Sequence[str], speed: float | None = None) -> Variants:
    """The family of a model, by what gives its matrices. Raises UnknownNameError, ValueOutOfBoundsError."""
    return (PrintedVariants if type(model) is Model else Variants)(model, names, speed)


def over_speed(system: PeriodicSystem) -> Family:
    """The family of a system's speeds."""
    if isinstance(system, Model) and (type(system) is Model or hasattr(system.module, "LINKS")):
        return variants(system, [SPEED])
    return Speeds(system)


def _entries_one_by_one(family: Family, phase: Array, points: Array) -> Array:
    n = family.example.n
    found = np.full((len(points), len(phase), 3 * n**2 + n), np.nan)
    for index, point in enumerate(points):
        try:
            found[index] = _flat(*family.system(point), phase)
        except SolveError:
            # The point keeps its NaN; the single solve will say why.
            continue
    return found


def _outputs_one_by_one(
    family: Family, phase: Array, points: Array, q: Array, qd: Array, qdd: Array
) -> Array:
    found = []
    for index, point in enumerate(points):
        system, speed = family.system(point)
        values = system.output_values(phase[index], speed, q[index], qd[index], qdd[index])
        found.append([values[name] for name in system.outputs])
    return np.array(found).reshape(len(points), -1, phase.shape[1])


def _flat(system: PeriodicSystem, speed: float, phase: Array) -> Array:
    return np.concatenate([part.reshape(len(phase), -1) for part in system.in_phase(phase, speed)], axis=1)


def _over_speed(model: Model, phase: Array, speeds: Array) -> Array:
    """Entries (P, k, 3n² + n) at speeds (P,), of some and by Lagrange's polynomials between them."""
    low, high = speeds.min(), speeds.max()
    if len(speeds) <= _POWERS or high - low < 1e-3 * high:
        return np.stack([_flat(model, float(speed), phase) for speed in speeds])
    nodes = np.linspace(low, high, _POWERS)
    weights = np.ones((len(speeds), _POWERS))
    for i, j in np.ndindex(_POWERS, _POWERS):
        if i != j:
            weights[:, i] *= (speeds - nodes[j]) / (nodes[i] - nodes[j])
    known = np.stack([_flat(model, float(speed), phase) for speed in nodes])
    return np.tensordot(weights, known, axes=1)
