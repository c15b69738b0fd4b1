"""Modal damping ratios, compared with 2ζ M √(M⁻¹K), closed forms for constant coefficients, and prescribed
dissipation."""

from functools import cache

import numpy as np
import pytest
from scipy.linalg import sqrtm

import solve
from derive import Mechanism, cos, rate, rectangle, sin, sqrt
from solve.errors import MatricesError, TransientError

NUMBERS = {"m": 2.0, "k": 50.0, "F": 1.0}


@cache
def chain(varies=cos, ratios=2):
    """Return two masses on two springs, one of which varies with the phase, with one damping ratio or one per
    mode."""
    made = Mechanism("chain", "Two masses whose spring varies")
    q1, q2 = made.coordinates(q1=("m", "first"), q2=("m", "second"))
    m, k, e, F = made.parameters(
        m=("kg", "each mass", "> 0"), k=("N/m", "each spring", "> 0"), e=("1", "share"), F=("N", "load")
    )
    made.kinetic = m * (rate(q1) ** 2 + 2 * rate(q2) ** 2) / 2
    made.potential = (k * (1 + e * varies(made.phase)) * q1**2 + k * (q2 - q1) ** 2) / 2
    zeta = made.family("zeta", range(1, ratios + 1), "1", "damping ratio", ">= 0")
    made.damping_ratio = zeta if ratios > 1 else zeta[0]
    made.force(F * cos(made.phase), along=q2)
    return made


def test_multipliers_follow_from_constant_damping_ratios():
    model = solve.load(chain(), e=0.0, zeta1=0.02, zeta2=0.3, **NUMBERS)
    omega = np.sqrt(np.linalg.eigvals(np.array([[50.0, -25.0], [-12.5, 12.5]])).real)
    omega.sort()
    zeta, speed = np.array([0.02, 0.3]), 3.0
    poles = -zeta * omega + 1j * omega * np.sqrt(1 - zeta**2)
    expected = np.exp(poles * 2 * np.pi / speed)
    computed = solve.floquet(model, speed, rtol=1e-11).multipliers
    computed = computed[computed.imag > 0]
    np.testing.assert_allclose(computed, np.where(expected.imag > 0, expected, expected.conj()), rtol=1e-9)


def test_one_ratio_applies_to_all_modes_at_every_position():
    model = solve.load(chain(ratios=1), e=0.6, zeta1=0.04, **NUMBERS)
    phase = np.array([0.3, 1.7, 4.4])
    M, C, K, _ = model.at(phase, 7.0)
    for m, c, k in zip(M, C, K, strict=True):
        np.testing.assert_allclose(c, 2 * 0.04 * m @ sqrtm(np.linalg.solve(m, k)).real, rtol=1e-12)


def test_damping_at_many_points_equals_single_points():
    model = solve.load(chain(), e=0.4, zeta1=0.02, zeta2=0.05, **NUMBERS)
    sweep = solve.sweep(model, [2.0, 3.0], over={"zeta2": [0.01, 0.2], "k": [40.0, 60.0]})
    for point in sweep.points:
        alone = solve.floquet(model.varied(point.parameters), point.speed)
        assert point.spectral_radius == pytest.approx(alone.spectral_radius, rel=1e-9)


def test_modal_damping_applies_to_nonlinear_orbits_and_transients():
    model = solve.load(chain(), e=0.3, zeta1=0.03, zeta2=0.08, **NUMBERS)
    linear, nonlinear = solve.periodic(model, 3.0), solve.nonlinear(model, 3.0)
    np.testing.assert_allclose(nonlinear.at(1.0), linear.at(1.0), rtol=1e-7)
    np.testing.assert_allclose(nonlinear.multipliers, linear.multipliers, rtol=1e-7)
    ends = [solve.transient(model, 3.0, 3, nonlinear=each, rtol=1e-5).q[:, -1] for each in (False, True)]
    np.testing.assert_allclose(ends[1], ends[0], rtol=1e-6)


