"""Norms of periodic systems: closed forms, a covariance integrated by SciPy, and gains versus frequency."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import solve
from solve.errors import ControlError, MissingValueError, UnknownNameError


def oscillator(epsilon):
    """q̈ + 0.2 q̇ + (4 + ε cos φ) q = u."""

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        stiffness = (4 + epsilon * np.cos(phase))[:, None, None]
        return one, 0.2 * one, stiffness, np.zeros((len(phase), 1)), one

    return solve.PeriodicSystem(matrices, ["q"], inputs=["u"])


def test_norms_of_a_constant_oscillator_match_closed_forms():
    variance = solve.h2_norm(oscillator(0.0), 1.0, ["q"])
    assert variance.value**2 == pytest.approx(1 / (2 * 0.2 * 4), rel=1e-9)
    gain = solve.hinf_norm(oscillator(0.0), 1.0, ["q"])
    exact = 1 / np.sqrt(0.2**2 * 4 - 0.2**4 / 4)
    assert abs(gain.value - exact) <= gain.error * exact
    # The resonance √3.98 rad/s is 2 - 0.00501 rad/s.
    assert gain.frequency == pytest.approx(2 - np.sqrt(3.98), abs=1e-5)


def test_largest_gain_of_a_lag_is_at_frequency_zero():
    """x′ = -0.1 x + u."""

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        return -0.1 * one, np.zeros((len(phase), 1)), one, one, 0 * one

    made = solve.FirstOrderSystem(matrices, ["x"], inputs=["u"], outputs=["y"])
    found = solve.hinf_norm(made, 1.0, ["y"])
    assert found.value == pytest.approx(10.0, rel=1e-6)
    assert found.frequency == 0.0


def test_h2_norm_matches_the_integrated_covariance():
    found = solve.h2_norm(oscillator(1.0), 1.0, ["q"])

    def rates(t, y):
        A = np.array([[0.0, 1.0], [-4.0 - np.cos(t), -0.2]])
        P = y[:4].reshape(2, 2)
        return np.append((A @ P + P @ A.T + np.diag([0.0, 1.0])).ravel(), P[0, 0])

    # After 24 periods the covariance is periodic to exp(-0.2 · 48 π) = 1e-13.
    start = solve_ivp(rates, (0, 48 * np.pi), np.zeros(5), "DOP853", rtol=1e-10, atol=1e-12).y[:, -1]
    start[4] = 0.0
    period = solve_ivp(rates, (0, 2 * np.pi), start, "DOP853", rtol=1e-11, atol=1e-13).y[4, -1]
    assert found.value**2 == pytest.approx(period / (2 * np.pi), rel=1e-8)
    assert found.error < 1e-8


def test_hinf_norm_matches_the_largest_harmonic_transfer_gain():
    found = solve.hinf_norm(oscillator(1.0), 1.0, ["q"])

    def first_order(phase, speed):
        k = len(phase)
        A = np.zeros((k, 2, 2))
        A[:, 0, 1], A[:, 1, 0], A[:, 1, 1] = 1.0, -4 - np.cos(phase), -0.2
        B, C, D = np.zeros((k, 2, 1)), np.zeros((k, 1, 2)), np.zeros((k, 1, 1))
        B[:, 1], C[..., 0] = 1.0, 1.0
        return A, np.zeros((k, 2)), B, C, D

    made = solve.FirstOrderSystem(first_order, ["q", "v"], inputs=["u"], outputs=["y"])
    transfer = solve.harmonic_transfer(made, 1.0, harmonics=8)
    gains = np.array([transfer.gain(w) for w in np.linspace(0.0, 0.5, 26)])
    assert gains.max() <= found.value * (1 + 1e-6)
    assert transfer.gain(found.frequency) == pytest.approx(found.value, rel=1e-5)


def test_hinf_norm_of_slow_variation_is_the_largest_frozen_gain():
    """For x′ = -x + u and y = (1 + cos φ) x, the gain from u to x is at most 1, and that from x to y at most
    2."""
    rate = 0.02

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        return -one, np.zeros((len(phase), 1)), one, (1 + np.cos(phase))[:, None, None], 0 * one

    system = solve.FirstOrderSystem(matrices, ["x"], inputs=["u"], outputs=["y"])
    found = solve.hinf_norm(system, rate, ["y"])
    # Signals about φ = 0 of the duration 1/sqrt(rate) fall short by a part of the order of the rate.
    assert 2 * (1 - rate) < found.value < 2.0


@pytest.mark.slow
def test_hinf_norm_exceeds_gains_computed_with_few_harmonics():
    press = solve.load("manipulator")
    found = solve.hinf_norm(press, "70 rpm", ["q2"], rtol=1e-5)
    with_two, with_many = (
        float(solve.harmonic_transfer(_of_press(press), "70 rpm", harmonics=k).gain(found.frequency))
        for k in (2, 24)
    )
    assert with_two < 0.1 * found.value
    assert 0.95 * found.value < with_many < found.value


def _of_press(press):
    """Return the first-order equations of the press from the torque to the deflection q2."""

    def matrices(phase, speed):
        M, C, K, _ = press.at(phase, speed)
        (B,) = press._inputs_at(phase, speed)
        k, A = len(phase), np.zeros((len(phase), 4, 4))
        A[:, [0, 1], [2, 3]] = 1.0
        A[:, 2:, :2], A[:, 2:, 2:] = -np.linalg.solve(M, K), -np.linalg.solve(M, C)
        inputs = np.concatenate((np.zeros((k, 2, 1)), np.linalg.solve(M, B)), axis=1)
        outputs = np.broadcast_to(np.eye(1, 4, 1), (k, 1, 4))
        return A, np.zeros((k, 4)), inputs, outputs, np.zeros((k, 1, 1))

    states = ["q1", "q2", "v1", "v2"]
    return solve.FirstOrderSystem(matrices, states, press.period, press.breaks, ["u"], ["y"])


def test_norms_require_stability_and_inputs():
    with pytest.raises(ControlError, match="unstable"):
        solve.hinf_norm(
            solve.OutputFeedback(oscillator(0.0), ["q_dot"]).varied({"u_by_q_dot": -1.0}), 1.0, ["q"]
        )
    with pytest.raises(ControlError, match="no inputs"):
        solve.h2_norm(solve.load("mathieu", zeta=0.1), 1.0, ["q"])


@pytest.mark.parametrize("norm", [solve.h2_norm, solve.hinf_norm])
def test_one_or_more_norms_may_be_requested(norm):
    system = oscillator(0.0)
    assert norm(system, 1.0, "q", "u").value == norm(system, 1.0, ["q", "q"], ["u", "u"]).value
    for names in (([],), (["q"], [])):
        with pytest.raises(MissingValueError, match="is empty; give at least one name, such as"):
            norm(system, 1.0, *names)
    with pytest.raises(UnknownNameError, match="unknown state or output 'speed'"):
        norm(system, 1.0, "speed")
