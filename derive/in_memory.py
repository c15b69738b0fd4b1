"""Generated code of a mechanism that lies in no file."""

from collections.abc import Iterator

import sympy

from derive.checks import check
from derive.emit import module_text
from derive.errors import DeriveError
from derive.freshness import sha256
from derive.mechanism import Mechanism
from derive.stated import line_of
from derive.structure import Structure
from derive.structure_text import structure_text

_KEPT = 64
_codes: dict[str, str] = {}


def code(mechanism: Mechanism) -> str:
    """Text of the generated module; what was derived before for the same statement is not derived again.

    Raises DeclarationError and the other errors of a statement.
    """
    statement = "\n".join(_statement(mechanism))
    if statement not in _codes:
        text = _derived(mechanism, statement)
        while len(_codes) >= _KEPT:
            del _codes[next(iter(_codes))]
        _codes[statement] = text
    return _codes[statement]


def _derived(mechanism: Mechanism, statement: str) -> str:
    of_statement = sha256(statement), f"{mechanism.name}.py"
    try:
        check(mechanism)
        if isinstance(mechanism, Structure):
            return structure_text(mechanism, *of_statement)
        return module_text(mechanism, *of_statement)
    except DeriveError as error:
        line = line_of(mechanism.lines, error)
        if line is None:
            raise
        raise type(error)(f"{mechanism.name}, line {line}: {error}") from error


def _statement(mechanism: Mechanism) -> Iterator[str]:
    """Everything that is stated; expressions to the last digit."""
    yield repr(mechanism)
    if mechanism.declared_field:
        yield sympy.srepr(mechanism.declared_field.shape(*sympy.symbols("k xi")))
    for each in (mechanism.kinetic, mechanism.potential, mechanism.dissipation, mechanism.period):
        yield sympy.srepr(each)
    for pair in (*mechanism.forces, *mechanism.fundamental_motion.items()):
        yield sympy.srepr(pair)
    for output in mechanism.declared_outputs:
        yield sympy.srepr(output.expression)
    for sketch in mechanism.declared_sketches:
        yield sympy.srepr(sketch.points)
