"""Model of Meissner's equation: half the sum of the multipliers is J2 of Eq. (7.11) of the thesis."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import solve

frequencies = st.floats(0.1, 9.0)


def meissners_function(x1, x2):
    mean = (x1 / x2 + x2 / x1) / 2
    return np.cos(x1) * np.cos(x2) - mean * np.sin(x1) * np.sin(x2)


@given(frequencies, frequencies)
@settings(max_examples=25)
def test_half_the_sum_of_the_multipliers_is_j2(x1, x2):
    stability = solve.floquet(solve.load("meissner", w1=x1, w2=x2), "3.141592653589793 rad/s", rtol=1e-11)
    assert stability.multipliers.sum().real / 2 == pytest.approx(
        meissners_function(x1, x2), rel=1e-8, abs=1e-8
    )


@given(frequencies, frequencies, st.floats(0.2, 0.8), st.floats(0.5, 5.0))
@settings(max_examples=25)
def test_multipliers_match_the_closed_form_at_other_shares_and_speeds(w1, w2, share, speed):
    x1, x2 = 2 * np.pi * share * w1 / speed, 2 * np.pi * (1 - share) * w2 / speed
    mean = (w1 / w2 + w2 / w1) / 2
    half = np.cos(x1) * np.cos(x2) - mean * np.sin(x1) * np.sin(x2)
    stability = solve.floquet(solve.load("meissner", w1=w1, w2=w2, share=share), speed, rtol=1e-11)
    assert stability.multipliers.sum().real / 2 == pytest.approx(half, rel=1e-7, abs=1e-7)


def test_cases_agree_with_their_titles():
    assert solve.floquet(solve.load("meissner", "stable"), np.pi).verdict == "stable"
    assert solve.floquet(solve.load("meissner", "unstable"), np.pi).verdict == "unstable"


@pytest.mark.slow
def test_j2_is_plus_or_minus_one_on_the_boundaries():
    """On the boundaries of a chart, J2 equals the multiplier, +1 or −1."""
    chart = solve.chart(solve.load("meissner"), x={"w1": np.linspace(0.2, 6.2, 25)}, y={"w2": [1.9, 2.0]})
    assert sum(len(points) for _, points in chart.boundaries) >= 6
    for name, points in chart.boundaries:
        for x1, x2 in points:
            assert meissners_function(x1, x2) == pytest.approx(float(name), abs=1e-5)
