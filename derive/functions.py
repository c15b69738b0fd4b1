"""Functions in expressions: unknowns of closed loops of rigid links, and Fourier series.

A loop c(z; x) = 0 determines its unknowns z (angles or positions) as functions of its arguments x, such as
the angle of a crank. In expressions, an unknown or a series is a function whose additional arguments are the
orders of its derivatives, so that SymPy's chain rule applies. The derivatives of the unknowns are solutions
of linear systems with the matrix ∂c/∂z. Expressions do not contain the coefficients of a series, so that they
remain short.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any, ClassVar, Protocol

import sympy

from derive.domains import substituted
from derive.symbols import PHASE, Moving, primed
from derive.units import Dimension, parse

Order = tuple[int, ...]
"""Order of the derivative with respect to each argument."""


class LoopFunction(sympy.Function):
    """Unknown of a loop as a function: z(x, y) is the unknown, and z(x, y, 1, 0) is its derivative ∂z/∂x.

    There is one subclass per unknown.
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
        """Dimension of the derivative. `parts` are the dimensions of the arguments."""
        dimension = parse(self.unit)
        for part, times in zip(parts, self.order, strict=False):
            dimension /= part**times
        return dimension

    @property
    def derivatives(self) -> tuple[int, list[tuple[Any, int]]]:
        """Order of the derivative with respect to the phase, and the other arguments with their nonzero
        orders."""
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
    """Closed loop of rigid links.

    unknowns, units: z and the units of z. given: formal arguments. arguments: actual arguments. closure:
    expressions in z, `given` and parameters, one per unknown, that vanish if the loop is closed. start:
    expressions for z in `given` and parameters; exact if `iterations` is 0, otherwise the initial guess of
    Newton's method.
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
        """Function class of each unknown."""
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
        """Parameters in the equations of the loop, in alphabetical order."""
        free: set[Any] = set().union(*(part.free_symbols for part in (*self.closure, *self.start)))
        return sorted(free - {*self.unknowns, *self.given}, key=lambda symbol: symbol.name)

    def at(self, arguments: Iterable[sympy.Expr], order: Order | None = None) -> tuple[Any, ...]:
        """Unknowns, or their derivatives of the given order, as functions of `arguments`."""
        return tuple(function(*arguments, *(order or ())) for function in self.functions)

    @property
    def jacobian(self) -> sympy.Matrix:
        """Jacobian ∂c/∂z of the closure equations c with respect to the unknowns z."""
        return sympy.Matrix(self.closure).jacobian(self.unknowns)

    @property
    def newton_step(self) -> list[Any]:
        """Unknowns z after one step of Newton's method."""
        return list(
            sympy.Matrix(self.unknowns) + _linear_solution(self.jacobian, -sympy.Matrix(self.closure))
        )

    def derivative(self, order: Order) -> list[Any]:
        """Derivatives of the unknowns for one order, expressed by the derivatives of lower orders."""
        functions = dict(zip(self.unknowns, self.at(self.given), strict=True))
        closed: Any = sympy.Matrix(self.closure).xreplace(functions)
        for symbol, times in zip(self.given, order, strict=True):
            for _ in range(times):
                closed = closed.diff(symbol)
        rest = closed.xreplace(dict.fromkeys(self.at(self.given, order), sympy.S.Zero))
        return list(_linear_solution(self.jacobian.xreplace(functions), -rest))

    @property
    def margins(self) -> list[Any]:
        """Expressions that are positive if the loop is closed to within 1e-9 of the magnitude of its
        terms."""
        arguments = self.arguments
        values = dict(zip((*self.unknowns, *self.given), (*self.at(arguments), *arguments), strict=True))
        closed = [equation.xreplace(values) for equation in self.closure]
        sizes = [sympy.Add(*map(sympy.Abs, sympy.Add.make_args(equation))) for equation in closed]
        return [size / 10**9 - sympy.Abs(gap) for size, gap in zip(sizes, closed, strict=True)]


