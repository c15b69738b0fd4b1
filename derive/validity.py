"""Limits of validity of the generated equations: domains of functions, and terms that the linearisation
neglects.

Roots and arccosines of a motion may cancel in the equations. The equations may then be real at phases at
which the motion is not.
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import sympy
from sympy.printing.str import StrPrinter

from derive.declarations import Condition
from derive.domains import POSITIVE, Need, is_met, need, needs, signs_of
from derive.equations import from_fundamental
from derive.errors import DeclarationError
from derive.functions import LoopFunction, PeriodicFunction, at_fundamental_motion
from derive.mechanism import MechanismStatement
from derive.switches import outermost, switches
from derive.symbols import PHASE, SPEED, counted, steady
from derive.units import cut, short


class Demand(NamedTuple):
    """Domain condition of a function in the mechanism: `margin` must satisfy `relation`.

    what: description of the expression that contains the function. function, margin_text: function and margin
    as text.
    """

    what: str
    function: str
    margin_text: str
    relation: str
    margin: Any


def demands(mechanism: MechanismStatement) -> list[Demand]:
    """Return the domain conditions that the signs of the parameters do not imply.

    Raises DeclarationError if a condition can never hold.
    """
    signs, known = signs_of(mechanism.declared_parameters), _known(mechanism)
    collected: dict[tuple[Any, str], Demand] = {}
    for what, expression, motion in _stated(mechanism):
        # If a factor is zero in the fundamental motion, the other factors do not restrict the domain.
        for node, condition in needs(_about_fundamental(mechanism, expression)):
            needed = condition._replace(margin=at_fundamental_motion(condition.margin))
            if is_met(needed, signs) or not needed.margin.free_symbols <= known:
                continue
            if needed.margin.is_number and motion:
                raise DeclarationError(f"{what} does not exist: {_sentence(node)}")
            varies = needed.margin.has(PHASE, SPEED, LoopFunction)
            if varies or (motion and not needed.margin.is_number):
                original = need(node) or needed
                demand = Demand(what, short(node), _shown(original.margin), needed.relation, needed.margin)
                collected.setdefault((needed.margin, needed.relation), demand)
    declared = [
        Demand("a condition of the mechanism", stated.meaning, stated.text, POSITIVE, stated.margin)
        for stated in _conditions(mechanism)
        if stated.margin.has(SPEED)
    ]
    return [*collected.values(), *declared]


def conditions(mechanism: MechanismStatement) -> list[Condition]:
    """Return the declared conditions that do not depend on the speed, evaluated in the fundamental motion."""
    return [condition for condition in _conditions(mechanism) if not condition.margin.has(SPEED)]


def _conditions(mechanism: MechanismStatement) -> Iterator[Condition]:
    for condition in mechanism.conditions:
        yield replace(
            condition, margin=at_fundamental_motion(_about_fundamental(mechanism, condition.margin))
        )


def _about_fundamental(mechanism: MechanismStatement, expression: Any) -> Any:
    """Expression with coordinates relative to the fundamental motion, at constant speed."""
    return steady(from_fundamental(mechanism, sympy.sympify(expression)))


def _stated(mechanism: MechanismStatement) -> Iterator[tuple[str, Any, bool]]:
    """Yield, for each expression that is evaluated in the fundamental motion, its description, the
    expression, and whether it is itself a motion.
    """
    for symbol, motion in mechanism.fundamental_motion.items():
        yield f"the fundamental motion of {symbol}", motion, True
    for name in ("kinetic", "potential"):
        yield f"the {name} energy", getattr(mechanism, name), False
    yield "the dissipation", mechanism.dissipation, False
    for force, along in mechanism.forces:
        yield "a force", force, False
        yield "the displacement of a force", along, False


def _known(mechanism: MechanismStatement) -> set[Any]:
    options = {symbol for option in mechanism.declared_options for symbol in option.indicators}
    return {PHASE, SPEED, *options, *(parameter.symbol for parameter in mechanism.declared_parameters)}


class _Printer(StrPrinter):
    """Printer that writes moduli as |x|."""

    def _print_Abs(self, expr: sympy.Abs) -> str:
        return f"|{self._print(expr.args[0])}|"


def _shown(margin: Any) -> str:
    return cut(_Printer().doprint(margin))


def _sentence(node: Any) -> str:
    needed: Need | None = need(node)
    return f"{short(node)} is not real and finite" + (
        f"; it requires {_shown(needed.margin)} {needed.relation}" if needed else ""
    )


def losses(mechanism: MechanismStatement, residual: Iterable[Any], linearised: Iterable[Any]) -> list[str]:
    """Return one sentence per parameter or series that the residual contains but M, C, K and d do not."""
    linear = _names(mechanism, linearised)
    return [_ignored(name) for name in _names(mechanism, residual) if name not in linear]


def switched(mechanism: MechanismStatement) -> list[str]:
    """Return one sentence per step or kink that the vibration may cross."""
    return [_one_sided(function) for function in _steps(mechanism, _energies(mechanism))]


def idle(mechanism: MechanismStatement, results: Iterable[Any]) -> list[str]:
    """Return one sentence per parameter or series that the energies contain but no result does."""
    used = _names(mechanism, results)
    return [_idle(name) for name in _names(mechanism, _energies(mechanism)) if name not in used]


def _energies(mechanism: MechanismStatement) -> list[Any]:
    works = [part for work in mechanism.forces for part in work]
    stated = (mechanism.kinetic, mechanism.potential, mechanism.dissipation, *works)
    return [counted(sympy.sympify(expression)) for expression in stated]


def _ignored(name: str) -> str:
    return f"{name} is in the energies but not in the linearised equations; linear results ignore it"


def _idle(name: str) -> str:
    return f"{name} is in the energies but has no effect: no equation of motion and no output contains it"


def _one_sided(function: Any) -> str:
    return (
        f"{short(function)} is in the energies; linear results use its slope at the fundamental motion and "
        "ignore steps and kinks that the vibration crosses"
    )


def _names(mechanism: MechanismStatement, expressions: Iterable[Any]) -> list[str]:
    """Names of the parameters and series in the expressions, in the order of declaration."""
    combined = sympy.Tuple(*expressions)
    symbols, series = combined.free_symbols, {type(part) for part in combined.atoms(PeriodicFunction)}
    parameters = [declared.symbol for declared in mechanism.declared_parameters]
    names = [symbol.name for symbol in parameters if symbol in symbols]
    return names + [declared.__name__ for declared in mechanism.declared_series if declared in series]


def _steps(mechanism: MechanismStatement, energies: Iterable[Any]) -> list[Any]:
    """Steps and kinks that depend on coordinates or their rates."""
    moving = {
        s
        for coordinate in mechanism.declared_coordinates
        for s in (coordinate.symbol, coordinate.symbol.rate)
    }
    nodes = dict.fromkeys(node for energy in energies for node in outermost(energy))
    return sorted((node for node in nodes if switches(node, moving)), key=sympy.default_sort_key)
