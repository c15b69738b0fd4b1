"""Undamped nonlinear modes, compared with closed forms."""

import numpy as np
import pytest
from scipy.special import ellipk

import solve
from derive import Heaviside, Mechanism, exp, rate, sin
from solve.errors import ValueOutOfBoundsError
from tests.derive.modules import module_of
from tests.solve.newton.mechanisms import absorber, duffing, model_of, stop


def test_frequency_of_duffings_mode_matches_elliptic_functions():
    """q̈ + q + q³ = 0 with amplitude A: Ω = π √(1 + A²)/(2 K(m)), m = A²/(2 + 2 A²)."""
    model = model_of(duffing(), zeta=0.0, k=1.0, alpha=1.0, f=0.0)
    found = solve.branch(model, "0.9:2.2 rad/s", unforced=True, rtol=1e-9, points=40)
    A = found.peaks[:, 0]
    expected = np.pi * np.sqrt(1 + A**2) / 2 / ellipk(A**2 / 2 / (1 + A**2))
    np.testing.assert_allclose(found.speeds, expected, rtol=1e-9)
    np.testing.assert_allclose(found.energies, A**2 / 2 + A**4 / 4, rtol=1e-9)
    assert found.speeds[0] < 1.01
    assert found.speeds[-1] == pytest.approx(2.2)
    assert (found.multipliers == 1).all()
    assert found.warnings == []


def test_frequency_of_a_gear_with_loss_of_contact():
    """During contact, the motion is harmonic about F/k with amplitude A = max q; during free flight, it is
    uniformly accelerated: T = 2 (π - arccos(F/(k A))) √(m/k) + 2 (m/F) √(k/m) √(A² - (F/k)²)."""
    m, k, F = 0.5, 4e8, 2000.0
    model = solve.load("gear_backlash", e=0.0, E=0.0, c=0.0)
    found = solve.branch(model, "20000:29000 rad/s", unforced=True, rtol=1e-8, points=20)
    A = found.figures[:, 0, 0]
    contact = 2 * (np.pi - np.arccos(F / k / A)) * np.sqrt(m / k)
    flight = 2 * m / F * np.sqrt(k / m * (A**2 - (F / k) ** 2))
    np.testing.assert_allclose(found.speeds, 2 * np.pi / (contact + flight), rtol=1e-8)
    np.testing.assert_allclose(found.energies, k * A**2 / 2, rtol=1e-5)
    assert found.speeds.min() == pytest.approx(20000.0)


def test_modes_begin_at_the_frequencies_of_small_vibrations():
    numbers = {"m": 1.0, "ma": 0.1, "c": 0.0, "k": 1.0, "k3": 0.5, "ka": 0.1, "F": 0.0}
    found = solve.branch(model_of(absorber(), **numbers), "0.7:1.3 rad/s", unforced=True, rtol=1e-6, points=8)
    small = np.sqrt(np.linalg.eigvalsh(np.array([[1.1, -0.1 / 0.1**0.5], [-0.1 / 0.1**0.5, 1.0]])))
    assert set(found.numbers) == {0, 1}
    for number, frequency in enumerate(small):
        first = found.numbers.tolist().index(number)
        assert found.speeds[first] == pytest.approx(frequency, abs=0.03)
        assert found.energies[first] < found.energies[first + 1]


@pytest.mark.parametrize(
    ("model", "given", "words"),
    [
        (("cam", {}), {}, "contain a load or an acceleration"),
        (("gear_backlash", {"e": 0.0, "E": 0.0}), {}, "contain damping"),
        (("gear_backlash", {"e": 0.0, "E": 0.0, "c": 0.0}), {}, "contain no frequency of small vibrations"),
        (("gear_backlash", {"E": 0.0, "c": 0.0}), {}, "contain a load"),
        (("gear_backlash", {}), {"switch": True}, "omit 'over', 'switch', 'start', 'begin' and 'periods'"),
    ],
)
def test_other_equations_are_refused(model, given, words):
    name, numbers = model
    with pytest.raises(ValueOutOfBoundsError, match=words):
        solve.branch(solve.load(name, **numbers), "100:200 rad/s", unforced=True, **given)


def varied(shape):
    """Duffing's oscillator with a load, a stiffness and a cubic stiffness that are proportional to a function
    of the phase."""
    made = Mechanism("varied", "Oscillator that varies over the period", energy="1/s^2")
    (q,) = made.coordinates(q=("1", "displacement"))
    k, load, stiffness, cubic = made.parameters(
        k=("1/s^2", "stiffness"),
        load=("1/s^2", "load"),
        stiffness=("1/s^2", "varying stiffness"),
        cubic=("1/s^2", "varying cubic stiffness"),
    )
    varying = shape(made.phase)
    made.kinetic = rate(q) ** 2 / 2
    made.potential = k * (q**2 / 2 + q**4 / 4) + varying * (stiffness * q**2 / 2 + cubic * q**4 / 4)
    made.force(load * varying, along=q)
    made.decline_drive_torque("an equation without units")
    return made


