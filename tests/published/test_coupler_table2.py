"""Table 2 of the paper and further claims about its coupler, tested with the derived model and the solver."""

import numpy as np
import pytest

import solve
from solve.errors import UnknownNameError, ValueOutOfBoundsError
from solve.studies.bands import bands
from solve.studies.sweep import sweep

PRINTED_MM = {
    600: (0.2750, 0.0090, 0.0011),
    900: (0.6309, 0.0204, 0.0025),
    1200: (1.1583, 0.0364, 0.0046),
    1500: (1.8704, 0.0572, 0.0072),
}
LAST_DIGIT_MM = 0.5e-4
SPEEDS = [f"{rpm} rpm" for rpm in PRINTED_MM]
LINEAR_ACCELERATION = solve.Newmark(gamma=1 / 2, beta=1 / 6)
AS_PRINTED = solve.Newmark(gamma=1 / 4, beta=1 / 6)


def maxima_mm(orbit):
    return [1e3 * orbit.statistics(name).max_abs for name in ("q1", "q2", "q3")]


def paper_orbit(rpm, method):
    """Return the orbit with the number of whole steps per period whose length is nearest to the paper's step,
    1e-4 s."""
    return solve.periodic(solve.load("coupler"), f"{rpm} rpm", method, steps=round(60 / rpm / 1e-4))


def test_default_case_reproduces_all_of_table_2():
    points = sweep(solve.load("coupler"), SPEEDS)
    computed = 1e3 * np.array([points.figures(name) for name in ("q1", "q2", "q3")]).T
    np.testing.assert_allclose(computed, list(PRINTED_MM.values()), rtol=0, atol=LAST_DIGIT_MM)


@pytest.mark.parametrize("rpm", PRINTED_MM)
def test_newmark_with_linear_acceleration_reproduces_table_2(rpm):
    computed = maxima_mm(paper_orbit(rpm, LINEAR_ACCELERATION))
    np.testing.assert_allclose(computed, PRINTED_MM[rpm], rtol=0, atol=LAST_DIGIT_MM)


@pytest.mark.parametrize("rpm", PRINTED_MM)
def test_newmark_in_the_printed_form_has_missing_entries(rpm):
    orbit = paper_orbit(rpm, AS_PRINTED)
    missed = np.abs(np.array(maxima_mm(orbit)) - PRINTED_MM[rpm]) > LAST_DIGIT_MM
    assert list(missed) == [rpm >= 1200, False, False]
    assert any("gamma = 0.25 < 1/2 is first order and adds energy" in text for text in orbit.warnings)


@pytest.mark.parametrize("rpm", PRINTED_MM)
def test_model_is_valid_at_every_speed_of_table_2(rpm):
    orbit = solve.periodic(solve.load("coupler"), f"{rpm} rpm", "radau")
    assert orbit.warnings == []
    assert orbit.verdict == "asymptotically stable"


def test_printed_table_1_gives_a_much_too_soft_coupler():
    orbit = solve.periodic(solve.load("coupler", "table1"), "600 rpm", "radau")
    assert maxima_mm(orbit)[0] == pytest.approx(3.0345, abs=LAST_DIGIT_MM)
    assert orbit.warnings == []


def test_table_1_with_its_printed_mass_gives_large_deflections():
    """The density is chosen to give the printed mass per unit length, m3/l3. The rotary inertia follows from
    it."""
    printed_mass, table1 = 3.74, solve.load("coupler", "table1").parameters
    density = printed_mass / table1["l3"] / table1["A"]
    orbit = solve.periodic(solve.load("coupler", "table1", rho=density), "600 rpm", "radau")
    assert maxima_mm(orbit)[0] == pytest.approx(3.0045, abs=LAST_DIGIT_MM)


def test_printed_table_1_exceeds_the_validity_at_1500_rpm():
    orbit = solve.periodic(solve.load("coupler", "table1"), "1500 rpm", "radau")
    assert maxima_mm(orbit)[0] == pytest.approx(35.01, abs=0.005)
    assert len(orbit.warnings) == 2
    assert any("not small relative to the length: deflection_ratio" in text for text in orbit.warnings)
    assert any(
        "close to the buckling load of the coupler: euler_ratio reaches 0.842" in text
        for text in orbit.warnings
    )


