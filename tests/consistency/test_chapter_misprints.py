"""Misprints of chapter Eqs. (52) and (61): how far the printed equations are from Lagrange's.

Cam, case 1, at phase 0: sines vanish, so that U′ = Σ aₖ, U″ = 0 and U‴ = −Σ k² aₖ can be written down.
"""

import numpy as np
import pytest
from chapter import built, sampled, vector

import solve
from models.cam import published

SLOPE = 0.22165 + 0.05560 - 0.01706  # U′(0), m
THIRD = -(0.22165 + 9 * 0.05560 - 25 * 0.01706)  # U‴(0), m
FOLLOWERS, OUTPUT_LINK = 28 + 50, 50  # m2 + m3 and m3, kg
ORIGIN = np.zeros(1)


@pytest.fixture(scope="module")
def cam():
    return solve.load("cam", case="1").parameters


def test_printed_61_omits_or_inverts_the_shaft_coupling(cam):
    derived = sampled(built("cam", "linearised"), ORIGIN, 20 * np.pi, vector("cam", cam))[0][0]
    printed = published.mass_as_printed_61(ORIGIN, cam)[0]
    assert derived[0, 1:] == pytest.approx([FOLLOWERS * SLOPE, OUTPUT_LINK * SLOPE], rel=1e-12)
    assert printed[0, 1:] == pytest.approx([0.0, OUTPUT_LINK * THIRD], rel=1e-12)
    assert np.array_equal(derived, derived.T), "a mass matrix from a kinetic energy is symmetric"
    assert printed[0, 1] - printed[1, 0] == pytest.approx(-20.29482, rel=1e-6)
    assert printed[0, 2] - printed[2, 0] == pytest.approx(-27.787, rel=1e-6)


def test_printed_52_lacks_the_torque_of_an_accelerated_follower(cam):
    """For q̈2 = 1 m/s² with all other motion zero, (52) lacks (m2 + m3) U′(0) = 20.29 N m."""
    rest, accelerated = np.zeros((1, 3)), np.array([[0.0, 1.0, 0.0]])
    state = (ORIGIN, 20 * np.pi, rest, rest, accelerated)
    derived = built("cam", "residual")(0, 20 * np.pi, rest[0], rest[0], accelerated[0], vector("cam", cam))
    corrected = published.residual(*state, cam)[0]
    printed = published.residual(*state, cam, as_printed=True)[0]
    assert np.array(derived).ravel() == pytest.approx(corrected, rel=1e-12)
    assert printed - corrected == pytest.approx([-FOLLOWERS * SLOPE, 0, 0], rel=1e-9)


def test_corrected_52_to_54_equal_the_derived_residual(cam):
    generator = np.random.default_rng(52)
    phase, speed = generator.uniform(0, 2 * np.pi, 200), 20 * np.pi
    q, qd, qdd = generator.uniform(-2, 2, (3, 200, 3)) * [0.5, 1e-3, 1e-3]
    derived = built("cam", "residual")(phase[None], speed, q.T, qd.T, qdd.T, vector("cam", cam)).full().T
    by_hand = published.residual(phase, speed, q, qd, qdd, cam)
    assert np.abs(derived - by_hand).max(axis=0) == pytest.approx(0, abs=1e-12 * np.abs(by_hand).max())
