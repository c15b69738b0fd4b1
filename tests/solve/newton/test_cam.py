"""Nonlinear motion of the cam, compared with reference values and time integration."""

import casadi
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import solve
from solve.methods.free import solutions_on
from solve.newton import iteration

FOLDS = 436.20566083, 418.64249093, 428.83929264, 428.42998683
"""Speeds in rpm of the first folds from 400 rpm on, by shooting with the equations by hand and variational
equations of heyoka: `tests.benchmarks.heyoka_shooting.fold`."""


def after_a_revolution(model, speed):
    """State after one revolution from the state x = (q, q̇), by DOP853 with the generated residual."""
    n, t = model.n, casadi.SX.sym("t")
    x, a = casadi.SX.sym("x", 2 * n), casadi.SX.sym("a", n)
    r = model.setup.function("residual")(speed * t, speed, x[:n], x[n:], a, model.setup.p)
    acceleration = casadi.solve(casadi.jacobian(r, a), -casadi.substitute(r, a, 0))
    function = casadi.Function("rate", [t, x], [casadi.vertcat(x[n:], acceleration)])
    buffer, evaluate = function.buffer()
    time, state, computed = np.zeros(1), np.zeros(2 * n), np.zeros(2 * n)
    buffer.set_arg(0, time.data), buffer.set_arg(1, state.data), buffer.set_res(0, computed.data)

    def rate(at, given, _kept=(function, buffer)):
        time[0], state[:] = at, given
        evaluate()
        return computed.copy()

    def around(start):
        return solve_ivp(rate, (0.0, 2 * np.pi / speed), start, "DOP853", rtol=1e-11, atol=1e-15).y[:, -1]

    return around


def peaks(orbit):
    return np.array([orbit.statistics(name).max_abs for name in orbit.coordinates])


@pytest.mark.parametrize(
    ("speed", "q1", "q3"), [("100 rpm", -0.03, 0.45), pytest.param("300 rpm", -3.5, 65, id="300 rpm")]
)
def test_nonlinear_peaks_differ_from_linear_ones_as_stated(speed, q1, q3):
    """Changes of the peaks from the linear to the nonlinear orbit, in percent."""
    cam = solve.load("cam")
    change = 100 * (peaks(solve.nonlinear(cam, speed)) / peaks(solve.periodic(cam, speed)) - 1)
    assert change[0] == pytest.approx(q1, abs=0.5 * 10 ** -(2 if abs(q1) < 1 else 1))
    assert change[2] == pytest.approx(q3, abs=0.01 if q3 < 1 else 0.5)


@pytest.mark.slow
def test_orbit_closes_and_finite_differences_confirm_the_multipliers():
    cam, speed = solve.load("cam"), 10 * np.pi
    orbit = solve.nonlinear(cam, speed, rtol=1e-9)
    around, start = after_a_revolution(cam, speed), np.concatenate((orbit.q[:, 0], orbit.qd[:, 0]))
    sizes = np.concatenate((np.abs(orbit.q).max(axis=1), np.abs(orbit.qd).max(axis=1)))
    assert (np.abs(around(start) - start) <= 1e-7 * sizes).all()
    differences = []
    for k, size in enumerate(sizes):
        apart = np.zeros(6)
        apart[k] = 1e-4 * size
        # Richardson's combination of central differences.
        one, two = (
            (around(start + s * apart) - around(start - s * apart)) / (2 * s * apart[k]) for s in (1, 2)
        )
        differences.append((4 * one - two) / 3)
    expected = np.linalg.eigvals(np.array(differences).T)
    expected = expected[np.argsort(-np.abs(expected))]
    distance = np.abs(orbit.multipliers[:, None] - expected).min(axis=1).max()
    assert distance <= 1e-6 * orbit.spectral_radius


@pytest.mark.slow
def test_both_cases_converge_at_600_rpm():
    first, second = (solve.nonlinear(solve.load("cam", case=case), "600 rpm") for case in "12")
    for orbit in (first, second):
        assert orbit.found_by == "transient"
        assert orbit.verdict == "asymptotically stable"
        assert max(orbit.error_estimate) <= 1e-8
    assert peaks(second)[0] == pytest.approx(0.530, abs=5e-4)


@pytest.fixture
def chaos(monkeypatch):
    """Make a transient end far from every orbit. Whether this happens for the cam at 450 rpm differs between
    machines."""

    def unsettled(task, grid):
        raise solve.errors.NoOrbitError("after 80 periods from rest, the motion still changes by 6%")

    monkeypatch.setattr("solve.newton.orbits.by_transient", unsettled)


@pytest.mark.slow
def test_missing_orbit_error_reports_the_progress_of_each_strategy(chaos):
    with pytest.raises(solve.errors.NoOrbitError) as refused:
        solve.nonlinear(solve.load("cam"), "450 rpm")
    text = str(refused.value)
    for part in (
        "450 rpm",
        "by the linear orbit",
        "% of the load",
        "turns back or ends",
        "periods from rest",
    ):
        assert part in text
    low, high = (
        float(word) for word in text.split("between ")[2].split(";")[0].replace(" rpm", "").split(" and ")
    )
    assert 400 < low < high < 450


@pytest.mark.slow
def test_unstable_orbit_warns_that_the_motion_does_not_settle():
    orbit = solve.nonlinear(solve.load("cam"), "500 rpm")
    assert orbit.verdict == "unstable"
    assert any("does not settle" in text for text in orbit.warnings)


@pytest.mark.slow
def test_folds_of_the_branch_equal_shooting():
    found = solve.branch(solve.load("cam"), "400:460 rpm", points=110)
    assert found.turning[:4] * 30 / np.pi == pytest.approx(FOLDS, rel=1e-6)


def test_final_grid_requires_one_correction_per_number_of_stages(monkeypatch):
    used = []

    def recorded(chosen, points, grid, *rest):
        used.append((grid.steps, len(chosen.stages.c)))
        return solutions_on(chosen, points, grid, *rest)

    monkeypatch.setattr(iteration, "solutions_on", recorded)
    orbit = solve.nonlinear(solve.load("cam", case="1"), "300 rpm", rtol=1e-6)
    assert [stages for steps, stages in used if steps == orbit.steps] == [8, 7]
