"""Maxima of the dominant multiplier and of the spectral radius, and the divisions and combinations that
explain them."""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

import solve
from solve.studies.resonances import MultiplierMatcher
from tests.solve import systems


def two_modes(frequencies, decays, coupling=0.0):
    """Return two oscillators that decay at rates δ(Ω), coupled by a stiffness that varies once per period."""

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        damping = 2 * np.diag([decay(speed) for decay in decays])
        varying = np.cos(phase)[:, None, None] * np.array([[0.0, coupling], [coupling, 0.0]])
        load = np.column_stack((np.cos(phase), np.cos(phase)))
        return one * np.eye(2), one * damping, one * np.diag(np.square(frequencies)) + varying, load

    return solve.PeriodicSystem(matrices, ["x", "y"])


def test_maximum_at_a_multiplier_crossing_stays_unexplained():
    """At Ω = 10, mode 1 decays as fast as mode 2; beyond this speed, mode 1 is dominant. Its frequency is a
    tenth of the speed away from its third division, but its multiplier is 36° from +1."""
    system = two_modes((31.0, 55.0), (lambda speed: 0.5 + 0.1 * (speed - 10.0), lambda _: 0.5))
    critical = solve.critical_speeds(system, np.linspace(9.6, 10.25, 27), orders=6)
    (row,) = [row for row in critical.rows if row.multiplier]
    assert row.multiplier.speed == pytest.approx(10.0, rel=1e-4)
    assert (row.mode, row.order, row.combination) == (None, None, None)
    assert critical.record()["rows"][critical.rows.index(row)]["combination"] is None
    assert (
        "no division of a frequency and no combination up to order 6 explains the row"
        in critical._repr_html_()
    )


def test_combination_resonance_explains_the_multiplier_maximum():
    """At Ω = ω1 + ω2, the parametric coupling ε feeds both modes. The slower of their decay rates is (δ1 +
    δ2)/2 - sqrt((δ1 - δ2)²/4 + ε²/(16 ω1 ω2)) (A. H. Nayfeh, D. T. Mook, Nonlinear Oscillations, 1979,
    Section 5.4)."""
    system = two_modes((1.0, 9.0), (lambda _: 0.2, lambda _: 0.3), 1.8)
    critical = solve.critical_speeds(system, np.linspace(9.0, 11.0, 41), orders=5)
    (row,) = [row for row in critical.rows if row.multiplier and row.mode is None]
    assert row.multiplier.speed == pytest.approx(10.0, rel=0.03)
    assert (row.combination.modes, row.combination.sign, row.combination.order) == ((2, 1), 1, 1)
    at = np.abs(critical.speeds - 10.0).argmin()
    rate = np.log(critical.radius[at]) * critical.speeds[at] / (2 * np.pi)
    assert critical.speeds[at] == pytest.approx(10.0)
    assert rate == pytest.approx(-0.25 + np.sqrt(0.05**2 + 1.8**2 / 144), rel=0.05)
    assert "2+1" in critical._repr_html_()
    (computed,) = [each for each in critical.record()["rows"] if each["combination"]]
    assert computed["combination"]["modes"] == [2, 1]
    table = critical.to_pandas()
    assert list(table["explained_by"][table["mode"].isna() & (table["explained_by"] != "")]) == ["2+1, k = 1"]


def coupled(frequencies, damping, amplitude, sign=1, own=0.0):
    """Return oscillators with the same damping c, coupled by a stiffness that varies as cos Ωt; the coupling
    is antisymmetric for sign -1. The stiffness of the first oscillator also varies. In the first
    approximation, the resonance of the sum of the frequencies (for sign -1, of the difference) grows at the
    rate -c/2 + sqrt(ε²/(16 ω1 ω2) - (Ω - ω2 ∓ ω1)²/4) (A. H. Nayfeh, D. T. Mook, Nonlinear Oscillations,
    1979, Section 5.4)."""
    coupling = np.array([[own, amplitude], [sign * amplitude, 0.0]])

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        stiffness = one * np.diag(np.square(frequencies)) + np.cos(phase)[:, None, None] * coupling
        return one * np.eye(2), damping * one * np.eye(2), stiffness, np.zeros((len(phase), 2))

    return solve.PeriodicSystem(matrices, ["x", "y"])


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("damping", [0.0, 0.05, 0.1])
def test_combination_resonance_of_equally_damped_modes_is_found(damping, sign):
    """The resonance is found whether or not it makes the motion unstable. Beside it, all moduli are equal;
    only at the resonance does |ρ| rise."""
    low, high, amplitude = 1.0, np.sqrt(3.0), 0.1
    speed = high + sign * low
    critical = solve.critical_speeds(
        coupled((low, high), damping, amplitude, sign), speed * np.linspace(0.85, 1.17, 65), orders=4
    )
    (row,) = [row for row in critical.rows if row.radius]
    assert (row.combination.modes, row.combination.sign, row.combination.order) == ((2, 1), sign, 1)
    assert row.combination.speed == pytest.approx(speed, rel=0.01)
    largest = amplitude / np.sqrt(16 * low * high)

    def radius(at):
        return np.exp(2 * np.pi / at * (-damping / 2 + np.sqrt(largest**2 - (at - speed) ** 2 / 4)))

    edges = speed - 2 * largest, speed + 2 * largest
    truth = minimize_scalar(lambda at: -radius(at), bounds=edges, method="bounded")
    assert row.radius.speed == pytest.approx(truth.x, rel=0.01)
    assert row.radius.height == pytest.approx(radius(truth.x), rel=0.01)
    assert f"2{'+' if sign > 0 else '−'}1" in repr(critical)


