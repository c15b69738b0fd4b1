"""SymPy expressions as CasADi code: every supported function has the value of SymPy's function."""

import math

import casadi
import pytest
import sympy

from derive.errors import UnsupportedExpressionError
from derive.printer import FUNCTIONS, CasadiPrinter

x, y = sympy.symbols("x y", real=True)
WITHIN = {"acosh": 1.7, "log": 0.3}


def evaluated(expression: sympy.Expr, x_value: float, y_value: float) -> float:
    """Value of the printed code with CasADi symbols."""
    symbols = {"x": casadi.SX.sym("x"), "y": casadi.SX.sym("y"), "casadi": casadi, "math": math}
    text = CasadiPrinter().doprint(expression)
    function = casadi.Function("f", [symbols["x"], symbols["y"]], [eval(text, symbols)])
    return float(function(x_value, y_value))


@pytest.mark.parametrize("name", sorted(FUNCTIONS))
def test_elementary_functions_are_printed_with_their_values(name):
    arguments = (x, y) if name == "atan2" else (x,)
    expression = getattr(sympy, name)(*arguments)
    at = WITHIN.get(name, -0.3 if name in ("Abs", "sign", "atan2") else 0.4)
    expected = float(expression.subs({x: at, y: -1.2}))
    assert evaluated(expression, at, -1.2) == pytest.approx(expected, rel=1e-15)


@pytest.mark.parametrize(
    "expression",
    [
        x / 3 - 2 * y / 7,
        sympy.sqrt(x**2 + y**2) / sympy.sqrt(x),
        1 / sympy.sqrt(x * y**2),
        (x + y) ** -3 * x**5,
        x ** sympy.Rational(3, 2),
        -((x - y) ** 2) / (1 + x),
        sympy.pi * x + sympy.E * y,
        sympy.Max(x, y, 0) - sympy.Min(x, y, -1),
        0.1 * x + sympy.Float("1e-30") * y,
        sympy.exp(-x) * x**y,
        sympy.Piecewise((x, y > 1), (y, sympy.And(x > 1, y < 0.8)), (2, True)),
        sympy.Piecewise((x, sympy.Or(y >= 1, x <= 1)), (y, True)),
        sympy.Heaviside(x - y) + 2 * sympy.Heaviside(y - x),
    ],
)
def test_arithmetic_is_printed_with_its_value(expression):
    expected = float(expression.subs({x: 1.25, y: 0.75}).evalf(30))
    assert evaluated(expression, 1.25, 0.75) == pytest.approx(expected, rel=4e-16)


def test_rational_numbers_are_printed_exactly():
    assert CasadiPrinter().doprint(x / 3) == "(1/3)*x"


@pytest.mark.parametrize(
    "expression", [sympy.gamma(x), sympy.Piecewise((x, sympy.Eq(y, 0)), (y, True)), sympy.I * x]
)
def test_unsupported_expressions_are_refused(expression):
    with pytest.raises(UnsupportedExpressionError, match="cannot be generated"):
        CasadiPrinter().doprint(expression)
