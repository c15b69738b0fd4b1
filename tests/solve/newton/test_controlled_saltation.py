"""Closed loops with a discontinuous force: multipliers compared with those of equal machines without
feedback."""

import numpy as np
import pytest

import solve
from derive import Heaviside, Mechanism, cos, rate

GIVEN = {"m": 1.0, "k": 4.0, "c": 0.3, "F": 3.0, "R": 0.4, "g": 0.1}


def pushed():
    """Mass on a spring with a force that is zero beyond a distance."""
    made = Mechanism("pushed", "A mass with a force that jumps at a distance")
    q = made.coordinate("q", "m", "position")
    m, k, c = made.parameters(m=("kg", "mass", "> 0"), k=("N/m", "spring", "> 0"), c=("N s/m", "damping"))
    F, R, g = made.parameters(F=("N", "load"), R=("N", "push"), g=("m", "distance", "> 0"))
    made.kinetic, made.potential, made.dissipation = m * rate(q) ** 2 / 2, k * q**2 / 2, c * rate(q) ** 2 / 2
    made.force(F * cos(made.phase) - R * Heaviside(q - g), along=q)
    made.input("u", "N", along=q)
    return made


@pytest.mark.slow
def test_feedback_equals_additional_stiffness_and_damping():
    model = solve.load(pushed, **GIVEN)
    loop = solve.OutputFeedback(model, ["q", "q_dot"]).varied({"u_by_q": 0.7, "u_by_q_dot": 0.4})
    stiffer = model.varied({"k": GIVEN["k"] + 0.7, "c": GIVEN["c"] + 0.4})
    found, expected = (solve.nonlinear(each, 1.0, rtol=1e-6) for each in (loop, stiffer))
    assert found.statistics("q").max > GIVEN["g"] > found.statistics("q").min
    assert np.abs(found.multipliers - expected.multipliers).max() < 1e-5 * abs(expected.multipliers[0])
    # A filter without gain adds its own multipliers, exp(-π ω).
    filtered = solve.OutputFeedback(stiffer, ["q"], notches=["3 rad/s"])
    multipliers = solve.nonlinear(filtered, 1.0, rtol=1e-6).multipliers
    assert np.abs(multipliers[:2] - expected.multipliers).max() < 1e-5 * abs(expected.multipliers[0])