def test_duffing_with_a_damping_ratio_equals_equivalent_dissipation():
    def duffing(stated):
        made = Mechanism("duffing", "Duffing's oscillator")
        q = made.coordinate("q", "m", "deflection")
        m, k, k3, F = made.parameters(
            m=("kg", "mass"), k=("N/m", "spring"), k3=("N/m^3", "its hardening"), F=("N", "load")
        )
        zeta = made.parameter("zeta", "1", "damping ratio")
        made.kinetic, made.potential = m * rate(q) ** 2 / 2, k * q**2 / 2 + k3 * q**4 / 4
        if stated:
            made.dissipation = zeta * sqrt(k * m) * rate(q) ** 2
        else:
            made.damping_ratio = zeta
        made.force(F * cos(made.phase), along=q)
        return solve.nonlinear(solve.load(made, m=1.0, k=9.0, k3=8.0, F=1.0, zeta=0.1), 2.5)

    one, other = duffing(True), duffing(False)
    np.testing.assert_allclose(other.multipliers, one.multipliers, rtol=1e-8)
    np.testing.assert_allclose(other.at(2.0), one.at(2.0), rtol=1e-8)


def test_drive_power_equals_modal_dissipation():
    made = Mechanism("shaft", "Elastic shaft that drives a slider")
    q = made.coordinate("q", "rad", "twist")
    J, m, r, k = made.parameters(
        J=("kg m^2", "disc"), m=("kg", "slider"), r=("m", "stroke"), k=("N m/rad", "shaft")
    )
    zeta = made.parameter("zeta", "1", "damping ratio")
    angle = made.phase + q
    made.kinetic = (J * rate(angle) ** 2 + m * rate(r * sin(angle)) ** 2) / 2
    made.potential, made.damping_ratio = k * q**2 / 2, zeta
    numbers = {"J": 0.2, "m": 1.0, "r": 0.1, "k": 400.0, "zeta": 0.05}
    orbit = solve.nonlinear(solve.load(made, **numbers), 20.0)
    phase = np.linspace(0.0, 2 * np.pi, 512, endpoint=False)
    inertia = 0.2 + 0.01 * np.cos(phase) ** 2
    lost = 2 * 0.05 * np.sqrt(400 * inertia) * orbit.state(phase)[1][0] ** 2
    gained = 20.0 * orbit.statistics("drive_torque").mean
    assert gained == pytest.approx(lost.mean(), rel=1e-8)


def test_damping_follows_jumps_of_the_stiffness():
    model = solve.load(
        chain(lambda phase: rectangle(phase, 0, 2), 1), e=0.5, zeta1=0.04, m=2.0, k=50.0, F=1.0
    )
    K = np.array([[[125.0, -50], [-50, 50]], [[100.0, -50], [-50, 50]]])
    M = np.diag([2.0, 4.0])
    for c, k in zip(model.at(np.array([1.0, 3.0]), 7.0)[1], K, strict=True):
        np.testing.assert_allclose(c, 2 * 0.04 * M @ sqrtm(np.linalg.solve(M, k)).real, rtol=1e-12)
    with pytest.raises(TransientError, match="cannot be integrated if matrices with damping ratios jump"):
        solve.transient(model, 3.0, 2, nonlinear=True)


def test_negative_stiffness_is_refused():
    with pytest.raises(MatricesError, match="K is not symmetric, or not positive semidefinite"):
        solve.periodic(solve.load(chain(), e=2.5, zeta1=0.02, zeta2=0.05, **NUMBERS), 3.0)


def test_damping_ratio_above_one_raises_a_warning():
    model = solve.load(chain(), e=0.2, zeta1=0.02, zeta2=2.0, **NUMBERS)
    assert any(
        "above 1, modes do not oscillate" in warning for warning in solve.periodic(model, 3.0).warnings
    )
