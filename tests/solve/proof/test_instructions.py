"""CasADi functions evaluated on balls, discs and power series."""

import math

import casadi
import pytest

pytest.importorskip("flint")

from solve.errors import LinearModelError
from solve.proof.balls import acb, arb, arb_series, precision
from solve.proof.instructions import ANY, Instructions, UndecidedError

x = casadi.SX.sym("x")
SMOOTH = {
    "polynomial": 3 - 2 * x + x**3,
    "quotient": (1 + x) / (3 + x**2),
    "roots": casadi.sqrt(2 + x) * (3 + x) ** 0.3,
    "exponentials": casadi.exp(x) + casadi.log(2 + x) + casadi.sinh(x) + casadi.tanh(x),
    "circular": casadi.sin(x) * casadi.cos(2 * x) + casadi.tan(x / 2),
    "inverse": casadi.asin(x / 2) + casadi.acos(x / 3) + casadi.atan(2 * x),
    "angle": casadi.atan2(x, 2 + x) + casadi.atan2(2 + x, x) + casadi.atan2(-2 - x, x),
}
PIECES = {
    "modulus": casadi.fabs(x - 0.5),
    "sign": casadi.sign(x - 0.5) * x,
    "floor": casadi.floor(3 * x) + casadi.ceil(2 * x),
    "remainder": casadi.fmod(x + 4, 1.5),
    "extrema": casadi.fmin(x, 0.3) + casadi.fmax(x**2, 0.2),
    "choice": casadi.if_else(x < 0.4, x**2, 1 - x),
    "logic": casadi.if_else(casadi.logic_and(x > 0.1, casadi.logic_not(x <= 0.2)), 2 * x, 5),
}


def evaluated(expression, number, outcomes=None):
    (((_, _, value),),), computed = Instructions.from_function(casadi.Function("f", [x], [expression]))(
        [[number]], outcomes
    )
    return value, computed


@pytest.mark.parametrize("name", [*SMOOTH, *PIECES])
@pytest.mark.parametrize("at", [0.07, 0.31, 0.83])
def test_ball_contains_the_value(name, at):
    expression = {**SMOOTH, **PIECES}[name]
    exact = float(casadi.Function("f", [x], [expression])(at))
    value, _ = evaluated(expression, arb(at))
    assert value.overlaps(arb(exact, 4e-15))
    wide, _ = evaluated(expression, arb(at, 1e-3), ANY)
    assert wide.overlaps(arb(exact, 4e-15))


@pytest.mark.parametrize("name", SMOOTH)
def test_power_series_has_the_derivatives_of_casadi(name):
    with precision(100, 4):
        _, outcomes = evaluated(SMOOTH[name], arb(0.31))
        series, _ = evaluated(SMOOTH[name], arb_series([arb(0.31), 1]), outcomes)
        expression = SMOOTH[name]
        for order in range(4):
            exact = float(casadi.Function("f", [x], [expression])(0.31)) / math.factorial(order)
            assert series[order].overlaps(arb(exact, 1e-12 * max(1.0, abs(exact)))), order
            expression = casadi.jacobian(expression, x)


@pytest.mark.parametrize("name", SMOOTH)
def test_disc_contains_the_function_values(name):
    _, outcomes = evaluated(SMOOTH[name], arb(0.31))
    disc, _ = evaluated(SMOOTH[name], acb(arb(0.31, 0.1), arb(0, 0.1)), outcomes)
    for angle in range(12):
        z = 0.31 + 0.1 * complex(math.cos(angle), math.sin(angle))
        value, _ = evaluated(SMOOTH[name], acb(z.real, z.imag), outcomes)
        assert disc.overlaps(value)


@pytest.mark.parametrize(
    "expression",
    [
        casadi.sqrt(x),
        casadi.log(x),
        x**0.5,
        casadi.asin(1 + x),
        casadi.acos(1 + x),
        1 / x,
    ],
)
def test_disc_around_a_singularity_has_no_bound(expression):
    value, _ = evaluated(expression, acb(arb(0.1, 0.2), arb(0, 0.2)), ())
    assert not value.is_finite()


def test_disc_around_i_has_no_bound_for_atan():
    value, _ = evaluated(casadi.atan(x), acb(arb(0.0, 0.1), arb(1.0, 0.1)), ())
    assert not value.is_finite()


@pytest.mark.parametrize(
    ("name", "at"),
    [
        ("modulus", 0.5),
        ("floor", 1 / 3),
        ("remainder", 0.5),
        ("choice", 0.4),
        ("extrema", 0.3),
        ("logic", 0.2),
    ],
)
def test_comparison_with_several_outcomes_is_undecided(name, at):
    with pytest.raises(UndecidedError):
        evaluated(PIECES[name], arb(at, 1e-3))
    hull, _ = evaluated(PIECES[name], arb(at, 1e-3), ANY)
    function = casadi.Function("f", [x], [PIECES[name]])
    for near in (at - 5e-4, at + 5e-4):
        assert hull.overlaps(arb(float(function(near)), 1e-14))


def test_unsupported_operation_is_refused():
    with pytest.raises(LinearModelError, match="OP_ERF"):
        Instructions.from_function(casadi.Function("f", [x], [casadi.erf(x)]))
