"""Sampled feedback, compared with matrix exponentials and with integration by SciPy from sample to sample."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import solve
from solve.errors import ControlError, ValueOutOfBoundsError

GAIN = np.array([[0.8, 0.6]])


def oscillator(epsilon, load=1.0):
    """q̈ + 0.1 q̇ + (4 + ε cos φ) q = load cos φ + u, with the period 2π."""

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        stiffness = (4 + epsilon * np.cos(phase))[:, None, None]
        return one, 0.1 * one, stiffness, load * np.cos(phase)[:, None], one

    return solve.PeriodicSystem(matrices, ["q"], inputs=["u"])


def constant_gains(system):
    loop = solve.OutputFeedback(system, ["q", "q_dot"])
    return loop.varied({"u_by_q": GAIN[0, 0], "u_by_q_dot": GAIN[0, 1]})


@pytest.mark.parametrize("samples", [3, 8])
@pytest.mark.parametrize("delay", [0, 1])
def test_multipliers_of_a_constant_system_match_the_matrix_exponential(samples, delay):
    rates = np.zeros((3, 3))
    rates[:2] = [[0.0, 1.0, 0.0], [-4.0, -0.1, 1.0]]
    step = expm(rates * 2 * np.pi / samples)
    A, B = step[:2, :2], step[:2, 2:]
    discrete = A - B @ GAIN if not delay else np.block([[A, B], [-GAIN, np.zeros((1, 1))]])
    expected = np.abs(np.linalg.eigvals(discrete)).max() ** samples
    found = solve.sampled(constant_gains(oscillator(0.0)), 1.0, samples, delay)
    assert abs(found.spectral_radius - expected) <= found.error + 1e-9 * expected
    assert found.verdict == ("unstable" if expected > 1 else "asymptotically stable")


@pytest.mark.parametrize("delay", [0, 1])
def test_observer_with_held_inputs_matches_integration_by_scipy(delay):
    samples, system = 12, oscillator(1.0)
    made = solve.lqg(system, 1.0, {"q": 3.0}, {"u": 0.5}, {"u": 1.0}, {"q": 0.1}, feedforward=True)
    found = solve.sampled(made.closed, 1.0, samples, delay)

    def over_a_period(z):
        x, estimate, later, largest = z[:2], z[2:4], z[4], 0.0
        for t in np.arange(samples) * (2 * np.pi / samples):
            y, largest = x[0], max(largest, abs(x[0]))
            computed = float(made.feedforward(t)[0, 0] - (made.gain(t)[0] @ estimate)[0])
            u, later = (later, computed) if delay else (computed, 0.0)

            def rates(s, state, u=u, y=y):
                A = np.array([[0.0, 1.0], [-4 - np.cos(s), -0.1]])
                forced = np.array([0.0, u + np.cos(s)])
                error = made.observer.gain(s)[0, :, 0] * (y - state[2])
                return np.concatenate((A @ state[:2] + forced, A @ state[2:] + forced + error))

            span = (t, t + 2 * np.pi / samples)
            run = solve_ivp(rates, span, np.concatenate((x, estimate)), "DOP853", rtol=1e-9, atol=1e-10)
            x, estimate = run.y[:2, -1], run.y[2:, -1]
        return np.array([*x, *estimate, later]), largest

    load = over_a_period(np.zeros(5))[0]
    Phi = np.stack([over_a_period(row)[0] - load for row in np.eye(5)], axis=1)
    assert found.spectral_radius == pytest.approx(np.abs(np.linalg.eigvals(Phi)).max(), rel=1e-5)
    largest = over_a_period(np.linalg.solve(np.eye(5) - Phi, load))[1]
    assert largest <= found.largest["q"] * (1 + 1e-6)
    assert found.largest["q"] < 1.1 * largest


def test_multipliers_converge_to_those_of_the_continuous_loop():
    made = solve.lqr(oscillator(1.0), 1.0, {"q": 3.0}, {"u": 0.5}, feedforward=True)
    gaps = [
        abs(solve.sampled(made.closed, 1.0, samples).spectral_radius - made.stability.spectral_radius)
        for samples in (400, 800)
    ]
    # The delay of 1.5 samples is an error of first order.
    assert gaps[1] == pytest.approx(gaps[0] / 2, rel=0.1)


def test_unsupported_sampled_loops_are_refused():
    system = oscillator(0.0)
    late = solve.OutputFeedback(system, ["q"], delay=0.01)
    for loop in (system, late):
        with pytest.raises(ControlError, match="no feedback to be sampled"):
            solve.sampled(loop, 1.0, 10)
    with pytest.raises(ValueOutOfBoundsError, match="delay is 2"):
        solve.sampled(constant_gains(system), 1.0, 10, delay=2)
    for samples in (0, 10**8):
        with pytest.raises(ValueOutOfBoundsError, match="samples"):
            solve.sampled(constant_gains(system), 1.0, samples)
