"""Steps and kinks of the equations: their phases, and the existence of a linearisation at the fundamental
motion.

The fundamental motion may stay away from a switch g(φ, q, q̇) = 0 of the residual (a clearance), pass it at
some phases, or remain on it (friction at rest, contact without clearance).

The phases (`BREAKS` of a generated module) are zeros of switches that depend on the phase. Such a switch has
the form A cos(aφ+b) + B sin(aφ+b) + c, or is an angle modulo a period; its zeros are known in closed form.
For nested switches the zeros of all branches are included; superfluous phases do no harm.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import sympy
from sympy.core.relational import Relational

from derive.declarations import Condition
from derive.domains import Signs, is_finite, margin_of, substituted, value_at_rest
from derive.errors import ExpansionError, UnsupportedExpressionError
from derive.printer import CasadiPrinter
from derive.switches import (
    BESIDE,
    STEPPING,
    Numbers,
    Wrapped,
    arbitrary_points,
    in_order,
    jumps,
    outermost,
    sides_differ,
    switch_location,
    switches,
    zeros_of,
)
from derive.symbols import PHASE, SPEED, Moving
from derive.units import short

SMOOTHED = "smooth it by a velocity v0, a parameter: v/sqrt(v**2 + v0**2) in place of sign(v)"


def require_tangents(residual: sympy.Matrix, jacobian: sympy.Matrix, moving: Sequence[Any]) -> None:
    """Raise ExpansionError if a switch makes the residual nondifferentiable at the fundamental motion.

    jacobian: derivatives of the residual with respect to all time-varying symbols, away from the switches.
    """
    for switch in switches(residual, moving):
        resting_value = substituted(switch, resting(moving))
        if vanishes(resting_value):
            parts, where = [*residual, *jacobian], f"{short(switch)} is 0 during the whole motion"
        elif PHASE in resting_value.free_symbols:
            parts, where = [*residual], f"it passes {switch_location(switch, [*residual])}"
        else:
            continue
        if _is_discontinuous(parts, resting_value, moving):
            coordinates = {
                symbol for symbol in moving if symbol.rate in moving and symbol.rate.rate in moving
            }
            remedy = "give it a clearance or a preload, or smooth it"
            if not switch.free_symbols & coordinates:
                remedy = SMOOTHED
            raise ExpansionError(
                f"there is no linearisation at the fundamental motion: {where}, where forces or their "
                f"slopes are discontinuous in the coordinates; {remedy}",
                switch,
            )


def open_clearances(
    residual: sympy.Matrix, jacobian: sympy.Matrix, moving: Sequence[Any], signs: Signs
) -> Iterator[Condition]:
    """Yield conditions on parameters under which clearances are not exactly zero.

    Clearances with the same slope on both sides of the switch are omitted.
    """
    rest = resting(moving)
    parts: list[Any] = [*residual, *jacobian]
    values = [substituted(part, rest) for part in parts]
    pairs = zip(parts, values, strict=True)
    linear = [value if is_finite(value) else value_at_rest(part, rest, signs)[0] for part, value in pairs]
    for switch in switches(residual, moving):
        clearance = substituted(switch, rest)
        symbols = in_order(clearance)
        if symbols and PHASE not in symbols and any(jumps(linear, clearance, symbol) for symbol in symbols):
            meaning = (
                f"the equations have no linearisation where {short(switch)} = 0 in the fundamental motion"
            )
            names = tuple(symbol.name for symbol in symbols)
            shown = -clearance if clearance.could_extract_minus_sign() else clearance
            yield Condition(f"{short(shown)} other than 0", meaning, sympy.Abs(clearance), names)


def at_fundamental_motion(matrix: Any, moving: Sequence[Any], signs: Signs | None = None) -> Any:
    """Matrix with zero substituted for all time-varying symbols.

    At a switch that is zero in the fundamental motion, the values on the two sides must be equal. Singular
    pieces are assumed to be inactive; see `inactive`.
    """
    rest = resting(moving)
    at_switch = [
        node
        for node in matrix.atoms(sympy.Heaviside, sympy.sign, Relational)
        if _argument(node).free_symbols & {*moving} and vanishes(substituted(_argument(node), rest))
    ]
    beside = matrix.xreplace({node: _chosen(node, moving) for node in at_switch})
    value = beside.applyfunc(lambda entry: substituted(entry, rest))
    if is_finite(value):
        return value
    return beside.applyfunc(lambda entry: value_at_rest(entry, rest, signs or {})[0])


def inactive(parts: Iterable[Any], moving: Sequence[Any], signs: Signs) -> Iterator[Condition]:
    """Yield conditions under which pieces that would be singular in the fundamental motion are inactive.

    Conditions that follow from the signs of the parameters are omitted.
    """
    rest = resting(moving)
    for part in parts:
        if is_finite(substituted(part, rest)):
            continue
        for condition in value_at_rest(part, rest, signs)[1]:
            margin = margin_of(condition)
            if margin is None or margin.xreplace(dict(signs)).is_positive:
                continue
            names = tuple(symbol.name for symbol in in_order(margin))
            meaning = "a nondifferentiable piece of the equations is active in the fundamental motion"
            yield Condition(f"{short(margin)} > 0", meaning, margin, names)


def resting(moving: Sequence[Any]) -> dict[Any, Any]:
    """Substitution of zero for all time-varying symbols."""
    return dict.fromkeys(moving, sympy.S.Zero)


def vanishes(expression: Any) -> bool:
    """Whether an expression is identically zero."""
    symbols = in_order(expression)
    numbers = Numbers([expression], symbols)
    values = [numbers(point) for point in arbitrary_points(symbols)]
    return all(value is not None and abs(value[0]) < 1e-40 for value in values)


def _is_discontinuous(parts: Sequence[Any], resting_value: Any, moving: Sequence[Any]) -> bool:
    """Whether the values of the expressions on the two sides of the fundamental motion differ, at zeros of
    the switch."""
    symbols = in_order(*parts, resting_value, *moving)
    numbers, side = Numbers(parts, symbols), _beside(moving)
    other = {symbol: -value for symbol, value in side.items()}
    along = arbitrary_points(symbols) if vanishes(resting_value) else zeros_of(resting_value, PHASE, symbols)
    return any(
        sides_differ(numbers({**place, **side}), numbers({**place, **other}), numbers(place))
        for place in along
    )


def _beside(moving: Sequence[Any]) -> dict[Any, Any]:
    """Arbitrary small values of the symbols that are zero on the fundamental motion."""
    (point, *_) = arbitrary_points(moving)
    return {symbol: value * BESIDE for symbol, value in point.items()}


def _chosen(node: Any, moving: Sequence[Any]) -> Any:
    """Value of a step or kink close to the fundamental motion."""
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


PASSES = '''\
def _passes(known):
    """Phases from 0 to PERIOD at which slope*phase + offset equals a target plus a multiple of turn. Empty if
    one of these values is not a number, for example on an inactive branch."""
    phases = []
    try:
        slope, offset, targets, turn = known()
        targets = [float(target) for target in targets]
    except (TypeError, ValueError, ZeroDivisionError):
        return phases
    for target in targets if slope else ():
        first, last = sorted(((offset - target)/turn, (slope*PERIOD + offset - target)/turn))
        if last - first > 10000:
            raise ValueError(f"there are {last - first:.3g} jumps per period; allowed: up to 10000")
        turns = range(math.floor(first), math.ceil(last) + 1)
        phases += [(target + k*turn - offset)/slope for k in turns]
    return [phase for phase in phases if 0 <= phase < PERIOD]'''
ANGLES = '''\
def _angles(cosine, sine, rest):
    """Angles x at which cosine*cos(x) + sine*sin(x) + rest is zero."""
    size = math.hypot(cosine, sine)
    if abs(rest) > size or size == 0:
        return ()
    middle, half = math.atan2(sine, cosine), math.acos(-rest/size)
    return (middle - half, middle + half)'''


class MathPrinter(CasadiPrinter):
    """Printer that writes functions with the prefix `math.`."""

    def doprint(self, expr: Any, assign_to: Any = None) -> str:
        return super().doprint(expr, assign_to).replace("casadi.", "math.")


@dataclass(frozen=True)
class Passage:
    """Set of phases at which slope · φ + offset equals a target modulo `turn`.

    targets: source code of a tuple of expressions, or of a call of _angles.
    """

    slope: Any
    offset: Any
    targets: str
    turn: Any
    symbols: frozenset[Any]

    @property
    def text(self) -> str:
        slope, offset, turn = (MathPrinter().doprint(each) for each in (self.slope, self.offset, self.turn))
        return f"*_passes(lambda: ({slope}, {offset}, {self.targets}, {turn}))"


def passages(matrices: Iterable[Any], outputs: Iterable[Any], moving: Iterable[Any]) -> list[Passage]:
    """Return the phases at which switches change sign.

    The switches are those of the matrices, and those of the outputs that depend on neither the motion nor the
    speed. Raises UnsupportedExpressionError if the phase of a switch has no closed form.
    """
    rest = resting([*moving])
    by_text: dict[str, Passage] = {}
    for matrix in matrices:
        for switch in switches(matrix, (PHASE,)):
            by_text |= {passage.text: passage for passage in _passages(switch)}
    for output in outputs:
        for switch in switches(output, (PHASE,)):
            if not switch.free_symbols & {*rest, SPEED}:
                by_text |= {passage.text: passage for passage in _passages(switch)}
    return [by_text[text] for text in sorted(by_text)]


def _passages(switch: Any) -> Iterator[Passage]:
    for branch in _branches(switch):
        for factor in sympy.Mul.make_args(sympy.factor_terms(branch)):
            base = factor.base if isinstance(factor, sympy.Pow) else factor
            if PHASE in base.free_symbols:
                yield _passage(base, switch)


def _passage(zero: Any, switch: Any) -> Passage:
    """Phases of the zeros of a function that contains no switches."""
    zero = sympy.expand(zero)
    if SPEED not in zero.free_symbols:
        for wrapped in zero.atoms(Wrapped):
            angle, turn = wrapped.args
            value, factor = zero.coeff(wrapped, 0), zero.coeff(wrapped, 1)
            if sympy.expand(zero - value - factor * wrapped) == 0 and _free(value, factor, turn):
                targets = f"({MathPrinter().doprint(-value / factor)},)"
                return _linear(angle, targets, turn, zero, switch)
        for angle in {atom.args[0] for atom in zero.atoms(sympy.sin, sympy.cos)}:
            parts = [zero.coeff(function(angle), 1) for function in (sympy.cos, sympy.sin)]
            rest = sympy.expand(zero - parts[0] * sympy.cos(angle) - parts[1] * sympy.sin(angle))
            if _free(*parts, rest):
                targets = f"_angles({', '.join(map(MathPrinter().doprint, (*parts, rest)))})"
                return _linear(angle, targets, 2 * sympy.pi, zero, switch)
    raise _unknown(switch)


def _linear(angle: Any, targets: str, turn: Any, zero: Any, switch: Any) -> Passage:
    slope, offset = sympy.expand(angle).coeff(PHASE, 1), sympy.expand(angle).coeff(PHASE, 0)
    if not _free(slope, offset):
        raise _unknown(switch)
    return Passage(slope, offset, targets, turn, frozenset(zero.free_symbols - {PHASE}))


def _free(*expressions: Any) -> bool:
    return not any(expression.atoms(Moving) for expression in expressions)


def _unknown(switch: Any) -> UnsupportedExpressionError:
    return UnsupportedExpressionError(
        f"the phases where {short(switch)} = 0 cannot be determined; let steps and kinks depend on the "
        "phase only through sin or cos of an angle, or only through wrapped(angle), where the angle is "
        "a multiple of the phase plus a constant",
        switch,
    )


def _branches(switch: Any) -> Iterator[Any]:
    """Yield the expressions of a switch for all combinations of branches of the steps, kinks and piecewise
    functions within it."""
    nodes = outermost(switch)
    for chosen in product(*map(_alternatives, nodes)):
        branch = switch.xreplace(dict(zip(nodes, chosen, strict=True)))
        if not branch.has(*STEPPING):
            yield branch
        else:
            yield from _branches(branch)


def _alternatives(node: Any) -> list[Any]:
    if isinstance(node, sympy.Piecewise):
        return [argument.args[0] for argument in node.args]
    if isinstance(node, sympy.Max | sympy.Min):
        return list(node.args)
    if isinstance(node, sympy.Abs):
        return [node.args[0], -node.args[0]]
    return [sympy.S.One, sympy.S.Zero] if isinstance(node, sympy.Heaviside) else [sympy.S.One, -sympy.S.One]
