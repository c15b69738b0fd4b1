"""Checks of a mechanism before the derivation of its equations."""

import difflib
from collections.abc import Iterator, Mapping, Set
from dataclasses import dataclass, field
from typing import Any

import sympy

from derive.declarations import AROUND, METRE
from derive.errors import DeclarationError, DeriveError, UnitError, UnknownSymbolError, UnusedParameterError
from derive.functions import LoopFunction, PeriodicFunction
from derive.mechanism import MechanismStatement
from derive.structure import StructureStatement
from derive.switches import switches
from derive.symbols import ACCELERATION, PHASE, SPEED
from derive.units import ONE, SECOND, Dimension, dimension_of, parse, require, require_coherent, short

Dimensions = Mapping[sympy.Symbol, Dimension]


@dataclass(frozen=True)
class _Statement:
    """Expression in the mechanism file, with its required unit and its forbidden symbols."""

    what: str
    expression: sympy.Expr
    unit: str | None
    """Required unit; None if any consistent unit is allowed."""
    forbidden: Set[Any] = frozenset()
    symbols: Mapping[Any, Dimension] = field(default_factory=dict)
    """Dimensions of symbols that are permitted in this expression only."""


def check(mechanism: MechanismStatement) -> None:
    """Raise DeclarationError, UnknownSymbolError, UnitError or UnusedParameterError at the first fault."""
    if mechanism.declared_inputs and (isinstance(mechanism, StructureStatement) or mechanism.declared_field):
        raise DeclarationError(
            f"input {mechanism.declared_inputs[0].name}: structures and mechanisms with a field cannot have "
            "inputs; describe the deflection by coordinates"
        )
    if isinstance(mechanism, StructureStatement):
        mechanism.require_complete()
        statements = [_Statement(*statement) for statement in mechanism.numbers()]
        for statement in statements:
            if switches(statement.expression, (PHASE,)):
                raise DeclarationError(
                    f"{statement.what} has a step or kink in the phase: {short(statement.expression)}; the "
                    "links of a structure require smooth motions"
                )
    else:
        _require_equations(mechanism)
        statements = list(_statements(mechanism))
    statements += [*_kinematic_statements(mechanism), *_sketches(mechanism)]
    dimension = dimensions(mechanism)
    for statement in statements:
        try:
            _require(statement, {**dimension, **statement.symbols})
        except DeriveError as error:
            error.about = statement.expression
            raise
    _require_use(mechanism, [statement.expression for statement in statements])


def _require(statement: _Statement, known: Dimensions) -> None:
    _require_finite(statement)
    _require_last_piece(statement)
    _require_known(statement, known)
    if statement.unit is None:
        dimension_of(statement.what, statement.expression, known)
        return
    try:
        require(statement.what, statement.expression, statement.unit, known)
    except UnitError as error:
        if METRE not in statement.symbols:
            raise
        raise UnitError(
            f"{error}; write a length that is not a parameter as a number multiplied by metre"
        ) from None


def _require_equations(mechanism: MechanismStatement) -> None:
    """Raise DeclarationError for a mechanism without equations or outputs, or with conflicting
    declarations."""
    energies = (mechanism.kinetic, mechanism.potential, mechanism.dissipation, *mechanism.forces)
    moved = any(energy != 0 for energy in energies) and not mechanism.no_drive_torque
    if not (mechanism.declared_coordinates or mechanism.declared_outputs or moved):
        raise DeclarationError(
            f"{mechanism.name} has no coordinates; declare one with coordinates(...), or for a rigid "
            "mechanism give energies as functions of the phase, or outputs"
        )
    require_coherent("the energy", mechanism.energy)
    ratios, modes = len(mechanism.damping_ratios), len(mechanism.declared_coordinates)
    if ratios > modes:
        raise DeclarationError(
            f"{ratios} damping ratios for {modes} coordinate{'s'[: modes > 1]}; give at most one per mode"
        )
    for loop in mechanism.declared_loops:
        for unknown, unit in zip(loop.unknowns, loop.units, strict=True):
            require_coherent(unknown.name, unit)
    if mechanism.energy != "J" and not mechanism.no_drive_torque:
        raise DeclarationError(
            f"energies in {mechanism.energy} give no drive torque in N m; call decline_drive_torque(reason)"
        )
    if not mechanism.no_drive_torque and "drive_torque" in {
        output.name for output in mechanism.declared_outputs
    }:
        raise DeclarationError(
            'the name "drive_torque" is reserved for the output that follows from the energies; rename '
            "your output, or call decline_drive_torque(reason)"
        )


