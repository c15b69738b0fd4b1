"""SymPy expressions as Python text on CasADi symbols."""

import sympy
from sympy.printing.pycode import AbstractPythonCodePrinter

from derive.errors import UnsupportedExpressionError

SAME = ("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "exp", "log", "sign")
HYPERBOLIC = ("sinh", "cosh", "tanh", "asinh", "acosh", "atanh")
FUNCTIONS = {"Abs": "casadi.fabs", **{name: f"casadi.{name}" for name in SAME + HYPERBOLIC}}


class CasadiPrinter(AbstractPythonCodePrinter):
    """Prints with `casadi.` and `math.` before each function; rationals stay exact until Python divides."""

    def __init__(self) -> None:
        super().__init__({"user_functions": FUNCTIONS, "precision": 17, "fully_qualified_modules": False})

    def _print_Pow(self, expr: sympy.Pow, rational: bool = False) -> str:
        if expr.exp == sympy.S.Half and not rational:
            return f"casadi.sqrt({self._print(expr.base)})"
        if expr.exp == -sympy.S.Half and not rational:
            return f"1/casadi.sqrt({self._print(expr.base)})"
        return super()._print_Pow(expr, rational=rational)

    def _print_Pi(self, expr: sympy.Basic) -> str:
        return "math.pi"

    def _print_Exp1(self, expr: sympy.Basic) -> str:
        return "math.e"

    def _print_Max(self, expr: sympy.Max) -> str:
        return self._nest("casadi.fmax", expr)

    def _print_Min(self, expr: sympy.Min) -> str:
        return self._nest("casadi.fmin", expr)

    def _nest(self, function: str, expr: sympy.Basic) -> str:
        first, *rest = (self._print(part) for part in expr.args)
        for part in rest:
            first = f"{function}({first}, {part})"
        return first

    def _print_Function(self, expr: sympy.Function) -> str:
        name = type(expr).__name__
        if name not in FUNCTIONS:
            raise UnsupportedExpressionError(
                f"{expr} cannot be generated; known functions: {', '.join(sorted(FUNCTIONS))}, sqrt, Max, Min"
            )
        return f"{FUNCTIONS[name]}({', '.join(self._print(part) for part in expr.args)})"

    def emptyPrinter(self, expr: object) -> str:
        raise UnsupportedExpressionError(f"{expr} ({type(expr).__name__}) cannot be generated")
