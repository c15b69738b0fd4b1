"""Test whether a list of instructions is periodic in the phase with period T, by exact rules for each
operation.

If φ changes to φ + T, every intermediate value v changes to v + a + bπ with rational numbers a and b, or to
−v, or its change is unknown. The rules follow from

    sin(x + 2πk) = sin x, sin(x + π + 2πk) = −sin x, likewise for cos, tan(x + πk) = tan x, (−v)² = v²,

and c(v + a + bπ) = cv + ca + cbπ for rational c, because the constants of the code are exact doubles. The
result of any other operation has the period T if its operands have the period T. The rules hold for real
functions; they prove the period wherever the operations are defined."""

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction

import casadi

from solve.proof.balls import Ball, arb
from solve.proof.instructions import Instructions


@dataclass(frozen=True)
class Shift:
    """Change of a variable from v to v + a + bπ."""

    a: Fraction = Fraction(0)
    b: Fraction = Fraction(0)

    def times(self, factor: Fraction) -> "Shift":
        return Shift(self.a * factor, self.b * factor)

    def plus(self, other: "Shift") -> "Shift":
        return Shift(self.a + other.a, self.b + other.b)


PERIODIC, FLIPPED = Shift(), "flipped"
Change = Shift | str | None
"""Type of the change of a value over a period: a shift, a change of sign, or an unknown change (None)."""


def repeats(instructions: Instructions, period: Fraction) -> bool:
    """Whether all outputs have the period `period`·π in the first input. The other inputs must be constants
    or functions with this period."""
    work: list[tuple[Change, Fraction | None]] = [(None, None)] * instructions.storage
    for operation, positions, result, constant in instructions.lines:
        operands = [work[place] for place in positions] if operation != casadi.OP_INPUT else []
        if operation == casadi.OP_OUTPUT:
            if operands[0][0] != PERIODIC:
                return False
        elif operation == casadi.OP_CONST:
            work[result] = PERIODIC, _rational(constant)
        elif operation == casadi.OP_INPUT:
            work[result] = (Shift(b=period) if positions[0] == 0 else PERIODIC), None
        else:
            work[result] = _changed(operation, operands), None
    return True


def _rational(x: Ball) -> Fraction | None:
    if not isinstance(x, arb) or not x.is_exact() or not x.is_finite():
        return None
    mantissa, exponent = (int(part) for part in x.man_exp())
    return mantissa * Fraction(2) ** exponent


def _changed(operation: int, operands: list[tuple[Change, Fraction | None]]) -> Change:
    changes, constants = [change for change, _ in operands], [constant for _, constant in operands]
    if all(change == PERIODIC for change in changes):
        return PERIODIC
    rule = _RULES.get(operation)
    return None if rule is None or None in changes else rule(changes, constants)


def _sum(sign: int) -> Callable[..., Change]:
    def rule(changes: list[Change], constants: list[Fraction | None]) -> Change:
        first, second = changes
        if isinstance(first, Shift) and isinstance(second, Shift):
            return first.plus(second.times(Fraction(sign)))
        return FLIPPED if first == second == FLIPPED else None

    return rule


def _product(changes: list[Change], constants: list[Fraction | None]) -> Change:
    first, second = changes
    if FLIPPED in changes:
        other = second if first == FLIPPED else first
        return PERIODIC if other == FLIPPED else FLIPPED if other == PERIODIC else None
    for shift, factor in ((first, constants[1]), (second, constants[0])):
        if factor is not None and isinstance(shift, Shift):
            return shift.times(factor)
    return None


def _quotient(changes: list[Change], constants: list[Fraction | None]) -> Change:
    divisor = constants[1]
    return _product(changes, [None, 1 / divisor if divisor else None])


def _scaled(factor: int) -> Callable[..., Change]:
    return lambda changes, constants: (
        changes[0].times(Fraction(factor)) if isinstance(changes[0], Shift) else FLIPPED
    )


def _wave(changes: list[Change], constants: list[Fraction | None]) -> Change:
    """Rule for sin and cos. The result does not change if the argument shifts by a multiple of 2π, and
    changes sign if it shifts by an odd multiple of π."""
    (shift,) = changes
    if not isinstance(shift, Shift) or shift.a or shift.b.denominator > 1:
        return None
    return FLIPPED if shift.b % 2 else PERIODIC


def _odd(changes: list[Change], constants: list[Fraction | None]) -> Change:
    return FLIPPED if changes == [FLIPPED] else None


def _even(changes: list[Change], constants: list[Fraction | None]) -> Change:
    return PERIODIC if changes == [FLIPPED] else None


def _sine(changes: list[Change], constants: list[Fraction | None]) -> Change:
    return FLIPPED if changes == [FLIPPED] else _wave(changes, constants)


def _cosine(changes: list[Change], constants: list[Fraction | None]) -> Change:
    return PERIODIC if changes == [FLIPPED] else _wave(changes, constants)


def _tangent(changes: list[Change], constants: list[Fraction | None]) -> Change:
    return FLIPPED if changes == [FLIPPED] else PERIODIC if _wave(changes, constants) else None


_RULES: dict[int, Callable[..., Change]] = {
    casadi.OP_ASSIGN: lambda changes, constants: changes[0],
    casadi.OP_ADD: _sum(1),
    casadi.OP_SUB: _sum(-1),
    casadi.OP_MUL: _product,
    casadi.OP_DIV: _quotient,
    casadi.OP_NEG: _scaled(-1),
    casadi.OP_TWICE: _scaled(2),
    casadi.OP_SQ: _even,
    casadi.OP_FABS: _even,
    casadi.OP_INV: _odd,
    casadi.OP_SIN: _sine,
    casadi.OP_COS: _cosine,
    casadi.OP_TAN: _tangent,
    casadi.OP_ASIN: _odd,
    casadi.OP_ATAN: _odd,
    casadi.OP_SINH: _odd,
    casadi.OP_TANH: _odd,
    casadi.OP_SIGN: _odd,
}
"""Mapping from operations to their rules, for operands that change."""
