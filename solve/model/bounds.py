"""Bounds of parameters and outputs, as generated modules state them ("> 0", "integer, >= 1")."""

import math
from collections.abc import Mapping
from types import ModuleType
from typing import Any

from solve.errors import ValueOutOfBoundsError
from solve.units import in_unit, require_size_of_number


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
    return f"{value:z.{digits}g} {unit}".removesuffix(" 1")


def checked_parameters(module: ModuleType, given: Mapping[str, Any]) -> dict[str, float]:
    """The parameters that a generated module declares, from the given ones: numbers in the declared units, or
    texts with a unit such as "30 mm"; each finite and within its bound. Raises ValueOutOfBoundsError,
    UnitError."""
    checked = {}
    for name, unit, meaning, bound in module.PARAMETERS:
        try:
            value = in_unit(given[name], unit, name)
        except (TypeError, ValueError):
            raise ValueOutOfBoundsError(
                f"{name} ({meaning}) is {given[name]!r}; give a number in {unit}"
            ) from None
        if not math.isfinite(value) or not all(holds(clause, value) for clause in clauses(bound)):
            raise ValueOutOfBoundsError(
                f"{name} ({meaning}) is {measured(value, unit)}; allowed: {bound or 'any finite number'}"
            )
        # A small number beside others is none; one that must not be 0 may be divided by.
        if abs(value) > 1 or "> 0" in clauses(bound):
            require_size_of_number(f"{name} ({meaning})", value)
        checked[name] = value
    return checked
