"""Closed loops of rigid links: their unknowns as functions of what moves them.

A loop c(z; x) = 0 makes its unknowns z, angles or positions, functions of its arguments x, such as the
angle of a crank. In expressions an unknown is a function that knows how often it is differentiated
by each argument, so that rates and Lagrange's equations follow from the chain rule alone. Its
derivatives come from differentiating the loop: each is the solution of a linear system with the
matrix ∂c/∂z, for any planar four-bar and for any loop of a user's own alike.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any, ClassVar

import sympy

from derive.domains import substituted
from derive.symbols import PHASE, Moving, primed
from derive.units import Dimension, parse

Order = tuple[int, ...]
"""How often a function is differentiated by each of its arguments."""


class LoopFunction(sympy.Function):
    """An unknown of a loop; z(x, y, 1, 0) is ∂z/∂x, and z(x, y) the unknown itself.

    A subclass is made for each unknown of each loop.
    """

    is_real = True
    loop: ClassVar["Loop"]
    unit: ClassVar[str]

    @classmethod
    def eval(cls, *args: Any) -> Any:
        count = len(cls.loop.given)
        return cls(*args, *count * [0]) if len(args) == count else None

    @property
    def arguments(self) -> tuple[Any, ...]:
        return self.args[: len(self.loop.given)]

    @property
    def order(self) -> Order:
        return tuple(int(str(times)) for times in self.args[len(self.loop.given) :])

    def fdiff(self, argindex: int = 1) -> sympy.Expr:
        order = list(self.order)
        order[argindex - 1] += 1
        return self.func(*self.arguments, *order)

    def dimension_from(self, parts: list[Dimension]) -> Dimension:
        """Dimension of the function where its arguments have those of the parts."""
        dimension = parse(self.unit)
        for part, times in zip(parts, self.order, strict=False):
            dimension /= part**times
        return dimension

    @property
    def derivatives(self) -> tuple[int, list[tuple[Any, int]]]:
        """How often it is differentiated by the phase, and by each other argument by which it is."""
        orders = list(zip(self.arguments, self.order, strict=True))
        others = [(argument, times) for argument, times in orders if times and argument != PHASE]
        return sum(times for argument, times in orders if argument == PHASE), others

    def _latex(self, printer: Any, exp: str | None = None) -> str:
        primes, others = self.derivatives
        by = "".join(
            rf"\partial_{{{printer._print(argument)}}}{_exponent(times)} " for argument, times in others
        )
        text = by + sympy.latex(sympy.Symbol(type(self).__name__)) + primed(primes)
        return text if exp is None else rf"\left({text}\right)^{{{exp}}}"

    def _mathml_presentation(self, printer: Any) -> Any:
        return printer.unknown(self)


def _exponent(times: int) -> str:
    return f"^{{{times}}}" if times > 1 else ""


@dataclass(frozen=True, eq=False)
class Loop:
    """A closed loop of links.

    unknowns: z, with their units. given: formal arguments, and `arguments` what stands for them.
    closure: expressions of z, given and parameters that vanish, as many as unknowns. start: z as
    expressions of given and parameters, exact if `iterations` is 0, else the first guess of as many
    steps of Newton's method.
    """

    unknowns: tuple[sympy.Symbol, ...]
    units: tuple[str, ...]
    given: tuple[sympy.Symbol, ...]
    arguments: tuple[Any, ...]
    closure: tuple[Any, ...]
    start: tuple[Any, ...]
    iterations: int

    @cached_property
    def functions(self) -> tuple[Any, ...]:
        """The class of each unknown."""
        count = len(self.given)
        shared = {"loop": self, "nargs": (count, 2 * count)}
        return tuple(
            type(unknown.name, (LoopFunction,), {**shared, "unit": unit})
            for unknown, unit in zip(self.unknowns, self.units, strict=True)
        )

    def __str__(self) -> str:
        return ", ".join(unknown.name for unknown in self.unknowns)

    @property
    def name(self) -> str:
        """Name of the generated function that solves the loop."""
        return "_" + "_".join(unknown.name for unknown in self.unknowns)

    @property
    def parameters(self) -> list[sympy.Symbol]:
        """What the loop depends on besides its arguments."""
        free: set[Any] = set().union(*(part.free_symbols for part in (*self.closure, *self.start)))
        return sorted(free - {*self.unknowns, *self.given}, key=lambda symbol: symbol.name)

    def at(self, arguments: Iterable[sympy.Expr], order: Order | None = None) -> tuple[Any, ...]:
        """The unknowns, or their derivatives of an order, at the arguments."""
        return tuple(function(*arguments, *(order or ())) for function in self.functions)

    @property
    def jacobian(self) -> sympy.Matrix:
        """∂c/∂z."""
        return sympy.Matrix(self.closure).jacobian(self.unknowns)

    @property
    def newton_step(self) -> list[Any]:
        """z after one step of Newton's method."""
        return list(
            sympy.Matrix(self.unknowns) + _linear_solution(self.jacobian, -sympy.Matrix(self.closure))
        )

    def derivative(self, order: Order) -> list[Any]:
        """Derivatives of an order of the unknowns, from those of lower orders (applied to `given`)."""
        functions = dict(zip(self.unknowns, self.at(self.given), strict=True))
        closed: Any = sympy.Matrix(self.closure).xreplace(functions)
        for symbol, times in zip(self.given, order, strict=True):
            for _ in range(times):
                closed = closed.diff(symbol)
        rest = closed.xreplace(dict.fromkeys(self.at(self.given, order), sympy.S.Zero))
        return list(_linear_solution(self.jacobian.xreplace(functions), -rest))

    @property
    def margins(self) -> list[Any]:
        """Expressions that are positive where the loop closes within 1e-9 of the size of the terms."""
        arguments = self.arguments
        values = dict(zip((*self.unknowns, *self.given), (*self.at(arguments), *arguments), strict=True))
        closed = [equation.xreplace(values) for equation in self.closure]
        sizes = [sympy.Add(*map(sympy.Abs, sympy.Add.make_args(equation))) for equation in closed]
        return [size / 10**9 - sympy.Abs(gap) for size, gap in zip(sizes, closed, strict=True)]


