"""Slider-crank mechanism with a clearance compared with integration from event to event."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import solve

R, L, MASS, FORCE, K, CHI, C, GAP = 0.05, 0.12, 0.14, 100.0, 1e7, 0.5, 20.0, 2e-4
SPEED = 100 * np.pi


def pin(phase):
    """Second derivative of r cos φ + √(l² - r² sin² φ) with respect to the phase."""
    root = np.sqrt(L**2 - R**2 * np.sin(phase) ** 2)
    return (
        -R * np.cos(phase) - R**2 * np.cos(2 * phase) / root - (R**2 * np.sin(2 * phase)) ** 2 / 4 / root**3
    )


def after_a_revolution(start):
    """Return q and q̇ after one revolution, and the phases of the events."""
    state, phase, events = np.array(start), 0.0, []
    while phase < 2 * np.pi:
        depth = FORCE / K - state[0]
        depth = 0.0 if abs(depth) < 1e-15 else depth
        behind = -depth - GAP
        behind = 0.0 if abs(behind) < 1e-15 else behind
        front = depth > 0 or (depth == 0 and state[1] < 0)
        rear = behind > 0 or (behind == 0 and state[1] > 0)

        def rate(t, y, front=front, rear=rear):
            depth, speed = FORCE / K - y[0], y[1]
            contact = K * depth * (1 - CHI * speed) if front else 0.0
            contact += K * (depth + GAP) * (1 + CHI * speed) if rear else 0.0
            return [speed / SPEED, ((contact - FORCE - C * speed) / MASS - SPEED**2 * pin(t)) / SPEED]

        def at_front(t, y):
            return y[0] - FORCE / K

        def at_rear(t, y):
            return y[0] - FORCE / K - GAP

        at_front.terminal = at_rear.terminal = True
        at_front.direction, at_rear.direction = (1 if front else -1), (-1 if rear else 1)
        ends = phase, 2 * np.pi
        run = solve_ivp(rate, ends, state, "DOP853", rtol=1e-12, atol=1e-16, events=(at_front, at_rear))
        phase, state = float(run.t[-1]), run.y[:, -1].copy()
        if run.status == 1:
            state[0] = FORCE / K + (0.0 if len(run.t_events[0]) else GAP)
            events.append(phase)
    return state, events


@pytest.fixture(scope="module")
def found():
    return solve.nonlinear(solve.load("slider_crank"), SPEED, rtol=1e-9)


def test_orbit_equals_integration_from_event_to_event(found):
    start = np.array([found.q[0, 0], found.qd[0, 0]])
    after, events = after_a_revolution(start)
    sizes = np.array([np.abs(found.q).max(), np.abs(found.qd).max()])
    assert (np.abs(after - start) < 1e-8 * sizes).all()
    assert found.events == pytest.approx(events, abs=1e-7)


def test_outputs_of_the_clearance(found):
    assert found.statistics("gap").max == pytest.approx(GAP, rel=1e-9)
    apart = 1 - found.statistics("front_contact").mean - found.statistics("rear_contact").mean
    assert 0 < apart < 0.2
    # The slider repeats its motion, so that the mean of the contact force is the load.
    assert found.statistics("contact_force").mean == pytest.approx(FORCE, rel=1e-4)
    assert found.statistics("wear").min == pytest.approx(0, abs=1e-6)
