"""Periods that are proved from the instructions of a function."""

import math
from fractions import Fraction

import casadi
import pytest

pytest.importorskip("flint")

import solve
from solve.proof.instructions import Instructions
from solve.proof.periodicity import repeats
from solve.proof.prove import prove

x = casadi.SX.sym("x")
SHOWN = {
    "waves": casadi.sin(3 * x) * casadi.cos(x - 0.7) + casadi.cos(x + x),
    "quotient": (1 + casadi.cos(x)) / (3 + casadi.sin(4 * x / 2)),
    "halves": casadi.cos(x / 2) ** 2
    + casadi.sin(x / 2) * casadi.cos(1.5 * x)
    + casadi.fabs(casadi.sin(x / 2)),
    "odd": casadi.cos(casadi.atan(casadi.tan(x / 4 + x / 4) + 0 * x)) + casadi.exp(casadi.sin(-x)),
    "cancelled": x - (x + casadi.sin(x)),
}
OPEN = {
    "phase": x + casadi.sin(x),
    "half wave": casadi.sin(x / 2),
    "irrational": casadi.cos(1.1 * x),
    "rounded": casadi.floor(x / (2 * math.pi)) * 2 * math.pi - x,
    "reciprocal": casadi.cos(1 / x),
    "constant over phase": casadi.sin(2 / x),
    "square": casadi.sin(x**2),
    "sum of half wave and wave": casadi.sin(x / 2) + casadi.cos(x),
}


def is_proved_periodic(expression, period=Fraction(2)):
    return repeats(Instructions.from_function(casadi.Function("f", [x], [expression])), period)


@pytest.mark.parametrize("name", SHOWN)
def test_proved_periods_are_true_periods(name):
    assert is_proved_periodic(SHOWN[name])
    function = casadi.Function("f", [x], [SHOWN[name]])
    for at in (0.3, 1.1, 2.9, 4.0):
        assert float(function(at + 2 * math.pi)) == pytest.approx(float(function(at)), abs=1e-12)


@pytest.mark.parametrize("name", OPEN)
def test_function_without_an_exact_period_has_no_proved_period(name):
    assert not is_proved_periodic(OPEN[name])


@pytest.mark.parametrize("name", SHOWN)
def test_incommensurate_functions_have_no_proved_period(name):
    assert not is_proved_periodic(SHOWN[name], Fraction(201, 100))


def test_assumption_states_the_unproved_periods():
    assert "continued periodically" not in prove(solve.load("mathieu"), 1.0, orbit=False).assumed
    assert "continued periodically" in prove(solve.load("meissner"), 1.0, orbit=False).assumed