def _statements(mechanism: MechanismStatement) -> Iterator[_Statement]:
    moving = [coordinate.symbol for coordinate in mechanism.declared_coordinates]
    rates, accelerations = {q.rate for q in moving}, {q.rate.rate for q in moving}
    motion = {*moving} | rates | accelerations
    local = mechanism.declared_field.local if mechanism.declared_field else set()
    points = set(mechanism.declared_field.points) if mechanism.declared_field else set()
    never = accelerations | local | points
    energies = {
        "kinetic energy": (mechanism.kinetic, mechanism.energy, never),
        "potential energy": (mechanism.potential, mechanism.energy, never | rates),
        "dissipation": (mechanism.dissipation, mechanism.energy + "/s", never),
    }
    for what, (energy, unit, forbidden) in energies.items():
        yield _Statement(what, _expression(what, energy), unit, forbidden)
    for force, along in mechanism.forces:
        what = f"virtual work of {short(force)} along {short(along)}"
        yield _Statement(what, sympy.Mul(force, along), mechanism.energy, never)
        yield _Statement(f"displacement {short(along)}", along, None, never | rates)
    for each in mechanism.declared_inputs:
        force = sympy.Dummy(each.name)
        what, symbols = f"virtual work of {each.name} along {short(each.along)}", {force: parse(each.unit)}
        yield _Statement(what, force * each.along, mechanism.energy, never | rates, symbols)
    for coordinate in mechanism.declared_coordinates:
        if coordinate.symbol in mechanism.fundamental_motion:
            desired = mechanism.fundamental_motion[coordinate.symbol]
            yield _Statement(f"fundamental motion of {coordinate.symbol}", desired, coordinate.unit, motion)
    for ratio in mechanism.damping_ratios:
        yield _Statement("damping ratio", ratio, "1", motion | local | points | {PHASE, SPEED})
    for output in mechanism.declared_outputs:
        yield _Statement(f"output {output.name}", output.expression, output.unit, local)


def _sketches(mechanism: MechanismStatement) -> Iterator[_Statement]:
    moving = [coordinate.symbol for coordinate in mechanism.declared_coordinates]
    local = mechanism.declared_field.symbols if mechanism.declared_field else []
    never = {s for q in (*moving, *local) for s in q.motion[1:]}
    if mechanism.declared_field:
        never |= {*mechanism.declared_field.points, mechanism.declared_field.tension}
    symbols = {AROUND: ONE, METRE: parse("m")}
    for sketch in mechanism.declared_sketches:
        for number in sketch.numbers:
            yield _Statement(f"sketch {sketch.name}", number, sketch.unit, never, symbols)


def _kinematic_statements(mechanism: MechanismStatement) -> Iterator[_Statement]:
    moving = [coordinate.symbol for coordinate in mechanism.declared_coordinates]
    motion = {s for q in moving for s in q.motion}
    for loop in mechanism.declared_loops:
        for equation in loop.closure:
            yield _Statement(f"loop of {loop}", equation, None, motion | {PHASE, SPEED})
    for condition in mechanism.conditions:
        yield _Statement(f"condition {condition.text}", condition.margin, None)
    parameters = {parameter.symbol for parameter in mechanism.declared_parameters}
    yield _Statement("period", _period(mechanism), "rad", motion | parameters | {PHASE, SPEED})


def _period(mechanism: MechanismStatement) -> sympy.Expr:
    period = _expression("period", mechanism.period)
    if period.is_number and not period.is_positive:
        raise DeclarationError(f"period is {period}; give a positive angle, such as 2*pi")
    return period


