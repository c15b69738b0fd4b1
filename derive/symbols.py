"""Symbols that vary with time, and the total time derivative."""

from collections.abc import Iterable
from typing import Any

import sympy
from sympy.core.relational import Relational

from derive.errors import DeclarationError
from derive.switches import STEPPING, Wrapped, is_derive_function, slope, wrapped
from derive.units import short


class Moving(sympy.Symbol):
    """Real symbol that varies with time, such as a coordinate q1, whose rate is q1d."""

    def __new__(cls, name: str) -> "Moving":
        return super().__new__(cls, name, real=True)

    @property
    def rate(self) -> Any:
        return Moving(self.name + "d")

    @property
    def motion(self) -> tuple[Any, Any, Any]:
        """The symbol, its rate and its acceleration."""
        return self, self.rate, self.rate.rate


class Phase(Moving):
    """Phase φ of the drive in rad, whose rate is the speed Ω."""

    @property
    def rate(self) -> Any:
        return SPEED


SPEED = sympy.Symbol("speed", real=True)
ACCELERATION = sympy.Symbol("speedd", real=True)
"""Rate of change of the speed in a transient, rad/s²; 0 at constant speed."""

PHASE = Phase("phase")


def rate(expression: Any) -> Any:
    """Total time derivative of an expression.

    Parameters
    ----------
    expression : expression, or matrix of expressions
        Function of parameters, phase, speed, coordinates and rates of coordinates.

    Returns
    -------
    expression or matrix
        Derivative with respect to time. A matrix is differentiated entry by entry.

    Raises
    ------
    ImpulseError
        If the expression is discontinuous.
    DeclarationError
        If a tuple or text is given, or if a step or kink contains the phase plus a coordinate.
    """
    if isinstance(expression, sympy.MatrixBase):
        return expression.applyfunc(rate)
    given = sympy.sympify(expression)
    if not isinstance(given, sympy.Expr):
        raise DeclarationError(
            f"rate({short(given)}): give one number, expression or Matrix; coordinates(...) returns a "
            "tuple, even for a single coordinate: write coordinate(...), or (q,) = coordinates(...)"
        )
    argument = counted(given)
    moving = sorted(argument.atoms(Moving), key=lambda symbol: symbol.name)
    terms = [slope(argument, symbol) * symbol.rate for symbol in moving]
    if argument.has(SPEED):
        terms.append(slope(argument, SPEED) * ACCELERATION)
    return sympy.Add(*terms)


def steady(expression: Any) -> Any:
    """Expression or matrix at constant speed."""
    return expression.xreplace({ACCELERATION: sympy.S.Zero})


def counted(expression: Any) -> Any:
    """Replace the phase by the phase modulo 2π in the steps, kinks and pieces of an expression.

    Periodic functions of the phase are unchanged. Raises DeclarationError if a step, kink or piece contains
    both the phase, outside of periodic functions, and a coordinate.
    """
    if isinstance(expression, STEPPING) and _whole_phase(expression):
        compared = _compared(expression)
        if any(_whole_phase(part) and part.atoms(Moving) != {PHASE} for part in compared):
            raise DeclarationError(
                f"{short(expression)} contains both the phase and a coordinate; state the range of the "
                "angle: wrapped(phase + q) is between 0 and 2*pi"
            )
        return _wrapped(expression)
    if not expression.has(*STEPPING):
        return expression
    return expression.func(*map(counted, expression.args))


def _compared(expression: Any) -> Iterable[Any]:
    """Expressions or inequalities that select the branch of a step, kink or piecewise function."""
    if isinstance(expression, sympy.Piecewise):
        return set().union(*(argument.args[1].atoms(Relational) for argument in expression.args))
    return expression.args


def _whole_phase(expression: Any) -> bool:
    """Whether the expression contains the phase outside of periodic functions, so that it is unbounded."""
    return expression == PHASE or any(map(_whole_phase, _parts(expression)))


def _wrapped(expression: Any) -> Any:
    if expression == PHASE:
        return wrapped(PHASE)
    if (
        isinstance(expression, Wrapped)
        or is_derive_function(expression)
        or _repeats(expression)
        or not expression.args
    ):
        return expression
    return expression.func(*map(_wrapped, expression.args))


def _repeats(expression: Any) -> bool:
    """Whether an expression is a sine, cosine or tangent whose value repeats when the phase increases by
    2π."""
    turning = isinstance(expression, sympy.sin | sympy.cos | sympy.tan)
    return turning and bool(sympy.diff(expression.args[0], PHASE).is_Integer)


def _parts(expression: Any) -> tuple[Any, ...]:
    """Arguments of an expression; empty for periodic functions."""
    repeats = isinstance(expression, Wrapped | sympy.sin | sympy.cos | sympy.tan) or is_derive_function(
        expression
    )
    return () if repeats else expression.args


def primed(order: int) -> str:
    """LaTeX of the primes of a derivative of the given order."""
    return "'" * order if order < 4 else f"^{{({order})}}"


def unused_symbol(name: str, taken: set[str]) -> sympy.Symbol:
    """Return a symbol whose name is not in `taken`, and add the name to `taken`. Underscores are appended to
    a name in use."""
    while name in taken:
        name += "_"
    taken.add(name)
    return sympy.Symbol(name, real=True)


def nesting(expression: sympy.Basic, functions: type[sympy.Function]) -> int:
    """Largest nesting depth of functions of the given class in an expression."""
    nodes = expression.atoms(functions)
    return 1 + max(nesting(argument, functions) for node in nodes for argument in node.args) if nodes else 0
