"""Integrals of products of mode functions, in closed form for all mode numbers at once.

Mode functions are sums of powers of ξ = x/l times sines and cosines of π(ak + c)ξ, a whole. Their
products are sums of waves ξ^p exp(iπtξ), which integrate by parts; at ξ = 1 only the parity (−1)^k of a
mode number remains. Equal mode numbers, for which some t vanish, have an integral of their own.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from itertools import permutations
from typing import Any

import sympy

from derive.errors import UnsupportedExpressionError

XI = sympy.Symbol("xi", real=True)
MODE_I, MODE_J = sympy.symbols("i j", integer=True, positive=True)
PARITY = {number: sympy.Symbol(f"parity_{number}") for number in (MODE_I, MODE_J)}
"""Stand for (−1)^i and (−1)^j while sums are simplified."""
SEPARATE_FACTORS = {sympy.pi, *PARITY.values()}

Shape = Callable[[Any, Any], Any]
"""The mode function of a mode number k = 1, 2, … and of ξ = x/l."""


@dataclass(frozen=True)
class ModalIntegral:
    """∫ ξ^power ψ_i^(a) ψ_j^(b) dξ over 0 … 1; `equal` for i = j, `different` for any others."""

    different: sympy.Expr
    equal: sympy.Expr

    @property
    def vanishes(self) -> bool:
        return self.different == self.equal == 0


def modal_integral(shape: Shape, a: int, b: int, power: int, most: int) -> ModalIntegral:
    """Product of the derivatives a and b (by ξ) of modes i and j, for numbers up to `most`.

    Raises UnsupportedExpressionError where the mode functions are of another kind.
    """
    product = XI**power * shape(MODE_I, XI).diff(XI, a) * shape(MODE_J, XI).diff(XI, b)
    equal = product.xreplace({MODE_J: MODE_I})
    return ModalIntegral(_integral(product, (MODE_I, MODE_J), most), _integral(equal, (MODE_I,), most))


def modal_moment(shape: Shape, a: int, power: int, most: int) -> sympy.Expr:
    """∫ ξ^power ψ_j^(a) dξ over 0 … 1, as `modal_integral`."""
    return _integral(XI**power * shape(MODE_J, XI).diff(XI, a), (MODE_J,), most)


@cache
def _integral(function: Any, symbols: tuple[sympy.Symbol, ...], most: int) -> sympy.Expr:
    """Integral over 0 … 1, for all mode numbers up to `most` that differ. Energies and outputs of all fields
    of a shape have the same ones."""
    numbers = [
        dict(zip(symbols, each, strict=True)) for each in permutations(range(1, most + 1), len(symbols))
    ]
    total = sympy.S.Zero
    for (power, half_waves), factor in _waves(function).items():
        _require_frequency(half_waves, numbers)
        total += factor * _wave(power, half_waves)
    simple: Any = sympy.factor_terms(_factored(total))
    return simple.xreplace({symbol: (-1) ** number for number, symbol in PARITY.items()})


def _factored(total: sympy.Expr) -> sympy.Expr:
    """Sum of powers of π and parities, each times a factored quotient of mode numbers. The integral is real:
    imaginary terms, which cancel with those of the opposite frequency, are left out, as factors of their sum
    are long sought."""
    quotients: dict[sympy.Expr, sympy.Expr] = {}
    for term in sympy.Add.make_args(sympy.expand(total)):
        imaginary = term.as_coefficient(sympy.I)
        if imaginary is not None and not imaginary.has(sympy.I):
            continue
        powers = term.as_powers_dict()
        parity = sympy.Mul(*(symbol ** (powers[symbol] % 2) for symbol in PARITY.values()))
        constant = parity * sympy.pi ** powers[sympy.pi]
        rest = sympy.Mul(*(base**power for base, power in powers.items() if base not in SEPARATE_FACTORS))
        quotients[constant] = quotients.get(constant, sympy.S.Zero) + rest
    return sympy.Add(*(constant * sympy.factor(quotient) for constant, quotient in quotients.items()))


def _waves(function: Any) -> dict[tuple[int, sympy.Expr], sympy.Expr]:
    """Factors of ξ^p exp(iπtξ), by p and t."""
    waves: dict[tuple[int, sympy.Expr], sympy.Expr] = {}
    for term in sympy.Add.make_args(sympy.expand(function.rewrite(sympy.exp))):
        factor, varying = term.as_independent(XI)
        power, half_waves = 0, sympy.S.Zero
        parts: Any = sympy.Mul.make_args(varying)
        for part in parts:
            base, exponent = part.as_base_exp()
            if base == XI and exponent.is_Integer:
                power += int(exponent)
            elif part.func is sympy.exp:
                half_waves += sympy.expand(part.exp / (sympy.I * sympy.pi * XI))
            elif part != 1:
                raise _unsupported(part)
        waves[power, half_waves] = waves.get((power, half_waves), sympy.S.Zero) + factor
    return waves


def _wave(power: int, half_waves: sympy.Expr) -> sympy.Expr:
    """∫ ξ^p exp(iπtξ) dξ over 0 … 1."""
    if half_waves == 0:
        return sympy.Rational(1, power + 1)
    end, slope = _end_value(half_waves), sympy.I * sympy.pi * half_waves
    terms = [end / slope]
    for m in range(1, power + 1):
        terms.append(-terms[-1] * (power - m + 1) / slope)
    return sympy.Add(*terms) - terms[-1] / end


def _end_value(half_waves: Any) -> sympy.Expr:
    """exp(iπt) for t = ai + bj + c with whole a and b."""
    a, b = half_waves.coeff(MODE_I), half_waves.coeff(MODE_J)
    rest = half_waves - a * MODE_I - b * MODE_J
    if not (a.is_Integer and b.is_Integer and rest.is_number):
        raise _unsupported(sympy.exp(sympy.I * sympy.pi * half_waves * XI))
    return PARITY[MODE_I] ** (a % 2) * PARITY[MODE_J] ** (b % 2) * sympy.exp(sympy.I * sympy.pi * rest)


def _require_frequency(half_waves: sympy.Expr, numbers: list[dict[sympy.Symbol, int]]) -> None:
    """Where a wave's frequency vanishes for some mode numbers only, its formula is 0/0 there."""
    if half_waves == 0:
        return
    for each in numbers:
        if half_waves.xreplace({symbol: sympy.Integer(n) for symbol, n in each.items()}) == 0:
            named = ", ".join(f"{symbol} = {n}" for symbol, n in each.items())
            raise UnsupportedExpressionError(
                "mode functions cannot be integrated for all mode numbers at once: frequencies meet at "
                f"{named}; give mode k a single frequency of its own, above 0"
            )


def _unsupported(part: sympy.Basic) -> UnsupportedExpressionError:
    return UnsupportedExpressionError(
        f"mode functions with the part {part} cannot be integrated for all mode numbers at once; "
        "give sums of powers of xi = x/l times sin or cos of pi*(a*k + c)*xi, a whole"
    )
