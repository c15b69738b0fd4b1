"""Deflection w(x, t) along an elastic link, and integrals of products of its mode functions.

The author of a mechanism writes energies per unit length as functions of w, its slope and curvature, the
rates of all three, and the position x. In these energies, w and its derivatives at one position are treated
as coordinates. The energies are then integrated over the link. Mode functions are sums of powers of ξ = x/l
times sines and cosines of π(ak + c)ξ, with an integer a and the mode number k. Products of mode functions are
sums of waves ξ^p exp(iπtξ), which are integrated by parts. At ξ = 1, a wave depends on the mode number only
through its parity (−1)^k. For equal mode numbers, some t are zero; these integrals are computed separately.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache, cached_property
from itertools import permutations
from typing import Any, ClassVar

import sympy

from derive.errors import UnsupportedExpressionError
from derive.symbols import Moving
from derive.units import Dimension, parse

XI = sympy.Symbol("xi", real=True)
MODE_I, MODE_J = sympy.symbols("i j", integer=True, positive=True)
PARITY = {number: sympy.Symbol(f"parity_{number}") for number in (MODE_I, MODE_J)}
"""Symbols that replace (−1)^i and (−1)^j while sums are simplified."""
SEPARATE_FACTORS = {sympy.pi, *PARITY.values()}

Shape = Callable[[Any, Any], Any]
"""Type of mode functions: functions of a mode number k = 1, 2, … and of ξ = x/l."""


@dataclass(frozen=True)
class ModalIntegral:
    """Integral ∫ ξ^power ψ_i^(a) ψ_j^(b) dξ from 0 to 1: `equal` for i = j, `different` otherwise."""

    different: sympy.Expr
    equal: sympy.Expr

    @property
    def vanishes(self) -> bool:
        return self.different == self.equal == 0


def modal_integral(shape: Shape, a: int, b: int, power: int, most: int) -> ModalIntegral:
    """Integral ∫ ξ^power ψ_i^(a) ψ_j^(b) dξ from 0 to 1, for mode numbers i and j up to `most`.

    a and b are the orders of the derivatives with respect to ξ. Raises UnsupportedExpressionError for mode
    functions whose integral has no closed form here.
    """
    product = XI**power * shape(MODE_I, XI).diff(XI, a) * shape(MODE_J, XI).diff(XI, b)
    equal = product.xreplace({MODE_J: MODE_I})
    return ModalIntegral(_integral(product, (MODE_I, MODE_J), most), _integral(equal, (MODE_I,), most))


def modal_moment(shape: Shape, a: int, power: int, most: int) -> sympy.Expr:
    """Integral ∫ ξ^power ψ_j^(a) dξ from 0 to 1; see `modal_integral`."""
    return _integral(XI**power * shape(MODE_J, XI).diff(XI, a), (MODE_J,), most)


@cache
def _integral(function: Any, symbols: tuple[sympy.Symbol, ...], most: int) -> sympy.Expr:
    """Integral of a function from 0 to 1, valid for all distinct mode numbers up to `most`.

    The result is cached, because the same integrals occur repeatedly.
    """
    numbers = [
        dict(zip(symbols, permutation, strict=True))
        for permutation in permutations(range(1, most + 1), len(symbols))
    ]
    total = sympy.S.Zero
    for (power, half_waves), factor in _waves(function).items():
        _require_frequency(half_waves, numbers)
        total += factor * _wave(power, half_waves)
    simple: Any = sympy.factor_terms(_factored(total))
    return simple.xreplace({symbol: (-1) ** number for number, symbol in PARITY.items()})


def _factored(total: sympy.Expr) -> sympy.Expr:
    """Collect a sum by powers of π and parities, and factor the quotients of mode numbers.

    Imaginary terms are omitted: they cancel in the real integral, and factoring is slow.
    """
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
    """Mapping from (power, half_waves) to the coefficient of ξ^power exp(iπ half_waves ξ) in a function."""
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
    """Integral ∫ ξ^power exp(iπ half_waves ξ) dξ from 0 to 1."""
    if half_waves == 0:
        return sympy.Rational(1, power + 1)
    end, slope = _end_value(half_waves), sympy.I * sympy.pi * half_waves
    terms = [end / slope]
    for m in range(1, power + 1):
        terms.append(-terms[-1] * (power - m + 1) / slope)
    return sympy.Add(*terms) - terms[-1] / end


def _end_value(half_waves: Any) -> sympy.Expr:
    """Value of exp(iπ half_waves) for half_waves = ai + bj + c with integers a and b."""
    a, b = half_waves.coeff(MODE_I), half_waves.coeff(MODE_J)
    rest = half_waves - a * MODE_I - b * MODE_J
    if not (a.is_Integer and b.is_Integer and rest.is_number):
        raise _unsupported(sympy.exp(sympy.I * sympy.pi * half_waves * XI))
    return PARITY[MODE_I] ** (a % 2) * PARITY[MODE_J] ** (b % 2) * sympy.exp(sympy.I * sympy.pi * rest)


def _require_frequency(half_waves: sympy.Expr, numbers: list[dict[sympy.Symbol, int]]) -> None:
    """Raise UnsupportedExpressionError if the frequency of a wave is zero for some mode numbers but not for
    all. The formula of the integral would then be 0/0."""
    if half_waves == 0:
        return
    for number in numbers:
        if half_waves.xreplace({symbol: sympy.Integer(n) for symbol, n in number.items()}) == 0:
            named = ", ".join(f"{symbol} = {n}" for symbol, n in number.items())
            raise UnsupportedExpressionError(
                "mode functions cannot be integrated for all mode numbers at once: frequencies "
                f"coincide at {named}; give each mode k one frequency above 0, different from all "
                "others"
            )


def _unsupported(part: sympy.Basic) -> UnsupportedExpressionError:
    return UnsupportedExpressionError(
        f"mode functions with the term {part} cannot be integrated for all mode numbers at once; give "
        "sums of powers of xi = x/l times sin or cos of pi*(a*k + c)*xi, with an integer a"
    )


class FieldIntegral(sympy.Function):
    """Integral ∫ density dx over the length of a field. Each field has a subclass."""

    nargs = 2
    is_real = True
    field: ClassVar["Field"]

    @property
    def density(self) -> Any:
        return self.args[0]

    @property
    def free_symbols(self) -> set[Any]:
        return super().free_symbols - self.field.local

    def dimension_from(self, parts: list[Dimension]) -> Dimension:
        """Dimension of the integral. `parts` are the dimensions of the density and the length."""
        return parts[0] * parts[1]


@dataclass(frozen=True, eq=False)
class Field:
    """Deflection w(x, t) = Σ q_k(t) ψ_k(x/length) of an elastic link.

    shape: ψ_k as a function of k and xi = x/length. modes: name of the option that states the number of
    modes.
    """

    name: str
    unit: str
    meaning: str
    length: sympy.Expr
    shape: Shape = field(repr=False)
    modes: str
    points: dict[Any, tuple[Moving, sympy.Expr]] = field(default_factory=dict, init=False)
    """Mapping from symbols to the quantity (w, w′, w″ or the tension) and the position that they represent;
    see `at`."""

    @cached_property
    def position(self) -> sympy.Symbol:
        """Position x, from 0 to the length."""
        return sympy.Symbol(f"{self.name}_position", real=True)

    @cached_property
    def derivatives(self) -> tuple[Moving, Moving, Moving]:
        """Deflection w and its derivatives w′ and w″ with respect to x."""
        return Moving(self.name), Moving(f"{self.name}_slope"), Moving(f"{self.name}_curvature")

    @property
    def deflection(self) -> Any:
        """Deflection w."""
        return self.derivatives[0]

    @property
    def slope(self) -> Any:
        """Slope w′."""
        return self.derivatives[1]

    @property
    def curvature(self) -> Any:
        """Curvature w″."""
        return self.derivatives[2]

    @cached_property
    def shortening(self) -> Any:
        """Displacement u(x) = ½∫w′² dx (from 0 to x) of a point of an inextensible link towards the start."""
        return Moving(f"{self.name}_shortening")

    @cached_property
    def total_shortening(self) -> Any:
        """Displacement u at the end of the link: the length of the link minus that of its chord."""
        return Moving(f"{self.name}_total_shortening")

    @cached_property
    def tension(self) -> Any:
        """Axial force N of the straight link, which follows from the energy terms with the shortening."""
        return Moving(f"{self.name}_tension")

    @cached_property
    def local(self) -> set[Any]:
        """Symbols that depend on the position along the link."""
        moving = [*self.derivatives, self.shortening]
        return {self.position, self.tension, *moving, *(symbol.rate for symbol in moving)}

    @property
    def symbols(self) -> list[Moving]:
        """All time-varying symbols, without their rates and accelerations."""
        return [*self.derivatives, self.shortening, self.total_shortening, self.tension, *self.points]

    def dimensions(self, length: Dimension, energy: Dimension) -> dict[Any, Dimension]:
        """Mapping from `symbols` to their dimensions, given the dimensions of length and energy."""
        unit = parse(self.unit)
        dimension = {derivative: unit / length**order for order, derivative in enumerate(self.derivatives)}
        dimension |= {self.shortening: length, self.total_shortening: length, self.tension: energy / length}
        return dimension | {point: dimension[local] for point, (local, _) in self.points.items()}

    def integral(self, density: Any) -> Any:
        """Integral of a density over the link.

        Parameters
        ----------
        density : expression
            Quantity per unit length, as a function of x, w, w′, w″ and their rates.

        Returns
        -------
        expression
            ∫ density dx from 0 to the length.
        """
        return self._integral(sympy.sympify(density), self.length)

    def line(self, start: tuple[Any, Any], direction: Any) -> list[tuple[Any, Any]]:
        """Moving point of the bent link, for `sketch`.

        Parameters
        ----------
        start : tuple of two expressions
            Position (x, y) of the start of the link, m.
        direction : expression
            Angle from the x axis to the chord, rad. A positive w is a displacement at +90° from the chord.
        """
        (x, y), along, across = start, self.position - self.shortening, self.deflection
        c, s = sympy.cos(direction), sympy.sin(direction)
        return [(x + along * c - across * s, y + along * s + across * c)]

    def at(self, expression: Any, position: Any) -> Any:
        """Value of an expression at a position along the link.

        Parameters
        ----------
        expression : expression
            Function of x, w, w′, w″, their rates and the tension.
        position : expression
            Position, m.

        Returns
        -------
        expression
        """
        expression = sympy.sympify(expression)
        values: dict[sympy.Basic, Any] = {self.position: sympy.sympify(position)}
        for local in (*self.derivatives, self.tension):
            if expression.has(*local.motion):
                point = self._point(local, values[self.position])
                values |= zip(local.motion, point.motion, strict=True)
        return expression.xreplace(values)

    def _point(self, local: Moving, position: sympy.Expr) -> Any:
        positions = list(dict.fromkeys(place for _, place in self.points.values()))
        number = positions.index(position) if position in positions else len(positions)
        point = Moving(f"{local.name}_at_{number + 1}")
        self.points[point] = (local, position)
        return point

    @cached_property
    def _integral(self) -> Any:
        return type(f"integral_{self.name}", (FieldIntegral,), {"field": self})
