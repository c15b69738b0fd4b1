"""Steps and kinks in the coordinates: existence of tangents at the fundamental motion.

The fundamental motion may keep clear of a switch g(φ, q, q̇) of the residual (a clearance), pass it at some
phases, or lie on it throughout (friction at rest, contact without clearance).
"""

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import sympy
from sympy.core.relational import Relational

from derive.declarations import Condition
from derive.domains import Signs, substituted
from derive.errors import ExpansionError
from derive.pieces import at_rest, is_finite, margin_of
from derive.switches import (
    BESIDE,
    Numbers,
    arbitrary_points,
    differ,
    in_order,
    jumps,
    place_of,
    places,
    switches,
)
from derive.symbols import PHASE
from derive.units import short

SMOOTHED = "smooth it by a velocity v0, a parameter: v/sqrt(v**2 + v0**2) in place of sign(v)"


def require_tangents(residual: sympy.Matrix, jacobian: sympy.Matrix, moving: Sequence[Any]) -> None:
    """Raise ExpansionError if a switch leaves the residual without a tangent at the fundamental motion.

    jacobian: derivatives of the residual with respect to all moving symbols, away from the switches.
    """
    for switch in switches(residual, moving):
        at_rest = substituted(switch, resting(moving))
        if vanishes(at_rest):
            parts, where = [*residual, *jacobian], f"{short(switch)} is 0 all along it"
        elif PHASE in at_rest.free_symbols:
            parts, where = [*residual], f"it passes {place_of(switch, [*residual])}"
        else:
            continue
        if _apart(parts, at_rest, moving):
            coordinates = {
                symbol for symbol in moving if symbol.rate in moving and symbol.rate.rate in moving
            }
            remedy = "give it a clearance or a preload, or smooth it"
            if not switch.free_symbols & coordinates:
                remedy = SMOOTHED
            raise ExpansionError(
                f"there is no linearisation at the fundamental motion: {where}, where forces jump with the "
                f"coordinates, or their slope does; {remedy}",
                switch,
            )


def open_clearances(
    residual: sympy.Matrix, jacobian: sympy.Matrix, moving: Sequence[Any], signs: Signs
) -> Iterator[Condition]:
    """Conditions on parameters: no clearance is exactly zero in the fundamental motion if slopes differ
    there."""
    rest = resting(moving)
    parts: list[Any] = [*residual, *jacobian]
    values = [substituted(part, rest) for part in parts]
    pairs = zip(parts, values, strict=True)
    linear = [value if is_finite(value) else at_rest(part, rest, signs)[0] for part, value in pairs]
    for switch in switches(residual, moving):
        still = substituted(switch, rest)
        held = in_order(still)
        if held and PHASE not in held and any(jumps(linear, still, symbol) for symbol in held):
            meaning = (
                f"the equations have no linearisation where {short(switch)} = 0 in the fundamental motion"
            )
            names = tuple(symbol.name for symbol in held)
            shown = -still if still.could_extract_minus_sign() else still
            yield Condition(f"{short(shown)} other than 0", meaning, sympy.Abs(still), names)


def at_desired_motion(matrix: Any, moving: Sequence[Any], signs: Signs | None = None) -> Any:
    """Matrix evaluated with all moving symbols zero. At switches that are zero there, either side gives the
    same value. Singular pieces are assumed inactive, see `inactive`."""
    rest = resting(moving)
    at_switch = [
        node
        for node in matrix.atoms(sympy.Heaviside, sympy.sign, Relational)
        if _argument(node).free_symbols & {*moving} and vanishes(substituted(_argument(node), rest))
    ]
    beside = matrix.xreplace({node: _chosen(node, moving) for node in at_switch})
    made = beside.applyfunc(lambda entry: substituted(entry, rest))
    return made if is_finite(made) else beside.applyfunc(lambda entry: at_rest(entry, rest, signs or {})[0])


def inactive(parts: Iterable[Any], moving: Sequence[Any], signs: Signs) -> Iterator[Condition]:
    """Conditions that pieces which are singular in the fundamental motion, such as those of a contact, are
    inactive there. Signs of parameters that guarantee this make a condition unnecessary."""
    rest = resting(moving)
    for part in parts:
        if is_finite(substituted(part, rest)):
            continue
        for condition in at_rest(part, rest, signs)[1]:
            margin = margin_of(condition)
            if margin is None or margin.xreplace(dict(signs)).is_positive:
                continue
            names = tuple(symbol.name for symbol in in_order(margin))
            meaning = "a piece of the equations without a tangent is active in the fundamental motion"
            yield Condition(f"{short(margin)} > 0", meaning, margin, names)


def resting(moving: Sequence[Any]) -> dict[Any, Any]:
    """Substitution of zero for all moving symbols."""
    return dict.fromkeys(moving, sympy.S.Zero)


def vanishes(expression: Any) -> bool:
    """Whether an expression is identically zero."""
    symbols = in_order(expression)
    numbers = Numbers([expression], symbols)
    found = [numbers(point) for point in arbitrary_points(symbols)]
    return all(each is not None and abs(each[0]) < 1e-40 for each in found)


def _apart(parts: Sequence[Any], at_rest: Any, moving: Sequence[Any]) -> bool:
    """Whether the parts differ between states on both sides of the fundamental motion, where the switch is
    zero there."""
    symbols = in_order(*parts, at_rest, *moving)
    numbers, side = Numbers(parts, symbols), _beside(moving)
    other = {symbol: -value for symbol, value in side.items()}
    along = arbitrary_points(symbols) if vanishes(at_rest) else places(at_rest, PHASE, symbols)
    return any(
        differ(numbers({**place, **side}), numbers({**place, **other}), numbers(place)) for place in along
    )


def _beside(moving: Sequence[Any]) -> dict[Any, Any]:
    """State close to the fundamental motion."""
    (point, *_) = arbitrary_points(moving)
    return {symbol: value * BESIDE for symbol, value in point.items()}


def _chosen(node: Any, moving: Sequence[Any]) -> Any:
    """Value of a step close to the fundamental motion."""
    argument = _argument(node)
    symbols = in_order(argument, *moving)
    numbers = Numbers([argument], symbols)({**arbitrary_points(symbols)[0], **_beside(moving)})
    if numbers is None or numbers[0] == 0:
        return node
    sign = 1 if numbers[0] > 0 else -1
    if isinstance(node, Relational):
        return sympy.true if node.func(sign, 0) else sympy.false
    return sympy.Integer(sign) if isinstance(node, sympy.sign) else sympy.Integer((1 + sign) // 2)


def _argument(node: Any) -> Any:
    first, *others = node.args
    return first - others[0] if isinstance(node, Relational) else first
