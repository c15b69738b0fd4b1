"""The numbers of a case for reading beside the equations. `solve` reads case files for solving, with all that
can be wrong in them; what it refuses may pass here, what it takes has the same value."""

import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import sympy

from derive.errors import CaseError
from derive.mechanism import MechanismStatement
from derive.units import parse, size


def case_numbers(path: Path, case: str, mechanism: MechanismStatement) -> dict[sympy.Symbol, float]:
    """The parameters of a case in coherent SI, but for those that a table of measured values gives, or a
    frequency where an angular velocity is declared.

    Raises CaseError where the file cannot be read or has no such case, UnitError.
    """
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8-sig"))
        cases = {name: {**entry.get("parameters", {})} for name, entry in content["case"].items()}
        shared = {**content.get("common", {}).get("parameters", {})}
    except (OSError, UnicodeDecodeError, ValueError, KeyError, AttributeError, TypeError) as error:
        raise CaseError(f"{path} cannot be read as a case file: {_cause(error)}") from None
    if case not in cases:
        raise CaseError(f'{path} has no case "{case}"; it has: {", ".join(cases)}')
    declared = {each.symbol.name: each for each in mechanism.declared_parameters}
    numbers = {}
    for name, entry in {**shared, **cases[case]}.items():
        for member, value in _members(name, entry):
            if member not in declared or not isinstance(value, int | float):
                raise CaseError(
                    f"{path}: {member} = {value!r} is no number of a parameter of {mechanism.name}"
                )
            unit = entry.get("unit", "")
            if parse(unit) != parse(declared[member].unit):
                raise CaseError(f'{path}: {member} is in "{unit}"; it must be in "{declared[member].unit}"')
            # Whether a hertz is 1 or 2π rad/s depends on what it is converted to.
            if ("Hz" in unit) == ("Hz" in declared[member].unit):
                numbers[declared[member].symbol] = float(value) * size(unit)
    return numbers


def _members(name: str, entry: Any) -> Iterator[tuple[str, Any]]:
    """Each parameter of an entry, with its value."""
    kinds = {"unit": str, "values": list, "count": int}
    if not isinstance(entry, dict) or not all(
        isinstance(entry[key], kind) for key, kind in kinds.items() if key in entry
    ):
        raise CaseError(f"{name} is {entry!r}; give a table with value or values, and unit")
    if "count" in entry:
        yield from ((f"{name}{k + 1}", entry.get("value")) for k in range(entry["count"]))
    elif "values" in entry:
        yield from ((f"{name}{k}", value) for k, value in enumerate(entry["values"], start=1))
    elif "table" not in entry:
        yield name, entry.get("value")


def _cause(error: Exception) -> str:
    """Reason why a case file cannot be read."""
    if isinstance(error, OSError):
        return (error.strerror or "no access").lower()
    if isinstance(error, KeyError):
        return f"it has no {error}"
    return str(error) if isinstance(error, ValueError) else "a table is missing in it"