def test_three_modes_are_sufficient_and_twenty_are_possible():
    first = {
        modes: sweep(solve.load("coupler", options={"modes": modes}), SPEEDS).figures("q1")
        for modes in (3, 8, 20)
    }
    assert abs(first[8] / first[3] - 1).max() < 1e-5
    assert abs(first[20] / first[8] - 1).max() < 1e-8
    assert solve.load("coupler", options={"modes": 20}).coordinates[-1] == "q20"


def test_crossed_branch_is_a_different_mechanism():
    computed = sweep(solve.load("coupler", options={"branch": "crossed"}), SPEEDS).figures("q1")
    assert (abs(1e3 * computed - [row[0] for row in PRINTED_MM.values()]) > 100 * LAST_DIGIT_MM).all()


@pytest.mark.slow
def test_undamped_coupler_has_the_expected_unstable_bands():
    """A search may also find the band of a combination resonance, which is tested below."""
    undamped = solve.load("coupler", alpha=0, cx=0, cy=0)
    computed = bands(undamped, [f"{rpm} rpm" for rpm in np.linspace(4000, 6000, 41)])
    wide = [band for band in computed if band.spectral_radius > 1.001]
    assert [band.kind for band in wide] == ["-1", "+1"]
    edges = np.array([wide[0].low, wide[0].high, wide[1].low]) * 30 / np.pi
    np.testing.assert_allclose(edges, [4294.86, 4347.96, 5643.97], rtol=0, atol=0.05)
    assert wide[1].open_high


@pytest.mark.parametrize("method", ["gauss", "radau"])
def test_narrow_band_of_a_combination_resonance_is_found(method):
    """Two pairs of multipliers meet off the real axis. Between 4685.2847 and 4685.2862 rpm, the motion grows
    by a factor of 1 + 4e-6 per period."""
    undamped = solve.load("coupler", alpha=0, cx=0, cy=0)
    radius = [
        solve.floquet(undamped, f"{rpm} rpm", method).spectral_radius
        for rpm in (4685.2840, 4685.2855, 4685.2870)
    ]
    np.testing.assert_allclose(radius, [1, 1 + 3.89e-6, 1], rtol=0, atol=1e-8)


def test_deflection_at_any_point_matches_the_modes():
    system = solve.load("coupler")
    orbit = solve.periodic(system, "1500 rpm", "radau")
    middle = system.field("w", 0.5) @ orbit.q
    np.testing.assert_allclose(middle, orbit.outputs["midpoint_deflection"], rtol=0, atol=1e-15)
    line = system.field("w", [0, 0.25, 1]) @ orbit.q
    assert line.shape == (3, len(orbit.phase))
    assert abs(line[[0, 2]]).max() < 1e-15
    k = np.arange(1, 4)[:, None]
    np.testing.assert_allclose(line[1], (np.sin(k * np.pi / 4) * orbit.q).sum(axis=0), rtol=0, atol=1e-15)
    with pytest.raises(UnknownNameError, match="field of coupler 'v'; known: w"):
        system.field("v", 0.5)
    with pytest.raises(ValueOutOfBoundsError, match="fractions of the length, 0 to 1"):
        system.field("w", 0.4 / 0.2)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (
            {"l2": 0.9},
            r"the crank cannot turn fully: l1 \+ l2 < l3 \+ l4 does not hold for l1 = 1 m, l2 = 0.9 m",
        ),
        ({"l4": 1.8}, r"the crank cannot turn fully: \|l1 - l2\| > \|l3 - l4\| does not hold"),
        ({"l3": 0}, r"l3 \(length of the coupler\) is 0 m; allowed: > 0"),
        ({"l2": -0.05}, r"l2 \(length of the crank\) is -0.05 m; allowed: > 0"),
        ({"options": {"modes": 0}}, "option modes of coupler is 0; allowed: a whole number from 1 to 20"),
    ],
)
def test_impossible_parameters_are_refused_in_one_line(given, message):
    with pytest.raises(ValueOutOfBoundsError, match=message) as refused:
        solve.load("coupler", **given)
    assert "\n" not in str(refused.value)


def test_unknown_branch_is_refused():
    with pytest.raises(UnknownNameError, match="value of option branch 'upper'; known: crossed, open"):
        solve.load("coupler", options={"branch": "upper"})
