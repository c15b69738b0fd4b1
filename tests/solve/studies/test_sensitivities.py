"""Sensitivities versus speed, of maxima over speed in closed form, and of band edges found by another
search."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq, minimize_scalar

import solve
from solve.errors import NoDerivativeError, NoResultError, UnknownNameError
from solve.results.critical_speeds import Critical, Maximum
from solve.studies.sensitivities import _CORNER
from tests.solve.derivatives.test_sensitivities import C, F, K, M, amplitude, model


def test_sensitivities_versus_speed_match_those_at_single_speeds():
    cam, of, by = solve.load("cam"), ["q3.max_abs", "rho1"], ["k1", "speed"]
    over = solve.sensitivities_over(cam, "300 600 rpm", of, by)
    for at, speed in enumerate(over.speeds.tolist()):
        alone = solve.sensitivities(cam, speed, of, by)
        for quantity in of:
            for name in by:
                assert over[quantity][name][at] == alone[quantity][name]
        elasticity = alone.elasticities("q3.max_abs")["speed"]
        assert over.elasticities[at, 0, 1] == pytest.approx(elasticity, rel=1e-12)
    assert over.warnings == []
    assert len(over.to_pandas()) == 2 * 2 * 2


def test_speeds_without_an_orbit_are_reported():
    undamped = model(c=0.0)
    resonance = math.sqrt(K / M) / 2
    over = solve.sensitivities_over(undamped, [1.0, resonance], "q.max", ["k", "f"])
    assert np.isfinite(over.derivatives[0]).all()
    assert np.isnan(over.derivatives[1]).all()
    assert "no result" in over.warnings[0]
    with pytest.raises(NoResultError, match="no speed has a result"):
        solve.sensitivities_over(undamped, [resonance], "q.max", "k")


def peak(m=M, c=C, k=K):
    """Return the speed at which the amplitude f / |k - 4 m Ω² + 2 i c Ω| is largest."""
    return math.sqrt(k / m - c**2 / (2 * m**2)) / 2


def test_derivative_of_the_resonance_speed_matches_the_closed_form():
    # The second coordinate rests but for its own load; the first has one maximum.
    critical = solve.critical_speeds(model(), np.linspace(0.9, 1.5, 13), quantity="q", figure="rms")
    moved = solve.speed_sensitivities(critical, ["m", "c", "k", "f"])
    at, speed = moved.found["response1"], peak()
    assert at.value == pytest.approx(speed, rel=1e-9)
    expected = {
        "m": (-K / M**2 + C**2 / M**3) / (8 * speed),
        "c": -C / M**2 / (8 * speed),
        "k": 1 / M / (8 * speed),
        "f": 0.0,
    }
    for name, value in expected.items():
        assert moved["response1"][name] == pytest.approx(value, rel=1e-6, abs=1e-9)
    assert abs(amplitude(speed=speed)) > F / K


def test_derivative_of_the_maximum_speed_matches_finite_differences():
    numbers = {"delta": 1.0, "epsilon": 0.1, "zeta": 0.1}

    def largest(**changed):
        mathieu = solve.load("mathieu", **{**numbers, **changed})
        return minimize_scalar(
            lambda speed: -solve.floquet(mathieu, speed, rtol=1e-12).spectral_radius,
            bounds=(0.98, 1.02),
            method="bounded",
            options={"xatol": 1e-10},
        ).x

    critical = solve.critical_speeds(solve.load("mathieu", **numbers), [0.9, 1.1], orders=2)
    moved = solve.speed_sensitivities(critical, list(numbers))
    assert moved.found["radius1"].value == pytest.approx(largest(), rel=1e-7)
    for name, value in numbers.items():
        expected = (largest(**{name: value + 2e-3}) - largest(**{name: value - 2e-3})) / 4e-3
        assert moved["radius1"][name] == pytest.approx(expected, rel=1e-5)
    assert (moved.found["radius1"].errors > 0).all()


def test_maximum_at_a_multiplier_crossing_has_no_derivative():
    """The maximum is that of the cam at 69.01 rad/s, where Re ρ1 jumps."""
    cam, at = solve.load("cam"), 69.00953
    below, above = (solve.floquet(cam, at + way).multipliers[0].real for way in (-1e-3, 1e-3))
    assert below < -0.03
    assert above > 0.01
    critical = solve.critical_speeds(cam, "650:665:4 rpm", orders=12)
    corner = replace(critical, rows=[Critical(multiplier=Maximum(at, 0.0113))])
    moved = solve.speed_sensitivities(corner, "k1")
    assert math.isnan(moved["multiplier1"]["k1"])
    assert moved.warnings == [f"multiplier1: {_CORNER}"]


def test_unbounded_response_has_no_derivative():
    critical = solve.critical_speeds(model(c=0.0), np.linspace(0.9, 1.5, 13), quantity="q", orders=2)
    moved = solve.speed_sensitivities(critical, ["k"])
    assert moved.found["response1"].value == pytest.approx(math.sqrt(K / M) / 2, rel=1e-4)
    assert math.isnan(moved["response1"]["k"])
    assert moved.warnings[0].startswith("response1: the response is unbounded")


def edge(low, high, **numbers):
    """Return a speed at which the spectral radius is 1, by bisection."""
    mathieu = solve.load("mathieu", **numbers)
    return brentq(
        lambda speed: solve.floquet(mathieu, speed, rtol=1e-11).spectral_radius - 1, low, high, xtol=1e-13
    )


def test_derivatives_of_band_edges_match_a_search():
    numbers = {"delta": 1.0, "epsilon": 0.3, "zeta": 0.02}
    bands = solve.bands(solve.load("mathieu", **numbers), [0.8, 1.2])
    moved = solve.speed_sensitivities(bands, ["delta", "epsilon", "zeta"])
    band, step = bands[0], 1e-4
    for word, speed in (("from", band.low), ("to", band.high)):
        near = speed - 0.01, speed + 0.01
        assert moved.found[f"band1.{word}"].value == pytest.approx(edge(*near, **numbers), rel=1e-9)
        for name, value in numbers.items():
            low, high = (edge(*near, **{**numbers, name: value + way * step}) for way in (-1, 1))
            assert moved[f"band1.{word}"][name] == pytest.approx((high - low) / (2 * step), rel=1e-5)


def test_edges_of_an_undamped_band_have_no_derivative():
    bands = solve.bands(solve.load("mathieu", delta=1.0, epsilon=0.3, zeta=0.0), [0.8, 1.2])
    moved = solve.speed_sensitivities(bands, "delta")
    assert math.isnan(moved["band1.from"]["delta"])
    assert re.search("multipliers? .*; if the system is undamped, add a little damping", moved.warnings[0])
    with pytest.raises(NoResultError, match="no edge of an unstable range"):
        solve.speed_sensitivities(
            solve.bands(solve.load("mathieu", delta=1.0, epsilon=0.0), [0.8, 1.2]), "delta"
        )


def test_invalid_input_is_refused_before_solving():
    with pytest.raises(UnknownNameError):
        solve.sensitivities_over(solve.load("cam"), [30.0], "q9.max")
    with pytest.raises(NoDerivativeError):
        solve.sensitivities_over(solve.load("gear_pair"), [30.0], "q.max", "z1")
