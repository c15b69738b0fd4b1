"""The three examples of the chapter, compared with values that other programs converged to 1e-10."""

import functools
import math

import numpy as np
import pytest

import solve
from tests.digits import half_a_digit

RTOL = 1e-9
TURN = np.linspace(0.0, 2 * np.pi, 20_001)
EXTREMA = [  # model, speed, coordinate, quantity, value as printed
    ("cam", "100 rpm", "q1", "max", "6.228723e-3"),
    ("cam", "100 rpm", "q1", "min", "-6.050572e-3"),
    ("cam", "100 rpm", "q3", "max", "7.009975e-6"),
    ("cam", "100 rpm", "q3", "min", "-7.767657e-6"),
    ("cam", "600 rpm", "q1", "max", "0.7684522"),
    ("cam", "600 rpm", "q1", "min", "-0.8666075"),
    ("cam", "600 rpm", "q3", "max", "4.860678e-3"),
    ("cam", "600 rpm", "q3", "min", "-4.859140e-3"),
    ("manipulator", "50 rpm", "q1", "max_abs", "0.03163246"),
    ("manipulator", "50 rpm", "q2", "max_abs", "1.313046e-3"),
    ("gear_pair", "1800 rpm", "q", "max", "1.5182805e-5"),
    ("gear_pair", "1800 rpm", "q", "mean", "1.2026528955e-5"),
]
SPECTRAL_RADII = [
    ("cam", "1", "100 rpm", 1.466125e-7),
    ("cam", "1", "600 rpm", 0.0701120372),
    ("manipulator", "1", "50 rpm", 0.0019966777),
    ("manipulator", "2", "50 rpm", 0.0014537726),
    ("gear_pair", "1", "1800 rpm", 0.0126556680),
]


@functools.cache
def orbit(model, speed, case="1", **options):
    return solve.periodic(solve.load(model, case=case, options=options), speed, rtol=RTOL)


@pytest.mark.parametrize(("model", "speed", "coordinate", "quantity", "value"), EXTREMA)
def test_extrema_agree_to_all_printed_digits(model, speed, coordinate, quantity, value):
    computed = getattr(orbit(model, speed).statistics(coordinate), quantity)
    assert computed == pytest.approx(float(value), rel=0, abs=half_a_digit(value))


@pytest.mark.parametrize(("model", "case", "speed", "value"), SPECTRAL_RADII)
def test_spectral_radii_match_converged_values(model, case, speed, value):
    computed = orbit(model, speed, case)
    assert computed.spectral_radius == pytest.approx(value, rel=1e-6)
    assert computed.verdict == "asymptotically stable"
    assert solve.floquet(computed.system, speed, rtol=RTOL).spectral_radius == pytest.approx(value, rel=1e-6)


@pytest.mark.parametrize(
    ("model", "speed"), [("cam", "100 rpm"), ("cam", "600 rpm"), ("gear_pair", "1800 rpm")]
)
def test_error_estimates_meet_the_tolerance(model, speed):
    assert max(orbit(model, speed).error_estimate) <= RTOL


@pytest.mark.parametrize("case", ["1", "2"])
@pytest.mark.parametrize("speed", ["100 rpm", "600 rpm"])
def test_mean_deflections_of_the_cam_follow_from_the_load(case, speed):
    """Over a period, the inertia forces of a link that returns to its position cancel: the mean values
    satisfy k2 q2 = k3 q3 = -F."""
    computed = orbit("cam", speed, case)
    for name, stiffness in (("q2", 8.2e8), ("q3", 2.6e8)):
        scale = computed.statistics(name).max_abs
        assert computed.statistics(name).mean == pytest.approx(-100.0 / stiffness, abs=1e-12 * scale + 1e-18)
        assert computed.harmonics(name)[0][0] == pytest.approx(-100.0 / stiffness, abs=1e-12 * scale + 1e-18)


def test_runge_kutta_with_9300_steps_is_accurate_to_1e_5():
    """With this number of steps, the method of the chapter reaches 1e-6 for q3. All extrema are accurate to
    1e-5."""
    coarse = solve.periodic(solve.load("cam"), "600 rpm", "rk4", steps=9300, rtol=1e-5)
    fine = orbit("cam", "600 rpm")
    for name in ("q1", "q2", "q3"):
        ours, truth = coarse.statistics(name), fine.statistics(name)
        assert (ours.max, ours.min) == pytest.approx((truth.max, truth.min), rel=1e-5)
    error = np.abs(coarse.at(TURN) - fine.at(TURN)).max(axis=1) / np.abs(fine.at(TURN)).max(axis=1)
    assert error[2] == pytest.approx(9.4e-7, rel=0.02)
    assert coarse.warnings[0].startswith("the linearisation may be invalid")


@pytest.mark.parametrize(
    ("method", "steps", "error"),
    [
        ("rk4", 1000, 7.0e-3),
        ("rk4", 2000, 4.4e-4),
        ("rk4", 5000, 1.1e-5),
        ("rk4", 10_000, 7.0e-7),
        ("newmark", 1000, 0.47),
        ("newmark", 2000, 0.14),
        ("newmark", 5000, 2.3e-2),
        ("newmark", 10_000, 5.6e-3),
    ],
)
def test_newmark_is_faster_at_equal_steps_but_less_accurate(method, steps, error):
    """For the worst coordinate of the cam at 600 rpm, Newmark's method is faster with equal steps, but not at
    equal accuracy."""
    coarse = solve.periodic(solve.load("cam"), "600 rpm", method, steps=steps, rtol=0.5).at(TURN)
    fine = orbit("cam", "600 rpm").at(TURN)
    worst = (np.abs(coarse - fine).max(axis=1) / np.abs(fine).max(axis=1)).max()
    assert worst == pytest.approx(error, rel=0.03)


