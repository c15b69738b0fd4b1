"""Derivatives and discontinuities of functions with switches (steps, kinks and pieces).

The derivative of a discontinuous function contains an impulse, which matrices and forces cannot represent.
Differentiation of a discontinuous function therefore raises an error. Derivatives of other functions are
those on the two sides of a switch.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
from itertools import combinations, pairwise
from typing import Any
from zlib import crc32

import mpmath
import sympy
from sympy.core.relational import Relational

from derive.errors import ImpulseError
from derive.units import short

_DIGITS = 50
BESIDE = mpmath.mpf(10) ** -30
"""Distance from a switch at which its two sides are evaluated.

It is far above the round-off of `_DIGITS` digits and far below any change of a smooth function.
"""

_SCAN = sorted([k / 45 for k in range(-316, 317)] + [s * 10.0**k for k in range(-6, 7) for s in (-1, 1)])
"""Values of a symbol between which a sign change of a switch is sought: −7 … 7 in steps of 1/45, and powers
of ten."""

_STEPS = {
    "Heaviside": lambda x, _=None: int(x > 0),
    "sign": lambda x: (x > 0) - (x < 0),
    "Wrapped": lambda x, turn: x % turn,
}
_AWAY = mpmath.mpf("0.1")
"""Distance from a switch at which the magnitude of an expression is evaluated."""

_JUMP = 1e-9
"""Smallest relative difference between the two sides of a switch that counts as a discontinuity.