def _linear_solution(matrix: Any, right: Any) -> Any:
    """Solution z of `matrix` z = `right` by Cramer's rule, which requires no test for zero pivots."""
    return matrix.adjugate() * right / matrix.det(method="berkowitz")


def lower_orders(orders: Iterable[Order]) -> list[Order]:
    """Return the given orders of derivatives and all lower orders, lowest first."""
    needed = {lower for order in orders for lower in product(*(range(times + 1) for times in order))}
    return sorted(needed, key=lambda order: (sum(order), order))


def at_fundamental_motion(expression: Any) -> Any:
    """Expression at the fundamental motion, where all time-varying symbols except the phase are zero."""
    moving = expression.atoms(Moving) - {PHASE}
    return substituted(expression, dict.fromkeys(moving, sympy.S.Zero))


def four_bar(names: tuple[str, str], links: Mapping[str, Any], side: Any) -> Loop:
    """Loop of a planar four-bar linkage, with the directions of coupler and follower in closed form.

    A is the crank pin, B the joint of coupler and follower, and C the pivot of the follower. B is computed
    from the height of the triangle ABC and the foot of this height.
    names: names of the two directions. links: angle and length of the crank, lengths of coupler and follower,
    length and tilt of the ground line; those that vary with time are the arguments of the loop. side: +1 if B
    lies on the left of the line from A to C, −1 if it lies on the right.
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
    """Return two inequalities that hold if crank pin, joint and follower pivot form a triangle at every crank
    angle."""
    crank, coupler, follower, ground = (
        at_fundamental_motion(sympy.sympify(x)) for x in (crank, coupler, follower, ground)
    )
    reach = ground + crank < coupler + follower
    return reach, sympy.Abs(ground - crank) > sympy.Abs(coupler - follower)


class Series(Protocol):
    """Protocol of a declared periodic function, as the author of a mechanism uses it."""

    mean: Any
    """Parameter that is the mean; None if the mean is zero."""

    def __call__(self, angle: Any, /) -> Any:
        """Value of the function at an angle, as an expression."""
        ...


class PeriodicFunction(sympy.Function):
    """Fourier series as a function: U(φ) is its value, and U(φ, k) is its k-th derivative.

    There is one subclass per declared series; it contains the coefficients.
    """

    is_real = True
    dimension: ClassVar[Dimension]
    mean: ClassVar[sympy.Symbol | None] = None
    first: ClassVar[tuple[sympy.Symbol, ...]]
    """Cosine coefficients, or amplitudes."""
    second: ClassVar[tuple[sympy.Symbol, ...]]
    """Sine coefficients, or phase angles of the cosines in rad."""
    form: ClassVar[str]
    """Form of the series: "cosine-sine" or "amplitude-phase"."""
    integrated: ClassVar[bool] = False
    """Whether the coefficients are those of the first derivative (chapter Eq. (65))."""

    nargs = (1, 2)

    @classmethod
    def eval(cls, *args: Any) -> Any:
        return cls(*args, 0) if len(args) == 1 else None

    @property
    def order(self) -> int:
        """Order of the derivative."""
        return int(str(self.args[1]))

    def fdiff(self, argindex: int = 1) -> sympy.Expr:
        return self.func(self.args[0], self.order + 1)

    def _latex(self, printer, exp: str | None = None) -> str:
        name = sympy.latex(sympy.Symbol(type(self).__name__)) + primed(self.order)
        if self.args[0] != PHASE:
            name += r"\left(" + printer._print(self.args[0]) + r"\right)"
        return name if exp is None else rf"\left({name}\right)^{{{exp}}}"

    def _mathml_presentation(self, printer: Any) -> Any:
        return printer.series(self)

    @classmethod
    def coefficients(cls) -> tuple[sympy.Symbol, ...]:
        """All parameters of the series, the mean first."""
        return (*((cls.mean,) if cls.mean else ()), *cls.first, *cls.second)