def _expression(what: str, given: Any) -> sympy.Expr:
    """Convert a number or expression to a SymPy expression. Raises DeclarationError for other types."""
    try:
        expression = sympy.sympify(given, strict=True)
    except sympy.SympifyError:
        expression = None
    if not isinstance(expression, sympy.Expr):
        raise DeclarationError(f"{what} is {given!r}; give a number or an expression")
    return expression


def _require_finite(statement: _Statement) -> None:
    if statement.expression.has(sympy.nan, sympy.zoo, sympy.oo, -sympy.oo):
        raise DeclarationError(
            f"{statement.what} is not finite: {short(statement.expression)}; check for a division by zero"
        )


def _require_last_piece(statement: _Statement) -> None:
    for pieces in statement.expression.atoms(sympy.Piecewise):
        if pieces.args[-1].args[1] != sympy.true:
            raise DeclarationError(
                f"{statement.what} has no value where no condition of {short(pieces)} holds; add a last "
                "piece with the condition True, such as (0, True)"
            )


def dimensions(mechanism: MechanismStatement) -> dict[sympy.Symbol, Dimension]:
    """Physical dimensions of all symbols of a mechanism."""
    by_symbol: dict[sympy.Symbol, Dimension] = {
        PHASE: ONE,
        SPEED: ONE / SECOND,
        ACCELERATION: ONE / SECOND**2,
    }
    by_symbol |= {parameter.symbol: parse(parameter.unit) for parameter in mechanism.declared_parameters}
    by_symbol |= {symbol: ONE for option in mechanism.declared_options for symbol in option.indicators}
    moving = {coordinate.symbol: parse(coordinate.unit) for coordinate in mechanism.declared_coordinates}
    if mechanism.declared_field:
        length = dimension_of("length", mechanism.declared_field.length, by_symbol)
        moving |= mechanism.declared_field.dimensions(length, parse(mechanism.energy))
        by_symbol[mechanism.declared_field.position] = length
    for symbol, unit in moving.items():
        by_symbol |= {derivative: unit / SECOND**order for order, derivative in enumerate(symbol.motion)}
    for loop in mechanism.declared_loops:
        by_symbol |= {z: parse(unit) for z, unit in zip(loop.unknowns, loop.units, strict=True)}
        for dummy, argument in zip(loop.given, loop.arguments, strict=True):
            by_symbol[dummy] = dimension_of(f"loop of {loop}", argument, by_symbol)
    return by_symbol


def _require_known(statement: _Statement, known: Dimensions) -> None:
    names = [symbol.name for symbol in known]
    for symbol in sorted(statement.expression.free_symbols - (set(known) - statement.forbidden), key=str):
        if symbol in statement.forbidden:
            raise UnknownSymbolError(
                f"{statement.what} contains {symbol}, which is not allowed there; remove {symbol}, or state "
                "the term by another energy, a dissipation or a force"
            )
        if str(symbol) in names:
            raise UnknownSymbolError(
                f"{statement.what} contains a symbol named {symbol} other than the declared one; "
                "use the symbols that coordinates(...) and parameters(...) return"
            )
        nearest = difflib.get_close_matches(str(symbol), names, 1)
        hint = f"; did you mean {nearest[0]}?" if nearest else "; declare it with parameters(...)"
        raise UnknownSymbolError(f"{statement.what} contains {symbol}, which is not declared{hint}")


def _require_use(mechanism: MechanismStatement, expressions: list[sympy.Expr]) -> None:
    symbols = set().union(*(expression.free_symbols for expression in expressions))
    for series in set().union(*(expression.atoms(PeriodicFunction) for expression in expressions)):
        symbols |= set(type(series).coefficients())
    for unknown in set().union(*(expression.atoms(LoopFunction) for expression in expressions)):
        symbols |= set(unknown.loop.parameters)
    for parameter in mechanism.declared_parameters:
        if parameter.symbol not in symbols:
            unused = f"parameter {parameter.symbol} is not used; use it or remove it"
            raise UnusedParameterError(unused, parameter.symbol)
    for option in mechanism.declared_options:
        if mechanism.declared_field and option.name == mechanism.declared_field.modes:
            continue
        if not symbols & set(option.indicators):
            raise UnusedParameterError(f"option {option.name} is not used; use it or remove it")
