"""Functions that switch (steps, kinks, pieces): their derivatives beside the switches, and what jumps there.

The derivative of a jump is an impulse, which neither matrices nor forces can hold. Derivatives are
therefore taken beside the switches, and refused where what is differentiated jumps.
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
"""How far beside a switch its sides are looked at."""

_SCAN = sorted([k / 45 for k in range(-316, 317)] + [s * 10.0**k for k in range(-6, 7) for s in (-1, 1)])
"""Where a switch is looked for along a symbol."""

_STEPS = {
    "Heaviside": lambda x, _=None: int(x > 0),
    "sign": lambda x: (x > 0) - (x < 0),
    "Wrapped": lambda x, turn: x % turn,
}
_AWAY = mpmath.mpf("0.1")
"""How far from a switch the size of an expression is looked at."""

_JUMP = 1e-9
"""Difference between both sides, relative to the size, that counts as a jump."""


class Wrapped(sympy.Function):
    """An angle less whole turns: from 0 to `turn`."""

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
    """The angle less whole turns: from 0 to `turn` (rad)."""
    return Wrapped(sympy.sympify(angle), sympy.sympify(turn))


def rectangle(angle: Any, start: Any, end: Any) -> Any:
    """1 where the angle is between start and end (rad), whole turns aside, else 0."""
    return sympy.Heaviside(end - start - wrapped(angle - start))


def trapezoid(angle: Any, start: Any, full: Any, falling: Any, end: Any) -> Any:
    """0 but between start and end (rad), whole turns aside: rising to 1 at `full`, falling from `falling`."""
    inside, Max = wrapped(angle - start), sympy.Max

    def ramp(low: Any, high: Any) -> Any:
        return (Max(0, inside - low) - Max(0, inside - high)) / (high - low)

    return ramp(sympy.S.Zero, full - start) - ramp(falling - start, end - start)


STEPPING = (sympy.Piecewise, sympy.Heaviside, sympy.sign, sympy.Abs, sympy.Max, sympy.Min)


def switches(expression: Any, by: Iterable[Any]) -> list[Any]:
    """Expressions that depend on some of the symbols, and where one of which is zero the given expression
    jumps or has a kink."""
    moving, found = set(by), set()
    for node in sympy.preorder_traversal(expression):
        found |= {g for g in _switching(node) if g.free_symbols & moving and -g not in found}
    return sorted(found, key=sympy.default_sort_key)


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
    """Expression that is zero where a wrapped angle jumps."""
    angle, turn = node.args
    return sympy.sin(sympy.pi * angle / turn)


def place_of(switch: Any, expressions: Iterable[Any]) -> str:
    """Text that states where a switch of expressions lies."""
    for node in set().union(*(each.atoms(Wrapped) for each in expressions)):
        if _whole_turns(node) in (switch, -switch):
            angle, turn = node.args
            return f"{short(angle)} = 0 modulo {short(turn)}"
    return f"{short(switch)} = 0"


def outermost(expression: Any) -> list[Any]:
    """Steps, kinks and pieces of an expression, none within another."""
    if isinstance(expression, STEPPING):
        return [expression]
    return list(dict.fromkeys(node for part in expression.args for node in outermost(part)))


def slope(expression: Any, by: Any) -> Any:
    """Derivative by a symbol beside the switches. Raises ImpulseError where the expression jumps as the
    symbol passes one."""
    require_no_jump(expression, (by,))
    return beside(known_real(sympy.sympify(expression)).diff(by))


def known_real(expression: Any) -> Any:
    """Modulus and sign of what SymPy does not know to be real, such as a root, by steps and kinks whose
    derivatives it knows."""
    moduli, signs = (
        {part: part.args[0] for part in expression.atoms(kind) if part.args[0].is_extended_real is None}
        for kind in (sympy.Abs, sympy.sign)
    )
    known = {part: sympy.Max(inner, -inner) for part, inner in moduli.items()}
    return expression.xreplace(known | {part: 2 * sympy.Heaviside(x) - 1 for part, x in signs.items()})


def beside(derivative: Any) -> Any:
    """A derivative without what is zero beside the switches; powers of a step are the step."""
    if not derivative.has(sympy.DiracDelta, sympy.Heaviside):
        return derivative
    without = derivative.replace(sympy.DiracDelta, lambda *_: sympy.S.Zero)
    return without.replace(
        lambda part: isinstance(part, sympy.Pow) and isinstance(part.base, sympy.Heaviside) and part.exp > 0,
        lambda part: part.base,
    )


def require_no_jump(expression: Any, by: Sequence[Any]) -> None:
    """Raise ImpulseError where the expression jumps as one of the symbols passes a switch."""
    for switch in switches(expression, by):
        moving = next(symbol for symbol in by if symbol in switch.free_symbols)
        if jumps([expression], switch, moving):
            raise ImpulseError(
                f"{short(expression)} jumps where {place_of(switch, [expression])}, so its derivative with "
                f"respect to {moving} is an impulse there; V and forces may jump with the phase; T and "
                "displacements may only have kinks, and so may V as a function of coordinates",
                switch,
            )


def jumps(expressions: Sequence[Any], switch: Any, moving: Any) -> bool:
    """Whether some of the expressions jump where the switch is zero, as the symbol passes there."""
    symbols = in_order(*expressions, switch)
    values = Numbers(expressions, symbols)

    def at(place: Mapping[Any, Any], side: Any) -> list[Any] | None:
        with mpmath.workdps(_DIGITS):
            return values({**place, moving: place[moving] + side})

    return any(
        differ(*(at(place, side) for side in (-BESIDE, BESIDE, -_AWAY, _AWAY)))
        for place in places(switch, moving, symbols)
    )


def places(switch: Any, moving: Any, symbols: Sequence[Any]) -> Iterator[dict[Any, Any]]:
    """Values of all symbols for which the switch is zero, found along one of them."""
    for point, roots in zip(arbitrary_points(symbols), _roots(switch, moving), strict=True):
        for root in roots:
            yield {**point, moving: root}


def in_order(*expressions: Any) -> list[Any]:
    """The symbols of expressions."""
    symbols = set().union(*(each.free_symbols for each in expressions))
    return sorted(symbols, key=lambda symbol: (len(symbol.name), symbol.name))


class Numbers:
    """Values of expressions; None where one has none."""

    def __init__(self, expressions: Iterable[Any], symbols: Sequence[Any], exact: bool = True):
        """exact: to many digits, else in floating point, which is quicker."""
        self._symbols, self._kind = symbols, mpmath.mpf if exact else float
        made = [_stood_in(sympy.sympify(each)) for each in expressions]
        self._undefined = any(each.has(sympy.zoo, sympy.nan) for each in made)
        if self._undefined:
            return
        modules = [_STEPS, "mpmath" if exact else "math"]
        # By dummies: a symbol may be called like a function.
        self._function = sympy.lambdify(symbols, made, modules, dummify=True)

    def __call__(self, point: Mapping[Any, Any]) -> list[Any] | None:
        """At values of all symbols."""
        if self._undefined:
            return None
        with mpmath.workdps(_DIGITS):
            try:
                return self._function(*(self._kind(point[symbol]) for symbol in self._symbols))
            except (ZeroDivisionError, ValueError, TypeError, OverflowError):
                return None


def differ(one: list[Any] | None, other: list[Any] | None, *alike: list[Any] | None) -> bool:
    """Whether numbers on both sides are apart, by the size of these and of others alike."""
    if one is None or other is None:
        return False
    size = max(abs(x) for numbers in (one, other, *alike) for x in numbers or [0])
    return any(abs(a - b) > _JUMP * size for a, b in zip(one, other, strict=True))


def arbitrary_points(symbols: Sequence[Any]) -> list[dict[Any, Any]]:
    """Values between 0.3 and 1.7 for symbols, each by its name: rising with it, falling, and mixed."""

    def share(name: str) -> float:
        return sum(ord(letter) % 128 * 128.0 ** -(k + 1) for k, letter in enumerate(name))

    rising = {symbol: 0.3 + 1.4 * share(symbol.name) for symbol in symbols}
    falling = {symbol: 2 - value for symbol, value in rising.items()}
    mixed = {symbol: 0.3 + 1.4 * crc32(symbol.name.encode()) / 2**32 for symbol in symbols}
    return [rising, falling, mixed]


@lru_cache(maxsize=256)
def _roots(switch: Any, moving: Any) -> list[list[Any]]:
    """Where the sign changes along a symbol, for each of the arbitrary points."""
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
    """The sign of a switch along a symbol."""

    def __init__(self, switch: Any, point: Mapping[Any, Any], moving: Any, exact: bool = True):
        symbols = in_order(switch)
        self._numbers, self._point, self._moving = Numbers([switch], symbols, exact), point, moving

    def __call__(self, x: Any) -> int | None:
        found = self._numbers({**self._point, self._moving: x})
        return None if found is None or found[0].imag != 0 else (found[0] > 0) - (found[0] < 0)

    def narrowed(self, low: Any, high: Any, halvings: int) -> tuple[Any, Any]:
        """Ends between which the sign changes."""
        first = self(low)
        for _ in range(halvings):
            middle = (low + high) / 2
            low, high = (middle, high) if self(middle) == first else (low, middle)
        return low, high


def is_own(part: Any) -> bool:
    """Whether an expression is a function that derive defines, series and unknowns of loops."""
    known = isinstance(part, Wrapped) or type(part).__module__.startswith("sympy.")
    return isinstance(part, sympy.Function) and not known


def _stood_in(expression: Any) -> Any:
    """Functions of derive's own, which are smooth, stood in for by smooth ones."""

    return expression.replace(
        is_own, lambda part: sympy.sin(sympy.Add(*part.args) + len(type(part).__name__))
    )
