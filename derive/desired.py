"""Where the desired motion, and what is stated along it, is real and finite: what a generated module demands
of the phase, the speed and the parameters before its equations mean anything.

Roots and arccosines may cancel in the equations, which are then real where the motion is not.
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
from derive.mechanism import Mechanism
from derive.symbols import PHASE, SPEED, steady
from derive.units import cut, short


class Demand(NamedTuple):
    """Of what is stated a function, whose `margin` must satisfy `relation`, and both as texts."""

    what: str
    function: str
    margin_text: str
    relation: str
    margin: Any


def demands(mechanism: Mechanism) -> list[Demand]:
    """Those that the signs of the parameters do not ensure. Raises DeclarationError where one is never
    met."""
    signs, known = signs_of(mechanism.declared_parameters), _known(mechanism)
    found: dict[tuple[Any, str], Demand] = {}
    for what, expression, motion in _stated(mechanism):
        for node, needed in needs(in_desired_motion(mechanism, expression)):
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
    met = [Demand("what is stated", each.meaning, each.text, POSITIVE, each.margin) for each in stated]
    return [*found.values(), *met]


def conditions(mechanism: Mechanism) -> list[Condition]:
    """Those stated that hold or not whatever the speed is, in the desired motion."""
    return [each for each in _conditions(mechanism) if not each.margin.has(SPEED)]


def _conditions(mechanism: Mechanism) -> Iterator[Condition]:
    for each in mechanism.conditions:
        yield replace(each, margin=in_desired_motion(mechanism, each.margin))


def in_desired_motion(mechanism: Mechanism, expression: Any) -> Any:
    """The expression where every coordinate has its desired motion."""
    return at_desired_motion(steady(from_fundamental(mechanism, sympy.sympify(expression))))


def _stated(mechanism: Mechanism) -> Iterator[tuple[str, Any, bool]]:
    """What is stated along the desired motion, and whether it is the motion itself."""
    for symbol, motion in mechanism.fundamental_motion.items():
        yield f"the desired motion of {symbol}", motion, True
    for name in ("kinetic", "potential"):
        yield f"the {name} energy", getattr(mechanism, name), False
    yield "the dissipation", mechanism.dissipation, False
    for force, along in mechanism.forces:
        yield "a force", force, False
        yield "the displacement of a force", along, False


def _known(mechanism: Mechanism) -> set[Any]:
    options = {symbol for option in mechanism.declared_options for symbol in option.indicators}
    return {PHASE, SPEED, *options, *(each.symbol for each in mechanism.declared_parameters)}


class _Printer(StrPrinter):
    """Moduli as they are written by hand."""

    def _print_Abs(self, expr: sympy.Abs) -> str:
        return f"|{self._print(expr.args[0])}|"


def _shown(margin: Any) -> str:
    return cut(_Printer().doprint(margin))


def _sentence(node: Any) -> str:
    needed: Need | None = need(node)
    return f"{short(node)} is not real and finite" + (
        f"; it needs {_shown(needed.margin)} {needed.relation}" if needed else ""
    )
