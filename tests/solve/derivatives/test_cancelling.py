"""Derivatives that are sums of large cancelling terms: those with respect to a common phase shift, on which
no statistic and no multiplier depends."""

from functools import cache

import pytest

import solve
from derive import Mechanism, cos, rate, sin
from tests.derive.modules import module_of
from tests.solve.newton.mechanisms import model_of

NUMBERS = {"zeta": 0.05, "k": 2.0, "e": 0.5, "alpha": 0.1, "f": 0.5, "s": 0.3}
OF = ["q.max_abs", "q.rms", "q.harmonic1", "w.rms", "w.harmonic2", "rho1.abs", "exponent1.re"]


@cache
def shifted():
    made = Mechanism("shifted", "Two masses, all of whose loads are shifted", energy="1/s^2")
    q, w = made.coordinates(q=("1", "first"), w=("1", "second"))
    zeta, k, e, alpha, f = made.parameters(
        zeta=("1/s", "damping"),
        k=("1/s^2", "stiffness"),
        e=("1/s^2", "varying stiffness"),
        alpha=("1/s^2", "cubic stiffness"),
        f=("1/s^2", "load"),
    )
    angle = made.phase + made.parameter("s", "rad", "shift")
    made.kinetic, made.dissipation = (rate(q) ** 2 + rate(w) ** 2) / 2, zeta * (rate(q) ** 2 + rate(w) ** 2)
    made.potential = (k + e * cos(angle)) * q**2 / 2 + alpha * q**4 / 4 + k * w**2 + k * (q - w) ** 2 / 6
    made.force(f * (cos(angle) + sin(2 * angle)), along=q)
    made.decline_drive_torque("an equation without units")
    return module_of(made)


@pytest.mark.parametrize("nonlinear", [True, False])
@pytest.mark.parametrize("by", [["s"], list(NUMBERS)])
def test_reported_error_covers_roundoff_of_vanishing_derivatives(by, nonlinear):
    """For few parameters, direct derivatives of the orbit are summed; for many, an adjoint problem is
    solved."""
    model = model_of(shifted(), **NUMBERS)
    for speed in (0.7, 1.3, 2.1):
        for quantity in OF:
            sensitivities = solve.sensitivities(model, speed, quantity, by, rtol=1e-11, nonlinear=nonlinear)
            reported = sensitivities.found[quantity].errors[by.index("s")]
            assert abs(sensitivities[quantity]["s"]) <= 10 * reported, (speed, quantity)
            assert reported < 1e-10


def test_single_multiplier_derivative_is_computed_without_the_others(monkeypatch):
    cam = solve.load("cam")
    of, by = ["rho1.abs", "exponent1.re"], ["k1", "speed"]
    expected = solve.sensitivities(cam, "600 rpm", of, by)
    monkeypatch.setattr("solve.certify.all_multipliers.Spectrum._logarithms_and_errors", None)
    sensitivities = solve.sensitivities(cam, "600 rpm", of, by)
    assert [sensitivities[quantity] for quantity in of] == [expected[quantity] for quantity in of]
