"""Conversion of numbers with units."""

import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from solve.arguments import checked_rtol
from solve.errors import UnitError, ValueOutOfBoundsError
from solve.units import conversion, speed_in_si, speeds_in_si, with_unit

positive = st.floats(1e-6, 1e9)
TURN = 2 * math.pi
ROTATION = {
    "rpm": TURN / 60, "rad/s": 1.0, "Hz": TURN, "kHz": 1e3 * TURN, "mHz": 1e-3 * TURN, "hertz": TURN,
    "deg/s": TURN / 360, "turn/s": TURN, "turn/min": TURN / 60, "1/s": 1.0,
}  # fmt: skip


@given(positive, st.sampled_from(sorted(ROTATION)))
def test_speeds_are_read_in_every_unit_of_rotation(number, unit):
    assert speed_in_si(f"{number!r} {unit}") == pytest.approx(number * ROTATION[unit], rel=1e-14)


@given(positive, st.sampled_from(sorted(ROTATION)), st.sampled_from(sorted(ROTATION)))
def test_unit_conversions_are_reversible(number, first, second):
    there = with_unit(f"{number!r} {first}", "rad/s") / conversion(second, "rad/s")
    back = there * conversion(second, "rad/s") / conversion(first, "rad/s")
    assert back == pytest.approx(number, rel=1e-13)


@pytest.mark.parametrize(
    ("given", "unit", "size"),
    [
        ("mm", "m", 1e-3),
        ("kg cm^2", "kg m^2", 1e-4),
        ("N mm/deg", "N m/rad", 0.18 / math.pi),
        ("GPa", "N/m^2", 1e9),
        ("kN/mm", "N/m", 1e6),
        ("deg", "rad", math.pi / 180),
        ("%", "1", 0.01),
        ("N m", "J", 1.0),
        ("rpm", "Hz", 1 / 60),
        ("N s/m", "kg/s", 1.0),
    ],
)
def test_units_of_case_values_are_converted(given, unit, size):
    assert conversion(given, unit) == pytest.approx(size, rel=1e-14)


@given(st.floats(1e-3, 1e6))
def test_float_is_a_speed_in_radians_per_second(speed):
    assert speed_in_si(speed) == speed


@pytest.mark.parametrize("text", ["600", "", "rpm", "fast rpm", "fastrpm", "6,5 rpm"])
def test_speed_without_a_number_or_unit_is_refused(text):
    with pytest.raises(UnitError, match=rf"^'{text}' .*write it like '600 rpm'$"):
        speed_in_si(text)


@pytest.mark.parametrize(
    "unit", ["m", "N", "furlongs", "RPM", "rev/s", "rpm rpm", "2 rpm", "__import__('os')"]
)
def test_units_of_another_kind_are_refused(unit):
    with pytest.raises(UnitError, match=r"does not convert to 'rad/s'"):
        speed_in_si(f"600 {unit}")


@pytest.mark.parametrize("unit", ["1/min", "1/hour"])
def test_ambiguous_speed_units_are_refused(unit):
    with pytest.raises(UnitError, match=r"may count revolutions or radians; write rpm, Hz or rad/s"):
        speed_in_si(f"600 {unit}")


@pytest.mark.parametrize(
    ("given", "unit"), [("degC", "K"), ("m*2", "m"), ("12", "m"), ("", "m"), ("kg", "N")]
)
def test_incompatible_units_are_refused(given, unit):
    with pytest.raises(UnitError, match=f"^unit '{re.escape(given)}' .*'{unit}'"):
        conversion(given, unit)


@pytest.mark.parametrize(
    "speed", [0.0, -1.0, math.nan, math.inf, "0 rpm", "-5 rpm", "nan rpm", "inf Hz", None]
)
def test_speeds_that_are_not_finite_and_positive_are_refused(speed):
    with pytest.raises(ValueOutOfBoundsError, match=rf"speed is {speed}; allowed: finite and > 0"):
        speed_in_si(speed)


