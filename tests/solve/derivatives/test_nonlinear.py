"""Derivatives of nonlinear orbits and of their multipliers: central differences, a linear model, and the
amplitude of a single harmonic in closed form."""

from functools import cache, partial

import numpy as np
import pytest

import solve
from derive import Mechanism, cos, rate
from solve.errors import LinearModelError
from tests.solve.derivatives.differences import differences
from tests.solve.model.test_damping import NUMBERS, chain
from tests.solve.newton.mechanisms import duffing, model_of, pendulum

GRID = {"method": solve.Radau(), "rtol": 1e-11, "engine": "auto"}


def check(model, speed, of, by, steps):
    """Compare derivatives with differences on one grid. Newton's iteration evaluates matrices along the
    curve, not at the stages; its results therefore have the derivatives of the orbit up to the error of the
    grid, which is small here."""
    settings = {**GRID, "steps": steps}
    sensitivities = solve.sensitivities(model, speed, of, by, nonlinear=True, **settings)
    for name in sensitivities.by:
        expected = differences(model, speed, name, of, solved=solve.nonlinear, parts=(1e-3, 1e-4), **settings)
        for quantity, slope in zip(of, expected, strict=True):
            scale = max(
                abs(slope), 1e-2 * abs(sensitivities.found[quantity].value / (sensitivities.by[name] or 0.05))
            )
            assert abs(sensitivities[quantity][name] - slope) <= 1e-8 * scale, (quantity, name)


@pytest.mark.slow
def test_derivatives_of_a_hardening_oscillator_match_differences():
    model = model_of(duffing(), zeta=0.1, k=1.0, alpha=0.5, f=1.5)
    check(model, 1.3, ["q.max", "q.harmonic3", "q.rms", "rho1", "rho1.abs"], ["alpha", "speed"], 96)


def test_small_load_gives_the_linear_derivatives():
    model = model_of(duffing(), zeta=0.1, k=1.0, alpha=0.5, f=1e-6)
    of, by = ["q.max", "rho1"], ["k", "zeta", "speed"]
    linear, nonlinear = (
        solve.sensitivities(model, 1.3, of, by, nonlinear=each, steps=128) for each in (False, True)
    )
    for quantity in of:
        assert nonlinear[quantity] == pytest.approx(linear[quantity], rel=1e-8)


def test_multiplier_derivatives_at_rest_match_the_linear_model():
    model = model_of(pendulum(), c=0.2, b=0.3, g=1.0)
    of, by = ["rho1.re", "rho1.im", "exponent1.re"], ["b", "g", "speed"]
    linear, nonlinear = (
        solve.sensitivities(model, 1.7, of, by, nonlinear=each, steps=128) for each in (False, True)
    )
    for quantity in of:
        assert nonlinear[quantity] == pytest.approx(linear[quantity], rel=1e-9)


@pytest.mark.slow
def test_cam_derivatives_match_finite_differences():
    of = ["q1.max_abs", "q3.rms", "contact_force.min", "rho1"]
    check(solve.load("cam"), 30.0, of, ["k1", "speed"], 1024)


def test_errors_cover_the_change_due_to_finer_steps():
    model = model_of(duffing(), zeta=0.1, k=1.0, alpha=0.5, f=1.5)
    of, by = ["q.max", "q.rms", "rho1"], ["alpha", "f", "speed"]
    rough, exact = (solve.sensitivities(model, 1.3, of, by, steps=m, nonlinear=True) for m in (48, 384))
    for quantity in of:
        off = np.abs(rough.found[quantity].derivatives - exact.found[quantity].derivatives)
        assert (off <= 3 * rough.found[quantity].errors).all()


def test_nonlinear_derivatives_of_a_linear_model_are_refused():
    with pytest.raises(LinearModelError):
        solve.sensitivities(solve.load("four_bar"), 30.0, "rho1", nonlinear=True)


def test_nonlinear_derivatives_match_linear_ones_for_linear_springs():
    damped = solve.load(chain(), e=0.3, zeta1=0.03, zeta2=0.08, **NUMBERS)
    of, by = ["q1.max", "q2.harmonic1", "rho1"], ["k", "zeta2", "m", "speed"]
    linear, nonlinear = (
        solve.sensitivities(damped, 3.0, of, by, nonlinear=each, steps=96) for each in (False, True)
    )
    for quantity in of:
        assert nonlinear[quantity] == pytest.approx(linear[quantity], rel=1e-8)


def test_two_period_orbit_repeating_after_one_has_equal_derivatives():
    model = model_of(duffing(), zeta=0.1, k=1.0, alpha=0.5, f=0.4)
    of, by = ["q.max", "q.rms", "rho1.abs", "exponent1.re"], ["alpha", "zeta", "speed"]
    one, two = (
        solve.sensitivities(model, 2.3, of, by, steps=128 * k, nonlinear=True, periods=k) for k in (1, 2)
    )
    radius = one.found["rho1.abs"].value
    assert not any("repeats" in note for note in one.notes)
    assert any("repeats after each of its 2 periods" in note for note in two.notes)
    for quantity in of:
        doubled = 2 * radius if quantity == "rho1.abs" else 1.0
        for name in by:
            assert two[quantity][name] == pytest.approx(doubled * one[quantity][name], rel=1e-6, abs=1e-9)


@pytest.mark.slow
def test_derivatives_of_a_period_doubled_pendulum_match_differences():
    model, of, by = (
        model_of(pendulum(), c=0.1, b=0.15, g=1.0),
        ["q.rms", "q.harmonic1", "rho1.abs"],
        ["b", "c"],
    )
    settings = {**GRID, "steps": 512, "periods": 2}
    sensitivities = solve.sensitivities(model, 2.0, of, by, nonlinear=True, **settings)
    from_here = partial(solve.nonlinear, start=solve.nonlinear(model, 2.0, periods=2))
    for name in by:
        expected = differences(model, 2.0, name, of, solved=from_here, parts=(1e-2, 1e-3), **settings)
        assert [sensitivities[each][name] for each in of] == pytest.approx(
            list(expected), rel=1e-7, abs=1e-10
        )


@cache
def on_a_cubic_spring():
    """Return a mass on a cubic spring with a damping ratio."""
    made = Mechanism("cubic", "A mass on a cubic spring with a damping ratio")
    (q,) = made.coordinates(q=("m", "displacement"))
    m, k, a, F = made.parameters(
        m=("kg", "mass", "> 0"), k=("N/m", "spring", "> 0"), a=("N/m^3", "its hardening"), F=("N", "load")
    )
    made.kinetic = m * rate(q) ** 2 / 2
    made.potential = k * (1 + cos(made.phase) / 3) * q**2 / 2 + a * q**4 / 4
    made.damping_ratio = made.parameter("zeta", "1", "damping ratio", ">= 0")
    made.force(F * cos(made.phase), along=q)
    return made


@pytest.mark.slow
def test_derivatives_with_a_damping_ratio_match_differences():
    model = solve.load(on_a_cubic_spring(), m=2.0, k=50.0, a=20.0, F=10.0, zeta=0.1)
    check(model, 7.0, ["q.max", "q.rms", "rho1.abs"], ["m", "k", "a", "zeta", "speed"], 128)
