"""Sliders of the live window: ranges, and values typed with units."""

import pytest

import solve
from solve.model.bounds import clauses, holds
from solve.units import RPM, speed_in_si
from solve.views.live import controls


@pytest.mark.parametrize("model", ["cam", "manipulator", "gear_pair", "mathieu", "meissner", "coupler"])
def test_slider_ends_satisfy_the_bounds_of_their_parameters(model):
    loaded = solve.load(model)
    for control in controls.controls_of(loaded, controls.first_speed(loaded, None)):
        span = control.range
        assert span.low <= control.value <= span.high, control.name
        assert span.low < span.high, control.name
        for end in (span.low, span.high):
            assert all(holds(clause, end) for clause in clauses(control.bound)), (control.name, end)


@pytest.mark.parametrize(
    ("value", "bound", "low", "high"),
    [
        (2.0, "> 0", 0.2, 20.0),
        (0.0, ">= 0", 0.0, 3.0),
        (-2.0, "", -6.0, 2.0),
        (0.25, ">= 0, <= 1", 0.0, 1.0),
        (14.0, "integer, >= 1", 1.0, 42.0),
    ],
)
def test_range_of_a_slider_follows_the_bound(value, bound, low, high):
    span = controls.parameter_range(value, bound, 3.0)
    assert (span.low, span.high) == (low, high)
    assert span.integer == ("integer" in bound)


def test_open_bound_is_excluded_from_the_slider():
    span = controls.parameter_range(0.5, "> 0, < 1", 1.0)
    assert 0 < span.low < 0.01
    assert 0.99 < span.high < 1


def test_initial_speed_is_that_of_the_case_or_below_resonance():
    assert controls.first_speed(solve.load("manipulator"), None) == speed_in_si("50 rpm")
    assert controls.first_speed(solve.load("cam"), "600 rpm") == speed_in_si("600 rpm")
    lowest = solve.frequencies(solve.load("cam")).values.min()
    assert controls.first_speed(solve.load("cam"), None) == pytest.approx(0.1 * lowest, rel=0.05)


@pytest.mark.parametrize(
    ("name", "text", "value"),
    [
        ("k1", "90000", 9e4),
        ("k1", "90 kN m/rad", 9e4),
        ("a1", "200mm", 0.2),
        ("speed", "5 Hz", 300.0),
        ("speed", "450", 450.0),
        ("speed", "450 rpm", 450.0),
    ],
)
def test_typed_values_are_converted_to_the_unit_of_the_slider(name, text, value):
    assert controls.typed(solve.load("cam"), name, text, RPM) == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("k1", "soft", "k1 is 'soft'; give a number, in N m/rad unless a unit follows"),
        ("k1", "3 m", "k1: unit 'm' does not convert to 'N m/rad'"),
        ("k1", "-3", "k1 (torsional stiffness of the shaft) is -3 N m/rad; allowed: > 0"),
        ("speed", "3 kg", "unit 'kg' does not convert to 'rad/s'"),
        ("speed", "-3", "speed is -3"),
        ("k9", "3", "unknown parameter of cam 'k9'"),
    ],
)
def test_invalid_input_is_refused_in_one_sentence(name, text, message):
    with pytest.raises(solve.SolveError) as refusal:
        controls.typed(solve.load("cam"), name, text, RPM)
    assert message in str(refusal.value)
