"""What a complete statement of a mechanism must satisfy before anything is derived from it."""

import sympy

from derive.errors import DeclarationError, UnknownSymbolError, UnusedParameterError
from derive.mechanism import Mechanism
from derive.symbols import PHASE, SPEED
from derive.transmission import PeriodicFunction
from derive.units import ONE, SECOND, Dimension, parse, require


def check(mechanism: Mechanism) -> None:
    """Raise DeclarationError, UnknownSymbolError, UnitError or UnusedParameterError on the first fault."""
    if not mechanism.declared_coordinates:
        raise DeclarationError(
            f"{mechanism.name} has no coordinates; declare one or more with coordinates(...)"
        )
    stated = _statements(mechanism)
    known = _dimensions(mechanism)
    accelerations = {each.symbol.rate.rate for each in mechanism.declared_coordinates}
    for what, (expression, unit) in stated.items():
        allowed = set(known) if what.startswith("output ") else set(known) - accelerations
        if what.startswith("fundamental motion "):
            allowed -= {s for each in mechanism.declared_coordinates for s in (each.symbol, each.symbol.rate)}
        _require_known(what, expression, allowed)
        require(what, expression, unit, known)
    _require_use(mechanism, [expression for expression, _ in stated.values()])


def _statements(mechanism: Mechanism) -> dict[str, tuple[sympy.Expr, str]]:
    """Every expression of the statement with the unit that it must have, by its name for messages."""
    stated = {
        "kinetic energy": (sympy.sympify(mechanism.kinetic), mechanism.energy),
        "potential energy": (sympy.sympify(mechanism.potential), mechanism.energy),
        "dissipation": (sympy.sympify(mechanism.dissipation), mechanism.energy + "/s"),
        "period": (sympy.sympify(mechanism.period), "rad"),
    }
    for force, along in mechanism.forces:
        stated[f"virtual work of {force} along {along}"] = (force * along, mechanism.energy)
    for each in mechanism.declared_coordinates:
        if each.symbol in mechanism.fundamental_motion:
            stated[f"fundamental motion of {each.symbol}"] = (
                mechanism.fundamental_motion[each.symbol],
                each.unit,
            )
    for output in mechanism.declared_outputs:
        stated[f"output {output.name}"] = (output.expression, output.unit)
    return stated


def _dimensions(mechanism: Mechanism) -> dict[sympy.Symbol, Dimension]:
    known: dict[sympy.Symbol, Dimension] = {PHASE: ONE, SPEED: ONE / SECOND}
    for each in mechanism.declared_coordinates:
        unit = parse(each.unit)
        known |= {each.symbol: unit, each.symbol.rate: unit / SECOND, each.symbol.rate.rate: unit / SECOND**2}
    known |= {each.symbol: parse(each.unit) for each in mechanism.declared_parameters}
    known |= {symbol: ONE for option in mechanism.declared_options for symbol in option.indicators}
    return known


def _require_known(what: str, expression: sympy.Expr, allowed: set[sympy.Symbol]) -> None:
    unknown = sorted(str(symbol) for symbol in expression.free_symbols - allowed)
    if unknown:
        raise UnknownSymbolError(
            f"{what} holds {', '.join(unknown)}, which cannot stand there; "
            f"it may hold {', '.join(sorted(symbol.name for symbol in allowed))}"
        )


def _require_use(mechanism: Mechanism, expressions: list[sympy.Expr]) -> None:
    symbols = set().union(*(each.free_symbols for each in expressions))
    for series in set().union(*(each.atoms(PeriodicFunction) for each in expressions)):
        symbols |= set(type(series).coefficients())
    for parameter in mechanism.declared_parameters:
        if parameter.symbol not in symbols:
            raise UnusedParameterError(
                f"the parameter {parameter.symbol} is declared but never used; use it or drop it"
            )
    for option in mechanism.declared_options:
        if not symbols & set(option.indicators):
            raise UnusedParameterError(
                f"the option {option.name} is declared but never used; use it or drop it"
            )
