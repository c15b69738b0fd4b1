"""Derivatives of nonlinear orbits and of their multipliers: central differences, a linear model, and the
amplitude of a pure wave in closed form."""

import numpy as np
import pytest

import solve
from solve.errors import LinearModelError, NoDerivativeError
from tests.solve.derivatives.differences import differences
from tests.solve.model.test_damping import NUMBERS, chain
from tests.solve.newton.mechanisms import duffing, model_of, pendulum

GRID = {"method": solve.Radau(), "rtol": 1e-11, "engine": "auto"}


def check(model, speed, of, by, steps):
    """Newton's iteration takes its matrices along the curve and not at the stages: what it gives on a grid
    has the derivatives of the orbit but for the error of the grid, which is small here."""
    settings = {**GRID, "steps": steps}
    found = solve.sensitivities(model, speed, of, by, nonlinear=True, **settings)
    for name in found.by:
        expected = differences(model, speed, name, of, solved=solve.nonlinear, parts=(1e-3, 1e-4), **settings)
        for quantity, slope in zip(of, expected, strict=True):
            scale = max(abs(slope), 1e-2 * abs(found.found[quantity].value / (found.by[name] or 0.05)))
            assert abs(found[quantity][name] - slope) <= 1e-8 * scale, (quantity, name)


@pytest.mark.slow
def test_a_hardening_oscillator():
    model = model_of(duffing(), zeta=0.1, k=1.0, alpha=0.5, f=1.5)
    check(model, 1.3, ["q.max", "q.harmonic3", "q.rms", "rho1", "rho1.abs"], ["alpha", "speed"], 96)


def test_a_small_load_has_the_linear_derivatives():
    model = model_of(duffing(), zeta=0.1, k=1.0, alpha=0.5, f=1e-6)
    of, by = ["q.max", "rho1"], ["k", "zeta", "speed"]
    linear, nonlinear = (
        solve.sensitivities(model, 1.3, of, by, nonlinear=each, steps=128) for each in (False, True)
    )
    for quantity in of:
        assert nonlinear[quantity] == pytest.approx(linear[quantity], rel=1e-8)


def test_multipliers_of_an_orbit_that_stays_at_rest_change_with_the_stroke():
    model = model_of(pendulum(), c=0.2, b=0.3, g=1.0)
    of, by = ["rho1.re", "rho1.im", "exponent1.re"], ["b", "g", "speed"]
    linear, nonlinear = (
        solve.sensitivities(model, 1.7, of, by, nonlinear=each, steps=128) for each in (False, True)
    )
    for quantity in of:
        assert nonlinear[quantity] == pytest.approx(linear[quantity], rel=1e-9)


@pytest.mark.slow
def test_the_cam():
    of = ["q1.max_abs", "q3.rms", "contact_force.min", "rho1"]
    check(solve.load("cam"), 30.0, of, ["k1", "speed"], 1024)


def test_errors_hold_what_finer_steps_change():
    model = model_of(duffing(), zeta=0.1, k=1.0, alpha=0.5, f=1.5)
    of, by = ["q.max", "q.rms", "rho1"], ["alpha", "f", "speed"]
    rough, exact = (solve.sensitivities(model, 1.3, of, by, steps=m, nonlinear=True) for m in (48, 384))
    for quantity in of:
        off = np.abs(rough.found[quantity].derivatives - exact.found[quantity].derivatives)
        assert (off <= 3 * rough.found[quantity].errors).all()


def test_what_has_none_is_said():
    with pytest.raises(LinearModelError):
        solve.sensitivities(solve.load("four_bar"), 30.0, "rho1", nonlinear=True)
    damped = solve.load(chain(), e=0.3, zeta1=0.03, zeta2=0.08, **NUMBERS)
    with pytest.raises(NoDerivativeError, match="damping ratios"):
        solve.sensitivities(damped, 3.0, "q1.max", "k", nonlinear=True)
