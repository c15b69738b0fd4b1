"""Systems that differ by numbers: the speed, and parameters of a model."""

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Protocol

import numpy as np

from solve.arrays import Array
from solve.errors import UnknownNameError, ValueOutOfBoundsError
from solve.load import Model
from solve.sampling import OutputSampler, PointSampler
from solve.system import PeriodicSystem

SPEED = "speed"
"""The name under which the speed Ω (rad/s) varies like a parameter."""


class Family(Protocol):
    """Systems over points (P, v), a row the values of `names`."""

    names: tuple[str, ...]

    def system(self, point: Array) -> tuple[PeriodicSystem, float]:
        """The system at a point (v,) and its speed in rad/s."""
        ...

    def entries(self, phase: Array, points: Array) -> Array:
        """Ω²M, ΩC, K by rows and d at phases (k,): (P, k, 3n² + n)."""
        ...

    def outputs(self, phase: Array, points: Array, q: Array, qd: Array, qdd: Array) -> Array:
        """Outputs (P, o, k) at phases (P, k) and states (P, n, k), derivatives by time."""
        ...


class Speeds:
    """One system over its speed."""

    names: tuple[str, ...] = (SPEED,)

    def __init__(self, system: PeriodicSystem):
        self._system = system

    def system(self, point: Array) -> tuple[PeriodicSystem, float]:
        return self._system, float(point[0])

    def entries(self, phase: Array, points: Array) -> Array:
        return np.stack([_flat(self._system, phase, float(speed)) for (speed,) in points])

    def outputs(self, phase: Array, points: Array, q: Array, qd: Array, qdd: Array) -> Array:
        return _outputs_one_by_one(self, phase, points, q, qd, qdd)


class Variants:
    """A generated model over the speed, its parameters, or both."""

    def __init__(self, model: Model, names: Sequence[str], speed: float | None = None):
        """`speed` (rad/s) holds where the speed is not among the names. Raises UnknownNameError,
        ValueOutOfBoundsError."""
        known = [SPEED, *model.parameters]
        for name in names:
            if name not in known:
                raise UnknownNameError(f"quantity of {model.name}", name, known)
        if len(set(names)) < len(names):
            raise ValueOutOfBoundsError(f"{names[0]} is given twice; vary different quantities")
        self.names = tuple(names)
        self._model, self._speed = model, speed
        self._free = [name for name in names if name != SPEED]
        self._fixed = (
            np.array(list(model.parameters.values())),
            [list(model.parameters).index(name) for name in self._free],
        )
        self._sampler = PointSampler(model.module.linearised(**model.options), *self._fixed)

    def system(self, point: Array) -> tuple[PeriodicSystem, float]:
        values = dict(zip(self.names, map(float, point), strict=True))
        speed = values.pop(SPEED, self._speed)
        assert speed is not None
        if not values:
            return self._model, speed
        model = self._model
        return Model(model.module, model.case, model.options, {**model.parameters, **values}), speed

    def entries(self, phase: Array, points: Array) -> Array:
        P, k, n = len(points), len(phase), self._sampler.n
        speed, free = self._numbers(points)
        found = self._sampler(np.tile(phase, P), np.repeat(speed, k), np.repeat(free, k, axis=0))
        found = found.reshape(P, k, -1)
        found[:, :, : n**2] *= (speed**2)[:, None, None]
        found[:, :, n**2 : 2 * n**2] *= speed[:, None, None]
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

    def _numbers(self, points: Array) -> tuple[Array, Array]:
        """Speeds (P,) and free parameters (P, v)."""
        free = points[:, [self.names.index(name) for name in self._free]]
        if SPEED in self.names:
            return points[:, self.names.index(SPEED)], free
        return np.full(len(points), self._speed), free


class Built:
    """Systems that a function of a user's own builds from values by name."""

    def __init__(
        self, build: Callable[..., PeriodicSystem], names: Sequence[str], speed: float | None = None
    ):
        """`speed` (rad/s) holds where the speed is not among the names."""
        self.names = tuple(names)
        self._build, self._speed = build, speed

    def system(self, point: Array) -> tuple[PeriodicSystem, float]:
        values = dict(zip(self.names, map(float, point), strict=True))
        speed = values.pop(SPEED, self._speed)
        assert speed is not None
        return self._build(**values), speed

    def entries(self, phase: Array, points: Array) -> Array:
        return np.stack([_flat(system, phase, speed) for system, speed in map(self.system, points)])

    def outputs(self, phase: Array, points: Array, q: Array, qd: Array, qdd: Array) -> Array:
        return _outputs_one_by_one(self, phase, points, q, qd, qdd)


def over_speed(system: PeriodicSystem) -> Family:
    """The family of a system's speeds."""
    return Variants(system, [SPEED]) if type(system) is Model else Speeds(system)


def _flat(system: PeriodicSystem, phase: Array, speed: float) -> Array:
    return np.concatenate([part.reshape(len(phase), -1) for part in system.in_phase(phase, speed)], axis=1)


def _outputs_one_by_one(
    family: Family, phase: Array, points: Array, q: Array, qd: Array, qdd: Array
) -> Array:
    found = []
    for index, point in enumerate(points):
        system, speed = family.system(point)
        values = system.output_values(phase[index], speed, q[index], qd[index], qdd[index])
        found.append([values[name] for name in system.outputs])
    return np.array(found).reshape(len(points), -1, phase.shape[1])