@given(st.floats(1.0, 1e3), st.floats(1.0, 1e3), st.integers(2, 50))
def test_ranges_of_speeds_include_both_ends_with_equal_steps(first, last, count):
    speeds = speeds_in_si(f"{first!r}:{last!r}:{count} rpm")
    assert len(speeds) == count
    assert speeds[0] == pytest.approx(first * TURN / 60)
    assert speeds[-1] == pytest.approx(last * TURN / 60)
    middle = (speeds[0] + speeds[-1]) / 2
    assert sum(speeds) / count == pytest.approx(middle)


def test_lists_of_speeds_are_read():
    assert speeds_in_si("600 900 1200 rpm") == pytest.approx([20 * math.pi, 30 * math.pi, 40 * math.pi])
    assert speeds_in_si("10 Hz") == pytest.approx([20 * math.pi])


@pytest.mark.parametrize(
    "text",
    ["", "rpm", "600:900:4", "600:900 rpm", "a:b:3 rpm", "600:900:2.5 rpm", "600:900:1 rpm", "1:2:3:4 rpm"],
)
def test_invalid_ranges_of_speeds_are_refused_with_an_example(text):
    with pytest.raises(
        (UnitError, ValueOutOfBoundsError), match=r"give 'A:B:N unit' or numbers with one unit"
    ):
        speeds_in_si(text)


def test_range_through_zero_is_refused():
    with pytest.raises(ValueOutOfBoundsError, match="allowed: finite and > 0"):
        speeds_in_si("0:900:4 rpm")


@pytest.mark.parametrize("rtol", [0.0, -1e-8, 1.0, 1e-15, math.nan, math.inf, None, "1e-8"])
def test_invalid_tolerances_are_refused(rtol):
    with pytest.raises(ValueOutOfBoundsError, match=rf"rtol is {rtol}; allowed: 1e-14 up to"):
        checked_rtol(rtol)


def test_valid_tolerances_are_unchanged():
    assert [checked_rtol(rtol) for rtol in (1e-14, 1e-8, 0.5)] == [1e-14, 1e-8, 0.5]


@pytest.mark.parametrize(
    ("text", "omega"),
    [("600rpm", 20 * math.pi), ("62.8rad/s", 62.8), ("1e1Hz", 20 * math.pi), ("1e3 rpm", 100 * math.pi / 3)],
)
def test_unit_may_follow_its_number_without_a_space(text, omega):
    assert speed_in_si(text) == pytest.approx(omega, rel=1e-15)
    assert speeds_in_si(text) == [speed_in_si(text)]


def test_ranges_of_speeds_may_omit_the_space():
    assert speeds_in_si("100:300:3rpm") == speeds_in_si("100:300:3 rpm")
    assert speeds_in_si("100 200rpm") == speeds_in_si("100 200 rpm")


@pytest.mark.parametrize(
    "unit",
    [
        "kg**(9**9**9)",
        "m*9**9**9",
        "m^999",
        "m**9**9",
        "m^2^3",
        "(" * 3000,
        "m " * 3000,
        "m/" * 50 + "s",
        "((m))",
        "m^-",
    ],
)
def test_unit_texts_are_never_evaluated(unit):
    with pytest.raises(UnitError, match="does not convert to 'm'; allowed: units of the same kind"):
        conversion(unit, "m")


@pytest.mark.parametrize(
    ("given", "unit", "size"),
    [("N/(m s)", "kg/s^3", 1.0), ("kg * mm**2 / s", "kg m^2/s", 1e-6), ("(mm/s)^2", "m^2/s^2", 1e-6)],
)
def test_units_may_contain_one_pair_of_brackets(given, unit, size):
    assert conversion(given, unit) == pytest.approx(size, rel=1e-14)


@pytest.mark.parametrize("speed", [1e61, 1e-61, 5e-324, "1e300 rpm", "1e-300 Hz"])
def test_speeds_beyond_the_numeric_range_are_refused(speed):
    with pytest.raises(ValueOutOfBoundsError, match=r"allowed: 0, or 1e-60 … 1e\+60 in magnitude"):
        speed_in_si(speed)
