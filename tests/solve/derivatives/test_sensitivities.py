"""Derivatives of orbits and multipliers: closed forms, central differences on one grid, and undefined
derivatives."""

import math

import numpy as np
import pytest

import solve
from derive import Mechanism, cos, rate, sin
from solve.errors import NoDerivativeError, ResonanceError, UnknownNameError, ValueOutOfBoundsError
from solve.units import speed_in_si
from tests.derive.modules import module_of
from tests.solve.derivatives.differences import PARTS, differences
from tests.solve.kernel.test_lanes import needs_compiler
from tests.solve.model.test_damping import NUMBERS as CHAIN
from tests.solve.model.test_damping import chain
from tests.solve.newton.mechanisms import model_of
from tests.solve.systems import random_system

SPEED, M, C, K, F = 3.0, 2.0, 0.7, 11.0, 5.0


def oscillators():
    """Return m q̈ + c q̇ + k q = f cos 2φ and a second oscillator, which may be identical, with the power of
    the first damper."""
    made = Mechanism("oscillators", "Two oscillators side by side", energy="1/s^2")
    q, p = made.coordinates(q=("1", "first"), p=("1", "second"))
    m, c, k, f, k2, c2 = made.parameters(
        m=("1", "mass", "> 0"),
        c=("1/s", "damping"),
        k=("1/s^2", "stiffness"),
        f=("1/s^2", "load"),
        k2=("1/s^2", "stiffness of the second"),
        c2=("1/s", "damping of the second"),
    )
    made.kinetic = (m * rate(q) ** 2 + rate(p) ** 2) / 2
    made.potential = (k * q**2 + k2 * p**2) / 2
    made.dissipation = (c * rate(q) ** 2 + c2 * rate(p) ** 2) / 2
    made.force(f * cos(2 * made.phase), along=q)
    made.force(k2 * sin(made.phase), along=p)
    made.output("lost", c * rate(q) ** 2, "1/s^3", "power in the first damper")
    made.decline_drive_torque("an equation without units")
    return module_of(made)


def model(**changed):
    return model_of(oscillators(), **{"m": M, "c": C, "k": K, "f": F, "k2": 7.0, "c2": 3.0, **changed})


def amplitude(m=M, c=C, k=K, f=F, speed=SPEED):
    """Return the complex amplitude of the first oscillator, f / (k - m ω² + i c ω) with ω = 2Ω."""
    return f / (k - m * (2 * speed) ** 2 + 2j * c * speed)


def exponent(m=M, c=C, k=K):
    return (-c + 1j * math.sqrt(4 * m * k - c**2)) / (2 * m)


NUMBERS = {"m": M, "c": C, "k": K, "f": F, "speed": SPEED}


@pytest.fixture(scope="module")
def oscillator_sensitivities():
    of = ["q.harmonic2", "q.max", "q.min", "q.rms", "q.mean", "q.phase2", "lost.mean", "lost.max"]
    return solve.sensitivities(model(), SPEED, of, list(NUMBERS))


@pytest.mark.parametrize("name", NUMBERS)
def test_derivatives_of_an_oscillator_match_the_closed_form(oscillator_sensitivities, name):
    a = amplitude()
    slope = -(a**2) / F * {"m": -4 * SPEED**2, "c": 2j * SPEED, "k": 1.0, "f": 0.0}.get(name, 0.0)
    slope += a / F * (name == "f") - a**2 / F * (-8 * M * SPEED + 2j * C) * (name == "speed")
    size = (slope * a.conjugate()).real / abs(a)
    expected = {
        "q.harmonic2": size,
        "q.max": size,
        "q.min": -size,
        "q.rms": size / math.sqrt(2),
        "q.mean": 0.0,
        "q.phase2": (slope / a).imag,
    }
    for quantity, value in expected.items():
        assert oscillator_sensitivities[quantity][name] == pytest.approx(value, rel=1e-8, abs=1e-10), quantity
    power = 2 * C * SPEED**2 * abs(a) ** 2
    loss = power / C * (name == "c") + 2 * power / SPEED * (name == "speed") + 2 * power / abs(a) * size
    assert oscillator_sensitivities["lost.mean"][name] == pytest.approx(loss, rel=1e-8)
    assert oscillator_sensitivities["lost.max"][name] == pytest.approx(2 * loss, rel=1e-8)


