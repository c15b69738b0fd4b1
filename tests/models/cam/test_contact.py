"""Cam with unilateral contact: lift-off, and multipliers compared with differences of the return map."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import solve

SPEED = 275 * np.pi / 30
P = 95000.0


def return_map(model):
    """Return the state (q, q̇) after one revolution, by integration of hand-coded equations from event to
    event."""
    p = model.parameters
    orders = np.arange(1, 13)
    a = np.array([p[f"a{k}"] for k in orders])

    def rate(t, x, sign):
        q1, q2, q3, v1, v2, v3 = x
        angle = SPEED * t + q1
        U1, U2 = a @ np.cos(orders * angle), -(orders * a) @ np.sin(orders * angle)
        held2 = p["k2"] * q2 + p["c2"] * v2 if sign > 0 else P
        held3 = p["k3"] * q3 + p["c3"] * v3
        a1 = (U1 * held2 - p["c1"] * v1 - p["k1"] * q1) / p["I1"]
        y1 = U2 * (SPEED + v1) ** 2 + U1 * a1
        y2, y3 = (held3 - held2) / p["m2"], -(held3 + p["F"]) / p["m3"]
        return [v1, v2, v3, a1, y2 - y1, y3 - y2]

    def apart(t, x, sign):
        return P - p["k2"] * x[1] - p["c2"] * x[4]

    apart.terminal = True

    def after(start):
        x, time, last = np.array(start), 0.0, 2 * np.pi / SPEED
        sign, events = np.sign(apart(0, x, 0)), []
        while time < last:
            apart.direction = -sign
            run = solve_ivp(
                rate, (time, last), x, "DOP853", rtol=1e-11, atol=1e-16, events=apart, args=(sign,)
            )
            time, x = run.t[-1], run.y[:, -1]
            if run.status == 1:
                sign = -sign
                events.append(SPEED * time)
        return x, events

    return after


@pytest.fixture(scope="module")
def cam():
    return solve.load("cam", options={"contact": "unilateral"})


@pytest.fixture(scope="module")
def orbit(cam):
    return solve.nonlinear(cam, SPEED, rtol=1e-9)


def test_follower_lifts_off_if_the_linear_model_warns(cam, orbit):
    assert any("lifts off" in text for text in solve.periodic(cam, 1.02 * SPEED).warnings)
    assert not any("lifts off" in text for text in solve.periodic(cam, 0.9 * SPEED).warnings)
    assert len(orbit.events) == 4
    assert orbit.statistics("contact_force").min == 0
    assert orbit.statistics("gap").max > 1e-6
    apart = np.diff(np.reshape(orbit.events, (2, 2)), axis=1).sum()
    assert orbit.statistics("in_contact").mean == pytest.approx(1 - apart / 2 / np.pi, abs=2e-3)


def test_bilateral_contact_is_the_default():
    cam, other = solve.load("cam"), solve.load("cam", P=1.0, R0=2.0)
    one, two = (solve.periodic(each, "100 rpm") for each in (cam, other))
    assert np.array_equal(one.q, two.q)
    assert one.statistics("gap").max <= 0
    assert not any("linear results use its slope" in text for text in one.warnings)
    assert one.statistics("in_contact").min == 1


@pytest.mark.slow
def test_multipliers_equal_differences_of_the_return_map(cam, orbit):
    after = return_map(cam)
    start = np.concatenate((orbit.q[:, 0], orbit.qd[:, 0]))
    sizes = np.concatenate((np.abs(orbit.q).max(axis=1), np.abs(orbit.qd).max(axis=1)))
    end, events = after(start)
    assert (np.abs(end - start) <= 1e-8 * sizes).all()
    assert orbit.events == pytest.approx(events, abs=1e-7)
    columns = []
    for k, size in enumerate(sizes):
        step = 1e-3 * size * np.eye(6)[k]
        one, two = (
            (after(start + s * step)[0] - after(start - s * step)[0]) / (2 * s * step[k]) for s in (1, 2)
        )
        columns.append((4 * one - two) / 3)
    expected = np.linalg.eigvals(np.array(columns).T)
    distance = np.abs(orbit.multipliers[:, None] - expected).min(axis=1).max()
    assert distance <= 1e-6
