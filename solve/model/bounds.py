"""Validation of parameters and options against the bounds stated by generated modules."""

import math
import re
from collections.abc import Mapping, Sequence
from types import ModuleType
from typing import Any

import numpy as np

from solve.contracts import Limit, Statistics
from solve.errors import UnknownNameError, ValueOutOfBoundsError
from solve.units import in_unit, require_size_of_number


def clauses(bound: str) -> list[str]:
    """Split a bound into its conditions, such as "> 0". All of them must hold.

    >>> clauses("integer, >= 1")
    ['integer', '>= 1']
    """
    return bound.split(", ") if bound else []


def holds(clause: str, value: Any) -> Any:
    """Whether a condition holds for a number, or for every element of an array separately.

    >>> holds("> 0", 2.0)
    True
    """
    if clause == "integer":
        return value % 1 == 0
    relation, limit = clause.split()
    number = float(limit)
    return {">": value > number, ">=": value >= number, "<": value < number, "<=": value <= number}[relation]


def measured(value: float, unit: str, digits: int = 6) -> str:
    """Text of a value with its unit, unless the unit is 1.

    >>> measured(20.0, "1"), measured(8e4, "N m/rad")
    ('20', '80000 N m/rad')
    """
    return f"{value:z.{digits}g} {unit}".removesuffix(" 1")


def checked_parameters(module: ModuleType, values: Mapping[str, Any]) -> dict[str, float]:
    """Return the parameters of a generated module as finite numbers in the declared units, within their
    bounds.

    values: numbers in the declared units, or strings with a unit such as "30 mm". Raises
    ValueOutOfBoundsError, UnitError."""
    checked = {}
    for name, unit, meaning, bound in module.PARAMETERS:
        try:
            value = in_unit(values[name], unit, name)
        except ValueOutOfBoundsError:
            raise ValueOutOfBoundsError(
                f"{name} ({meaning}) is {values[name]!r}; give a number in {unit}"
            ) from None
        if not math.isfinite(value) or not all(holds(clause, value) for clause in clauses(bound)):
            raise ValueOutOfBoundsError(
                f"{name} ({meaning}) is {measured(value, unit)}; allowed: {bound or 'any finite number'}"
            )
        # Subnormal numbers are negligible in sums, but not as divisors.
        if abs(value) > 1 or "> 0" in clauses(bound):
            require_size_of_number(f"{name} ({meaning})", value)
        checked[name] = value
    return checked


def stated_limits(
    rows: Sequence[tuple[str, str, str]], validity: Mapping[str, float], units: Mapping[str, str]
) -> list[Limit]:
    """Limits of validity stated by a generated module. `rows` contain quantity, bound and meaning; `validity`
    contains the bounds of coordinates."""
    return [
        *(_validity_limit(name, bound, units[name]) for name, bound in validity.items()),
        *(
            _bound_limit(name, meaning, units[name], clause)
            for name, bound, meaning in rows
            for clause in clauses(bound)
        ),
    ]


def _validity_limit(name: str, bound: float, unit: str) -> Limit:
    """Limit within which the linearisation is valid."""

    def message(values: Statistics) -> str:
        reached = f"max|{name}| = {values.max_abs:.3g} {unit}, beyond {bound:g}"
        return f"the linearisation may be invalid: {reached}"

    return Limit(name, lambda values: values.max_abs > bound, message)


def _bound_limit(name: str, meaning: str, unit: str, clause: str) -> Limit:
    """Limit for one condition, `clause`, of a bound in a generated module."""

    def extreme(values: Statistics) -> Any:
        return values.min if clause.startswith(">") else values.max

    def exceeded(values: Statistics) -> Any:
        return ~np.isnan(extreme(values)) & ~np.asarray(holds(clause, extreme(values)))

    def message(values: Statistics) -> str:
        return f"{meaning}: {name} reaches {measured(extreme(values), unit, 3)}, bound {clause}"

    return Limit(name, exceeded, message)


REDUCE = "reduce"
"""Name of an option of every beam structure: the number of modes retained per link. The options contain this
name only if the user states the number."""


def checked_options(module: ModuleType, values: Mapping[str, Any]) -> dict[str, Any]:
    """Values of all options. Options that `values` does not contain have their defaults. Raises
    UnknownNameError and ValueOutOfBoundsError."""
    link_options, motion_options = getattr(module, "LINK_OPTIONS", ()), getattr(module, "MOTION_OPTIONS", ())
    declared = (*module.OPTIONS, *link_options, *motion_options)
    allowed = {name: choices for name, choices, _ in declared}
    options: dict[str, Any] = {name: default for name, _, default in declared}
    for name, value in values.items():
        if name == REDUCE and name not in allowed:
            options[name] = _modes_a_link(module, value)
            continue
        if name not in allowed:
            raise UnknownNameError(f"option of {module.NAME}", name, allowed)
        per_link = any(name == option for option, *_ in link_options)
        checked = _option_per_link if per_link else _checked_option
        options[name] = checked(module, name, value, allowed[name])
    return options


def _modes_a_link(module: ModuleType, value: Any) -> int:
    """Number of modes per link, checked to be at least 1. Its upper limit is not checked here, because it
    depends on the number of elements, which is known only after their assembly."""
    if not hasattr(module, "LINKS"):
        raise ValueOutOfBoundsError(
            f"'reduce' requires a beam structure, but {module.NAME} is not one; omit 'reduce'"
        )
    modes = _as_integer(value)
    if type(modes) is not int or modes < 1:
        raise ValueOutOfBoundsError(f"reduce is {value}; allowed: a number of modes per link, 1 or more")
    return modes


def _option_per_link(module: ModuleType, name: str, value: Any, allowed: Sequence[Any]) -> Any:
    """Value of an option of a link: one value for all links, or a string with one value per link, separated
    by commas."""
    parts = (
        value.split(",") if isinstance(value, str) else value if isinstance(value, list | tuple) else [value]
    )
    links = [link for link, *_ in module.LINKS]
    if len(parts) not in (1, len(links)):
        raise ValueOutOfBoundsError(
            f"option {name} of {module.NAME} has {len(parts)} values; give one for all links, or one for "
            f"each of {','.join(links)}"
        )
    chosen = [_checked_option(module, name, part, allowed) for part in parts]
    return chosen[0] if len(chosen) == 1 else ",".join(map(str, chosen))


def _checked_option(module: ModuleType, name: str, value: Any, allowed: Sequence[Any]) -> Any:
    chosen = _as_integer(value) if isinstance(allowed, range) else value
    if not any(type(chosen) is type(allowed_value) and chosen == allowed_value for allowed_value in allowed):
        if isinstance(allowed, range):
            bounds = f"a whole number from {allowed[0]} to {allowed[-1]}"
            raise ValueOutOfBoundsError(f"option {name} of {module.NAME} is {value}; allowed: {bounds}")
        raise UnknownNameError(f"value of option {name}", str(value), map(str, allowed))
    return chosen


def _as_integer(value: Any) -> Any:
    """Convert a string or a NumPy integer to an integer; return other values unchanged."""
    if isinstance(value, np.integer):
        return int(value)
    return int(value) if isinstance(value, str) and re.fullmatch("-?[0-9]+", value.strip()) else value
