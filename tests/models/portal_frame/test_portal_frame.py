"""Portal frame: dependence of the frequencies on parameters, and half frame compared with whole frame."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import solve

POSITIVE = st.floats(0.2, 5.0)


def values(count=6, element="dynamic", elements=1, **parameters):
    model = solve.load("portal_frame", options={"element": element, "elements": elements}, **parameters)
    return solve.frequencies(model, count=count).values[0]


BASE = values()
CASE = solve.load("portal_frame").parameters


@settings(max_examples=15, deadline=None)
@given(st.fixed_dictionaries(dict.fromkeys(CASE, POSITIVE)))
def test_all_frequencies_scale_with_the_same_factor(factors):
    """Because its bars only bend, ω is proportional to √(EI/ρA)/L²."""
    scaled = {name: factors[name] * CASE[name] for name in CASE}
    ratio = np.sqrt(factors["E"] * factors["I"] / (factors["rho"] * factors["A"])) / factors["L"] ** 2
    np.testing.assert_allclose(values(**scaled), ratio * BASE, rtol=1e-9)


def test_portal_frame_does_not_move():
    model = solve.load("portal_frame")
    assert model.module.MOVES is False
    joints = model.at_positions(np.array([0.0])).joints
    np.testing.assert_allclose(joints, [[0, 1j, 1 + 1j, 1]], atol=1e-15)


def test_symmetric_modes_match_half_the_frame():
    """In half the frame, the middle of the beam can move vertically but cannot rotate."""
    from scipy.optimize import brentq

    a = 17.6632297

    def corner(x):
        """Rotational stiffness of the corner: that of the bar to the foot and that of the symmetrically bent
        beam."""
        S, C, s, c = np.sinh(x), np.cosh(x), np.sin(x), np.cos(x)
        bar = x * (C * s - S * c) / (1 - C * c)
        beam = x * (C * s - S * c - S + s) / (1 - C * c)
        return bar + beam

    first = brentq(corner, 3.0, 4.0, xtol=1e-14)
    assert BASE[1] == pytest.approx(a * first**2, rel=1e-8)


@pytest.mark.parametrize("element", ["cubic", "internal", "curvature"])
def test_finite_elements_bound_the_frequencies_from_above(element):
    computed = values(element=element, elements=4)
    assert (computed > BASE * (1 - 1e-10)).all()
    np.testing.assert_allclose(computed, BASE, rtol=8e-3 if element == "cubic" else 1e-5)
