"""Generated code of a mechanism that is stated in memory, without a file."""

from collections.abc import Iterator

import sympy

from derive.checks import check
from derive.emit import module_text
from derive.errors import DeriveError
from derive.freshness import sha256
from derive.mechanism import MechanismStatement
from derive.stated import line_of
from derive.structure import StructureStatement
from derive.structure_text import structure_text

_MAX_CACHED = 64
"""Number of statements whose code is kept."""

_cache: dict[str, str] = {}


def code(mechanism: MechanismStatement) -> str:
    """Text of the generated module. The code of an identical statement is reused.

    Raises DeclarationError and the other errors of a statement.
    """
    statement = "\n".join(_statement(mechanism))
    if statement not in _cache:
        text = _derived(mechanism, statement)
        while len(_cache) >= _MAX_CACHED:
            del _cache[next(iter(_cache))]
        _cache[statement] = text
    return _cache[statement]


def _derived(mechanism: MechanismStatement, statement: str) -> str:
    source = sha256(statement), f"{mechanism.name}.py"
    try:
        check(mechanism)
        if isinstance(mechanism, StructureStatement):
            return structure_text(mechanism, *source)
        return module_text(mechanism, *source)
    except DeriveError as error:
        line = line_of(mechanism.lines, error)
        if line is None:
            raise
        raise type(error)(f"{mechanism.name}, line {line}: {error}") from error


def _statement(mechanism: MechanismStatement) -> Iterator[str]:
    """Everything that is stated; expressions to the last digit."""
    yield repr(mechanism)
    if mechanism.declared_field:
        yield sympy.srepr(mechanism.declared_field.shape(*sympy.symbols("k xi")))
    for expression in (mechanism.kinetic, mechanism.potential, mechanism.dissipation, mechanism.period):
        yield sympy.srepr(expression)
    for pair in (*mechanism.forces, *mechanism.fundamental_motion.items()):
        yield sympy.srepr(pair)
    for output in mechanism.declared_outputs:
        yield sympy.srepr(output.expression)
    for sketch in mechanism.declared_sketches:
        yield sympy.srepr(sketch.points)
