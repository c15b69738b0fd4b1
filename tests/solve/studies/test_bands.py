"""Unstable bands, compared with characteristic values, closed forms and single solutions."""

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import mathieu_a, mathieu_b

import solve
from solve.errors import MatricesError, ValueOutOfBoundsError
from solve.terminal import progress
from tests.solve import systems

DELTA, EPSILON = 4.0, 2.0


def mathieu(delta=DELTA, epsilon=EPSILON, damping=0.0):
    """System q″ + damping q′ + (delta + epsilon cos 2φ) q = 0 with φ = Ωt."""

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        stiffness = (delta + epsilon * np.cos(2 * phase))[:, None, None]
        return one, damping * one, stiffness, np.zeros((len(phase), 1))

    return systems.system(matrices, 1, period=np.pi)


def edge(values, order, low, high):
    """Speed at which delta/Ω² equals the characteristic value of the given order at q = -epsilon/(2Ω²)."""
    return brentq(lambda w: values(order, EPSILON / (2 * w**2)) - DELTA / w**2, low, high, xtol=1e-14)


@pytest.mark.parametrize("engine", ["numpy", "auto"])
def test_edges_are_characteristic_values(engine):
    bands = solve.bands(mathieu(), np.linspace(0.9, 4.0, 40), tolerance=1e-10, engine=engine)
    assert [band.kind for band in bands] == ["+1", "-1"]
    second = edge(mathieu_a, 2, 0.8, 1.1), edge(mathieu_b, 2, 0.8, 1.1)
    first = edge(mathieu_a, 1, 1.5, 2.6), edge(mathieu_b, 1, 1.5, 2.6)
    for band, edges in zip(bands, (second, first), strict=True):
        assert (band.low, band.high) == pytest.approx(sorted(edges), rel=1e-8)
        assert (band.open_low, band.open_high) == (False, False)


def test_band_between_two_speeds_is_found():
    speeds = np.linspace(0.9, 4.0, 9)
    bands = solve.bands(mathieu(), speeds)
    inside = [np.any((speeds > band.low) & (speeds < band.high)) for band in bands]
    assert [band.kind for band in bands] == ["+1", "-1"]
    assert not all(inside), "the grid alone would have shown both"


@pytest.mark.parametrize("speeds", [(0.992, 1.992), (0.3, 1.008)], ids=["first", "last"])
def test_band_in_an_interval_at_an_end_of_the_range_is_found(speeds):
    """The edges of the band next to Ω² = delta are a_1 and b_1, 0.005 on both sides."""
    bands = solve.bands(mathieu(delta=1.0, epsilon=0.02), speeds, tolerance=1e-9)

    def distance(w, values):
        return values(1, 0.01 / w**2) - 1 / w**2

    edges = sorted(brentq(distance, 0.98, 1.02, (values,), xtol=1e-14) for values in (mathieu_a, mathieu_b))
    (band,) = [band for band in bands if band.kind == "-1" and band.high > 0.9]
    assert (band.low, band.high) == pytest.approx(edges, rel=1e-8)
    assert not band.open_low
    assert not band.open_high


def test_bands_may_extend_to_the_ends_of_the_range():
    (band,) = solve.bands(mathieu(), np.linspace(1.95, 2.05, 5))
    assert (band.low, band.high, band.open_low, band.open_high) == (1.95, 2.05, True, True)


def test_spectral_radius_of_a_band_is_its_maximum():
    (band,) = solve.bands(mathieu(), np.linspace(1.5, 3.0, 12))
    radii = [solve.floquet(mathieu(), w).spectral_radius for w in np.linspace(band.low, band.high, 41)[1:-1]]
    assert band.spectral_radius == pytest.approx(max(radii), rel=3e-3)


