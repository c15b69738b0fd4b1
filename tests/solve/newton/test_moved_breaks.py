"""Branches in a parameter that shifts the phase of a jump of the load."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import solve
from derive import Heaviside, Mechanism, rate

NUMBERS = {"c": 0.2, "k": 1.0, "alpha": 1.0, "f": 1.0, "begin": 2.0}
SPEED = 1.2


def switched_load():
    made = Mechanism("switched_load", "Mass on a cubic spring under a switched load", energy="1/s^2")
    (q,) = made.coordinates(q=("1", "displacement"))
    c, k, alpha = made.parameters(
        c=("1/s", "damping"), k=("1/s^2", "stiffness"), alpha=("1/s^2", "cubic stiffness")
    )
    f, begin = made.parameters(f=("1/s^2", "load"), begin=("rad", "phase at which the load begins"))
    made.kinetic, made.dissipation = rate(q) ** 2 / 2, c * rate(q) ** 2 / 2
    made.potential = k * q**2 / 2 + alpha * q**4 / 4
    made.force(f * Heaviside(made.phase - begin), along=q)
    made.decline_drive_torque("an equation without units")
    return made


def after_a_period(state, begin):
    """Return the state after one period and the largest displacement, integrated from jump to jump."""
    (c, k, alpha, f, _), peaks = NUMBERS.values(), []
    for first, last, load in ((0.0, begin, 0.0), (begin, 2 * np.pi, f)):
        run = solve_ivp(
            lambda t, x, load=load: [x[1], load - c * x[1] - k * x[0] - alpha * x[0] ** 3],
            (first / SPEED, last / SPEED),
            state,
            "DOP853",
            rtol=1e-12,
            atol=1e-13,
            events=lambda t, x: x[1],
        )
        state = run.y[:, -1]
        peaks += [passed[0] for passed in run.y_events[0]]
    return state, max(peaks)


def test_branches_follow_a_parameter_that_shifts_a_jump():
    """Without the derivative with respect to the phase of the jump, 40 points do not suffice to reach the
    end."""
    model = solve.load(switched_load, **NUMBERS)
    found = solve.branch(model, SPEED, over="begin=2:4", points=40, rtol=1e-7)
    assert found.ended == ""
    assert found.values[-1] == 4.0
    assert len(found.values) < 20
    curve, zero, peak = found.curve(len(found.values) - 1), np.zeros(1), 0.0
    state = np.array([curve(zero)[0, 0], SPEED * curve(zero, 1)[0, 0]])
    # The curve has 63 harmonics of the orbit, from which the motion settles.
    for _ in range(32):
        state, peak = after_a_period(state, 4.0)
    assert peak == pytest.approx(found.peaks[-1, 0], rel=1e-7)
