"""Bounds of parameters and outputs, as generated modules state them ("> 0", "integer, >= 1"), and conditions
on several parameters."""

import math
from collections.abc import Mapping, Sequence
from types import ModuleType
from typing import Any

import numpy as np

from solve.arrays import Array
from solve.errors import ValueOutOfBoundsError
from solve.model.sampling import ConditionSampler

_PHASES = 720
"""Phases of a period at which conditions on the parameters are looked at."""

_TOGETHER = 4096
"""Sets of parameters whose conditions are looked at together."""


def clauses(bound: str) -> list[str]:
    """The parts of a bound that must all hold.

    >>> clauses("integer, >= 1")
    ['integer', '>= 1']
    """
    return bound.split(", ") if bound else []


def holds(clause: str, value: Any) -> Any:
    """Whether one clause holds for a number, or for each of an array.

    >>> holds("> 0", 2.0)
    True
    """
    if clause == "integer":
        return value % 1 == 0
    relation, limit = clause.split()
    number = float(limit)
    return {">": value > number, ">=": value >= number, "<": value < number, "<=": value <= number}[relation]


def measured(value: float, unit: str, digits: int = 6) -> str:
    """A value with its unit, unless that is 1.

    >>> measured(20.0, "1"), measured(8e4, "N m/rad")
    ('20', '80000 N m/rad')
    """
    return f"{value:.{digits}g} {unit}".removesuffix(" 1")


def checked_parameters(module: ModuleType, given: Mapping[str, Any]) -> dict[str, float]:
    """The parameters that a generated module declares, from the given ones, each finite and within its
    bound. Raises ValueOutOfBoundsError."""
    checked = {}
    for name, unit, meaning, bound in module.PARAMETERS:
        try:
            value = float(given[name])
        except (TypeError, ValueError):
            raise ValueOutOfBoundsError(
                f"{name} ({meaning}) is {given[name]!r}; give a number in {unit}"
            ) from None
        if not math.isfinite(value) or not all(holds(clause, value) for clause in clauses(bound)):
            raise ValueOutOfBoundsError(
                f"{name} ({meaning}) is {measured(value, unit)}; allowed: {bound or 'any finite number'}"
            )
        checked[name] = value
    return checked


class Conditions:
    """What a generated module demands of its parameters beyond the bound of each, such as lengths with
    which a linkage can turn."""

    def __init__(self, module: ModuleType, options: Mapping[str, Any], parameters: Mapping[str, float]):
        """options: those that the generated functions take."""
        self._module, self._options, self._parameters = module, options, parameters
        self._stated: Sequence[tuple[str, str, Sequence[str]]] = getattr(module, "CONDITIONS", ())
        self._phases = (np.arange(_PHASES) + 0.5) * (module.PERIOD / _PHASES)
        self._p = np.array([parameters[name] for name, *_ in module.PARAMETERS])
        self._samplers: dict[tuple[str, ...], ConditionSampler] = {}

    def require(self) -> None:
        """Raise ValueOutOfBoundsError where parameters contradict each other."""
        if not self._stated:
            return
        margins = self._module.conditions(**self._options)(self._phases[None], self._p).full()
        units = {name: unit for name, unit, *_ in self._module.PARAMETERS}
        for (condition, meaning, names), margin in zip(self._stated, margins, strict=True):
            if not (margin > 0).all():
                given = ", ".join(
                    f"{name} = {measured(self._parameters[name], units[name])}" for name in names
                )
                raise ValueOutOfBoundsError(
                    f"{meaning}: {condition} does not hold for {given}; choose numbers for which it does"
                )

    def admit(self, names: Sequence[str], values: Array) -> Array:
        """Whether bounds and conditions hold (P,) with the parameters of these names at values (P, v)."""
        found = np.asarray(np.isfinite(values).all(axis=1))
        bounds = {name: bound for name, _, _, bound in self._module.PARAMETERS}
        for name, column in zip(names, values.T, strict=True):
            for clause in clauses(bounds[name]):
                found &= holds(clause, column)
        if any(not set(names).isdisjoint(concerned) for *_, concerned in self._stated):
            found[found] = self._hold(names, values[found])
        return found

    def _hold(self, names: Sequence[str], values: Array) -> Array:
        """Whether the conditions hold all over the period (P,)."""
        sampler = self._sampler(tuple(names))
        phase = self._phases if sampler.over_phase else self._phases[:1]
        different, group = np.unique(values, axis=0, return_inverse=True)
        hold = np.zeros(len(different), dtype=bool)
        for at in np.array_split(np.arange(len(different)), math.ceil(len(different) / _TOGETHER)):
            margins = sampler(np.tile(phase, len(at)), np.repeat(different[at], len(phase), axis=0))
            hold[at] = (margins > 0).reshape(len(at), -1).all(axis=1)
        return hold[group.ravel()]

    def _sampler(self, names: tuple[str, ...]) -> ConditionSampler:
        if names not in self._samplers:
            free = [list(self._parameters).index(name) for name in names]
            conditions = self._module.conditions(**self._options)
            self._samplers[names] = ConditionSampler(conditions, self._p, free)
        return self._samplers[names]
