"""SymPy expressions as Python text on CasADi symbols."""

from typing import Any

import sympy
from sympy.core.numbers import Exp1, Pi
from sympy.core.relational import GreaterThan, LessThan, StrictGreaterThan, StrictLessThan
from sympy.functions.elementary.piecewise import ExprCondPair
from sympy.logic.boolalg import BooleanTrue
from sympy.printing.pycode import AbstractPythonCodePrinter

from derive.errors import UnsupportedExpressionError
from derive.pieces import Selected
from derive.switches import Wrapped

SAME = ("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "exp", "log", "sign")
HYPERBOLIC = ("sinh", "cosh", "tanh", "asinh", "acosh", "atanh")
FUNCTIONS = {"Abs": "casadi.fabs", **{name: f"casadi.{name}" for name in SAME + HYPERBOLIC}}
NODES = (
    sympy.Symbol,
    sympy.Rational,
    sympy.Float,
    sympy.Add,
    sympy.Mul,
    sympy.Pow,
    sympy.Max,
    sympy.Min,
    sympy.Heaviside,
    sympy.Piecewise,
    ExprCondPair,
    StrictGreaterThan,
    GreaterThan,
    StrictLessThan,
    LessThan,
    sympy.And,
    sympy.Or,
    BooleanTrue,
    Wrapped,
    Selected,
    Pi,
    Exp1,
)


class CasadiPrinter(AbstractPythonCodePrinter):
    """Prints with `casadi.` and `math.` before each function; rationals stay exact until Python divides.

    Raises UnsupportedExpressionError where an expression has no counterpart.
    """

    def __init__(self) -> None:
        super().__init__({"precision": 17})

    def doprint(self, expr: Any, assign_to: Any = None) -> str:
        for node in sympy.preorder_traversal(expr):
            if not isinstance(node, NODES) and type(node).__name__ not in FUNCTIONS:
                raise UnsupportedExpressionError(
                    f"{node} cannot be generated; known functions: {', '.join(FUNCTIONS)}, sqrt, Max, Min, "
                    "Heaviside, Piecewise of conditions with < and >"
                )
        return str(super().doprint(expr, assign_to))

    def _print_Pow(self, expr: sympy.Pow, rational: bool = False) -> str:
        if expr.exp == sympy.S.Half and not rational:
            return f"casadi.sqrt({self._print(expr.base)})"
        if expr.exp == -sympy.S.Half and not rational:
            return f"1/casadi.sqrt({self._print(expr.base)})"
        return super()._print_Pow(expr, rational=rational)

    def _print_Pi(self, expr: Pi) -> str:
        return "math.pi"

    def _print_Exp1(self, expr: Exp1) -> str:
        return "math.e"

    def _print_Max(self, expr: sympy.Max) -> str:
        return self._nested("casadi.fmax", expr)

    def _print_Min(self, expr: sympy.Min) -> str:
        return self._nested("casadi.fmin", expr)

    def _print_Heaviside(self, expr: sympy.Heaviside) -> str:
        return f"({self._print(expr.args[0])} > 0)"

    def _print_Wrapped(self, expr: Wrapped) -> str:
        angle, turn = map(self._print, expr.args)
        return f"({angle} - {turn}*casadi.floor(({angle})/({turn})))"

    def _print_Piecewise(self, expr: Any) -> Any:
        *pieces, (last, always) = expr.args
        text = self._print(last) if always == sympy.true else "math.nan"
        for piece, condition in reversed(pieces if always == sympy.true else expr.args):
            text = f"casadi.if_else({self._print(condition)}, {self._print(piece)}, {text})"
        return text

    def _print_Selected(self, expr: Selected) -> str:
        condition, value, otherwise = map(self._print, expr.args)
        return f"casadi.if_else({condition}, {value}, {otherwise})"

    def _print_And(self, expr: sympy.And) -> str:
        return self._nested("casadi.logic_and", expr)

    def _print_Or(self, expr: sympy.Or) -> str:
        return self._nested("casadi.logic_or", expr)

    def _nested(self, function: str, expr: sympy.Basic) -> str:
        """A function of two arguments, applied over and over."""
        text, *rest = (self._print(part) for part in expr.args)
        for part in rest:
            text = f"{function}({text}, {part})"
        return text

    def _print_Function(self, expr: sympy.Function) -> str:
        return f"{FUNCTIONS[type(expr).__name__]}({', '.join(self._print(part) for part in expr.args)})"
