"""Orbits with one or all coordinates at rest (equilibria and antiresonances), compared with closed forms and
shooting by DOP853."""

import mpmath
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import fsolve

import solve
from solve.certify.correction import CoordinateScale
from solve.newton.iteration import zero_motion
from solve.period.grid import Grid
from tests.solve.newton.mechanisms import (
    absorber,
    bead,
    duffing,
    held_pendulum,
    model_of,
    torsional_absorber,
)

ABSORBER = {"m": 1.0, "ma": 0.1, "c": 0.05, "k": 1.0, "k3": 0.5, "ka": 0.1, "F": 0.02}
TORSION = {"m": 800.0, "J": 2.0, "c": 2e3, "k": 8e6, "k3": 1e15, "kt": 2e4, "r": 0.4, "F": 50.0}
"""Vibrations of micrometres and milliradians; antiresonance at 100 rad/s."""

EPS = np.finfo(float).eps

AT_REST = [
    (bead, {"c": 0.1, "g": 49.05}, 9.3),
    (bead, {"c": 0.3, "g": 43.7}, 8.9),
    (held_pendulum, {"c": 0.1, "g": 3.1, "t": 0.7}, 1.3),
    (held_pendulum, {"c": 0.2, "g": 9.81, "t": -6.3}, 25.0),
]


def stiffness(module, numbers, speed):
    """Stiffness of small vibrations about the equilibrium: (Ω⁴ - g²)/Ω², and √(g² - t²)."""
    g = numbers["g"]
    return (speed**4 - g**2) / speed**2 if module is bead else np.sqrt(g**2 - numbers["t"] ** 2)


def shot(module, numbers, speed, F):
    """max|q| of the orbit under a load, by shooting."""

    def rate(t, x):
        if module is bead:
            angle = np.arccos(numbers["g"] / speed**2) + x[0]
            force = (speed**2 * np.cos(angle) - numbers["g"]) * np.sin(angle)
        else:
            angle = np.arcsin(numbers["t"] / numbers["g"]) + x[0]
            force = numbers["t"] - numbers["g"] * np.sin(angle)
        return [x[1], force - numbers["c"] * x[1] + F * np.cos(speed * t)]

    def run(x, **given):
        return solve_ivp(rate, (0, 2 * np.pi / speed), x, "DOP853", rtol=1e-12, atol=1e-15, **given)

    def change(x):
        return run(x).y[:, -1] - x

    x, _, _, _ = fsolve(change, [0.0, 0.0], xtol=1e-13, full_output=True)
    # Where round-off prevents xtol, fsolve would warn: the change over a period decides.
    assert np.abs(change(x)).max() < 1e-13
    return np.abs(run(x, t_eval=np.linspace(0, 2 * np.pi / speed, 20001)).y[0]).max()


@pytest.mark.parametrize(("module", "numbers", "speed"), AT_REST)
def test_equilibrium_has_the_multipliers_of_its_linearisation(module, numbers, speed):
    model = model_of(module(), **numbers, F=0.0)
    orbit, linear = solve.nonlinear(model, speed), solve.periodic(model, speed)
    assert orbit.warnings == []
    assert np.abs(orbit.q).max() < 1e-14
    assert orbit.error_estimate.orbit < 1e-8
    assert orbit.residual < 1e-12
    assert linear.linearisation_error["q"] < 1e-12
    T, c = 2 * np.pi / speed, numbers["c"]
    rates = np.roots([1, c, stiffness(module, numbers, speed)])
    expected = np.exp(rates * T)
    for rho in orbit.multipliers:
        assert np.abs(expected - rho).min() < 1e-9
    assert orbit.verdict == "asymptotically stable"


@pytest.mark.parametrize(("module", "numbers", "speed"), AT_REST)
@pytest.mark.parametrize("F", [1e-2, 0.3])
def test_orbit_about_an_equilibrium_under_load_matches_shooting(module, numbers, speed, F):
    orbit = solve.nonlinear(model_of(module(), **numbers, F=F), speed)
    assert orbit.warnings == []
    assert orbit.statistics("q").max_abs == pytest.approx(shot(module, numbers, speed, F), rel=1e-6)


def test_equilibrium_has_no_warning_and_is_continued():
    model = model_of(bead(), c=0.1, g=43.7, F=0.0)
    validity = solve.validity(model, [7.7, 8.1, 8.9, 9.3])
    assert validity.errors.max() < 1e-12
    assert validity.trusted_to == 9.3
    branch = solve.branch(model, (8.1, 9.9))
    assert branch.warnings == []
    assert branch.speeds[-1] == pytest.approx(9.9)
    assert branch.peaks.max() < 1e-14


@pytest.mark.parametrize("speeds", [(0.7, 1.3), (1.3, 0.7), (0.95, 1.0)])
def test_branch_passes_the_antiresonance_of_an_undamped_absorber(speeds):
    branch = solve.branch(model_of(absorber(), **ABSORBER), speeds)
    assert branch.warnings == []
    assert branch.speeds[-1] == pytest.approx(speeds[1])
    for speed, (x, y) in zip(branch.speeds, branch.peaks, strict=True):
        if abs(speed - 1) < 0.05:
            # One harmonic: ma ÿ + ka (y - x) = 0.
            assert x == pytest.approx(abs(1 - speed**2) * y, rel=1e-3, abs=1e-12)


