"""Transients and run-ups with a controller, compared with SciPy's integration of the same equations."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import solve
from solve.equations import input_matrix


@pytest.fixture(scope="module")
def regulated():
    press = solve.load("manipulator")
    return solve.lqg(press, "70 rpm", {"q2": 1e8}, {"u": 1e-2}, {"u": 1.0}, {"q1": 1e-9}, rtol=1e-6)


def reference(loop, first, last, turns):
    """Return q, q̇ and x̂ at the end of a run-up from rest, in which the square of the speed increases
    linearly with the phase."""
    period, p = loop.model.period, 2
    ends = np.sqrt(np.linspace(first**2, last**2, turns + 1))
    state, phase = np.zeros(4 + 4), 0.0
    for start, stop in pairwise(ends):
        duration = 2 * period / (start + stop)
        rate = (stop - start) / duration

        def slope(t, x, start=start, rate=rate, phase=phase):
            speed = np.array([start + rate * t])
            at = np.array([phase + start * t + rate * t**2 / 2])
            matrices = loop.model.capabilities.varying(at, speed, rate)
            M, C, K, d = (part[0] for part in matrices)
            B = input_matrix(loop.model, at, speed)[0]
            u = -loop.feedback(at)[0] @ x[4:]
            qdd = np.linalg.solve(M, d + B @ u - K @ x[:p] - C @ x[p:4])
            L = loop.observer.gain(at).reshape(4, 1)
            A = np.block([[np.zeros((p, p)), np.eye(p)], [-np.linalg.solve(M, np.hstack((K, C)))]])
            b = np.concatenate((np.zeros(p), np.linalg.solve(M, d + B @ u)))
            return np.concatenate((x[p:4], qdd, A @ x[4:] + b + L @ (x[:1] - x[4:5])))

        run = solve_ivp(slope, (0, duration), state, "LSODA", rtol=1e-6, atol=1e-9, max_step=duration / 64)
        state, phase = run.y[:, -1], phase + period
    return state


@pytest.mark.slow
def test_run_up_with_an_observer_agrees_with_scipy(regulated):
    found = solve.transient(regulated.closed, speeds=(4.0, 7.0), turns=1)
    state = reference(regulated.closed, 4.0, 7.0, 1)
    q = found.q[:, -1]
    assert np.abs(q - np.concatenate((state[:2], state[4:]))).max() < 1e-3 * np.abs(q).max()


def test_transient_reaches_the_orbit_of_the_closed_loop(regulated):
    found = solve.transient(regulated.closed, "70 rpm", turns=3)
    orbit = solve.periodic(regulated.closed, "70 rpm")
    assert np.allclose(found.q[:, -1], orbit.at(np.zeros(1))[:, 0], rtol=1e-3)


@pytest.mark.slow
def test_nonlinear_transient_remains_on_the_nonlinear_orbit():
    loop = solve.OutputFeedback(solve.load("manipulator"), ["q1", "q1_dot"])
    loop = loop.varied({"u_by_q1": 9241.0, "u_by_q1_dot": -21.6})
    orbit = solve.nonlinear(loop, "70 rpm", rtol=1e-6)
    start = orbit.q[:, 0], orbit.qd[:, 0]
    found = solve.transient(loop, "70 rpm", turns=1, start=start, nonlinear=True)
    assert np.abs(found.q[:, -1] - start[0]).max() < 1e-4 * np.abs(orbit.q).max()
    assert np.abs(found.q[0]).max() == pytest.approx(orbit.statistics("q1").max_abs, rel=1e-3)
