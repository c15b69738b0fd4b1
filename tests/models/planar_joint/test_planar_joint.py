"""Planar clearance joint compared with the Newton-Euler equations of rod and slider."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import solve

r, L, m, mr, J, F, k, chi, c, g = 0.05, 0.12, 0.14, 0.1, 1.2e-4, 100.0, 1e7, 0.5, 20.0, 1e-4
R = 0.01


def crank(phase):
    """Position of the crank pin, and its first and second derivatives with respect to the phase (3, 2)."""
    outwards, ahead = np.array([np.cos(phase), np.sin(phase)]), np.array([-np.sin(phase), np.cos(phase)])
    return r * np.array([outwards, ahead, -outwards])


def after_a_revolution(state, speed):
    """Return the state after one revolution: angle of the rod, position of the slider, and their derivatives
    with respect to the phase. The rod is a body on the crank pin, with the contact force at its other end."""

    def rate(phase, y):
        beta, x, w, v = y
        w, v = speed * w, speed * v
        (A, vA, aA), along = crank(phase), np.array([np.cos(beta), np.sin(beta)])
        across = np.array([-along[1], along[0]])
        e = A + L * along - [x, 0.0]
        ed = speed * vA + L * w * across - [v, 0.0]
        distance = np.hypot(*e)
        penetration = max(0.0, distance - g)
        on_bearing = k * penetration * (1 + chi * (e @ ed) / distance) * e / distance + c * ed
        torque = -mr * L / 2 * across @ (speed**2 * aA) - L * across @ on_bearing
        return [
            y[2],
            y[3],
            torque / (J + mr * L**2 / 4) / speed**2,
            (on_bearing[0] - F) / m / speed**2,
        ]

    def gap(phase, y):
        (A, _, _), along = crank(phase), np.array([np.cos(y[0]), np.sin(y[0])])
        return np.hypot(*(A + L * along - [y[1], 0.0])) - g

    # The steps end at each beginning and end of contact, so that the integration keeps its order.
    gap.terminal, phase = True, 0.0
    gap.direction = -np.sign(gap(phase, state))
    while phase < 2 * np.pi:
        piece = solve_ivp(
            rate,
            (phase, 2 * np.pi),
            state,
            "DOP853",
            rtol=1e-10,
            atol=1e-14,
            max_step=2 * np.pi / 400,
            events=gap,
        )
        phase, state, gap.direction = piece.t[-1], piece.y[:, -1], -gap.direction
    return state


def state_of(orbit):
    """State for `after_a_revolution` at phase 0 of an orbit."""
    u, v = orbit.q[:, 0]
    ud, vd = orbit.qd[:, 0] / orbit.speed
    beta, betad = np.arcsin(v / L), (vd - r) / np.sqrt(L**2 - v**2)
    x = r + L * np.cos(beta) - (g + F / k + u)
    return np.array([beta, x, betad, -L * np.sin(beta) * betad - ud])


@pytest.mark.parametrize("speed", ["600 rpm", "1500 rpm"])
def test_orbits_equal_integration(speed):
    """At 600 rpm, pin and bearing remain in contact; at 1500 rpm, they separate."""
    orbit = solve.nonlinear(solve.load("planar_joint"), speed, rtol=1e-7)
    assert (len(orbit.events) == 0) == (speed == "600 rpm")
    start = state_of(orbit)
    after = after_a_revolution(start, orbit.speed)
    assert np.abs(after - start).max() < 1e-7 * L
    assert orbit.statistics("v").max_abs > 1e-5
    fraction = orbit.statistics("contact").mean
    assert (fraction == pytest.approx(1.0, abs=1e-9)) == (speed == "600 rpm")
    assert orbit.statistics("contact_force").min >= 0
    assert orbit.statistics("gap").max <= g
