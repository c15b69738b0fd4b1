"""Robust optima against scans, and gradients of statistics against differences."""

import numpy as np
import pytest
from scipy.integrate import quad

import solve
from solve.errors import SolveError
from solve.model.spread import spread_of
from solve.period.named import Named
from solve.studies.design_points import Design
from solve.studies.robust import Robust, Statistic, deviating
from tests.solve.studies.driven_oscillator import DAMPING, STIFFNESS, loaded, response
from tests.solve.studies.test_tracked import differences


@pytest.fixture(scope="module")
def model():
    return loaded()


def integrals(k, speed, half):
    """Return the mean and standard deviation of the amplitude for a stiffness evenly distributed within k ±
    half."""
    first, second = (
        quad(lambda x, power=power: abs(response(speed, k=x)) ** power, k - half, k + half)[0] / (2 * half)
        for power in (1, 2)
    )
    return first, np.sqrt(second - first**2)


def test_robust_optimum_equals_a_scan_of_mean_and_deviation(model):
    speeds, half = [1.5, 3.0], 1.5
    found = solve.optimise(
        model, "q.max_abs", {"k": (6.5, 16.0)}, speeds, robust=2.0, vary={"k": f"±{half}"}, rtol=1e-6
    )

    def worst(k):
        return max(mean + 2 * deviation for mean, deviation in (integrals(k, w, half) for w in speeds))

    scan = np.linspace(10.0, 13.0, 121)
    values = [worst(k) for k in scan]
    assert found.free["k"] == pytest.approx(scan[np.argmin(values)], abs=0.05)
    assert found.objective == pytest.approx(min(values), rel=0.02)
    assert "mean + 2 σ" in found.minimised


def test_quantile_optimum_equals_a_scan_of_quantiles(model):
    speeds, half = [1.5, 3.0], 1.5
    found = solve.optimise(
        model, "q.max_abs", {"k": (6.5, 16.0)}, speeds, robust="80 %", vary={"k": f"±{half}"}, rtol=1e-6
    )

    def worst(k):
        stiffness = np.linspace(k - half, k + half, 1001)
        return max(np.quantile(abs(response(w, k=stiffness)), 0.8) for w in speeds)

    scan = np.linspace(9.0, 14.0, 101)
    values = [worst(k) for k in scan]
    assert found.free["k"] == pytest.approx(scan[np.argmin(values)], abs=0.1)
    assert found.objective == pytest.approx(min(values), rel=0.02)
    assert found.minimised == "q.max_abs, 80 % quantile"


@pytest.mark.parametrize("percent", [1, 30, 50, 95, 99])
def test_quantile_over_machines_is_that_of_hazen(percent):
    statistic = Statistic.parse(f"{percent} %")
    values = np.random.default_rng(percent).standard_normal(statistic.machines)
    expected = np.quantile(values, percent / 100, method="hazen")
    assert statistic.weights(values) @ values == pytest.approx(expected, rel=1e-12)
    assert np.count_nonzero(values > expected) >= 2 or percent < 50


@pytest.mark.parametrize("objective", [3.0, "80 %"])
def test_robust_gradient_equals_differences(model, objective):
    design = Design(model, ["k"], np.array([6.5]), np.array([16.0]), [1.5], "auto", 1e-10, True)
    spreads = {"k": spread_of("k", "±1", STIFFNESS, "N/m"), "c": spread_of("c", "±10 %", DAMPING, "N s/m")}
    machines = deviating(design, spreads, 16)
    robust = Robust(machines, 0, Named.parse(model, "q.max_abs"), Statistic.parse(objective))
    x = np.array([0.4])
    np.testing.assert_allclose(robust.slopes(x), differences(robust.values, x), rtol=1e-6)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"robust": 3.0}, "no parameter has a tolerance"),
        ({"vary": {"k": "±1 %"}}, "'vary' requires 'robust'"),
        ({"robust": -1.0, "vary": {"k": "±1 %"}}, "robust is -1"),
        ({"robust": "100 %", "vary": {"k": "±1 %"}}, "from 1 % to 99 %"),
        ({"robust": "three", "vary": {"k": "±1 %"}}, "robust is three"),
        ({"robust": 1.0, "vary": {"k": "±1 %"}, "speeds": "1:2:3 rad/s"}, "list of speeds"),
        ({"robust": 1.0, "vary": {"k": "±1 %"}, "minimise": lambda orbits: 0.0}, "quantity by name"),
    ],
)
def test_invalid_robust_requests_are_refused(model, change, text):
    request = {"minimise": "q.max_abs", "free": {"k": (5.0, 20.0)}, "speeds": 1.0, **change}
    with pytest.raises(SolveError, match=text):
        solve.optimise(model, **request)


@pytest.mark.slow
def test_robust_gear_has_a_smaller_deviation_than_the_nominal_optimum():
    gear, free = solve.load("gear_pair", J1=0.05), {"J1": (0.03, 0.08)}
    vary, speed = {"k0": "±5 %", "zeta": "normal(0.024, 0.002)"}, "3800 rpm"
    spread = []
    for robust in (None, 3.0):
        options = {} if robust is None else {"robust": robust, "vary": vary}
        found = solve.optimise(gear, "mesh_force.max", free, speed, rtol=1e-5, **options)
        batch = solve.tolerances(
            found.system, speed, vary, of=["mesh_force.max"], samples=512, index_samples=0, rtol=1e-5
        )
        forces = batch.values[:, 1]
        spread.append((forces.mean() + 3 * forces.std(), forces.std()))
    (nominal, wide), (robust, narrow) = spread
    assert robust < 0.96 * nominal
    assert narrow < 0.3 * wide
