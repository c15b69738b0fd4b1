"""A deflection w(x, t) along an elastic link, to be expanded in mode functions.

The author of a mechanism writes energies a length in w, its slope and curvature, their rates and the
position x, as if these were coordinates at one place, and integrates them over the link.
"""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar

import sympy

from derive.modal_integrals import Shape
from derive.symbols import Moving
from derive.units import Dimension, parse


class FieldIntegral(sympy.Function):
    """∫ density dx over the length of a field; a subclass is made for each field."""

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
        """Dimension of the integral where density and length have those of the parts."""
        return parts[0] * parts[1]


@dataclass(frozen=True, eq=False)
class Field:
    """w(x, t) = Σ q_k(t) ψ_k(x/length), k = 1 … as many as the option `modes` says.

    shape: ψ_k as a function of k and xi = x/length.
    """

    name: str
    unit: str
    meaning: str
    length: sympy.Expr
    shape: Shape = field(repr=False)
    modes: str
    points: dict[Any, tuple[Moving, sympy.Expr]] = field(default_factory=dict, init=False)
    """What `at` gave: a symbol for w, w′, w″ or the tension at a position."""

    @cached_property
    def position(self) -> sympy.Symbol:
        """x, from 0 to the length."""
        return sympy.Symbol(f"{self.name}_position", real=True)

    @cached_property
    def derivatives(self) -> tuple[Moving, Moving, Moving]:
        """w, w′ and w″, derivatives by x."""
        return Moving(self.name), Moving(f"{self.name}_slope"), Moving(f"{self.name}_curvature")

    @property
    def deflection(self) -> Any:
        """w."""
        return self.derivatives[0]

    @property
    def slope(self) -> Any:
        """w′."""
        return self.derivatives[1]

    @property
    def curvature(self) -> Any:
        """w″."""
        return self.derivatives[2]

    @cached_property
    def shortening(self) -> Any:
        """u = ½∫w′² from 0 to x: what an inextensible link at x moves towards its beginning."""
        return Moving(f"{self.name}_shortening")

    @cached_property
    def total_shortening(self) -> Any:
        """u at the end: the chord is shorter by it than the link."""
        return Moving(f"{self.name}_total_shortening")

    @cached_property
    def tension(self) -> Any:
        """Axial force N of the straight link; it follows from what the energies say of the shortening."""
        return Moving(f"{self.name}_tension")

    @cached_property
    def local(self) -> set[Any]:
        """Symbols that mean something at one place only."""
        moving = [*self.derivatives, self.shortening]
        return {self.position, self.tension, *moving, *(each.rate for each in moving)}

    @property
    def symbols(self) -> list[Moving]:
        """Whatever moves, without its rates."""
        return [*self.derivatives, self.shortening, self.total_shortening, self.tension, *self.points]

    def dimensions(self, length: Dimension, energy: Dimension) -> dict[Any, Dimension]:
        """Dimensions of `symbols`, from those of length and energy."""
        unit = parse(self.unit)
        known = {each: unit / length**order for order, each in enumerate(self.derivatives)}
        known |= {self.shortening: length, self.total_shortening: length, self.tension: energy / length}
        return known | {point: known[local] for point, (local, _) in self.points.items()}

    def integral(self, density: Any) -> Any:
        """∫ density dx from 0 to the length."""
        return self._integral(sympy.sympify(density), self.length)

    def line(self, start: tuple[Any, Any], direction: Any) -> list[tuple[Any, Any]]:
        """For `sketch`, the point that runs along the bent link from its beginning (x, y), whose chord has
        a direction (rad from x); w is positive at +90° from it."""
        (x, y), along, across = start, self.position - self.shortening, self.deflection
        c, s = sympy.cos(direction), sympy.sin(direction)
        return [(x + along * c - across * s, y + along * s + across * c)]

    def at(self, expression: Any, position: Any) -> Any:
        """The value of an expression in x, w, w′, w″, their rates and the tension at a position."""
        expression = sympy.sympify(expression)
        values: dict[sympy.Basic, Any] = {self.position: sympy.sympify(position)}
        for local in (*self.derivatives, self.tension):
            if expression.has(*local.motion):
                point = self._point(local, values[self.position])
                values |= zip(local.motion, point.motion, strict=True)
        return expression.xreplace(values)

    def _point(self, local: Moving, position: sympy.Expr) -> Any:
        places = list(dict.fromkeys(place for _, place in self.points.values()))
        number = places.index(position) if position in places else len(places)
        point = Moving(f"{local.name}_at_{number + 1}")
        self.points[point] = (local, position)
        return point

    @cached_property
    def _integral(self) -> Any:
        return type(f"integral_{self.name}", (FieldIntegral,), {"field": self})