def test_multiplier_and_exponent_derivatives_match_the_closed_form():
    names = ["m", "c", "k", "speed"]
    lam, period = exponent(), 2 * math.pi / SPEED
    of = ["rho1", "rho1.re", "rho1.im", "rho1.abs", "spectral_radius", "exponent1", "exponent1.re", "rho2.im"]
    sensitivities = solve.sensitivities(model(), SPEED, of, names)
    rho = np.exp(lam * period)
    root = math.sqrt(4 * M * K - C**2)
    slopes = {
        "m": -lam / M + 1j * K / (M * root),
        "c": (-1 - 1j * C / root) / (2 * M),
        "k": 1j / root,
        "speed": 0.0,
    }
    sign = 1.0 if rho.imag > 0 else -1.0
    for name in names:
        of_rho = rho * (slopes[name] * period - (lam * period / SPEED) * (name == "speed"))
        upper = of_rho if sign > 0 else of_rho.conjugate()
        assert sensitivities["rho1"][name] == pytest.approx(upper, rel=1e-8)
        assert sensitivities["rho1.re"][name] == pytest.approx(upper.real, rel=1e-8)
        assert sensitivities["rho1.im"][name] == pytest.approx(upper.imag, rel=1e-8)
        assert sensitivities["rho2.im"][name] == pytest.approx(-upper.imag, rel=1e-8)
        radius = (of_rho * rho.conjugate()).real / abs(rho)
        assert sensitivities["rho1.abs"][name] == pytest.approx(radius, rel=1e-8, abs=1e-12)
        assert sensitivities["spectral_radius"][name] == sensitivities["rho1.abs"][name]
        assert sensitivities["exponent1.re"][name] == pytest.approx(slopes[name].real, rel=1e-8, abs=1e-11)


def test_elasticity_is_the_ratio_of_relative_changes(oscillator_sensitivities):
    a = oscillator_sensitivities.found["q.harmonic2"].value
    assert oscillator_sensitivities.elasticities("q.harmonic2")["f"] == pytest.approx(1.0, rel=1e-9)
    assert oscillator_sensitivities.elasticities("q.harmonic2")["k"] == pytest.approx(
        oscillator_sensitivities["q.harmonic2"]["k"] * K / a
    )


def test_errors_cover_the_change_due_to_finer_steps():
    of, by = ["q1.max_abs", "q3.rms", "spectral_radius"], ["k1", "a1", "speed"]
    cam = solve.load("cam")
    rough = solve.sensitivities(cam, 60.0, of, by, steps=256)
    exact = solve.sensitivities(cam, 60.0, of, by, steps=1536)
    for quantity in of:
        off = np.abs(rough.found[quantity].derivatives - exact.found[quantity].derivatives)
        assert (off <= 3 * rough.found[quantity].errors).all()
        assert (rough.found[quantity].errors <= 1e3 * off).any()


def test_derivative_does_not_depend_on_other_requested_quantities():
    cam = solve.load("cam")
    alone = solve.sensitivities(cam, 60.0, "q3.max_abs", "k1", steps=384)
    beside = solve.sensitivities(cam, 60.0, ["q1.rms", "q3.max_abs"], ["c2", "k1"], steps=384)
    assert beside["q3.max_abs"]["k1"] == pytest.approx(alone["q3.max_abs"]["k1"], rel=1e-12)