Across a distance of 2 `BESIDE`, a smooth function changes by about 1e-30. In the mechanisms of `models/`, the
smallest discontinuity is 0.04.
"""


class Wrapped(sympy.Function):
    """Function that returns an angle modulo `turn`."""

    nargs = 2
    is_real = True

    @classmethod
    def eval(cls, *args: Any) -> Any:
        angle, turn = args
        if angle.is_number:
            return angle - turn * sympy.floor(angle / turn)
        return None

    def fdiff(self, argindex: int = 1) -> sympy.Expr:
        return sympy.S.One

    def _sympystr(self, printer: Any) -> str:
        angle, turn = map(printer.doprint, self.args)
        return f"wrapped({angle})" if self.args[1] == 2 * sympy.pi else f"wrapped({angle}, {turn})"

    def _latex(self, printer: Any, exp: str | None = None) -> str:
        text = rf"\left({printer._print(self.args[0])} \bmod {printer._print(self.args[1])}\right)"
        return text if exp is None else rf"{text}^{{{exp}}}"


def wrapped(angle: Any, turn: Any = 2 * sympy.pi) -> Any:
    """Angle modulo `turn`.

    Parameters
    ----------
    angle : expression
        Angle, rad.
    turn : expression, default 2π
        Period, rad.

    Returns
    -------
    expression
        Angle between 0 and `turn`, rad.
    """
    return Wrapped(sympy.sympify(angle), sympy.sympify(turn))


def rectangle(angle: Any, start: Any, end: Any) -> Any:
    """Rectangular pulse of an angle modulo 2π.

    Parameters
    ----------
    angle : expression
        Angle, rad.
    start, end : expression
        Limits of the pulse, rad.

    Returns
    -------
    expression
        1 between `start` and `end`, otherwise 0.
    """
    return sympy.Heaviside(end - start - wrapped(angle - start))


def trapezoid(angle: Any, start: Any, full: Any, falling: Any, end: Any) -> Any:
    """Trapezoidal pulse of an angle modulo 2π.

    Parameters
    ----------
    angle : expression
        Angle, rad.
    start, full, falling, end : expression
        Corners of the pulse, rad: it rises from `start` to `full` and falls from `falling` to `end`.

    Returns
    -------
    expression
        1 between `full` and `falling`, 0 outside `start` and `end`.
    """
    inside, Max = wrapped(angle - start), sympy.Max

    def ramp(low: Any, high: Any) -> Any:
        return (Max(0, inside - low) - Max(0, inside - high)) / (high - low)

    return ramp(sympy.S.Zero, full - start) - ramp(falling - start, end - start)


STEPPING = (sympy.Piecewise, sympy.Heaviside, sympy.sign, sympy.Abs, sympy.Max, sympy.Min)


def switches(expression: Any, by: Iterable[Any]) -> list[Any]:
    """Return the switches of an expression: functions of the symbols `by` at whose zeros the expression may
    have a step or kink."""
    moving, zeros = set(by), set()
    for node in sympy.preorder_traversal(expression):
        zeros |= {g for g in _switching(node) if g.free_symbols & moving and -g not in zeros}
    return sorted(zeros, key=sympy.default_sort_key)


def _switching(node: Any) -> Iterator[Any]:
    args: Any = getattr(node, "args", ())
    if isinstance(node, sympy.Heaviside | sympy.sign | sympy.Abs):
        yield args[0]
    elif isinstance(node, sympy.Max | sympy.Min):
        yield from (a - b for a, b in combinations(args, 2))
    elif isinstance(node, Relational):
        yield args[0] - args[1]
    elif isinstance(node, Wrapped):
        yield _whole_turns(node)


def _whole_turns(node: Wrapped) -> Any:
    """Expression that is zero at the jumps of a wrapped angle."""
    angle, turn = node.args
    return sympy.sin(sympy.pi * angle / turn)


def switch_location(switch: Any, expressions: Iterable[Any]) -> str:
    """Return the condition under which a switch in the given expressions is zero, as text."""
    for node in set().union(*(expression.atoms(Wrapped) for expression in expressions)):
        if _whole_turns(node) in (switch, -switch):
            angle, turn = node.args
            return f"{short(angle)} = 0 modulo {short(turn)}"
    return f"{short(switch)} = 0"


def outermost(expression: Any) -> list[Any]:
    """Outermost steps, kinks and piecewise functions of an expression."""
    if isinstance(expression, STEPPING):
        return [expression]
    return list(dict.fromkeys(node for part in expression.args for node in outermost(part)))


def slope(expression: Any, by: Any) -> Any:
    """Derivative with respect to a symbol, next to the switches. Raises ImpulseError if the expression is
    discontinuous as a function of this symbol."""
    require_no_jump(expression, (by,))
    return beside(known_real(sympy.sympify(expression)).diff(by))


def known_real(expression: Any) -> Any:
    """Replace moduli and signs of possibly complex arguments by Max and Heaviside, which SymPy can
    differentiate."""
    moduli, signs = (
        {part: part.args[0] for part in expression.atoms(kind) if part.args[0].is_extended_real is None}
        for kind in (sympy.Abs, sympy.sign)
    )
    replaced = {part: sympy.Max(inner, -inner) for part, inner in moduli.items()}
    return expression.xreplace(replaced | {part: 2 * sympy.Heaviside(x) - 1 for part, x in signs.items()})


def beside(derivative: Any) -> Any:
    """Remove the terms of a derivative that vanish next to the switches, and replace powers of a step by the
    step."""
    if not derivative.has(sympy.DiracDelta, sympy.Heaviside):
        return derivative
    without = derivative.replace(sympy.DiracDelta, lambda *_: sympy.S.Zero)
    return without.replace(
        lambda part: isinstance(part, sympy.Pow) and isinstance(part.base, sympy.Heaviside) and part.exp > 0,
        lambda part: part.base,
    )


def require_no_jump(expression: Any, by: Sequence[Any]) -> None:
    """Raise ImpulseError if the expression is a discontinuous function of the symbols `by`."""
    for switch in switches(expression, by):
        moving = next(symbol for symbol in by if symbol in switch.free_symbols)
        if jumps([expression], switch, moving):
            raise ImpulseError(
                f"{short(expression)} is discontinuous where {switch_location(switch, [expression])}, so its "
                f"derivative with respect to {moving} is an impulse there; V and forces may be discontinuous "
                "in the phase; T, displacements, and V as a function of coordinates, may only have kinks",
                switch,
            )


def jumps(expressions: Sequence[Any], switch: Any, moving: Any) -> bool:
    """Whether one of the expressions, as a function of the symbol `moving`, is discontinuous at a zero of the
    switch."""
    symbols = in_order(*expressions, switch)
    values = Numbers(expressions, symbols)

    def at(place: Mapping[Any, Any], side: Any) -> list[Any] | None:
        with mpmath.workdps(_DIGITS):
            return values({**place, moving: place[moving] + side})

    return any(
        sides_differ(*(at(place, side) for side in (-BESIDE, BESIDE, -_AWAY, _AWAY)))
        for place in zeros_of(switch, moving, symbols)
    )


def zeros_of(switch: Any, moving: Any, symbols: Sequence[Any]) -> Iterator[dict[Any, Any]]:
    """Yield values of all symbols at which a switch is zero. The symbol `moving` is varied, and the others
    have arbitrary values."""
    for point, roots in zip(arbitrary_points(symbols), _roots(switch, moving), strict=True):
        for root in roots:
            yield {**point, moving: root}


def in_order(*expressions: Any) -> list[Any]:
    """Symbols of expressions, sorted by length of the name, then alphabetically."""
    symbols = set().union(*(expression.free_symbols for expression in expressions))
    return sorted(symbols, key=lambda symbol: (len(symbol.name), symbol.name))


class Numbers:
    """Function that returns the numerical values of expressions, or None if one of them is undefined."""

    def __init__(self, expressions: Iterable[Any], symbols: Sequence[Any], exact: bool = True):
        """exact: whether values are computed with `_DIGITS` digits, or in double precision, which is
        faster."""
        self._symbols, self._kind = symbols, mpmath.mpf if exact else float
        replaced = [_replace_own_functions(sympy.sympify(expression)) for expression in expressions]
        self._undefined = any(value.has(sympy.zoo, sympy.nan) for value in replaced)
        if self._undefined:
            return
        modules = [_STEPS, "mpmath" if exact else "math"]
        # Dummy symbols are used, because a symbol may have the same name as a function.
        self._function = sympy.lambdify(symbols, replaced, modules, dummify=True)

    def __call__(self, point: Mapping[Any, Any]) -> list[Any] | None:
        """Return the values of the expressions. `point` maps all symbols to their values."""
        if self._undefined:
            return None
        with mpmath.workdps(_DIGITS):
            try:
                return self._function(*(self._kind(point[symbol]) for symbol in self._symbols))
            except (ZeroDivisionError, ValueError, TypeError, OverflowError):
                return None


def sides_differ(one: list[Any] | None, other: list[Any] | None, *further: list[Any] | None) -> bool:
    """Whether values on the two sides of a switch differ, relative to the largest magnitude among them and
    the `further` values."""
    if one is None or other is None:
        return False
    size = max(abs(x) for numbers in (one, other, *further) for x in numbers or [0])
    return any(abs(a - b) > _JUMP * size for a, b in zip(one, other, strict=True))


def arbitrary_points(symbols: Sequence[Any]) -> list[dict[Any, Any]]:
    """Return three mappings from symbols to values between 0.3 and 1.7, which depend on the names only."""

    def share(name: str) -> float:
        return sum(ord(letter) % 128 * 128.0 ** -(k + 1) for k, letter in enumerate(name))

    rising = {symbol: 0.3 + 1.4 * share(symbol.name) for symbol in symbols}
    falling = {symbol: 2 - value for symbol, value in rising.items()}
    mixed = {symbol: 0.3 + 1.4 * crc32(symbol.name.encode()) / 2**32 for symbol in symbols}
    return [rising, falling, mixed]


@lru_cache(maxsize=256)
def _roots(switch: Any, moving: Any) -> list[list[Any]]:
    """Zeros of a switch as a function of the symbol `moving`, one list per set of arbitrary values of the
    other symbols."""
    return [list(_along(switch, point, moving)) for point in arbitrary_points(in_order(switch))]


def _along(switch: Any, point: Mapping[Any, Any], moving: Any) -> Iterator[Any]:
    quick, exact = (_Sign(switch, point, moving, exact) for exact in (False, True))
    signs = [quick(x) for x in _SCAN]
    for (low, first), (high, second) in pairwise(zip(_SCAN, signs, strict=True)):
        if first == 0:
            yield mpmath.mpf(low)
        elif first is not None and second is not None and second == -first:
            low, high = quick.narrowed(low, high, 46)
            with mpmath.workdps(_DIGITS):
                margin = 4 * (mpmath.mpf(high) - low) + mpmath.mpf(10) ** -14
                yield exact.narrowed(low - margin, high + margin, 90)[1]


class _Sign:
    """Sign of a switch as a function of one symbol."""

    def __init__(self, switch: Any, point: Mapping[Any, Any], moving: Any, exact: bool = True):
        symbols = in_order(switch)
        self._numbers, self._point, self._moving = Numbers([switch], symbols, exact), point, moving

    def __call__(self, x: Any) -> int | None:
        value = self._numbers({**self._point, self._moving: x})
        return None if value is None or value[0].imag != 0 else (value[0] > 0) - (value[0] < 0)

    def narrowed(self, low: Any, high: Any, halvings: int) -> tuple[Any, Any]:
        """Return a part of an interval that contains the change of sign, after a number of halvings."""
        first = self(low)
        for _ in range(halvings):
            middle = (low + high) / 2
            low, high = (middle, high) if self(middle) == first else (low, middle)
        return low, high


def is_derive_function(part: Any) -> bool:
    """Whether an expression is a series or an unknown of a loop."""
    foreign = isinstance(part, Wrapped) or type(part).__module__.startswith("sympy.")
    return isinstance(part, sympy.Function) and not foreign


def _replace_own_functions(expression: Any) -> Any:
    """Replace series and unknowns of loops by sines, so that the expression can be evaluated numerically."""
    return expression.replace(
        is_derive_function, lambda part: sympy.sin(sympy.Add(*part.args) + len(type(part).__name__))
    )