def combined():
    """Two oscillators with the frequencies 1 and √2·1.5, which a symmetric coupling of order 1 excites
    together."""

    def matrices(phase, speed):
        M = np.tile(np.eye(2), (len(phase), 1, 1))
        K = np.tile(np.diag([1.0, 4.5]), (len(phase), 1, 1))
        K[:, 0, 1] = K[:, 1, 0] = 0.4 * np.cos(phase)
        return M, 0 * M, K, np.zeros((len(phase), 2))

    return systems.system(matrices, 2)


def test_combination_resonance_has_a_complex_pair():
    system, total = combined(), 1.0 + np.sqrt(4.5)
    bands = solve.bands(system, np.linspace(0.9 * total, 1.1 * total, 12))
    (band,) = [band for band in bands if band.kind == "complex"]
    assert band.low < total < band.high
    for place, stable in ((-1e-4, True), (1e-4, False)):
        assert solve.floquet(system, band.low * (1 + place)).stable is stable
        assert solve.floquet(system, band.high * (1 - place)).stable is stable
    # To first order in the coupling half the width is 0.4 / (2 sqrt(ω1 ω2)).
    assert (band.high - band.low) / 2 == pytest.approx(0.4 / (2 * 4.5**0.25), rel=0.05)


def test_bands_of_three_nearly_equal_modes_are_separated():
    """One band is next to a band that contains both of the others."""

    def shaken(w, share):
        def matrices(phase, speed):
            one, eye = np.ones((len(phase), 1, 1)), np.eye(len(w))
            K = (w**2 * (1 + np.cos(phase)[:, None] * share))[:, :, None] * eye
            return one * eye, 0.005 * one * eye, K, np.zeros((len(phase), len(w)))

        return systems.system(matrices, len(w))

    w, share = np.array([100.0, 100.05, 100.2]), np.array([0.028, 0.067, 0.032])
    ((first,), (second,), (third,)) = (
        solve.bands(shaken(w[[i]], share[[i]]), [98.0, 103.0]) for i in range(3)
    )
    computed = [
        (band.low, band.high) for band in solve.bands(shaken(w, share), [60.0, 260.0]) if band.kind == "+1"
    ]
    alone = [(min(first.low, second.low), max(first.high, second.high)), (third.low, third.high)]
    assert np.ravel(computed) == pytest.approx(np.ravel(alone), rel=1e-6)


def test_damping_removes_a_weak_band():
    speeds = np.linspace(0.9, 4.0, 40)
    kinds = [band.kind for band in solve.bands(mathieu(damping=0.3), speeds)]
    assert kinds == ["-1"]
    assert solve.bands(mathieu(epsilon=0.0, damping=0.3), speeds) == []


def test_growth_within_round_off_is_not_a_band():
    assert solve.bands(mathieu(epsilon=1e-7), np.linspace(0.9, 4.0, 40)) == []


def test_progress_reports_stages_and_points():
    steps, fractions = [], []

    def listen(tracker):
        if len(tracker.tasks) > 1:
            steps.append(tracker.tasks[0].what)
            fractions.append(tracker.tasks[1].fraction(0.0))

    with progress.listen(listen):
        solve.bands(mathieu(), np.linspace(0.9, 4.0, 20))
    assert list(dict.fromkeys(steps)) == ["all speeds", "edges of bands"]
    assert fractions.count(1.0) >= 2
    assert max(fractions) == 1.0


def test_unresolved_tiny_multipliers_count_as_stable():
    """At 1 rad/s, no grid resolves the multipliers of the cam; their relative errors are infinite."""
    cam = solve.load("cam")
    bands = solve.bands(cam, [1.0, 1.2], rtol=1e-2)
    assert list(bands) == []
    assert bands.notes == []
    alone = solve.floquet(cam, 1.0, rtol=1e-2)
    assert alone.error_estimate.multipliers == np.inf
    assert alone.verdict == "asymptotically stable"


def test_single_speed_is_refused():
    with pytest.raises(ValueOutOfBoundsError, match="at least two speeds"):
        solve.bands(mathieu(), [2.0, 2.0])


def test_empty_range_is_refused():
    with pytest.raises(ValueOutOfBoundsError, match="no speeds given; give speeds, such as"):
        solve.bands(mathieu(), [])


