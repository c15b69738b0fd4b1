"""Nonlinear orbits, branches and transients of free machines, compared with DOP853 and each other."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import solve
from solve.errors import UnbalancedLoadError
from tests.solve.free_machines import (
    SPEED,
    cubic,
    mechanism,
    train,
)


@pytest.mark.parametrize(("T0", "b"), [(0.0, 0.0), (0.3, 0.1)])
def test_nonlinear_orbits_of_a_free_machine(T0, b):
    orbit = solve.nonlinear(cubic(T0, b), 1.3)

    def f(t, y):
        q1, q2, v1, v2 = y
        shaft = 3 * (q1 - q2) + 0.5 * (q1 - q2) ** 3 + 0.02 * (v1 - v2)
        return [v1, v2, np.cos(1.3 * t) + T0 - shaft, (shaft - b * v2) / 2]

    start = np.concatenate((orbit.q[:, 0], orbit.qd[:, 0]))
    grown = solve_ivp(f, (0, orbit.period), start, "DOP853", rtol=1e-12, atol=1e-14).y[:, -1]
    drift = T0 / b if b else 0.0
    np.testing.assert_allclose(grown - start, np.repeat([drift * orbit.period, 0], 2), atol=1e-9)
    assert orbit.verdict == "asymptotically stable"
    (mode,) = orbit.rigid_body_modes
    assert mode.vector == (1.0, 1.0)
    assert orbit.statistics("drag").mean == pytest.approx(T0, abs=1e-10)
    if b:
        assert mode.drift == pytest.approx(drift, rel=1e-9)


def test_transients_converge_to_the_orbit_of_a_drifting_machine():
    """They converge whatever the angle of rotation. The drift is T0/b."""
    machine = cubic(T0=0.3, b=2.0)
    run = solve.transient(machine, 1.3, turns=40, nonlinear=True)
    assert run.reached is not None
    assert run.warnings == []
    end = run.q[:, -1], run.qd[:, -1]
    computed = [run.orbit, *(solve.nonlinear(machine, 1.3, start) for start in (None, run, end))]
    computed.append(solve.nonlinear(machine, 1.3, periods=2))
    assert [orbit.found_by for orbit in computed[-3:]] == ["start", "start", "transient"]
    for orbit in computed:
        assert orbit.rigid_body_modes[0].drift == pytest.approx(0.15, rel=1e-6)
        assert orbit.statistics("q1").max_abs == pytest.approx(computed[1].statistics("q1").max_abs, rel=1e-5)


def test_nonlinear_free_machine_with_mean_torque_is_refused():
    with pytest.raises(UnbalancedLoadError, match=r"is 0\.3 N m"):
        solve.nonlinear(cubic(T0=0.3), 1.3)


@pytest.mark.parametrize(("T0", "b"), [(0.0, 0.0), (0.3, 0.1)])
def test_branch_of_a_free_machine_matches_single_orbits(T0, b):
    system = cubic(T0, b)
    branch = solve.branch(system, "1.3:1.5 rad/s")
    orbit = solve.nonlinear(system, 1.5)
    largest = [orbit.statistics(name).max_abs for name in orbit.coordinates]
    last = int(np.abs(branch.speeds - 1.5).argmin())
    assert branch.speeds[last] == pytest.approx(1.5, rel=1e-9)
    np.testing.assert_allclose(branch.peaks[last], largest, rtol=1e-5)


@pytest.mark.parametrize(("T0", "drag"), [(0.0, 0.0), (1.0, 0.4)])
def test_transient_reaches_orbit_of_free_machine(T0, drag):
    """The rigid-body motion is subtracted: the drift, or the offset due to the initial state."""
    shaft = np.array([[1.0, -1.0], [-1.0, 1.0]])
    C = 0.8 * shaft + np.diag([0.0, drag])
    machine = train(C, T0, np.diag([1.0, 2.0]), 5.0 * shaft, np.array([1.0, 0.0]), 1)
    transient = solve.transient(machine, 1.3, 60)
    assert transient.reached is not None
    assert transient.reached < 60
    assert transient.distances[0].max() > 1e-2
    assert not [text for text in transient.warnings if "not reached" in text]


def test_more_revolutions_are_suggested_only_with_damping():
    for damping, words in ((1e-4, "give more turns"), (0.0, "start on the orbit")):
        run = solve.transient(mechanism(c=damping), SPEED, turns=5)
        assert run.warnings[0].endswith(words)