@pytest.mark.parametrize(
    "shape",
    [
        lambda phase: sin(64 * phase),
        lambda phase: exp(-1e5 * sin((phase - 3.0) / 2) ** 2),
        lambda phase: Heaviside(phase - 1.01) - Heaviside(phase - 1.012),
    ],
    ids=["harmonic 64", "pulse of 0.4 degrees", "rectangle of 0.1 degrees"],
)
@pytest.mark.parametrize(
    ("term", "words"),
    [
        ("load", "at rest contain a load"),
        ("stiffness", "at rest contain coefficients that vary"),
        ("cubic", "along vibrations contain damping, or terms that vary with the phase"),
    ],
)
def test_terms_that_act_between_sixty_four_phases_are_refused(shape, term, words):
    numbers = {"load": 0.0, "stiffness": 0.0, "cubic": 0.0, term: 0.1}
    model = model_of(module_of(varied(shape)), k=1.0, **numbers)
    with pytest.raises(ValueOutOfBoundsError, match=words):
        solve.branch(model, "0.9:1.3 rad/s", unforced=True, points=3)


def damped(force):
    """Duffing's oscillator with a damping force that is zero at rest.

    force: function of the displacement and the velocity."""
    made = Mechanism("damped", "Oscillator with nonlinear damping", energy="1/s^2")
    (q,) = made.coordinates(q=("1", "displacement"))
    k, c = made.parameters(k=("1/s^2", "stiffness"), c=("1/s", "damping"))
    made.kinetic, made.potential = rate(q) ** 2 / 2, k * (q**2 / 2 + q**4 / 4)
    made.force(-c * force(q, rate(q)), along=q)
    made.decline_drive_torque("an equation without units")
    return made


def test_nonlinear_damping_is_refused():
    model = solve.load(damped(lambda q, v: q**2 * v), k=1.0, c=0.1)
    with pytest.raises(ValueOutOfBoundsError, match="along vibrations contain damping"):
        solve.branch(model, "0.9:1.3 rad/s", unforced=True, points=3)


def test_mode_ends_where_a_dashpot_begins_to_act():
    model = solve.load(damped(lambda q, v: Heaviside(q - 0.5) * (q - 0.5) * v), k=1.0, c=0.1)
    found = solve.branch(model, "0.9:1.3 rad/s", unforced=True, rtol=1e-6)
    assert 0.4 < found.peaks[-1, 0] < 0.5
    assert (
        found.ended
        == "beyond the last orbit, the equations contain damping, or terms that vary with the phase"
    )


@pytest.mark.parametrize("kappa", [30.0, 300.0, 3000.0])
def test_modes_with_a_hard_stop(kappa):
    """In free flight, q = A cos t. During contact, the mass vibrates about κ/(1 + κ) with the frequency √(1 +
    κ)."""
    model = model_of(stop(), zeta=0.0, k=1.0, kappa=kappa, gap=1.0, f=0.0)
    found = solve.branch(model, "0.9:1.6 rad/s", unforced=True, rtol=1e-8, points=40)
    assert (found.ended, found.values[-1]) == ("", 1.6)
    peak = found.figures[:, 0, 0]
    touches = peak > 1.001
    assert touches.sum() > 5
    centre, rate_in_contact = kappa / (1 + kappa), np.sqrt(1 + kappa)
    depth = peak[touches] - centre
    velocity = rate_in_contact * np.sqrt(depth**2 - (1 - centre) ** 2)
    flight = 2 * (np.pi - np.arctan(velocity))
    contact = 2 * np.arccos((1 - centre) / depth) / rate_in_contact
    np.testing.assert_allclose(found.speeds[touches], 2 * np.pi / (flight + contact), rtol=1e-7)
    np.testing.assert_allclose(found.speeds[peak < 1], 1.0, rtol=1e-9)


@pytest.mark.parametrize(("kappa", "gap"), [(3000.0, 0.3), (5000.0, 2.0), (20000.0, 0.7)])
def test_contact_with_a_hard_stop_raises_the_frequency(kappa, gap):
    model = model_of(stop(), zeta=0.0, k=1.0, kappa=kappa, gap=gap, f=0.0)
    found = solve.branch(model, "0.9:1.6 rad/s", unforced=True, rtol=1e-3)
    assert found.values.min() > 1 - 1e-6
