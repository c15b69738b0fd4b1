"""Families of systems whose speed or parameters vary."""

import copy
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from solve.arguments import described
from solve.arrays import Array
from solve.certify.coefficients import compared_phases
from solve.contracts import Formulas
from solve.equations import entries_of, entries_over, output_formulas, output_values
from solve.errors import SolveError, ValueOutOfBoundsError, require_name
from solve.kernel import formulas as kernel
from solve.kernel.engines import COMPILED, NUMPY
from solve.labels import SPEED
from solve.model.many_points import ModelPoints
from solve.period.points import SpeedPoints
from solve.system import PeriodicSystem

_CACHED_SYSTEMS = 8
"""Number of cached systems. The systems with the most recent parameter values are cached. Chosen by
judgement."""

_REPRESENTATIVES = 8
"""Approximate number of points that are sampled at all compared phases. Measured: sampling them takes 1 % of
the time of a chart of the cam, and 5 % of a sweep of 24 four-bars."""

_CHUNK_BYTES = 2**24
"""Memory limit, in bytes, of the entries at the compared phases that are sampled together. Chosen by
judgement."""


class Family:
    """Family of systems. A point (v,) contains the values of the v quantities `names`.

    speed: speed in rad/s, if it is not one of the quantities. example: one system of the family; all systems
    have the same coordinates, outputs, units and period. A copied or unpickled family builds its functions
    anew, because CasADi functions belong to one thread of one process."""

    names: tuple[str, ...]
    speed: float | None
    example: PeriodicSystem

    def system(self, point: Array) -> tuple[PeriodicSystem, float]:
        """Return the system and the speed (rad/s) at a point (v,). Raises subclasses of SolveError."""
        raise NotImplementedError

    def speeds(self, points: Array) -> Array:
        """Speeds (P,) of points (P, v), in rad/s."""
        if SPEED in self.names:
            return points[:, self.names.index(SPEED)]
        return np.full(len(points), self.speed)

    def entries(self, phase: Array, points: Array, engine: str = NUMPY) -> Array:
        """Entries (P, k, 3n² + n) of Ω²M, ΩC and K in row order, and of d, at phases (k,). They are NaN for
        points without a system."""
        entries = np.full((len(points), len(phase), 3 * self.example.n**2 + self.example.n), np.nan)
        for rows, point in zip(entries, points, strict=True):
            # Entries are NaN at points without a system. The solution of these points fails and reports the
            # reason.
            with suppress(SolveError):
                system, speed = self.system(point)
                rows[:] = entries_of(system, phase, speed)
        return entries

    def compared_entries(self, points: Array, engine: str = NUMPY) -> Iterator[tuple[Array, Array]]:
        """Yield phases (k,) and the entries (P, k, 3n² + n) at these phases, in chunks that fit into memory.

        The phases are the fixed phases at which the error estimate of a single point compares the
        coefficients, and the middle of each interval between neighbouring breaks of any point."""
        breaks = {b for group, _ in self.by_breaks(points) for b in group or ()}
        phases = compared_phases(self.example.period, tuple(breaks))
        size = 8 * len(phases) * len(points) * (3 * self.example.n**2 + self.example.n)
        for chunk in np.array_split(phases, max(1, math.ceil(size / _CHUNK_BYTES))):
            yield chunk, self.entries(chunk, points, engine)

    def exist(self, points: Array) -> Array:
        """Return a mask (P,) of the points (P, v) at which the fundamental motion exists."""
        return np.ones(len(points), dtype=bool)

    @property
    def moves_breaks(self) -> bool:
        """Whether the phases of the breaks may differ between points."""
        return True

    def at_speeds(self, points: Array) -> SpeedPoints | None:
        """Represent points (P, v) by one system at several speeds. Return None unless only the speed varies
        and the system provides `terms`."""
        return None

    def by_breaks(self, points: Array) -> list[tuple[tuple[float, ...] | None, Array]]:
        """Divide points (P, v) into groups with the same breaks. Return the breaks and the indices (k,) of
        each group. The breaks are None for points without a system."""
        groups: dict[tuple[float, ...] | None, list[int]] = {}
        for position, breaks in enumerate(self._breaks(points)):
            groups.setdefault(breaks, []).append(position)
        return [(breaks, np.array(positions)) for breaks, positions in groups.items()]

    def _breaks(self, points: Array) -> list[tuple[float, ...] | None]:
        breaks: list[tuple[float, ...] | None] = [None] * len(points)
        for position, point in enumerate(points):
            with suppress(SolveError):
                breaks[position] = self.system(point)[0].breaks
        return breaks

    def outputs(
        self, names: Sequence[str], phase: Array, points: Array, q: Array, qd: Array, qdd: Array
    ) -> Array:
        """Outputs (P, o, k) with the names `names` at phases (P, k), for states q, qd, qdd (P, n, k).
        Derivatives are with respect to time."""
        by_point = []
        for point, *state in zip(points, phase, q, qd, qdd, strict=True):
            system, speed = self.system(point)
            values = output_values(system, state[0], speed, *state[1:])
            by_point.append([values[name] for name in names])
        return np.array(by_point).reshape(len(points), -1, phase.shape[1])

    def output_formulas(self, points: Array) -> Formulas | None:
        """Formulas of the outputs, with the parameters (P, p) of the points; None if there are no
        formulas."""
        return None