def test_principal_parametric_resonance_is_found_at_twice_the_frequency():
    mathieu = solve.load("mathieu", delta=1.0, epsilon=0.2, zeta=0.0)
    critical = solve.critical_speeds(mathieu, np.linspace(0.6, 1.5, 46), orders=4)
    (row,) = [row for row in critical.rows if row.radius]
    assert (row.mode, row.order) == (1, 1)
    assert row.radius.speed == pytest.approx(1.0, rel=1e-2)
    critical = solve.critical_speeds(coupled((1.0, 2.3), 0.02, 0.0, own=0.2), np.linspace(1.7, 2.25, 45))
    (row,) = [row for row in critical.rows if row.radius]
    assert (row.combination.modes, row.combination.sign, row.combination.order) == ((1, 1), 1, 1)
    assert row.radius.speed == pytest.approx(2.0, rel=1e-2)


def test_undamped_multiplier_maxima_are_all_divisions():
    """Without damping, cos ωT = 1 at Ω = ω/k. The larger of cos ω1 T and cos ω2 T has no other smooth
    maximum. As all moduli are 1, no single multiplier is dominant."""
    frequencies = np.array([1.0, 1.7])
    critical = solve.critical_speeds(coupled(frequencies, 0.0, 0.0), np.linspace(0.4, 2.0, 90), orders=4)
    computed = {(row.mode, row.order): row.multiplier.speed for row in critical.rows if row.multiplier}
    assert set(computed) == {(2, 1), (1, 1), (2, 2), (2, 3), (1, 2), (2, 4)}
    for (mode, order), speed in computed.items():
        assert speed == pytest.approx(frequencies[mode - 1] / order, rel=1e-4)
    assert not [row for row in critical.rows if row.radius]


def test_equally_good_combinations_are_all_reported():
    """For two nearly equal modes, mean frequencies cannot distinguish 1+1, 2+1 and 2+2."""
    critical = solve.critical_speeds(
        coupled((1.0, 1.002), 0.01, 0.0, own=0.1), np.linspace(1.9, 2.1, 60), orders=4
    )
    (row,) = [row for row in critical.rows if row.radius]
    assert row.combination is None
    assert {(one.modes, one.order) for one in row.candidates} == {((1, 1), 1), ((2, 1), 1), ((2, 2), 1)}
    assert "several combinations of modes match the speed of the row equally well" in repr(critical)


def test_combination_resonance_narrower_than_the_speed_spacing_is_found():
    """With ε = 0.03, the motion is unstable over a relative width of less than 0.01."""
    critical = solve.critical_speeds(
        coupled((1.0, np.sqrt(3.0)), 0.0, 0.03), np.linspace(2.05, 3.3, 9), orders=3
    )
    (row,) = [row for row in critical.rows if row.radius]
    assert row.radius.speed == pytest.approx(1.0 + np.sqrt(3.0), rel=1e-4)
    largest = 0.03 / np.sqrt(16 * np.sqrt(3.0))
    assert np.log(row.radius.height) == pytest.approx(2 * np.pi * largest / row.radius.speed, rel=1e-2)
    assert (row.combination.modes, row.combination.sign) == ((2, 1), 1)


@pytest.mark.parametrize("alike", [True, False], ids=["one decay", "each its own"])
def test_multipliers_are_matched_to_modes_by_modulus_and_angle(alike):
    """The oscillators are uncoupled, and the multipliers are given in several orders. With equal decay rates,
    the angle alone decides."""
    speed, frequencies = 7.0, np.array([10.0, 16.0, 35.7])
    decays = np.full(3, 0.3) if alike else np.array([0.2, 0.9, 0.4])
    system = systems.constant(
        np.eye(3), np.diag(2 * decays), np.diag(frequencies**2), lambda p: 0 * p[:, None]
    )
    turned = np.exp((-decays + 1j * np.sqrt(frequencies**2 - decays**2)) * 2 * np.pi / speed)
    for order in ([0, 1, 2], [2, 0, 1], [1, 2, 0]):
        rho = np.column_stack((turned[order], turned[order].conj())).ravel()
        turn = MultiplierMatcher(system, speed, rho, frequencies / speed)
        true = {turn.pair_of(2 * place): mode for place, mode in enumerate(order)}
        assert turn.misfit(true) == pytest.approx(0.0, abs=1e-9)
        for place, mode in true.items():
            assert all(turn.misfit({place: other}) > 1 for other in {0, 1, 2} - {mode})
