"""Dimensions of units and expressions, and factors from units to SI."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from typing import Any, Protocol, runtime_checkable

import sympy
from sympy.core.relational import Relational

from derive.errors import UnitError

BASE = ("kg", "m", "s", "K", "A")


@dataclass(frozen=True)
class Dimension:
    """Physical dimension, as exponents of kg, m, s, K and A. The radian is dimensionless."""

    exponents: tuple[Fraction, ...]

    def __mul__(self, other: "Dimension") -> "Dimension":
        return Dimension(tuple(a + b for a, b in zip(self.exponents, other.exponents, strict=True)))

    def __pow__(self, power: Fraction | int) -> "Dimension":
        return Dimension(tuple(a * power for a in self.exponents))

    def __truediv__(self, other: "Dimension") -> "Dimension":
        return self * other**-1

    def __str__(self) -> str:
        above = [_factor(base, e) for base, e in zip(BASE, self.exponents, strict=True) if e > 0]
        below = ["/" + _factor(base, -e) for base, e in zip(BASE, self.exponents, strict=True) if e < 0]
        return (" ".join(above) or "1") + "".join(below)


def _factor(base: str, exponent: Fraction) -> str:
    return base if exponent == 1 else f"{base}^{exponent}"


def _of(*exponents: int) -> Dimension:
    return Dimension(tuple(Fraction(e) for e in exponents))


ONE = _of(0, 0, 0, 0, 0)
UNITS = {
    "1": ONE,
    "rad": ONE,
    "kg": _of(1, 0, 0, 0, 0),
    "m": _of(0, 1, 0, 0, 0),
    "s": _of(0, 0, 1, 0, 0),
    "K": _of(0, 0, 0, 1, 0),
    "A": _of(0, 0, 0, 0, 1),
    "Hz": _of(0, 0, -1, 0, 0),
    "N": _of(1, 1, -2, 0, 0),
    "Pa": _of(1, -1, -2, 0, 0),
    "J": _of(1, 2, -2, 0, 0),
    "W": _of(1, 2, -3, 0, 0),
}
_KINDS = ("[mass]", "[length]", "[time]", "[temperature]", "[current]")
SECOND = UNITS["s"]


_MAX_CHARACTERS = 80
"""Maximum length of a unit, and of an expression in a message: one line of a terminal with 80 columns."""

_COMPUTED = re.compile(r"(\*\*|\^)\s*(?!-?\d{1,2}(\.\d{1,2})?(?!\d|\.|\*\*|\^))")
"""Pattern of an invalid power. A valid power has at most two digits before the decimal point and two after
it."""


@runtime_checkable
class Composed(Protocol):
    """Function whose dimension is determined by the dimensions of its arguments."""

    def dimension_from(self, parts: list[Dimension]) -> Dimension: ...


def parse(text: str) -> Dimension:
    """Return the dimension of a unit such as "N m/rad", "kg m^2" or "kN/mm". Raises UnitError."""
    return _coherent(text) or _known_to_pint(text)[0]


def size(text: str) -> float:
    """Return the factor from a unit to the coherent SI unit of the same dimension, such as 0.001 for "mm".
    Raises UnitError."""
    return 1.0 if _coherent(text) else _known_to_pint(text)[1]


def require_coherent(what: str, text: str) -> None:
    """Raise UnitError unless the unit is a coherent SI unit."""
    if size(text) != 1.0:
        raise UnitError(
            f'{what} is in "{text}", which is {size(text):g} times the SI unit; coordinates and energies are '
            f"in SI units composed of {', '.join(UNITS)} (parameters and outputs may have any unit)"
        )


def _coherent(text: str) -> Dimension | None:
    """Dimension of a coherent SI unit, whose factors are read from left to right; None for other units."""
    dimension = ONE
    for sign, factor in re.findall(r"\s*(/?)\s*([^\s/]*)", text.strip())[:-1] or [("", text)]:
        name, _, power = factor.partition("^")
        if name not in UNITS or not re.fullmatch(r"-?\d{1,2}|", power) or factor.endswith("^"):
            return None
        exponent = int(power or 1)
        dimension *= UNITS[name] ** (-exponent if sign else exponent)
    return dimension


@lru_cache
def _known_to_pint(text: str) -> tuple[Dimension, float]:
    registry, refused = _registry(), f'the unit "{text}" is not understood'
    if len(text) > _MAX_CHARACTERS or _COMPUTED.search(text):
        raise UnitError(f"{refused}: powers are numbers such as 2, -1 or 1.5")
    try:
        units = registry.parse_units(text)
        zero, one = (registry.Quantity(x, units).to_base_units().magnitude for x in (0.0, 1.0))
    except Exception:
        raise UnitError(f'{refused}; write it as in "N m/rad", "kg m^2" or "kN/mm"') from None
    powers = dict(registry.get_dimensionality(units))
    exponents = [Fraction(powers.pop(kind, 0)).limit_denominator(60) for kind in _KINDS]
    if powers or zero != 0 or not text.strip():
        raise UnitError(f"{refused}: it has an offset, or a dimension beyond {', '.join(BASE)}")
    return Dimension(tuple(exponents)), float(one)


@lru_cache
def _registry() -> Any:
    import pint

    return pint.UnitRegistry()


def require(what: str, expression: sympy.Expr, unit: str, known: Mapping[sympy.Symbol, Dimension]) -> None:
    """Raise UnitError unless `expression` has the dimension of `unit`. `what` describes the expression in the
    message."""
    dimension = dimension_of(what, expression, known)
    if expression != 0 and dimension != parse(unit):
        raise UnitError(
            f'{what} must be in "{unit}" ({parse(unit)}) but {short(expression)} is in {dimension}'
        )


def dimension_of(what: str, expression: sympy.Basic, known: Mapping[sympy.Symbol, Dimension]) -> Dimension:
    """Dimension of an expression, computed from its subexpressions. `what` describes the expression in
    messages. Raises UnitError."""
    if isinstance(expression, sympy.Symbol):
        return known[expression]
    if isinstance(expression, sympy.Piecewise):
        return _pieces(what, expression, known)
    parts = [dimension_of(what, dimension, known) for dimension in expression.args]
    if isinstance(expression, sympy.Mul):
        product = ONE
        for dimension in parts:
            product *= dimension
        return product
    if isinstance(expression, sympy.Pow):
        return _power(what, expression, parts)
    if isinstance(expression, (sympy.Add, sympy.Max, sympy.Min, sympy.Abs, sympy.atan2)):
        common = _common(what, expression, parts)
        return ONE if isinstance(expression, sympy.atan2) else common
    if isinstance(expression, Composed):
        return expression.dimension_from(parts)
    for argument, dimension in zip(expression.args, parts, strict=True):
        if dimension != ONE and not isinstance(expression, sympy.sign | sympy.Heaviside):
            raise UnitError(
                f"{what}: the argument {short(argument)} of {expression.func.__name__} "
                f"is in {dimension}; it must be a pure number or an angle"
            )
    return getattr(expression, "dimension", ONE)


def _pieces(what: str, expression: sympy.Piecewise, known: Mapping[sympy.Symbol, Dimension]) -> Dimension:
    """Common dimension of the pieces of a piecewise function. The two sides of a condition must also have a
    common dimension."""
    compared = sorted(expression.atoms(Relational), key=sympy.default_sort_key)
    pieces = sympy.Tuple(*(argument.args[0] for argument in expression.args))
    *_, common = (
        _common(what, group, [dimension_of(what, part, known) for part in group.args])
        for group in (*compared, pieces)
    )
    return common


def _power(what: str, expression: sympy.Pow, parts: list[Dimension]) -> Dimension:
    base, exponent = parts
    if exponent != ONE:
        raise UnitError(
            f"{what}: the exponent of {short(expression)} is in {exponent}; it must be a pure number"
        )
    if base == ONE:
        return ONE
    if not isinstance(expression.exp, sympy.Rational):
        raise UnitError(
            f"{what}: {short(expression)} raises a quantity in {base} to a power that is not rational"
        )
    return base ** Fraction(int(expression.exp.p), int(expression.exp.q))


def _common(what: str, expression: sympy.Basic, parts: list[Dimension]) -> Dimension:
    """Common dimension of arguments that are added or compared. Zero has any dimension."""
    pairs = [pair for pair in zip(expression.args, parts, strict=True) if pair[0] != 0]
    for argument, part in pairs:
        if part != pairs[0][1]:
            raise UnitError(
                f"{what}: {short(pairs[0][0])} is in {pairs[0][1]} but {short(argument)} is in {part}; "
                "they cannot be added or compared"
            )
    return pairs[0][1]


def short(expression: sympy.Basic) -> str:
    """Expression as text for a message, truncated if it is long."""
    return cut(str(expression))


def cut(text: str) -> str:
    """Text for a message, truncated if it is long."""
    return text if len(text) <= _MAX_CHARACTERS else text[: _MAX_CHARACTERS - 3] + "..."
