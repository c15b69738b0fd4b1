"""Systems that differ by numbers: the speed, and parameters of a model."""

import copy
import reprlib
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from solve.arrays import Array
from solve.contracts import Formulas
from solve.errors import SolveError, ValueOutOfBoundsError, require_name
from solve.kernel import formulas as kernel
from solve.kernel.engines import COMPILED, NUMPY
from solve.labels import SPEED
from solve.period.points import AtSpeeds
from solve.system import PeriodicSystem

_KEPT = 8
"""Systems that are kept, one for each of the latest values of the parameters."""


class Family:
    """Systems over points (P, v), a row the values of `names`.

    speed: in rad/s, held where it is not among the names. example: a system of the family; its coordinates,
    outputs, units and period are those of all. Copies and pickles are built anew: CasADi's memory serves one
    thread of one process.
    """

    names: tuple[str, ...]
    speed: float | None
    example: PeriodicSystem

    def system(self, point: Array) -> tuple[PeriodicSystem, float]:
        """The system at a point (v,) and its speed in rad/s. Raises SolveError subclasses."""
        raise NotImplementedError

    def speeds(self, points: Array) -> Array:
        """Speeds (P,) of points (P, v), in rad/s."""
        if SPEED in self.names:
            return points[:, self.names.index(SPEED)]
        return np.full(len(points), self.speed)

    def entries(self, phase: Array, points: Array, engine: str = NUMPY) -> Array:
        """Ω²M, ΩC, K by rows and d at phases (k,): (P, k, 3n² + n); NaN at points without a system."""
        found = np.full((len(points), len(phase), 3 * self.example.n**2 + self.example.n), np.nan)
        for rows, point in zip(found, points, strict=True):
            # A point without a system keeps its NaN; its own solution will say why.
            with suppress(SolveError):
                system, speed = self.system(point)
                rows[:] = system.entries(phase, speed)
        return found

    def exist(self, points: Array) -> Array:
        """Whether the fundamental motion exists at points (P, v): (P,)."""
        return np.ones(len(points), dtype=bool)

    @property
    def moves_breaks(self) -> bool:
        """Whether the matrices may jump at other phases at other points."""
        return True

    def at_speeds(self, points: Array) -> AtSpeeds | None:
        """The points (P, v), where they are speeds of one system that says what its entries are sums of."""
        return None

    def by_breaks(self, points: Array) -> list[tuple[tuple[float, ...] | None, Array]]:
        """Phases of jumps, and the positions (k,) of the points (P, v) that have these; None where there is
        no system."""
        found: dict[tuple[float, ...] | None, list[int]] = {}
        for position, breaks in enumerate(self._breaks(points)):
            found.setdefault(breaks, []).append(position)
        return [(breaks, np.array(positions)) for breaks, positions in found.items()]

    def _breaks(self, points: Array) -> list[tuple[float, ...] | None]:
        each: list[tuple[float, ...] | None] = [None] * len(points)
        for position, point in enumerate(points):
            with suppress(SolveError):
                each[position] = self.system(point)[0].breaks
        return each

    def outputs(
        self, names: Sequence[str], phase: Array, points: Array, q: Array, qd: Array, qdd: Array
    ) -> Array:
        """Outputs of these names (P, o, k) at phases (P, k) and states (P, n, k), derivatives by time."""
        found = []
        for point, *state in zip(points, phase, q, qd, qdd, strict=True):
            system, speed = self.system(point)
            values = system.output_values(state[0], speed, *state[1:])
            found.append([values[name] for name in names])
        return np.array(found).reshape(len(points), -1, phase.shape[1])

    def output_formulas(self, points: Array) -> Formulas | None:
        """Those of the example with the parameters (P, p) of the points; None where there are none."""
        return None


