"""Simulated run-up compared with a hand-coded structure integrated by SciPy, and its limit for low
acceleration."""

import numpy as np
import pytest

import solve
from models.four_bar.linkage import TURN, Linkage
from models.four_bar.plan import Plan
from models.four_bar.run_up import Drive, RunUp, kinematics, simulate
from models.four_bar.stress_map import StressMap
from tests.models.four_bar.moving import Moving

PLAN = Plan(np.array([5.0, 20.0, 26.0, 30.0]), np.array([0.547, 0.547, 0.60, 0.61]), lead=0.4)


@pytest.fixture(scope="module")
def stresses():
    return StressMap(solve.load("four_bar"), 0.53, 0.62)


def test_drive_rates_match_finite_differences():
    run_up = RunUp(PLAN, 8.0, 5.0, home=0.547, returning=2.0)
    phi = np.linspace(0, run_up.turns * TURN, 40_001)
    drive = run_up(phi)
    pairs = (
        (phi, drive.speed),
        (drive.speed, drive.acceleration),
        (drive.L4, drive.L4_velocity),
        (drive.L4_velocity, drive.L4_acceleration),
    )
    for value, rate in pairs:
        missed = np.abs(np.gradient(value, drive.time) - rate)
        # Accelerations jump at corners, a few points each.
        assert np.sort(missed)[-40] < 1e-3 * np.abs(rate).max()
    assert drive.L4[-1] == pytest.approx(0.547)
    assert (drive.L4_velocity[-1], drive.speed[-1]) == pytest.approx((0.0, 30.0))


def test_kinematics_with_fixed_pivot_equal_the_linkage():
    model, phi = solve.load("four_bar"), np.linspace(0, TURN, 50)
    none = np.zeros(50)
    drive = Drive(none, none + 20.0, none + 3.0, none + 0.6, none, none)
    motion = Linkage(0.170, 0.328, 0.525, 0.6).motion(phi, 20.0, 3.0)
    for computed, true in zip(
        kinematics(model, phi, drive), (np.exp(1j * motion.t), motion.omega, motion.alpha), strict=True
    ):
        computed = np.exp(1j * computed) if np.iscomplexobj(true) else computed
        np.testing.assert_allclose(computed.T, true, atol=1e-11 * np.abs(true).max())


@pytest.mark.slow
def test_fast_run_up_agrees_with_a_hand_coded_structure(stresses):
    """Two revolutions from 24 rad/s at 12 rad/s², with a pivot motion of 40 mm. Every term of the load is
    significant."""

    def drive(phi):
        time = (np.sqrt(24**2 + 24 * phi) - 24) / 12
        wave, rate = 6 * time, 6.0
        return Drive(
            time,
            24 + 12 * time,
            12 + 0 * time,
            0.575 - 0.02 * np.cos(wave),
            0.02 * rate * np.sin(wave),
            0.02 * rate**2 * np.cos(wave),
        )

    hand = Moving(
        stresses.lengths[0].model.parameters,
        lambda t: 24 * t + 6 * t**2,
        lambda t: 0.575 - 0.02 * np.cos(6 * t),
    )
    times, q = hand.run(float(drive(np.array(2 * TURN)).time))
    computed = simulate(stresses, drive, 2).stress
    angle = np.array([hand.phi(t) for t in times])
    for link, fractions in enumerate(stresses.positions):
        each = np.max([hand.stress(times, q, link, fraction) for fraction in fractions], axis=0)
        for turn in range(2):
            inside = (angle >= turn * TURN) & (angle <= (turn + 1) * TURN)
            assert computed[turn, link] == pytest.approx(each[inside].max(), rel=3e-3)


@pytest.mark.slow
def test_slow_run_up_passes_through_steady_states(stresses):
    """At 0.1 rad/s², each revolution has the stress of the periodic vibration at the same speed and
    length."""
    plan = Plan(np.array([24.0, 27.0]), np.array([0.55, 0.60]), lead=0.3)
    run_up = RunUp(plan, 24.0, 30.0)
    simulated = simulate(stresses, run_up, run_up.turns)
    model = stresses.lengths[0].model
    for turn in (40, 80, 110):
        before, after = simulated.speed[turn - 1 : turn + 1]
        assert after - before < 0.03
        steady = solve.periodic(model.varied({"L4": float(simulated.L4[turn])}), float(after), rtol=1e-6)
        # Of the crank the root is the worst place, where the program looks by itself.
        worst = max(steady.statistics(f"crank_root_stress_{side}").max_abs for side in ("plus", "minus"))
        assert simulated.stress[turn, 0] == pytest.approx(worst, rel=0.02)