CASES = {
    "cam": ("600 rpm", ["q1.max_abs", "contact_force.min", "drive_torque.harmonic4", "rho1", "exponent3.re"]),
    "manipulator": (None, ["q1.max", "q1.rms", "drive_torque.max_abs", "hammer_displacement.rms", "rho1"]),
    "gear_pair": (None, ["q.max_abs", "mesh_force.max", "q.rms", "rho1"]),
    "coupler": ("600 rpm", ["q1.max_abs", "q2.rms", "midpoint_deflection.max", "drive_torque.rms", "rho1"]),
    "mathieu": ("1 rad/s", ["rho1", "exponent1.im"]),
    "four_bar": ("300 rpm", ["crank_tip_deflection.rms", "crank_root_stress_plus.max_abs", "rho1"]),
}  # fmt: skip
FEW = {"manipulator": ["speed"], "gear_pair": ["k1"], "mathieu": ["delta"]}

LEAST = {"four_bar": 1.0}
"""Elasticity of which 1e-8 are asked for: differences of the stiff linkage tell no more."""

STIFF = {"four_bar": (3e-2, 1e-2, 3e-3, 1e-3)}
"""Parts of a parameter that differences take. Stresses of the linkage with parameters that differ by rounding
alone differ by 3e-12 of themselves: with steps of a thousandth their differences have 2e-8 of rounding, with
steps of a hundredth 1e-9. By the coupler's length steps of a hundredth leave 1e-6 of their own, those of
three thousandths 3e-9 together with rounding."""


def check(name, parameters):
    """Compare with differences on one fixed grid, relative to the effect of the parameter alone."""
    model = solve.load(name)
    text, of = CASES[name]
    speed = speed_in_si(text or model.labels.case_speed)
    settings = {
        "method": solve.Radau(),
        "steps": 384 if name in ("cam", "gear_pair") else 96,
        "engine": "numpy",
    }
    sensitivities = solve.sensitivities(model, speed, of, parameters, **settings)
    for by in parameters or sensitivities.by:
        at = sensitivities.by[by]
        try:
            expected = differences(model, speed, by, of, parts=STIFF.get(name, PARTS), **settings)
        except ValueOutOfBoundsError:
            # It is 0, and may not be less.
            assert at == 0
            continue
        for quantity, slope in zip(of, expected, strict=True):
            ours, value = sensitivities[quantity][by], sensitivities.found[quantity].value
            if name == "manipulator" and math.isnan(abs(ours)):
                # Half a turn later the unloaded hammer does the same, but for a load or an even order.
                assert by == "F" or by.rstrip("0123456789") in ("a", "b", "Fa", "Fb")
                continue
            scale = max(abs(slope), LEAST.get(name, 1e-2) * abs(value) / (abs(at) or 0.05))
            assert abs(ours - slope) <= 1e-8 * scale, (quantity, by, ours, slope)


@pytest.mark.parametrize("name", FEW)
def test_derivatives_match_the_discrete_solution(name):
    check(name, FEW[name])


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_all_parameter_derivatives_match_the_discrete_solution(name):
    check(name, None)


def test_coinciding_multipliers_have_no_derivative():
    twins = model(m=1.0, k2=K, c2=C)
    sensitivities = solve.sensitivities(twins, SPEED, ["rho1.abs", "q.max"], ["k", "c"])
    assert all(math.isnan(each) for each in sensitivities["rho1.abs"].values())
    assert "another multiplier lies at a relative distance" in sensitivities.warnings[0]
    assert sensitivities["q.max"]["k"] != 0


def test_spectral_radius_shared_by_two_multipliers_has_no_derivative():
    alike = model(m=1.0, k2=2.0, c2=C)
    sensitivities = solve.sensitivities(alike, SPEED, ["spectral_radius", "rho1.abs"], ["c"])
    assert "same modulus" in sensitivities.found["spectral_radius"].reason
    assert sensitivities["rho1.abs"]["c"] != 0