class SystemFamily(Family):
    """A system over its speed, its parameters, or both."""

    def __init__(self, system: PeriodicSystem, names: Sequence[str], speed: float | None = None):
        """`speed` (rad/s) holds where the speed is not among the names. Raises UnknownNameError,
        ValueOutOfBoundsError."""
        known = [SPEED, *system.parameters]
        for name in names:
            require_name(f"quantity of {system.name}", name, known)
        if len(set(names)) < len(names):
            raise ValueOutOfBoundsError(f"{names[0]} is given twice; vary different quantities")
        self.names, self.speed = tuple(names), speed
        self.example = system
        self._free = [name for name in names if name != SPEED]
        self._together = system.many_points(self._free)
        self._recent: dict[tuple[float, ...], PeriodicSystem] = {}

    def __reduce__(self) -> tuple[Any, ...]:
        return SystemFamily, (copy.copy(self.example), self.names, self.speed)

    def system(self, point: Array) -> tuple[PeriodicSystem, float]:
        speed = float(self.speeds(point[None])[0])
        return (self._varied(self._numbers(point[None])[1][0]) if self._free else self.example), speed

    def exist(self, points: Array) -> Array:
        if self._together is None:
            return super().exist(points)
        return self._together.exist(*self._numbers(points))

    @property
    def moves_breaks(self) -> bool:
        return bool(self._free) and self.example.moves_breaks

    def at_speeds(self, points: Array) -> AtSpeeds | None:
        speeds = self.speeds(points)
        if self._free or self.example.terms(np.zeros(1), speeds[:1]) is None:
            return None
        return AtSpeeds(self.example, speeds)

    def by_breaks(self, points: Array) -> list[tuple[tuple[float, ...] | None, Array]]:
        if self.moves_breaks:
            return super().by_breaks(points)
        return [(self.example.breaks, np.arange(len(points)))]

    def _breaks(self, points: Array) -> list[tuple[float, ...] | None]:
        if self._together is None:
            return super()._breaks(points)
        return self._together.breaks(self._numbers(points)[1])

    def entries(self, phase: Array, points: Array, engine: str = NUMPY) -> Array:
        speeds, free = self._numbers(points)
        if self._together is not None and self._free:
            formulas = self._together.formulas if engine == COMPILED else None
            found = None if formulas is None else kernel.values(self._filled(formulas, points), phase, speeds)
            return self._together.entries(phase, speeds, free, found)
        n = self.example.n
        found = np.full((len(points), len(phase), 3 * n**2 + n), np.nan)
        different, group = np.unique(free, axis=0, return_inverse=True)
        for number, values in enumerate(different):
            members = np.flatnonzero(group.ravel() == number)
            with suppress(SolveError):
                found[members] = self._varied(values).entries_over(phase, speeds[members])
        return found

    def outputs(
        self, names: Sequence[str], phase: Array, points: Array, q: Array, qd: Array, qdd: Array
    ) -> Array:
        if self._together is None:
            return super().outputs(names, phase, points, q, qd, qdd)
        every = self._together.outputs(phase, *self._numbers(points), q, qd, qdd)
        return every[:, [self.example.outputs.index(name) for name in names]]

    def output_formulas(self, points: Array) -> Formulas | None:
        found = self.example.output_formulas(self._free)
        return None if found is None else self._filled(found, points)

    def _filled(self, formulas: Formulas, points: Array) -> Formulas:
        """With the parameters (P, p) of the points."""
        values = np.tile(formulas.values, (len(points), 1))
        values[:, [formulas.names.index(name) for name in self._free]] = self._numbers(points)[1]
        return formulas._replace(values=values)

    def _varied(self, values: Array) -> PeriodicSystem:
        if not self._free:
            return self.example
        key = tuple(values.tolist())
        if key not in self._recent:
            made = self.example.varied(dict(zip(self._free, key, strict=True)))
            while len(self._recent) >= _KEPT:
                del self._recent[next(iter(self._recent))]
            self._recent[key] = made
        return self._recent[key]

    def _numbers(self, points: Array) -> tuple[Array, Array]:
        """Speeds (P,) and free parameters (P, v)."""
        return self.speeds(points), points[:, [self.names.index(name) for name in self._free]]


class BuiltFamily(Family):
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
        self._build = build
        self.example, self._point = self._first(points)

    def _first(self, points: Array) -> tuple[PeriodicSystem, Array]:
        for point in points[:-1]:
            with suppress(SolveError):
                return self.system(point)[0], point
        return self.system(points[-1])[0], points[-1]

    def system(self, point: Array) -> tuple[PeriodicSystem, float]:
        values = dict(zip(self.names, map(float, point), strict=True))
        speed = values.pop(SPEED, self.speed)
        assert speed is not None
        built = self._build(**values)
        if not isinstance(built, PeriodicSystem):
            raise ValueOutOfBoundsError(
                f"the function that builds systems gives {reprlib.repr(built)}; give a PeriodicSystem"
            )
        return built, speed

    def __reduce__(self) -> tuple[Any, ...]:
        return BuiltFamily, (self._build, self.names, self._point[None], self.speed)


def over_speed(system: PeriodicSystem) -> Family:
    """The family of a system's speeds."""
    return SystemFamily(system, [SPEED])
