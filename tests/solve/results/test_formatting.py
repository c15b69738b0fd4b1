"""Units with prefixes, and rounding of numbers."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from solve.results.formatting import fixed, prefixed


@pytest.mark.parametrize(
    ("unit", "magnitude", "shown"),
    [
        ("m", 7.0e-6, "µm"),
        ("m", 0.205, "mm"),
        ("m", 1200.0, "m"),
        ("N m", 2.57e6, "MN m"),
        ("N", 999.0, "N"),
        ("N", 1000.0, "kN"),
        ("m/s", 0.0167, "mm/s"),
        ("rad", 0.867, "mrad"),
        ("rad", 20.0, "rad"),
        ("s", 1e-20, "ps"),
        ("1", 1e-3, ""),
        ("m^2", 1e-6, "m^2"),
        ("1/s", 1e-6, "1/s"),
        ("kg m^2", 1e-6, "kg m^2"),
        ("min", 1e-6, "min"),
        ("", 1e-6, ""),
        ("m", 0.0, "m"),
        ("m", math.nan, "m"),
    ],
)
def test_unit_prefixes_and_factors(unit, magnitude, shown):
    factor, label = prefixed(unit, magnitude)
    assert label == shown
    prefixes = {"µm": 1e6, "mm": 1e3, "MN m": 1e-6, "kN": 1e-3, "mm/s": 1e3, "mrad": 1e3, "ps": 1e12}
    assert factor == pytest.approx(prefixes.get(shown, 1.0), rel=1e-15)


@given(st.floats(min_value=1e-12, max_value=1e11))
def test_prefixed_numbers_lie_between_1_and_1000(magnitude):
    factor, _ = prefixed("N", magnitude)
    assert 0.999999 <= magnitude * factor < 1000.001


@pytest.mark.parametrize(
    ("value", "magnitude", "text"),
    [
        (768.45217, 866.6075, "768.4522"),
        (-0.00012, 2.079, "-0.000120"),
        (-1e-12, 2.079, "0.000000"),
        (0.0, 0.0, "0.000000"),
        (1234567.8, 1234567.8, "1.2346e+06"),
        (0.0, 1e9, "0"),
        (math.nan, 1.0, "–"),
    ],
)
def test_fixed_decimals_follow_the_magnitude(value, magnitude, text):
    assert fixed(value, magnitude) == text
