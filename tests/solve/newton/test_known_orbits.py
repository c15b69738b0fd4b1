"""Known orbits: the orbit is chosen first, and the load is computed from it."""

import numpy as np
import pytest

import solve
from solve.capabilities import Nonlinear
from tests.solve.newton.mechanisms import duffing, known_system, model_of, trigonometric
from tests.solve.references import relative_error

PHASE = np.linspace(0.0, 2 * np.pi, 500)


def near(orbit, seed):
    """Motion that differs from an orbit by at most 10 %."""
    rng = np.random.default_rng(seed)
    off = rng.standard_normal((2, 3)) + 1j * rng.standard_normal((2, 3))
    scale = np.abs(orbit(PHASE)).max(axis=1) / np.abs(trigonometric(off)(PHASE)).max(axis=1)
    return trigonometric(orbit.coefficients + 0.1 * scale[:, None] * off)


def check(seed):
    model, orbit = known_system(seed)
    computed = solve.nonlinear(model, 1.0, start=near(orbit, seed))
    assert computed.found_by == "start"
    assert computed.error_estimate.orbit <= 1e-8
    error = relative_error(computed.at(PHASE), orbit(PHASE))
    assert error <= 10 * computed.error_estimate.orbit
    _, v, a = computed.state(PHASE)
    np.testing.assert_allclose(v, orbit(PHASE, 1), rtol=0, atol=1e-7 * np.abs(v).max())
    np.testing.assert_allclose(a, orbit(PHASE, 2), rtol=0, atol=1e-6 * np.abs(a).max())


@pytest.mark.parametrize("seed", range(3))
def test_known_orbit_is_found_within_its_estimate(seed):
    check(seed)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3, 50))
def test_fifty_known_orbits_are_found_within_their_estimates(seed):
    check(seed)


@pytest.mark.slow
def test_without_initial_guess_only_known_orbits_are_found():
    for seed in range(50):
        model, orbit = known_system(seed)
        computed = solve.nonlinear(model, 1.0)
        assert computed.found_by in ("linear orbit", "load", "transient")
        assert relative_error(computed.at(PHASE), orbit(PHASE)) <= 10 * computed.error_estimate.orbit


def test_methods_agree():
    model, orbit = known_system(0)
    for method in ("radau", "gauss"):
        computed = solve.nonlinear(model, 1.0, orbit, method=method)
        assert computed.method == method
        assert relative_error(computed.at(PHASE), orbit(PHASE)) < 1e-8


def test_error_on_given_steps_is_estimated_with_doubled_steps():
    model, orbit = known_system(0)
    computed = solve.nonlinear(model, 1.0, orbit, method=solve.Gauss(order=4), steps=40)
    error = relative_error(computed.at(PHASE), orbit(PHASE))
    assert computed.steps == 40
    assert error / 10 < computed.error_estimate.orbit < 10 * error
    assert any("gauss with 40 steps" in text for text in computed.warnings)


def test_nonlinear_orbit_of_linear_model_is_linear_orbit():
    model = model_of(duffing(), zeta=0.1, k=1.0, alpha=0.0, f=1.0)
    linear, computed = solve.periodic(model, 0.7), solve.nonlinear(model, 0.7)
    assert computed.found_by == "linear orbit"
    assert relative_error(computed.at(PHASE), linear.at(PHASE)) < 1e-8
    np.testing.assert_allclose(computed.multipliers, linear.multipliers, rtol=1e-8)


class InUnits(solve.PeriodicSystem, Nonlinear):
    """Model whose equations are multiplied by numbers (n,)."""

    def __init__(self, model, units):
        self.model, self.units = model, units
        super().__init__(self.of(model), model.coordinates)

    def of(self, model):
        def matrices(phase, speed):
            M, C, K, d = model.at(phase, speed)
            return (*(self.units[:, None] * part for part in (M, C, K)), self.units * d)

        return matrices

    @property
    def capabilities(self):
        return super().capabilities._replace(nonlinear=self)

    def along(self, motion, compiled=None):
        return solve.PeriodicSystem(self.of(self.model.along(motion, compiled)), self.coordinates)


@pytest.mark.parametrize("engine", ["compiled", "numpy"])
def test_units_of_the_equations_do_not_reduce_accuracy(engine):
    model, orbit = known_system(2)
    computed, again = (
        solve.nonlinear(each, 1.0, start=orbit, rtol=1e-11, engine=engine)
        for each in (model, InUnits(model, 2.0 ** np.array([11, -11])))
    )
    assert relative_error(again.at(PHASE), computed.at(PHASE)) < 5e-14
    np.testing.assert_allclose(again.multipliers, computed.multipliers, rtol=0, atol=2e-14)