@pytest.mark.parametrize(
    ("speed", "largest", "trusted"),
    [("100 rpm", 0.0062, True), ("200 rpm", 0.026, True), ("300 rpm", 0.12, False), ("600 rpm", 0.87, False)],
)
def test_cam_warns_where_the_linearisation_is_invalid(speed, largest, trusted):
    computed = orbit("cam", speed)
    assert computed.statistics("q1").max_abs == pytest.approx(largest, rel=0.04)
    doubts = [text for text in computed.warnings if "linearisation" in text]
    assert len(doubts) == (0 if trusted else 1)
    if not trusted:
        assert f"max|q1| = {computed.statistics('q1').max_abs:.3g} rad, beyond 0.05" in doubts[0]


def test_coarse_newmark_multipliers_are_wrong_and_flagged():
    coarse = solve.periodic(solve.load("cam"), "100 rpm", "newmark", steps=1000, rtol=2e-2)
    fine = orbit("cam", "100 rpm")
    error = np.abs(coarse.at(TURN) - fine.at(TURN)).max(axis=1) / np.abs(fine.at(TURN)).max(axis=1)
    assert error.max() < 1e-2
    assert coarse.spectral_radius > 1000 * fine.spectral_radius
    assert any(
        "multipliers may be wrong, although the error of the orbit is" in text for text in coarse.warnings
    )


def test_unverified_orbits_are_not_reported_as_correct():
    """The steps do not resolve the modes of the slow cam, or only the multipliers are computed."""
    for computed in (
        solve.periodic(solve.load("cam"), "100 rpm", "newmark", steps=40, rtol=1e-6),
        solve.floquet(solve.load("cam"), "100 rpm", "newmark", steps=1000, rtol=1e-2),
    ):
        assert any("the multipliers may be wrong; use radau" in text for text in computed.warnings)


def test_printed_spectral_radii_contradict_the_printed_inputs():
    """The printed values are 0.001992 and 0.001623. The printed inputs give 0.001997 and 0.001454."""
    computed = [round(orbit("manipulator", "50 rpm", case).spectral_radius, 6) for case in "12"]
    assert computed == [0.001997, 0.001454]


def test_manipulator_spectral_radius_is_too_sensitive_to_its_inputs():
    """A relative change of k1 or I1 changes |ρ| by a relative value 15 to 18 times as large. The last printed
    digit of I1 = 1.11 therefore affects the third digit of |ρ|."""
    truth = orbit("manipulator", "50 rpm").spectral_radius
    for name, value in (("k1", 7692.0), ("I1", 1.11)):
        changed = solve.floquet(solve.load("manipulator", **{name: value * 1.001}), "50 rpm", rtol=RTOL)
        assert 15 < abs(changed.spectral_radius / truth - 1) / 1e-3 < 18


def gear_pair():
    """Return reduced mass, Eq. (70), mean frequency, and mesh damping from Tables 3 and 4."""
    J1, J2, rb1, rb2, k0, zeta = 0.093, 0.272, 30.46e-3, 84.86e-3, 8.1846e8, 0.024
    m_red = J1 * J2 / (J1 * rb2**2 + J2 * rb1**2)
    omega0 = math.sqrt(k0 / m_red)
    return m_red, omega0, 2 * omega0 * zeta * m_red


def test_constants_of_the_gear_pair_match_the_tables():
    m_red, omega0, c_z = gear_pair()
    assert m_red == pytest.approx(27.4336825, abs=0.5e-7)
    assert omega0 == pytest.approx(5462.0626, abs=0.5e-4)
    assert c_z == pytest.approx(7192.5356, abs=0.5e-4)
    M, C, K, _ = solve.load("gear_pair").at(TURN[:-1], 60 * np.pi)
    np.testing.assert_allclose(M, m_red, rtol=1e-13)
    np.testing.assert_allclose(C, c_z, rtol=1e-13)
    assert K.mean() == pytest.approx(8.1846e8, rel=1e-13)


def test_multipliers_of_the_gear_pair_satisfy_liouvilles_formula():
    """The multipliers are a complex pair with |ρ|² = det Φ = exp(-2 ζ ω0 T), whatever the mesh stiffness."""
    computed = orbit("gear_pair", "1800 rpm")
    assert computed.spectral_radius == pytest.approx(math.exp(-0.024 * gear_pair()[1] / 30), rel=1e-9)


@pytest.mark.parametrize(("hertz", "amplitude"), [(840, "1.227935e-2"), (420, "1.555781e-3")])
def test_meshing_lines_of_the_transmission_error_rate_match(hertz, amplitude):
    rate = orbit("gear_pair", "1800 rpm").harmonics("transmission_error_rate")[0]
    assert rate[hertz // 30] == pytest.approx(float(amplitude), rel=0, abs=half_a_digit(amplitude))


def test_sidebands_result_from_the_load_proportional_to_the_error():
    """At 870 Hz, one pinion order above 2 f_z, the amplitude is 1.33e-3 with Eq. (71) and 1.6e-6 with a
    constant torque."""
    tracking, constant = (
        orbit("gear_pair", "1800 rpm", load=load).harmonics("transmission_error_rate")[0][29]
        for load in ("tracking", "constant")
    )
    assert tracking == pytest.approx(1.33e-3, abs=0.005e-3)
    assert constant == pytest.approx(1.6e-6, abs=0.05e-6)
    assert orbit("gear_pair", "1800 rpm").system.labels.options["load"] == "tracking"