@pytest.mark.parametrize(
    ("module", "numbers", "speed", "rests", "moves"),
    [
        (absorber, ABSORBER, 1.0, "x", ("y", 0.02 / 0.1)),
        (torsional_absorber, TORSION, 100.0, "x", ("theta", 50 * 0.4 / 2e4)),
    ],
)
def test_orbit_at_the_antiresonance_matches_the_closed_form(module, numbers, speed, rests, moves):
    model = model_of(module(), **numbers)
    linear, orbit = solve.periodic(model, speed), solve.nonlinear(model, speed)
    name, amplitude = moves
    assert orbit.statistics(name).max_abs == pytest.approx(amplitude, rel=1e-8)
    assert orbit.statistics(rests).max_abs < 1e-10 * amplitude
    assert max(linear.linearisation_error.values()) < 1e-6


@pytest.mark.parametrize("speeds", [(80.0, 120.0), (120.0, 80.0)])
def test_branch_does_not_depend_on_the_unit_of_a_coordinate(speeds):
    """With the slide in micrometres instead of metres, the branch passes zero at the same speeds."""
    per_metre = 1e6
    power = {"m": -2, "c": -2, "k": -2, "k3": -4, "r": 1, "F": -1}
    in_micrometres = {name: value * per_metre ** power.get(name, 0) for name, value in TORSION.items()}
    one, other = (
        solve.branch(model_of(torsional_absorber(), **numbers), speeds)
        for numbers in (TORSION, in_micrometres)
    )
    for branch in (one, other):
        assert branch.warnings == []
    np.testing.assert_allclose(other.speeds, one.speeds, rtol=1e-7)
    np.testing.assert_allclose(other.peaks / [per_metre, 1.0], one.peaks, rtol=1e-5)


@pytest.mark.parametrize("speeds", [(80.0, 120.0), (120.0, 80.0)])
def test_slide_is_at_rest_while_the_disc_rotates(speeds):
    """J θ̈ + kt (θ - x/r) = 0 holds for every harmonic. The first one dominates if the spring is nearly
    linear."""
    branch = solve.branch(model_of(torsional_absorber(), **TORSION | {"k3": 1e11}), speeds)
    assert branch.speeds[-1] == pytest.approx(speeds[1])
    near = np.abs(branch.speeds - 100) < 5
    assert near.sum() >= 3
    for speed, (x, theta) in zip(branch.speeds[near], branch.peaks[near], strict=True):
        part = abs(1 - speed**2 / 100**2) * theta * TORSION["r"]
        assert x == pytest.approx(part, rel=1e-3, abs=1e-10 * TORSION["r"])


def test_coordinate_scale_is_load_divided_by_impedance():
    """The scale of an oscillator is F/(k + cΩ + mΩ²), a lower bound of max|q| = F/|k - mΩ² + icΩ|."""
    numbers = {"zeta": 0.2, "k": 3.0, "alpha": 0.0, "f": 0.7}
    model, grid = model_of(duffing(), **numbers), Grid.uniform(64, 2 * np.pi)
    for speed in (0.3, np.sqrt(3.0), 7.0):
        rest = zero_motion(1, grid)
        scale = CoordinateScale(model.along(rest), rest, speed, grid.steps)
        expected = 0.7 / (3.0 + 2 * 0.2 * speed + speed**2)
        assert scale.load_scale == pytest.approx(expected, rel=1e-12)
        assert solve.periodic(model, speed).statistics("q").max_abs >= expected


@pytest.mark.parametrize(("numbers", "speed"), [({"c": 0.1, "g": 49.05, "F": 0.0}, 9.3)])
def test_round_off_of_residual_is_below_bound(numbers, speed):
    """The reference has 50 digits, at angles and speeds near the equilibrium."""
    model, rng = model_of(bead(), **numbers), np.random.default_rng(5)
    with mpmath.workdps(50):
        g, worst = mpmath.mpf(numbers["g"]), 0.0
        for q, omega in zip(rng.normal(scale=0.3, size=200), speed + rng.random(200), strict=True):
            angle = mpmath.acos(g / mpmath.mpf(omega) ** 2) + mpmath.mpf(q)
            exact = (g - mpmath.mpf(omega) ** 2 * mpmath.cos(angle)) * mpmath.sin(angle)
            motion = zero_motion(1, Grid.uniform(1, 2 * np.pi))
            motion.coefficients[:] = q
            along = model.along(motion)
            _, _, K, d = along.at(np.array([0.3]), omega)
            residual = float(model.setup.function("residual")(0.3, omega, q, 0, 0, model.setup.p))
            bound = EPS * along.roundoff(np.array([0.3]), omega)[0, 0]
            assert K[0, 0] * q - d[0, 0] == pytest.approx(residual, abs=1e-10)
            worst = max(worst, abs(residual - float(exact)) / bound)
    assert 1e-3 < worst < 1
