"""Coexisting and subharmonic orbits, compared with harmonic balance and time integration."""

import json
import pickle

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import fsolve

import solve
from solve.errors import LinearModelError, ValueOutOfBoundsError
from tests.solve.newton.mechanisms import duffing, known_system, model_of, pendulum, trigonometric

ZETA, ALPHA, F, OMEGA = 0.05, 1.0, 0.4, 1.6


def balanced(amplitude):
    """Harmonics 1, 3, … (orders, coefficients) of Duffing's orbit near an amplitude, by harmonic balance."""
    orders, phase = np.arange(1, 40, 2), 2 * np.pi * np.arange(512) / 512
    waves = np.exp(1j * np.outer(orders, phase))

    def unbalanced(x):
        c = x[: len(orders)] + 1j * x[len(orders) :]
        cubes = 2 * np.fft.fft(np.real(c @ waves) ** 3)[orders] / len(phase)
        rest = (1 - (orders * OMEGA) ** 2 + 2j * ZETA * orders * OMEGA) * c + ALPHA * cubes
        rest[0] -= F
        return np.concatenate((rest.real, rest.imag))

    x = np.zeros(2 * len(orders))
    x[0], x[len(orders)] = amplitude.real, amplitude.imag
    found, _, flag, _ = fsolve(unbalanced, x, full_output=True, xtol=1e-13)
    assert flag == 1
    return orders, found[: len(orders)] + 1j * found[len(orders) :]


def amplitudes():
    """The three real solutions of ((1 - Ω² + ¾αA²)² + (2ζΩ)²)A² = F², as complex amplitudes relative to cos
    φ."""
    squares = np.roots(
        [
            (0.75 * ALPHA) ** 2,
            1.5 * ALPHA * (1 - OMEGA**2),
            (1 - OMEGA**2) ** 2 + (2 * ZETA * OMEGA) ** 2,
            -(F**2),
        ]
    )
    assert np.isreal(squares).all()
    return [F / (1 - OMEGA**2 + 0.75 * ALPHA * s + 2j * ZETA * OMEGA) for s in np.sort(squares.real)]


def multipliers(orders, c):
    """Multipliers of the variational equation about a Fourier series, by DOP853."""

    def rate(t, y):
        q = np.real(c @ np.exp(1j * orders * OMEGA * t))
        return (np.array([[0, 1], [-1 - 3 * ALPHA * q**2, -2 * ZETA]]) @ y.reshape(2, 2)).ravel()

    run = solve_ivp(rate, (0, 2 * np.pi / OMEGA), np.eye(2).ravel(), "DOP853", rtol=1e-12, atol=1e-13)
    return np.linalg.eigvals(run.y[:, -1].reshape(2, 2))


def test_three_coexisting_orbits_agree_with_harmonic_balance():
    model = model_of(duffing(), zeta=ZETA, k=1.0, alpha=ALPHA, f=F)
    phase, verdicts = np.linspace(0, 2 * np.pi, 300), []
    for amplitude in amplitudes():
        orders, c = balanced(amplitude)
        orbit = solve.nonlinear(model, OMEGA, start=trigonometric([[0, amplitude]]))
        truth = np.real(c @ np.exp(1j * np.outer(orders, phase)))
        np.testing.assert_allclose(orbit.at(phase)[0], truth, rtol=0, atol=1e-8 * abs(truth).max())
        expected = multipliers(orders, c)
        for rho in orbit.multipliers:
            assert np.abs(expected - rho).min() <= 1e-8 * np.abs(expected).max()
        verdicts.append(orbit.stable)
    assert verdicts == [True, False, True]


PIVOT = {"c": 0.1, "b": 0.15, "g": 1.0}
SWING = 2.0


