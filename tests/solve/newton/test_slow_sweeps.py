"""Jumps in slow sweeps of the clearance of a stop, compared with integration from event to event."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import solve
from tests.solve.newton.mechanisms import dashpot, model_of, stop

ZETA, SPEED = 0.1, 0.6


def reach(speed):
    """Amplitude without the stop, which is the clearance at which the orbit grazes the stop."""
    return 1 / abs(1 - speed**2 + 2j * ZETA * speed)


REACH = reach(SPEED)


def settled_peak(start, gap, force, periods, speed):
    """Return the state after some periods of q̈ + 2ζ q̇ + q + contact force = cos φ, and the largest |q| in
    the last period."""
    x, peak = np.array(start), 0.0
    for _ in range(periods):
        time, last, peak = 0.0, 2 * np.pi / speed, np.abs(x[0])
        while time < last:
            touches = x[0] > gap or (x[0] == gap and x[1] > 0)

            def rate(t, y, touches=touches):
                stopped = force(y[0] - gap, y[1]) if touches else 0.0
                return [y[1], np.cos(speed * t) - 2 * ZETA * y[1] - y[0] - stopped]

            def passes(t, y):
                return y[0] - gap

            def turns(t, y):
                return y[1]

            passes.terminal, passes.direction = True, -1 if touches else 1
            run = solve_ivp(
                rate, (time, last), x, rtol=1e-8, atol=1e-10, max_step=last / 400, events=(passes, turns)
            )
            time, x = run.t[-1], run.y[:, -1].copy()
            peak = max(peak, abs(x[0]), *(abs(y[0]) for y in run.y_events[1]))
            if run.status == 1:
                x[0] = gap
    return x, peak


def slow_sweep(gaps, force, periods, speed=SPEED):
    """Largest |q| at each of a sequence of slowly changing clearances, starting from the orbit without
    contact."""
    z = 1 / (1 - speed**2 + 2j * ZETA * speed)
    state = np.array([z.real, -speed * z.imag])
    peaks = []
    for gap in gaps:
        state, peak = settled_peak(state, gap, force, periods, speed)
        peaks.append(peak)
    return np.array(peaks)


@pytest.fixture(scope="module")
def hard_stop():
    numbers = {"zeta": ZETA, "k": 1.0, "kappa": 300.0, "gap": 1.02 * REACH, "f": 1.0}
    branch = solve.branch(
        model_of(stop(), **numbers), SPEED, over=f"gap={1.06 * REACH!r}:{0.9 * REACH!r}", points=90, rtol=1e-6
    )
    return branch, lambda depth, velocity: 300.0 * depth


def test_slow_sweep_jumps_where_the_branch_turns_back_near_grazing(hard_stop):
    branch, force = hard_stop
    down = branch.jumps[0]
    assert (down["direction"], down["coordinate"]) == ("down", "q")
    assert down["gap"] == pytest.approx(REACH, rel=1e-5)
    assert branch.grazing == []
    assert [point["gap"] < REACH for point in branch.folds] == [True, False]
    peaks = slow_sweep(REACH * (1 + np.array([5e-4, -5e-4])), force, 40)
    assert peaks[0] == pytest.approx(down["from"], rel=1e-4)
    assert peaks[1] == pytest.approx(down["to"], rel=1e-2)
    assert down["to"] > 1.05 * down["from"]


@pytest.mark.slow
def test_slow_sweep_back_jumps_at_smooth_fold(hard_stop):
    branch, force = hard_stop
    _, up = branch.jumps
    fold = max(branch.folds, key=lambda point: point["gap"])
    assert (up["direction"], up["gap"]) == ("up", fold["gap"])
    gaps = [0.99 * REACH, fold["gap"] * (1 - 1e-3), fold["gap"] * (1 + 2e-3)]
    peaks = slow_sweep(gaps, force, 60)
    assert peaks[1] > 1.02 * REACH
    assert peaks[2] == pytest.approx(up["to"], rel=1e-4)
    assert up["to"] == pytest.approx(REACH, rel=1e-4)


@pytest.mark.slow
def test_slow_sweep_jumps_at_a_stop_with_discontinuous_force():
    """The branch turns back exactly at the grazing orbit."""
    speed, numbers = 1.2, {"z": 2 * ZETA, "c": 0.1, "kappa": 5.0, "f": 0.3, "one": 1.0}
    free, gap = reach(speed), 1.05 * reach(speed)
    branch = solve.branch(
        model_of(dashpot(), **numbers, gap=gap), speed, over=f"gap={gap!r}:{0.6 * free!r}", rtol=1e-6
    )
    (down,) = branch.jumps
    assert down["direction"] == "down"
    assert down["gap"] == pytest.approx(free, rel=1e-5)
    peaks = slow_sweep(
        free * (1 + np.array([5e-4, -5e-4])),
        lambda depth, velocity: 0.3 + 5 * depth + 0.1 * velocity,
        40,
        speed,
    )
    assert peaks[0] == pytest.approx(down["from"], rel=1e-4)
    assert down["to"] is None
    assert peaks[1] > 2 * peaks[0]
