"""Unstable bands against characteristic values, closed forms and single solves."""

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import mathieu_a, mathieu_b

import solve
from solve.errors import ValueOutOfBoundsError
from tests.solve import systems

DELTA, EPSILON = 4.0, 2.0


def mathieu(delta=DELTA, epsilon=EPSILON, damping=0.0):
    """q″ + damping q′ + (delta + epsilon cos 2φ) q = 0 with φ = Ωt."""

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        stiffness = (delta + epsilon * np.cos(2 * phase))[:, None, None]
        return one, damping * one, stiffness, np.zeros((len(phase), 1))

    return systems.system(matrices, 1, period=np.pi)


def edge(values, order, low, high):
    """The speed at which delta/Ω² is the characteristic value of that order at q = -epsilon/(2Ω²)."""
    return brentq(lambda w: values(order, EPSILON / (2 * w**2)) - DELTA / w**2, low, high, xtol=1e-14)


@pytest.mark.parametrize("engine", ["numpy", "auto"])
def test_edges_are_characteristic_values(engine):
    found = solve.bands(mathieu(), np.linspace(0.9, 4.0, 40), tolerance=1e-10, engine=engine)
    assert [band.kind for band in found] == ["+1", "-1"]
    second = edge(mathieu_a, 2, 0.8, 1.1), edge(mathieu_b, 2, 0.8, 1.1)
    first = edge(mathieu_a, 1, 1.5, 2.6), edge(mathieu_b, 1, 1.5, 2.6)
    for band, edges in zip(found, (second, first), strict=True):
        assert (band.low, band.high) == pytest.approx(sorted(edges), rel=1e-8)
        assert not (band.open_low or band.open_high)


def test_a_band_between_two_speeds_is_found():
    speeds = np.linspace(0.9, 4.0, 9)
    found = solve.bands(mathieu(), speeds)
    inside = [np.any((speeds > band.low) & (speeds < band.high)) for band in found]
    assert [band.kind for band in found] == ["+1", "-1"]
    assert not all(inside), "the grid alone would have shown both"


def test_bands_reach_to_the_ends_of_the_range():
    (band,) = solve.bands(mathieu(), np.linspace(1.95, 2.05, 5))
    assert (band.low, band.high, band.open_low, band.open_high) == (1.95, 2.05, True, True)


def test_the_largest_multiplier_inside():
    (band,) = solve.bands(mathieu(), np.linspace(1.5, 3.0, 12))
    radii = [solve.floquet(mathieu(), w).spectral_radius for w in np.linspace(band.low, band.high, 41)[1:-1]]
    assert band.spectral_radius == pytest.approx(max(radii), rel=3e-3)


def combined():
    """Two oscillators of frequencies 1 and √2·1.5 that a symmetric coupling at order 1 pumps together."""

    def matrices(phase, speed):
        M = np.tile(np.eye(2), (len(phase), 1, 1))
        K = np.tile(np.diag([1.0, 4.5]), (len(phase), 1, 1))
        K[:, 0, 1] = K[:, 1, 0] = 0.4 * np.cos(phase)
        return M, 0 * M, K, np.zeros((len(phase), 2))

    return systems.system(matrices, 2)


def test_a_combination_resonance_is_a_complex_pair():
    system, total = combined(), 1.0 + np.sqrt(4.5)
    bands = solve.bands(system, np.linspace(0.9 * total, 1.1 * total, 12))
    (band,) = [band for band in bands if band.kind == "complex"]
    assert band.low < total < band.high
    for place, stable in ((-1e-4, True), (1e-4, False)):
        assert solve.floquet(system, band.low * (1 + place)).stable is stable
        assert solve.floquet(system, band.high * (1 - place)).stable is stable
    # To first order in the coupling half the width is 0.4 / (2 sqrt(ω1 ω2)).
    assert (band.high - band.low) / 2 == pytest.approx(0.4 / (2 * 4.5**0.25), rel=0.05)


def test_damping_removes_a_weak_band():
    speeds = np.linspace(0.9, 4.0, 40)
    kinds = [band.kind for band in solve.bands(mathieu(damping=0.3), speeds)]
    assert kinds == ["-1"]
    assert solve.bands(mathieu(epsilon=0.0, damping=0.3), speeds) == []


def test_growth_within_rounding_is_no_band():
    assert solve.bands(mathieu(epsilon=1e-7), np.linspace(0.9, 4.0, 40)) == []


def test_progress_rises():
    seen = []
    solve.bands(mathieu(), np.linspace(0.9, 4.0, 20), progress=seen.append)
    assert seen == sorted(seen)
    assert 20 <= seen[0] < seen[-1]


def test_one_speed_is_no_range():
    with pytest.raises(ValueOutOfBoundsError, match="at least two speeds"):
        solve.bands(mathieu(), [2.0, 2.0])
