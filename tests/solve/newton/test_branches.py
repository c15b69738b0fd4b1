"""Branches around folds, compared with closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import fsolve

import solve
from derive import Mechanism, cos, exp, rate, sin
from solve.errors import LinearModelError, UnitError, ValueOutOfBoundsError
from tests.solve.newton.mechanisms import cubic_rotor, duffing, model_of

NUMBERS = {"c": 0.08, "k": 1.0, "alpha": 0.1, "f": 0.2}


def balance(speed, amplitude):
    """f² - |k - Ω² + α a² + i c Ω|² a², and its derivative with respect to a."""
    c, k, alpha, f = NUMBERS.values()
    real = k - speed**2 + alpha * amplitude**2
    square = real**2 + (c * speed) ** 2
    slope = -2 * square * amplitude - 4 * real * alpha * amplitude**3
    return f**2 - square * amplitude**2, slope


def radius(speed, amplitude):
    """Spectral radius for η in z = (A + η) e^{iφ}, whose equations have constant coefficients: η̈ + (2iΩ + c)
    η̇ + (k - Ω² + icΩ + 2α|A|²) η + α A² η* = 0. A may be assumed real."""
    c, k, alpha, _ = NUMBERS.values()
    stiff = k - speed**2 + 2 * alpha * amplitude**2
    K = np.array([[stiff + alpha * amplitude**2, -c * speed], [c * speed, stiff - alpha * amplitude**2]])
    C = np.array([[c, -2 * speed], [2 * speed, c]])
    state = np.block([[np.zeros((2, 2)), np.eye(2)], [-K, -C]])
    return np.exp(2 * np.pi * np.linalg.eigvals(state).real.max() / speed)


@pytest.fixture(scope="module")
def rotor_branch():
    return solve.branch(model_of(cubic_rotor(), **NUMBERS), (0.8, 1.6), rtol=1e-5)


def test_curves_of_a_branch_equal_its_orbits(rotor_branch):
    branch = rotor_branch
    phases = np.linspace(0.0, 2 * np.pi, 400)
    for point in (0, len(branch.speeds) // 2, -1):
        q = branch.curve(point)(phases)
        assert q.shape == (2, 400)
        np.testing.assert_allclose(np.abs(q).max(axis=1), branch.peaks[point], rtol=1e-3)


def test_branch_orbits_satisfy_the_equations(rotor_branch):
    computed = rotor_branch
    assert computed.warnings == []
    assert computed.errors[:, 0].max() < 1e-5
    assert computed.speeds[[0, -1]] == pytest.approx([0.8, 1.6], rel=1e-9)
    for speed, (x, y), radii in zip(computed.speeds, computed.peaks, computed.radius, strict=True):
        assert abs(balance(speed, x)[0]) < 4e-5 * NUMBERS["f"] ** 2
        assert y == pytest.approx(x, rel=1e-5)
        assert radii == pytest.approx(radius(speed, x), rel=1e-3)


def test_verdicts_keep_the_margins_of_single_orbits(rotor_branch):
    """The verdict is unstable only beyond twice the error, because an estimate is not a bound."""
    radii, errors = rotor_branch.radius.copy(), rotor_branch.errors.copy()
    radii[:4], errors[:4, 1] = 1.003, (1e-3, 1.4e-3, 1.6e-3, 4e-3)
    verdicts = replace(rotor_branch, radius=radii, errors=errors).verdicts
    assert verdicts[:4] == ["unstable", "unstable", "undetermined", "undetermined"]


def test_turning_points_match_the_closed_form(rotor_branch):
    places = np.flatnonzero(rotor_branch.turns)
    assert len(places) == 2
    for place in places:
        near = rotor_branch.speeds[place], rotor_branch.peaks[place, 0]
        exact = fsolve(lambda at: balance(*at), near, xtol=1e-9)
        assert near[0] == pytest.approx(exact[0], rel=1e-6)
    verdicts = np.array(rotor_branch.verdicts)
    between = slice(places[0] + 1, places[1])
    assert set(verdicts[between]) == {"unstable"}
    assert set(verdicts[: places[0]]) == set(verdicts[places[1] + 1 :]) == {"asymptotically stable"}


def test_reversed_range_gives_the_same_branch(rotor_branch):
    back = solve.branch(model_of(cubic_rotor(), **NUMBERS), (1.6, 0.8), rtol=1e-5)
    np.testing.assert_allclose(back.turning, rotor_branch.turning[::-1], rtol=1e-6)
    assert back.speeds[-1] == pytest.approx(0.8, rel=1e-9)


@pytest.mark.parametrize("part", [1e-2, 3e-3, 1e-3, 1e-4, 1e-5])
@pytest.mark.parametrize("up", [True, False])
def test_branch_may_end_shortly_before_a_fold(rotor_branch, up, part):
    """With increasing speed it ends at the largest of three amplitudes, with decreasing speed at the
    smallest."""
    turning = rotor_branch.turning
    end = turning.max() * (1 - part) if up else turning.min() * (1 + part)
    branch = solve.branch(model_of(cubic_rotor(), **NUMBERS), (0.8 if up else 1.6, end), rtol=1e-5)
    c, k, alpha, f = NUMBERS.values()
    real = k - end**2
    squares = np.roots([alpha**2, 2 * alpha * real, real**2 + (c * end) ** 2, -(f**2)])
    assert np.abs(squares.imag).max() == 0
    assert len(branch.turning) == 0
    assert branch.speeds[-1] == pytest.approx(end, rel=1e-9)
    assert np.ptp(branch.speeds) == pytest.approx(abs(end - branch.speeds[0]), rel=1e-9)
    exact = np.sqrt(squares.real.max() if up else squares.real.min())
    assert branch.peaks[-1, 0] == pytest.approx(exact, rel=1e-4)
    assert set(branch.verdicts) == {"asymptotically stable"}


@pytest.mark.slow
def test_cam_branch_turns_back_near_436_rpm():
    cam = solve.load("cam")
    branch = solve.branch(cam, "420:500 rpm", points=30)
    going_on, lifted = branch.warnings
    assert going_on == "the branch continues beyond the 30 points requested; request more"
    assert lifted.startswith("the follower lifts off the cam: contact_force reaches -")
    first = branch.turning[0] * 30 / np.pi
    assert 435.9 < first < 437.3
    at = int(np.flatnonzero(branch.turns)[0])
    orbit = solve.nonlinear(cam, float(branch.speeds[at - 3]), rtol=1e-6)
    peaks = [orbit.statistics(name).max_abs for name in cam.coordinates]
    np.testing.assert_allclose(branch.peaks[at - 3], peaks, rtol=3e-3)
    assert branch.radius[at] == pytest.approx(1.0, abs=0.05)


def test_truncated_branch_gives_a_warning():
    model = model_of(cubic_rotor(), **NUMBERS)
    branch = solve.branch(model, "0.8:1.6 rad/s", points=4)
    assert len(branch.speeds) == 4
    assert branch.warnings == ["the branch continues beyond the 4 points requested; request more"]
    assert not len(branch.turning)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"speeds": "0:3 rad/s"}, "two different speeds above 0"),
        ({"speeds": "3:3 rad/s"}, "two different speeds, such as"),
        ({"speeds": "3:3.000000001 rad/s"}, "two different speeds, such as"),
        ({"speeds": "2:3"}, "without a unit; add a unit, as in '2:3 rpm'"),
        ({"speeds": "2:3 rad/s", "points": 1}, "points is 1"),
        ({"speeds": "2:3 rad/s", "rtol": 2.0}, "rtol"),
        ({"speeds": "2:3 rad/s", "start": "rest"}, "start is 'rest'; allowed: an orbit"),
        ({"speeds": "2:3 rad/s", "start": ([1j], [0])}, "allowed: Orbit, Transient, Scatter"),
        ({"speeds": "2:3 rad/s", "start": lambda phase: np.exp(1j * phase)[None]}, "it must return finite q"),
        (
            {"speeds": "2:3 rad/s", "start": lambda phase: None},
            "'start' returns None; it must return finite q",
        ),
        (
            {"speeds": "2:3 rad/s", "start": lambda phase: np.nan * np.tile(phase, (2, 1))},
            "'start' returns NaN or infinite",
        ),
        (
            {"speeds": "2:3 rad/s", "start": ([np.nan, 0], [0, 0])},
            "the start has NaN or infinite values; give",
        ),
    ],
)
def test_invalid_input_is_refused(given, words):
    with pytest.raises((UnitError, ValueOutOfBoundsError), match=words):
        solve.branch(model_of(cubic_rotor(), **NUMBERS), **given)


@pytest.mark.parametrize("numbers", [{"zeta": 0.005, "f": 0.3}, {"zeta": 0.01, "f": 1.0}])
def test_sharp_resonances_are_passed_in_both_directions(numbers):
    """At a third of the resonance speed, there are two folds within 2 % of the range."""
    model = model_of(duffing(), k=1.0, alpha=1.0, **numbers)
    up, down = (solve.branch(model, speeds, points=100, rtol=1e-5) for speeds in ((0.3, 1.0), (1.0, 0.3)))
    assert len(up.turning) == 2
    assert up.speeds[-1] == pytest.approx(1.0)
    assert down.speeds[-1] == pytest.approx(0.3)
    np.testing.assert_allclose(down.turning[::-1], up.turning, rtol=1e-6)
    assert not up.warnings
    assert not down.warnings


def test_coordinate_at_rest_remains_at_rest():
    branch = solve.branch(solve.load("mathieu"), "1:2 rad/s", points=3)
    assert not branch.peaks.any()


def test_branch_of_a_linear_model_is_refused():
    with pytest.raises(LinearModelError, match="linear by construction"):
        solve.branch(solve.load("four_bar"), "10:20 rad/s")


def test_switching_is_refused_for_linear_equations():
    mathieu = solve.load("mathieu")
    with pytest.raises(ValueOutOfBoundsError, match=r"^mathieu is linear .* the same delta .*; omit switch$"):
        solve.branch(mathieu, 1.0, over="delta=0.8:1.2", switch=True)


def test_summary_states_the_parameter():
    model = model_of(duffing(), zeta=0.05, k=1.0, alpha=1.0, f=0.4)
    found = solve.branch(model, 0.5, over="f=0.1:0.105", points=5)
    assert found.summary.startswith("The branch goes from f = 0.1 to 0.10")


def detent():
    """Mass on a spring, with a detent of the given width at the given position."""
    made = Mechanism("detent", "Mass with a detent", energy="1/s^2")
    (q,) = made.coordinates(q=("1", "displacement"))
    c, k, A = made.parameters(
        c=("1/s", "damping"), k=("1/s^2", "stiffness"), A=("1/s^2", "energy of the detent")
    )
    place, width = made.parameters(place=("1", "place of the detent"), width=("1", "width of the detent"))
    made.kinetic, made.dissipation = rate(q) ** 2 / 2, c * rate(q) ** 2 / 2
    made.potential = k * q**2 / 2 - A * exp(-(((q - place) / width) ** 2))
    made.force(k * cos(made.phase), along=q)
    made.decline_drive_torque("an equation without units")
    return made


@pytest.mark.parametrize("place", [0.05, -2e-4, 1.3])
def test_models_with_a_local_force_are_not_refused_as_linear(place):
    """The force is zero at rest and for large motions."""
    numbers = {"c": 0.1, "k": 1.0, "place": place, "width": abs(place) / 20}
    found = solve.branch(
        solve.load(detent, A=1e-4 * place**2, **numbers), (2.0, 2.01), switch=True, points=2, rtol=1e-4
    )
    assert len(found.values) == 2
    with pytest.raises(ValueOutOfBoundsError, match=r"^detent is linear in its coordinates"):
        solve.branch(solve.load(detent, A=0.0, **numbers), (2.0, 2.01), switch=True)


def pulsed():
    """Mass on a spring, with a force -p sin q that acts over half a degree of the period only."""
    made = Mechanism("pulsed", "Mass on a spring with a short nonlinear force", energy="1/s^2")
    (q,) = made.coordinates(q=("1", "displacement"))
    c, k, p = made.parameters(c=("1/s", "damping"), k=("1/s^2", "stiffness"), p=("1/s^2", "force"))
    made.kinetic, made.dissipation = rate(q) ** 2 / 2, c * rate(q) ** 2 / 2
    made.potential = k * q**2 / 2 + p * exp(-1e5 * sin((made.phase - 3.0) / 2) ** 2) * cos(q)
    made.force(k * cos(made.phase), along=q)
    made.decline_drive_torque("an equation without units")
    return made


def test_model_with_a_short_nonlinear_force_is_not_refused_as_linear():
    model = solve.load(pulsed, c=0.1, k=1.0, p=0.5)
    found = solve.branch(model, (2.0, 2.01), switch=True, points=2, rtol=1e-4)
    assert len(found.values) == 2
