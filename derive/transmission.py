"""Periodic functions given by Fourier coefficients: transmission functions, loads, stiffnesses.

An application U(φ) knows the order of its derivative: its derivative by φ is the same
function with the next order. No coefficient enters an expression, so that formulas stay
as short as they are on paper.
"""

from typing import Any, ClassVar, Protocol

import sympy

from derive.symbols import PHASE, primed
from derive.units import Dimension


class Series(Protocol):
    """What a mechanism's author sees of a periodic function."""

    mean: Any
    """Parameter that is the mean of the series, if it has one."""

    def __call__(self, angle: Any, /) -> Any:
        """The function of an angle, as an expression."""
        ...


class PeriodicFunction(sympy.Function):
    """A Fourier series of its argument; U(φ, k) is the k-th derivative, U(φ) the function itself.

    A subclass is made for each declared series and carries the names of its coefficients.
    """

    is_real = True
    dimension: ClassVar[Dimension]
    mean: ClassVar[sympy.Symbol | None] = None
    first: ClassVar[tuple[sympy.Symbol, ...]]
    """Cosine coefficients, or amplitudes."""
    second: ClassVar[tuple[sympy.Symbol, ...]]
    """Sine coefficients, or phase angles of the cosines in rad."""
    form: ClassVar[str]
    """"cosine-sine" or "amplitude-phase"."""
    integrated: ClassVar[bool] = False
    """Whether the coefficients are those of the first derivative (chapter Eq. (65))."""

    nargs = (1, 2)

    @classmethod
    def eval(cls, *args: Any) -> Any:
        return cls(*args, 0) if len(args) == 1 else None

    @property
    def order(self) -> int:
        """How often the function is differentiated."""
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