def test_equal_extrema_with_different_slopes_have_no_derivative():
    sensitivities = solve.sensitivities(
        solve.load("manipulator"), "50 rpm", ["q1.max", "q1.rms"], ["F", "k1"]
    )
    assert math.isnan(sensitivities["q1.max"]["F"])
    assert sensitivities["q1.max"]["k1"] != 0
    assert "several extrema" in sensitivities.warnings[0]
    assert sensitivities["q1.rms"]["F"] == pytest.approx(0.0, abs=1e-12)


def test_invalid_sensitivity_requests_are_refused():
    cam = solve.load("cam")
    for of, by, error in (
        ("q3.maxabs", "k1", UnknownNameError),
        ("q9.max", "k1", UnknownNameError),
        ("rho9", "k1", ValueOutOfBoundsError),
        ("q3", "k1", ValueOutOfBoundsError),
        ("q3.max", "kk", UnknownNameError),
        ([], "k1", ValueOutOfBoundsError),
    ):
        with pytest.raises(error):
            solve.sensitivities(cam, 60.0, of, by)
    with pytest.raises(NoDerivativeError, match="is an integer"):
        solve.sensitivities(solve.load("gear_pair"), 60.0, "q.max", "z1")
    with pytest.raises(NoDerivativeError, match="no generated equations"):
        solve.sensitivities(random_system(1, 2), 1.0)
    with pytest.raises(ValueOutOfBoundsError, match="support radau, gauss"):
        solve.sensitivities(cam, 60.0, "q3.max", "k1", method="newmark", steps=4000)
    with pytest.raises(ValueOutOfBoundsError, match="requires nonlinear=True"):
        solve.sensitivities(cam, 60.0, "q3.max", "k1", periods=2)
    with pytest.raises(ResonanceError):
        solve.sensitivities(model(c=0.0, k=4 * SPEED**2 * M), SPEED)


def test_derivatives_include_damping_ratios_that_depend_on_stiffness():
    damped = solve.load(chain(), e=0.3, zeta1=0.03, zeta2=0.08, **CHAIN)
    of, by = ["q1.max", "q2.rms", "rho1"], ["k", "zeta2"]
    settings = {"method": solve.Radau(), "steps": 96, "engine": "numpy"}
    sensitivities = solve.sensitivities(damped, 3.0, of, by, **settings)
    for name in by:
        expected = differences(damped, 3.0, name, of, **settings)
        assert [sensitivities[quantity][name] for quantity in of] == pytest.approx(list(expected), rel=1e-8)
    at_rest = solve.load(chain(), e=0.0, zeta1=0.03, zeta2=0.08, **CHAIN)
    with pytest.raises(NoDerivativeError, match="e is 0"):
        solve.sensitivities(at_rest, 3.0, of, "e")


def test_adjoint_and_direct_derivatives_agree():
    cam = solve.load("cam")
    of, many = ["q3.max_abs", "contact_force.harmonic3"], ["k1", "a1", "F", "speed", "m2", "c2", "b3"]
    adjoint = solve.sensitivities(cam, 60.0, of, many, steps=192)
    for name in many:
        # Fewer parameters than two a quantity are columns.
        alone = solve.sensitivities(cam, 60.0, of, name, steps=192)
        for quantity in of:
            assert adjoint[quantity][name] == pytest.approx(alone[quantity][name], rel=1e-10)


@needs_compiler
@pytest.mark.parametrize(
    ("name", "of"), [("cam", ["q3.max", "rho1"]), ("gear_pair", ["q.rms", "mesh_force.max"])]
)
def test_engines_give_the_same_derivatives(name, of):
    oscillator_sensitivities = [
        solve.sensitivities(solve.load(name), 60.0, of, steps=96, method=solve.Gauss(), engine=engine)
        for engine in ("compiled", "numpy")
    ]
    for quantity in of:
        ours, theirs = (each.found[quantity].derivatives for each in oscillator_sensitivities)
        assert np.allclose(ours, theirs, rtol=1e-9, atol=1e-9 * np.abs(theirs).max())
