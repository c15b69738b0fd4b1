"""Symbols that move in time, and the total time derivative through them."""

from typing import Any

import sympy


class Moving(sympy.Symbol):
    """A real symbol that varies with time, such as a coordinate q1; its rate is the symbol q1d."""

    def __new__(cls, name: str) -> "Moving":
        return super().__new__(cls, name, real=True)

    @property
    def rate(self) -> Any:
        return Moving(self.name + "d")


class Phase(Moving):
    """The phase φ = Ωt of the drive, rad; its rate is the constant speed Ω."""

    @property
    def rate(self) -> Any:
        return SPEED


SPEED = sympy.Symbol("speed", real=True)
PHASE = Phase("phase")


def rate(expression: sympy.Expr | float) -> sympy.Expr:
    """Total time derivative at constant speed, through phase, coordinates and their rates."""
    expression = sympy.sympify(expression)
    moving = sorted(expression.atoms(Moving), key=lambda symbol: symbol.name)
    return sympy.Add(*(expression.diff(symbol) * symbol.rate for symbol in moving))


def unused_symbol(name: str, taken: set[str]) -> sympy.Symbol:
    """A symbol of this name, with underscores added while it is taken; its name is then `taken` too."""
    while name in taken:
        name += "_"
    taken.add(name)
    return sympy.Symbol(name, real=True)
