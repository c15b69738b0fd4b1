"""Domain conditions of a generated module: where the fundamental motion and the energies and forces
along it are real and finite.

Roots and arccosines may cancel in the equations; these are then real where the motion is not.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import sympy
from sympy.printing.str import StrPrinter

from derive.declarations import Condition
from derive.domains import POSITIVE, Need, is_met, need, needs, signs_of
from derive.errors import DeclarationError
from derive.kinematics import LoopFunction, at_desired_motion
from derive.lagrange import from_fundamental
from derive.mechanism import MechanismStatement
from derive.symbols import PHASE, SPEED, steady
from derive.units import cut, short


class Demand(NamedTuple):
    """Domain condition of a function in the mechanism: `margin` must satisfy `relation`; both also as
    text."""

    what: str
    function: str
    margin_text: str
    relation: str
    margin: Any


def demands(mechanism: MechanismStatement) -> list[Demand]:
    """Conditions that the signs of the parameters do not guarantee. Raises DeclarationError if one can never
    hold."""
    signs, known = signs_of(mechanism.declared_parameters), _known(mechanism)
    found: dict[tuple[Any, str], Demand] = {}
    for what, expression, motion in _stated(mechanism):
        # A factor that is zero in the fundamental motion takes nothing from the domain of the others.
        for node, stated in needs(_about_fundamental(mechanism, expression)):
            needed = stated._replace(margin=at_desired_motion(stated.margin))
            if is_met(needed, signs) or not needed.margin.free_symbols <= known:
                continue
            if needed.margin.is_number and motion:
                raise DeclarationError(f"{what} does not exist: {_sentence(node)}")
            varies = needed.margin.has(PHASE, SPEED, LoopFunction)
            if varies or (motion and not needed.margin.is_number):
                own = need(node) or needed
                demand = Demand(what, short(node), _shown(own.margin), needed.relation, needed.margin)
                found.setdefault((needed.margin, needed.relation), demand)
    stated = [each for each in _conditions(mechanism) if each.margin.has(SPEED)]
    met = [
        Demand("a condition of the mechanism", each.meaning, each.text, POSITIVE, each.margin)
        for each in stated
    ]
    return [*found.values(), *met]


def conditions(mechanism: MechanismStatement) -> list[Condition]:
    """Declared conditions, evaluated in the fundamental motion, that do not depend on the speed."""
    return [each for each in _conditions(mechanism) if not each.margin.has(SPEED)]


def _conditions(mechanism: MechanismStatement) -> Iterator[Condition]:
    for each in mechanism.conditions:
        yield replace(each, margin=at_desired_motion(_about_fundamental(mechanism, each.margin)))


def _about_fundamental(mechanism: MechanismStatement, expression: Any) -> Any:
    """Expression with coordinates relative to the fundamental motion, at constant speed."""
    return steady(from_fundamental(mechanism, sympy.sympify(expression)))


def _stated(mechanism: MechanismStatement) -> Iterator[tuple[str, Any, bool]]:
    """Name and expression of everything evaluated along the fundamental motion, and whether it is the motion
    itself."""
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
    return {PHASE, SPEED, *options, *(each.symbol for each in mechanism.declared_parameters)}


class _Printer(StrPrinter):
    """Printer of moduli as |x|."""

    def _print_Abs(self, expr: sympy.Abs) -> str:
        return f"|{self._print(expr.args[0])}|"


def _shown(margin: Any) -> str:
    return cut(_Printer().doprint(margin))


def _sentence(node: Any) -> str:
    needed: Need | None = need(node)
    return f"{short(node)} is not real and finite" + (
        f"; it needs {_shown(needed.margin)} {needed.relation}" if needed else ""
    )