def test_pendulum_on_a_moving_pivot_has_half_the_frequency():
    model = model_of(pendulum(), **PIVOT)
    assert solve.floquet(model, SWING).verdict == "unstable"
    orbit = solve.nonlinear(model, SWING, periods=2)
    assert orbit.found_by == "transient"
    assert orbit.verdict == "asymptotically stable"
    assert orbit.period == pytest.approx(2 * 2 * np.pi / SWING)
    amplitude, _ = orbit.harmonics("q", 8)
    assert amplitude[1] > 0.5
    assert amplitude[[0, 2, 4]].max() < 1e-8

    def rate(t, x):
        drive = 1 - PIVOT["b"] * SWING**2 * np.cos(SWING * t)
        return [x[1], -PIVOT["c"] * x[1] - drive * np.sin(x[0])]

    start = np.array([orbit.q[0, 0], orbit.qd[0, 0]])
    for periods, back in ((2, True), (1, False)):
        run = solve_ivp(rate, (0, periods * orbit.period / 2), start, "DOP853", rtol=1e-12, atol=1e-12)
        assert bool(np.abs(run.y[:, -1] - start).max() < 1e-7) is back


def test_orbit_that_repeats_after_one_period_gives_a_warning():
    model, _ = known_system(0)
    one, two = solve.nonlinear(model, 1.0), solve.nonlinear(model, 1.0, periods=2)
    np.testing.assert_allclose(two.at([0.3, 7.1]), one.at([0.3, 7.1]), atol=1e-8)
    np.testing.assert_allclose(
        np.sort_complex(two.multipliers), np.sort_complex(one.multipliers**2), rtol=1e-7
    )
    assert any("repeats after each of its 2 periods" in text for text in two.warnings)


def test_linear_model_is_refused():
    structure = solve.load("four_bar")
    with pytest.raises(LinearModelError, match="four_bar is linear by construction"):
        solve.nonlinear(structure, 30.0)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"periods": 0}, "periods is 0"),
        ({"method": "newmark"}, "radau, gauss"),
        ({"start": trigonometric([[0, 1], [0, 1]], 4 * np.pi)}, "the start repeats after 12.5664"),
    ],
)
def test_invalid_input_is_refused(given, words):
    model, _ = known_system(0)
    with pytest.raises(ValueOutOfBoundsError, match=words):
        solve.nonlinear(model, 1.0, **given)


def test_orbit_is_pickled_and_saved_with_its_solution_strategy(tmp_path):
    orbit = solve.nonlinear(solve.load("cam"), "100 rpm", rtol=1e-6)
    copied = pickle.loads(pickle.dumps(orbit))
    np.testing.assert_array_equal(copied.q, orbit.q)
    assert copied.residual == pytest.approx(orbit.residual, rel=1e-3, abs=1e-12)
    orbit.save(tmp_path / "orbit.npz")
    with np.load(tmp_path / "orbit.npz") as held:
        metadata = json.loads(str(held["metadata"]))
    assert metadata["found_by"] == "linear orbit"
    assert metadata["iterations"] == orbit.iterations
    assert float(orbit.to_xarray()["q3"].max()) == orbit.q[2].max()


def test_multipliers_of_strongly_damped_oscillator_satisfy_liouvilles_formula():
    """The product of the multipliers is exp(−2ζT); the smaller multiplier contains most of this decay."""
    model, speed = model_of(duffing(), zeta=9.0, k=1.0, alpha=1.0, f=2.0), 0.8
    orbit = solve.nonlinear(model, speed, all_multipliers=True)
    assert orbit.multiplier_errors.max() < 1e-8
    product = np.log(np.abs(orbit.multipliers)).sum()
    assert product == pytest.approx(-2 * 9.0 * 2 * np.pi / speed, rel=1e-9)


def test_only_linear_results_warn_of_neglected_terms():
    model, left = model_of(duffing(), zeta=0.05, k=1.0, alpha=1.0, f=0.4), "linear results ignore it"
    nonlinear = solve.nonlinear(model, 1.6)
    results = (
        (True, solve.periodic(model, 1.6)),
        (True, solve.transient(model, 1.6, 2)),
        (False, nonlinear),
        (False, solve.transient(model, 1.6, 2, nonlinear=True)),
        (False, solve.branch(model, "1.6:1.61 rad/s", start=nonlinear, points=2)),
    )
    for linear, found in results:
        assert any(left in text for text in found.warnings) == linear
