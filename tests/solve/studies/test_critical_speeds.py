"""Critical speeds of systems with known frequencies."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

import solve
from solve.errors import UnknownNameError, ValueOutOfBoundsError
from solve.results.critical_speeds import Critical, Maximum
from solve.studies.mean_frequencies import MeanFrequencies, combinations
from tests.solve import systems

FREQUENCIES, ZETA = np.array([10.0, 37.0]), 0.02


def oscillators():
    """Return two uncoupled oscillators under loads with harmonics 1 to 4."""
    damping = np.diag(2 * ZETA * FREQUENCIES)

    def push(phase):
        wave = np.cos(np.outer(phase, np.arange(1, 5))).sum(axis=1)
        return np.column_stack((wave, wave))

    return systems.constant(np.eye(2), damping, np.diag(FREQUENCIES**2), push)


@pytest.fixture(scope="module")
def computed():
    return solve.critical_speeds(oscillators(), np.linspace(2.2, 12.0, 30), figure="rms", orders=5)


def rms(speed):
    k = np.arange(1, 5) * speed
    size = 1 / np.sqrt((FREQUENCIES[0] ** 2 - k**2) ** 2 + (2 * ZETA * FREQUENCIES[0] * k) ** 2)
    return np.sqrt((size**2).sum() / 2)


def test_maxima_of_the_response_match_the_closed_form(computed):
    rows = {row.order: row for row in computed.rows if row.mode == 1}
    for order in range(1, 5):
        near = FREQUENCIES[0] / order
        truth = minimize_scalar(lambda w: -rms(w), bounds=(0.95 * near, 1.05 * near), method="bounded")
        assert rows[order].response.speed == pytest.approx(truth.x, rel=1e-4)
        assert rows[order].response.height == pytest.approx(rms(truth.x), rel=1e-7)


@pytest.mark.parametrize("ratio", [2.7, 3.15])
def test_narrow_resonances_of_a_higher_mode_are_found(ratio):
    """The response of the second mode exceeds that of the first one only close to its resonances, whose width
    is a tenth of the distance between two speeds of the grid."""
    frequencies, zeta, push = np.array([1.0, ratio]), 1e-3, 0.3 ** np.arange(3)
    shapes = np.array([[np.cos(0.4), -np.sin(0.4)], [np.sin(0.4), np.cos(0.4)]])

    def load(phase):
        wave = np.cos(np.outer(phase, np.arange(1, 4))) @ push
        return np.column_stack((wave, wave))

    damping, stiffness = np.diag(2 * zeta * frequencies), np.diag(frequencies**2)
    C, K = (shapes @ matrix @ shapes.T for matrix in (damping, stiffness))
    system = systems.constant(np.eye(2), C, K, load)

    def rms(speed):
        k = np.arange(1, 4) * speed
        modal = frequencies**2 - k[:, None] ** 2 + 2j * zeta * frequencies * k[:, None]
        q = (shapes[0] * (shapes.T @ np.ones(2)) / modal).sum(axis=1)
        return np.sqrt((np.abs(q * push) ** 2).sum() / 2)

    rows = solve.critical_speeds(system, [0.55, 3.5], figure="rms", orders=3).rows
    found = {row.order: row.response for row in rows if row.mode == 2}
    for order in (1, 2):
        near = ratio / order * np.array([0.998, 1.002])
        truth = minimize_scalar(lambda w: -rms(w), bounds=near, method="bounded", options={"xatol": 1e-9})
        assert found[order].speed == pytest.approx(truth.x, rel=2e-5)
        assert found[order].height == pytest.approx(-truth.fun, rel=1e-5)


def test_maxima_of_multipliers_follow_from_the_damped_frequency(computed):
    decay, turn = ZETA * FREQUENCIES[0], FREQUENCIES[0] * np.sqrt(1 - ZETA**2)
    rows = {row.order: row for row in computed.rows if row.mode == 1}
    for order in range(1, 5):
        near = turn / order

        def real_part(w):
            return -np.exp(-decay * 2 * np.pi / w) * np.cos(turn * 2 * np.pi / w)

        truth = minimize_scalar(real_part, bounds=(0.9 * near, 1.1 * near), method="bounded")
        assert rows[order].multiplier.speed == pytest.approx(truth.x, rel=1e-4)


def test_divisions_and_combinations_match_the_closed_form(computed):
    divided = {(row.mode, row.order): row.division for row in computed.rows if row.division}
    assert {order for mode, order in divided if mode == 1} == {1, 2, 3, 4}
    for (mode, order), speed in divided.items():
        assert speed == pytest.approx(FREQUENCIES[mode - 1] / order, rel=1e-12)
    every = combinations(MeanFrequencies(computed.system, computed.speeds), 5)
    principal = [one.order for one in every if one.modes == (1, 1)]
    assert principal == [3, 5]
    for one in every:
        high, low = (FREQUENCIES[mode - 1] for mode in one.modes)
        exact = (high + one.sign * low) / one.order
        assert one.speed == pytest.approx(exact, rel=1e-12)


def test_constant_matrices_have_no_combination_resonances(computed):
    assert computed.combinations == []
    assert computed.constant_matrices


def test_speed_range_may_be_text():
    text, numbers = (
        solve.critical_speeds(oscillators(), speeds, figure="rms", orders=2)
        for speeds in ("5:6:4 rad/s", np.linspace(5.0, 6.0, 4))
    )
    assert [row.speed for row in text.rows] == [row.speed for row in numbers.rows]


def test_invalid_input_is_refused():
    system = oscillators()
    with pytest.raises(ValueOutOfBoundsError, match="at least two speeds"):
        solve.critical_speeds(system, [3.0])
    with pytest.raises(UnknownNameError, match="q2"):
        solve.critical_speeds(system, [3.0, 4.0], "q0")
    with pytest.raises(UnknownNameError, match="max_abs"):
        solve.critical_speeds(system, [3.0, 4.0], figure="max_ab")
    with pytest.raises(ValueOutOfBoundsError, match="orders is 0"):
        solve.critical_speeds(system, [3.0, 4.0], orders=0)


def test_figure_shows_response_multiplier_and_campbell_diagram(computed):
    response, multiplier, campbell = computed.plot().axes
    assert response.get_ylabel().startswith("rms q1")
    assert "multiplier" in multiplier.get_ylabel()
    assert "frequency (Hz)" in campbell.get_ylabel()
    shown = [axes.get_ylabel() for axes in computed.plot(campbell=True).axes]
    assert shown == [response.get_ylabel(), campbell.get_ylabel()]
    for axes in (response, multiplier, campbell):
        marked = [line for line in axes.get_lines() if line.get_marker() in {"v", "o"}]
        named = [text.get_text() for text in axes.get_legend().get_texts()]
        assert {line.get_label() for line in marked} <= set(named)


def _growing(phase, speed):
    """Return the system q″ + c q′ + 4 q, where c < 0 between the speeds 2 and 3 and the frozen K is 4 at all
    speeds."""
    one = np.ones((len(phase), 1, 1))
    damping = -0.1 if 2.0 < speed < 3.0 else 0.1
    return one, damping * one, 4.0 * one, np.cos(phase)[:, None]


def test_unstable_ranges_are_reported_and_omitted_from_the_curve():
    critical = solve.critical_speeds(
        solve.PeriodicSystem(_growing, ["q"]), np.linspace(1.0, 4.0, 31), orders=3
    )
    ((low, high, radius),) = critical.unstable_ranges
    assert 2.0 < low < 2.2
    assert 2.8 < high < 3.0
    assert radius == pytest.approx(np.exp(0.05 * 2 * np.pi / low), rel=1e-6)
    assert any("the motion is unstable from" in text for text in critical.warnings)
    assert "Unstable among the speeds" in critical._repr_html_()
    (curve,) = [line for line in critical.plot().axes[0].get_lines() if line.get_marker() != "v"]
    x, y = np.array(curve.get_data())
    inside = (x > 2.2 * 30 / np.pi) & (x < 2.8 * 30 / np.pi)
    assert not np.isfinite(y[inside]).any()


def test_imaginary_frozen_frequencies_give_a_warning():
    def hill(phase, speed):
        one = np.ones((len(phase), 1, 1))
        return one, 0.4 * one, (1.0 + 2.0 * np.cos(phase))[:, None, None], np.cos(phase)[:, None]

    critical = solve.critical_speeds(solve.PeriodicSystem(hill, ["q"]), np.linspace(4.0, 6.0, 5), orders=3)
    assert critical.imaginary.all()
    assert any("integer fractions are meaningless" in text for text in critical.warnings)


def test_response_curve_passes_through_the_marked_maxima(computed):
    for axes in computed.plot().axes[:2]:
        marks = [line for line in axes.get_lines() if line.get_marker() == "v"]
        points = set(zip(*axes.get_lines()[0].get_data(), strict=True))
        assert marks
        assert all(points.issuperset(zip(*mark.get_data(), strict=True)) for mark in marks)


def test_peak_is_assigned_to_the_resonant_harmonic():
    """Only q1 is excited, at harmonic 3. The seventh division of the other oscillator lies at the maximum of
    q1."""
    peak = 30.0 * np.sqrt(1 - 2 * ZETA**2) / 3
    frequencies = np.array([30.0, 7 * peak])

    def push(phase):
        return np.column_stack((np.cos(3 * phase), np.zeros_like(phase)))

    system = systems.constant(np.eye(2), np.diag(2 * ZETA * frequencies), np.diag(frequencies**2), push)
    critical = solve.critical_speeds(system, np.linspace(9.2, 10.8, 9), orders=8)
    ((mode, order),) = [(row.mode, row.order) for row in critical.rows if row.response]
    assert (mode, order) == (1, 3)
    assert any((row.mode, row.order) == (2, 7) for row in critical.rows)


ZETA_OF_ROTOR = 0.01


def rotor(asymmetry=0.2, zeta=ZETA_OF_ROTOR, frequency=100.0):
    """Shaft of unequal stiffnesses with an unbalance, in fixed coordinates. The whirling frequencies of the
    shaft at rest are ω sqrt(1 ± μ); it is unstable between them."""

    def matrices(phase, speed):
        one = np.broadcast_to(np.eye(2), (len(phase), 2, 2))
        c, s = np.cos(2 * phase), np.sin(2 * phase)
        turned = np.moveaxis(np.array([[c, s], [s, -c]]), 2, 0)
        unbalance = 1e-5 * speed**2 * np.column_stack((np.cos(phase), np.sin(phase)))
        return one, 2 * zeta * frequency * one, frequency**2 * (one + asymmetry * turned), unbalance

    return solve.PeriodicSystem(matrices, ["x", "y"])


def test_unstable_rotor_growth_is_not_assigned_to_a_division():
    """The response is largest at both edges of the band, where ρ = +1 and the harmonic is 1. In rotating
    coordinates it is constant, and (1 + μ - s)(1 - μ - s) + 4 ζ² s = 0 with s = Ω²/ω². Between the edges,
    there is no sustained motion, and the maximum of the multiplier does not belong to a division."""
    half = np.sqrt(0.2**2 - 4 * ZETA_OF_ROTOR**2 + 4 * ZETA_OF_ROTOR**4)
    low, high = 100 * np.sqrt(1 - 2 * ZETA_OF_ROTOR**2 + np.array([-half, half]))
    critical = solve.critical_speeds(rotor(), np.linspace(40.0, 130.0, 91), orders=4)
    ((first, last, radius),) = critical.unstable_ranges
    assert low < first < low + 1.01
    assert high - 1.01 < last < high
    peaks = sorted(row.response.speed for row in critical.rows if row.response)
    assert peaks == pytest.approx([low, high], rel=1e-4)
    assert radius > 1.1
    attributed = [row for row in critical.rows if row.mode and (row.response or row.multiplier)]
    assert {row.order for row in attributed if row.response} == {1}
    for row in attributed:
        assert row.multiplier is None or row.multiplier.height < 1
        assert abs(row.speed - row.division) < 0.05 * row.division
    inside = [row for row in critical.rows if first < row.speed < last and row.multiplier]
    assert inside
    assert all(row.mode is None for row in inside)


def test_response_is_unbounded_at_the_edges_of_an_unstable_range():
    critical = solve.critical_speeds(rotor(), np.linspace(80.0, 120.0, 41), orders=2)
    assert [row.unbounded for row in critical.rows if row.response] == [True, True]


@pytest.mark.parametrize(("shaken", "other"), [(0.2, 102.0), (0.1, 94.0)])
def test_both_edges_are_found_despite_another_dominant_mode(shaken, other):
    """A second mode decays at the same rate. Its real part hides that of the mode whose multiplier passes
    through +1."""

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        stiffness = np.diag([1e4, other**2]) * one
        stiffness[:, 0, 0] *= 1 + shaken * np.cos(phase)
        return one * np.eye(2), 0.2 * one * np.eye(2), stiffness, np.cos(phase)[:, None] * [1.0, 1.0]

    system = solve.PeriodicSystem(matrices, ["p", "q"])
    (band,) = (each for each in solve.bands(system, np.linspace(98.5, 101.0, 31)) if each.kind == "+1")
    critical = solve.critical_speeds(system, [30.0, 160.0], orders=1)
    computed = [row.response.speed for row in critical.rows if row.response and row.unbounded]
    assert computed == pytest.approx([band.high, band.low], rel=2e-5)


@pytest.mark.parametrize(
    ("frequencies", "shares", "ranges"),
    [
        ((100.0, 101.5), (0.084, 0.047), 2),
        ((100.0, 100.4), (0.031, 0.023), 2),
        ((100.0, 100.02), (0.08, 0.05), 1),
    ],
)
def test_unstable_ranges_of_two_nearly_equal_modes_are_separated(frequencies, shares, ranges):
    """The gap lies between two of the given speeds. The ranges of the third pair overlap."""
    damping = 100 * min(shares) ** 2 / 16

    def shaken(w, share, turn):
        def matrices(phase, speed):
            one = np.ones((len(phase), 1, 1))
            K = np.einsum("ij,pj,kj->pik", turn, w**2 * (1 + np.cos(phase)[:, None] * share), turn)
            return (
                one * np.eye(len(w)),
                one * damping * np.eye(len(w)),
                K,
                np.outer(np.cos(phase), turn.sum(1)),
            )

        return systems.system(matrices, len(w))

    turn = np.array([[0.8, -0.6], [0.6, 0.8]])
    w, share = np.array(frequencies), np.array(shares)
    alone = [next(iter(solve.bands(shaken(w[[i]], share[[i]], np.eye(1)), [98.0, 103.0]))) for i in (0, 1)]
    edges = sorted((edge for band in alone for edge in (band.low, band.high)), reverse=True)
    edges = edges if ranges == 2 else [edges[0], edges[-1]]
    both = shaken(w, share, turn)
    critical = solve.critical_speeds(both, [30.0, 160.0], orders=1)
    computed = [row.response.speed for row in critical.rows if row.response and row.unbounded]
    assert computed == pytest.approx(edges, rel=3e-5)
    assert np.ravel([range_[:2] for range_ in critical.unstable_ranges]) == pytest.approx(
        edges[::-1], rel=3e-5
    )
    computed = solve.bands(both, [30.0, 160.0])
    assert np.ravel([(band.low, band.high) for band in computed]) == pytest.approx(edges[::-1], rel=1e-6)


def test_neighbouring_unstable_resonances_are_separate_ranges():
    """Two parametrically coupled modes have principal resonances at 200 and 220 and a combination resonance
    at 210."""

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        K = np.diag([1e4, 1.21e4]) + np.cos(phase)[:, None, None] * np.full((2, 2), 100.0)
        return one * np.eye(2), one * 0.1 * np.eye(2), K, np.zeros((len(phase), 2))

    system = systems.system(matrices, 2)
    bands = solve.bands(system, [199.0, 222.0])
    ranges = solve.critical_speeds(system, [199.0, 222.0], orders=1).unstable_ranges
    assert len(ranges) == len(bands) == 3
    for (low, high, _), band in zip(ranges, bands, strict=True):
        assert band.low < low <= high < band.high


def test_widest_table_fits_80_columns():
    critical = solve.critical_speeds(rotor(frequency=20000.0), "80000:240000:40 rpm", orders=2)
    lines = [line.rstrip() for line in str(critical).splitlines()]
    assert any("|ρ|" in line and "mode" in line for line in lines)
    assert max(map(len, lines)) <= 80


def test_division_at_a_given_speed_is_reported_once():
    critical = solve.critical_speeds(oscillators(), [2.5, 5.0, 10.0], orders=4)
    divided = [(row.mode, row.order) for row in critical.rows if row.division and row.mode == 1]
    assert divided == [(1, 1), (1, 2), (1, 3), (1, 4)]


def test_speed_with_singular_inertia_does_not_affect_others():
    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        load = np.cos(phase)[:, None]
        return one * float(speed != 2.0), 0.02 * one, (4.0 + 0.4 * np.cos(phase))[:, None, None], load

    critical = solve.critical_speeds(solve.PeriodicSystem(matrices, ["q"]), [1.0, 1.5, 2.0, 3.0], orders=4)
    assert critical.notes[-1].startswith("1 of ")
    assert "M is singular" in critical.notes[-1]


def test_table_of_all_columns_fits_80_columns(computed):
    speed = 337.0
    row = Critical(
        Maximum(speed, 0.0213), Maximum(speed, -0.79), speed, 1, 2, speed, radius=Maximum(speed, 1.2)
    )
    (heading,) = [line for line in repr(replace(computed, rows=[row])).splitlines() if "at rest  " in line]
    assert heading.split()[-2:] == ["mode", "k"]
    assert len(heading) <= 80


def test_empty_result_states_that_nothing_was_found(computed):
    assert "no maximum and no division up to order 5 found from" in repr(replace(computed, rows=[]))