class SystemFamily(Family):
    """Family of one system with varying speed, parameters, or both."""

    def __init__(self, system: PeriodicSystem, names: Sequence[str], speed: float | None = None):
        """Store the system and the names of the quantities.

        speed (rad/s): required unless `names` contains the speed. Raises UnknownNameError,
        ValueOutOfBoundsError."""
        quantities = [SPEED, *system.labels.parameters]
        for name in names:
            require_name(f"quantity of {system.labels.name}", name, quantities)
        if len(set(names)) < len(names):
            raise ValueOutOfBoundsError(f"{names[0]} is given twice; vary different quantities")
        self.names, self.speed = tuple(names), speed
        self.example = system
        self._free = [name for name in names if name != SPEED]
        variation = system.capabilities.variation
        self._evaluator: ModelPoints | None = None if variation is None else variation.many_points(self._free)
        self._recent: dict[tuple[float, ...], PeriodicSystem] = {}

    def __reduce__(self) -> tuple[Any, ...]:
        return SystemFamily, (copy.copy(self.example), self.names, self.speed)

    def system(self, point: Array) -> tuple[PeriodicSystem, float]:
        speed = float(self.speeds(point[None])[0])
        system = self._varied(self._values(point[None])[1][0]) if self._free else self.example
        return system, speed

    def exist(self, points: Array) -> Array:
        if self._evaluator is None:
            return super().exist(points)
        return self._evaluator.exist(*self._values(points))

    @property
    def moves_breaks(self) -> bool:
        variation = self.example.capabilities.variation
        return bool(self._free) and variation is not None and variation.moves_breaks

    def at_speeds(self, points: Array) -> SpeedPoints | None:
        speeds, evaluation = self.speeds(points), self.example.capabilities.evaluation
        if self._free or evaluation is None or evaluation.terms(np.zeros(1), speeds[:1]) is None:
            return None
        return SpeedPoints(self.example, speeds)

    def by_breaks(self, points: Array) -> list[tuple[tuple[float, ...] | None, Array]]:
        if self.moves_breaks:
            return super().by_breaks(points)
        return [(self.example.breaks, np.arange(len(points)))]

    def _breaks(self, points: Array) -> list[tuple[float, ...] | None]:
        if self._evaluator is None:
            return super()._breaks(points)
        return self._evaluator.breaks(self._values(points)[1])

    def entries(self, phase: Array, points: Array, engine: str = NUMPY) -> Array:
        speeds, free = self._values(points)
        if self._evaluator is not None and self._free:
            formulas = self._evaluator.formulas if engine == COMPILED else None
            by_time = (
                None
                if formulas is None
                else kernel.values(self._with_values(formulas, points), phase, speeds)
            )
            return self._evaluator.entries(phase, speeds, free, by_time)
        n = self.example.n
        entries = np.full((len(points), len(phase), 3 * n**2 + n), np.nan)
        unique, group = np.unique(free, axis=0, return_inverse=True)
        for number, values in enumerate(unique):
            members = np.flatnonzero(group.ravel() == number)
            with suppress(SolveError):
                entries[members] = entries_over(self._varied(values), phase, speeds[members])
        return entries

    def outputs(
        self, names: Sequence[str], phase: Array, points: Array, q: Array, qd: Array, qdd: Array
    ) -> Array:
        if self._evaluator is None:
            return super().outputs(names, phase, points, q, qd, qdd)
        outputs = self._evaluator.outputs(phase, *self._values(points), q, qd, qdd)
        return outputs[:, [self.example.outputs.index(name) for name in names]]

    def output_formulas(self, points: Array) -> Formulas | None:
        formulas = output_formulas(self.example, self._free)
        return None if formulas is None else self._with_values(formulas, points)

    def _with_values(self, formulas: Formulas, points: Array) -> Formulas:
        """Formulas with the parameters (P, p) of the points inserted."""
        values = np.tile(formulas.values, (len(points), 1))
        values[:, [formulas.names.index(name) for name in self._free]] = self._values(points)[1]
        return formulas._replace(values=values)

    def _varied(self, values: Array) -> PeriodicSystem:
        if not self._free:
            return self.example
        key = tuple(values.tolist())
        if key not in self._recent:
            system = self.example.varied(dict(zip(self._free, key, strict=True)))
            while len(self._recent) >= _CACHED_SYSTEMS:
                del self._recent[next(iter(self._recent))]
            self._recent[key] = system
        return self._recent[key]

    def _values(self, points: Array) -> tuple[Array, Array]:
        """Return the speeds (P,) and the free parameters (P, v) of the points."""
        return self.speeds(points), points[:, [self.names.index(name) for name in self._free]]


class BuiltFamily(Family):
    """Family of systems that a function builds. Values are passed to the function as keyword arguments."""

    def __init__(
        self,
        build: Callable[..., PeriodicSystem],
        names: Sequence[str],
        points: Array,
        speed: float | None = None,
    ):
        """Build the example.

        points (P, v): the first one with a valid system provides the example. speed (rad/s): required unless
        `names` contains the speed."""
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
                f"the function that builds systems returns {described(built)}; it must return a "
                "PeriodicSystem"
            )
        return built, speed

    def __reduce__(self) -> tuple[Any, ...]:
        return BuiltFamily, (self._build, self.names, self._point[None], self.speed)


def representative(points: Array) -> Array:
    """Return about `_REPRESENTATIVES` of the points (P, v), equally spaced in the sequence of the points."""
    return points[:: max(1, len(points) // _REPRESENTATIVES)]


def over_speed(system: PeriodicSystem) -> Family:
    """Family of one system with varying speed."""
    return SystemFamily(system, [SPEED])