def _linear_solution(matrix: Any, right: Any) -> Any:
    """z of matrix z = right by Cramer's rule, which unlike elimination needs no pivot other than 0."""
    return matrix.adjugate() * right / matrix.det(method="berkowitz")


def lower_orders(orders: Iterable[Order]) -> list[Order]:
    """The orders and all lower ones that their derivatives are calculated from, lowest first."""
    needed = {lower for order in orders for lower in product(*(range(times + 1) for times in order))}
    return sorted(needed, key=lambda order: (sum(order), order))


def at_desired_motion(expression: Any) -> Any:
    """Expression in the fundamental motion: all moving symbols are zero, except the phase."""
    moving = expression.atoms(Moving) - {PHASE}
    return substituted(expression, dict.fromkeys(moving, sympy.S.Zero))


def four_bar(names: tuple[str, str], links: Mapping[str, Any], side: Any) -> Loop:
    """Directions of coupler and follower, from crank pin A and pivot C to joint B, in closed form.

    links: angle and length of the crank, lengths of coupler and follower, length and tilt of the ground
    line. Those that move are arguments. side: +1 where B lies on the left of the line from A to C,
    −1 on its right. B is the corner of the triangle A, B, C above the foot of its height.
    """
    moving = [name for name, value in links.items() if sympy.sympify(value).atoms(Moving)]
    given = {name: sympy.Dummy(name, real=True) for name in moving}
    values: list[Any] = [given.get(name, value) for name, value in links.items()]
    angle, crank, coupler, follower, ground, tilt = values
    phi3, phi4 = (sympy.Symbol(name, real=True) for name in names)
    cos, sin = sympy.cos, sympy.sin

    across = (ground * cos(tilt) - crank * cos(angle), ground * sin(tilt) - crank * sin(angle))
    square = across[0] ** 2 + across[1] ** 2
    foot = (1 + (coupler**2 - follower**2) / square) / 2
    height = side * sympy.sqrt(coupler**2 / square - foot**2)
    from_pin = (foot * across[0] - height * across[1], foot * across[1] + height * across[0])
    start = (
        sympy.atan2(from_pin[1], from_pin[0]),
        sympy.atan2(from_pin[1] - across[1], from_pin[0] - across[0]),
    )
    closure = (
        coupler * cos(phi3) - follower * cos(phi4) - across[0],
        coupler * sin(phi3) - follower * sin(phi4) - across[1],
    )
    arguments = tuple(links[name] for name in moving)
    return Loop((phi3, phi4), ("rad", "rad"), tuple(given.values()), arguments, closure, start, 0)


def full_turn(crank: Any, coupler: Any, follower: Any, ground: Any) -> tuple[Any, Any]:
    """What lets A, B, C form a triangle at every angle of the crank."""
    crank, coupler, follower, ground = (
        at_desired_motion(sympy.sympify(x)) for x in (crank, coupler, follower, ground)
    )
    reach = ground + crank < coupler + follower
    return reach, sympy.Abs(ground - crank) > sympy.Abs(coupler - follower)