def test_range_may_be_a_text():
    assert solve.bands(mathieu(), "0.9:4:12 rad/s") == solve.bands(mathieu(), np.linspace(0.9, 4.0, 12))


def undamped_coupler():
    return solve.load("coupler", alpha=0, cx=0, cy=0)


def rpm(*speeds):
    return np.array(speeds) * 30 / np.pi


@pytest.mark.parametrize("count", [2, 3, 17])
def test_bands_do_not_depend_on_the_speeds_between_the_ends(count):
    """There are two wide bands, two narrow ones in which multipliers meet off the real axis, and stable
    speeds between them."""
    coupler = undamped_coupler()
    bands = solve.bands(coupler, f"4200:6000:{count} rpm")
    assert [band.kind for band in bands] == ["-1", "complex", "complex", "+1"]
    assert [band.open_high for band in bands] == [False, False, False, True]
    edges = rpm(bands[0].low, bands[0].high, bands[3].low)
    np.testing.assert_allclose(edges, [4294.86, 4347.96, 5643.97], rtol=0, atol=0.05)
    for band in bands:
        width = (band.high - band.low) / (20 if band.open_high else 1)
        outside = [band.low - 0.3 * width, *([] if band.open_high else [band.high + 0.3 * width])]
        assert all(solve.floquet(coupler, speed).spectral_radius < 1 + 1e-8 for speed in outside), band
        inside = band.low + width * np.array([0.3, 0.5, 0.7])
        assert all(solve.floquet(coupler, speed).spectral_radius > 1 + 1e-6 for speed in inside), band


def test_unstable_range_is_split_at_a_stable_interior(monkeypatch):
    """Both ends lie in bands of the same kind; without further speeds they look like a single one."""
    monkeypatch.setattr("solve.studies.bands.INTERVALS", 1)
    monkeypatch.setattr("solve.studies.bands._MAX_ANGLE", 1e9)
    monkeypatch.setattr("solve.studies.bands._HALVINGS", 0)
    coupler = undamped_coupler()
    ends = [solve.floquet(coupler, f"{speed} rpm") for speed in (3286.9, 6000)]
    assert all(not end.stable and end.multipliers[0].real > 1 for end in ends)
    bands = solve.bands(coupler, "3286.9:6000:2 rpm")
    assert (bands[0].kind, bands[0].open_low, bands[0].open_high) == ("+1", True, False)
    assert (bands[-1].kind, bands[-1].open_low, bands[-1].open_high) == ("+1", False, True)
    assert rpm(bands[-1].low) == pytest.approx(5643.97, abs=0.05)
    for place, stable in ((-1e-6, False), (1e-6, True)):
        assert solve.floquet(coupler, bands[0].high * (1 + place)).stable is stable


def test_spacing_is_the_largest_distance_of_speeds_solved():
    wide, narrow = (solve.bands(mathieu(), f"0.9:4:{count} rad/s").spacing for count in (2, 1000))
    assert wide <= 3.1 / 40 * (1 + 1e-9)
    assert narrow == pytest.approx(3.1 / 999, rel=1e-6)


def test_singular_inertia_is_refused():
    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        return 0 * one, one, one, np.zeros((len(phase), 1))

    with pytest.raises(MatricesError):
        solve.bands(systems.system(matrices, 1), [1.0, 2.0])


def test_figure_shows_largest_multiplier_of_each_band():
    bands = solve.bands(solve.load("meissner"), "0.6:1.5:3 rad/s")
    assert len(bands) > 2
    for band in bands:
        inside = (bands.speeds > band.low) & (bands.speeds < band.high)
        assert bands.spectral_radius[inside].max() == band.spectral_radius


def test_plot_refuses_an_invalid_sweep():
    bands = solve.bands(mathieu(), [1.95, 2.05])
    with pytest.raises(ValueOutOfBoundsError, match=r"sweep is 'bands.png'; give a Sweep, such as"):
        bands.plot("bands.png")
