"""Python source of the constants of a generated module."""

import json
from collections.abc import Sequence

import sympy

from derive.declarations import Condition, Output
from derive.function_text import tuple_lines
from derive.functions import PeriodicFunction
from derive.mechanism import MechanismStatement
from derive.printer import CasadiPrinter


def constants(
    mechanism: MechanismStatement,
    outputs: list[Output],
    operations: dict[str, int],
    conditions: Sequence[Condition],
) -> str:
    """Source code of the constants of a generated module, without the hashes."""
    names = {parameter.symbol.name for parameter in mechanism.declared_parameters}
    rows = {
        "COORDINATES": [
            (coordinate.symbol.name, coordinate.unit, coordinate.meaning)
            for coordinate in mechanism.declared_coordinates
        ],
        "PARAMETERS": [
            (parameter.symbol.name, parameter.unit, parameter.meaning, parameter.bound)
            for parameter in mechanism.declared_parameters
        ],
        "OPTIONS": [(option.name, option.values, option.default) for option in mechanism.declared_options],
        "OUTPUTS": [(output.name, output.unit, output.meaning) for output in outputs],
        "LIMITS": mechanism.limits,
    }
    if mechanism.declared_inputs:
        rows["INPUTS"] = [(each.name, each.unit, each.meaning) for each in mechanism.declared_inputs]
    if conditions:
        rows["CONDITIONS"] = [
            (condition.text, condition.meaning, tuple(name for name in condition.parameters if name in names))
            for condition in conditions
        ]
    if mechanism.declared_series:
        rows["SERIES"] = [_series(series) for series in mechanism.declared_series]
    if mechanism.declared_bodies:
        rows["BODIES"] = [body.row for body in mechanism.declared_bodies]
    if mechanism.declared_field:
        deflection = mechanism.declared_field
        rows["FIELDS"] = [(deflection.name, deflection.unit, deflection.meaning)]
    if mechanism.declared_sketches:
        rows["SKETCH"] = [(sketch.name, sketch.unit, sketch.kind) for sketch in mechanism.declared_sketches]
    lines = [f"NAME = {literal(mechanism.name)}", f"TITLE = {literal(mechanism.title)}"]
    for name, tuples in rows.items():
        lines += tuple_lines(name, [*map(literal, tuples)])
    lines += [
        f"VALIDITY = {json.dumps(mechanism.validity)}",
        f"PERIOD = {CasadiPrinter().doprint(sympy.sympify(mechanism.period))}",
        f"OPERATIONS = {json.dumps(operations)}",
    ]
    return "\n".join(lines)


def _series(series: type[PeriodicFunction]) -> tuple:
    """Entry for a series in the constant SERIES.

    The entry contains the name, the form, whether the coefficients are those of the derivative, the mean, the
    prefixes of both kinds of coefficients, and the number of harmonics.
    """
    prefixes = (family[0].name.removesuffix("1") for family in (series.first, series.second))
    mean = series.mean.name if series.mean else ""
    return series.__name__, series.form, series.integrated, mean, *prefixes, len(series.first)


def literal(value: str | float | range | tuple) -> str:
    """Return the Python source of a value. Strings have double quotes."""
    if isinstance(value, tuple):
        return "(" + ", ".join(map(literal, value)) + ("," if len(value) == 1 else "") + ")"
    return json.dumps(value, ensure_ascii=False) if isinstance(value, str) else repr(value)
