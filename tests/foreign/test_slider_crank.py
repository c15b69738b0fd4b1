"""Slider-crank of the Test Set: equations from energies, compared with those of Simeon."""

import numpy as np
import pytest

import solve
from tests.foreign import slider_crank
from tests.foreign.initial_values import crank


@pytest.mark.slow
def test_equations_match_those_of_the_published_set():
    """At random states, the differences are below 1e-12 of the largest of the four values."""
    model = solve.load(slider_crank.mechanism, **slider_crank.NUMBERS)
    residual = model.setup.function("residual")
    rng = np.random.default_rng(19)
    for _ in range(50):
        phase = rng.uniform(0, 2 * np.pi)
        q, qd, qdd = (scale * rng.standard_normal(4) for scale in (1e-3, 0.5, 1e2))
        theirs = slider_crank.equations(phase, slider_crank.SPEED, q, qd, qdd)
        ours = residual(phase, slider_crank.SPEED, q, qd, qdd, model.setup.p).full()[:, 0]
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-12 * np.abs(theirs).max())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "value", "off"),
    [
        ("phi2", -0.3311734987910881, 1e-6),
        ("x3", 0.1697373326718410, 1e-6),
        ("q1", 1.893192460247178e-4, 1e-6),
        ("q3", -5.323907988763734e-6, 3e-6),
    ],
)
def test_second_reference_is_matched_within_its_accuracy(name, value, off):
    """The two references differ by 2.1e-6 in q3."""
    assert crank(name) == pytest.approx(value, rel=off)
