"""Critical speeds of the four-bar of thesis Table 4.1 (7.3), and its stresses versus L4 (7.5, 8.5.1)."""

import math

import numpy as np
import pytest

import solve
from solve.labels import parts_of

CRITICAL = {2: 92.59, 3: 61.33, 4: 46.14, 5: 36.87, 6: 30.73, 7: 26.37}
"""Speeds of the largest deflection of the follower's midpoint, rad/s, by the division of the first mean
frequency that they belong to; one element a link, ζ = 2 %. Computed by an independent program."""


@pytest.mark.slow
def test_critical_speeds_match_divisions_of_the_mean_frequency():
    model = solve.load("four_bar")
    critical = solve.critical_speeds(
        model, [25.0, 100.0], "follower_midpoint_deflection", orders=8, rtol=1e-6
    )
    rows = {row.order: row for row in critical.rows if row.mode == 1 and row.response and row.division}
    for order, speed in CRITICAL.items():
        row = rows[order]
        assert row.response.speed == pytest.approx(speed, abs=0.05)
        off = abs(row.response.speed / row.division - 1)
        assert off < 0.005 or (order == 2 and off == pytest.approx(0.006, abs=5e-4))
        # The dominant multiplier's real part is largest there too, within half a percent.
        assert row.multiplier.speed == pytest.approx(speed, rel=5e-3)


def peak(quantity, L4, speed, elements=3):
    """Return the largest stress of both surfaces over a period in MPa and the crank angle (degrees) at which
    it occurs."""
    model = solve.load("four_bar", options={"elements": elements}, L4=L4)
    orbit = solve.periodic(model, speed, rtol=1e-5)
    computed = max(
        (orbit.statistics(part) for part in parts_of(model, quantity)), key=lambda each: each.max_abs
    )
    at = computed.max_phase if computed.max >= -computed.min else computed.min_phase
    return computed.max_abs / 1e6, math.degrees(at)


@pytest.mark.slow
@pytest.mark.parametrize("speed", [17.0, 30.0])
def test_follower_stress_is_smallest_near_l4_of_0_65_m(speed):
    """Thesis 8.5.1 states 0.66 m; Figs. 7.13 (30 rad/s) and 8.24 (17 rad/s)."""
    lengths = [0.547, 0.60, 0.62, 0.64, 0.65, 0.66, 0.68]
    stress, angle = np.transpose([peak("follower_midpoint_stress", L4, speed) for L4 in lengths])
    assert lengths[int(stress.argmin())] == 0.65
    assert (np.diff(stress[:5]) < 0).all()
    assert (np.diff(stress[4:]) > 0).all()
    assert ((angle[:4] > 30) & (angle[:4] < 50)).all()
    assert ((angle[5:] > 182) & (angle[5:] < 195)).all()


@pytest.mark.slow
def test_damping_lowers_the_smallest_peak_of_the_coupler():
    """Thesis 7.6, "invariably". The peak is near 29.4 rad/s. At other speeds on either side, the same damping
    raises the stress."""
    speeds = [29.0, 29.2, 29.4, 29.6]
    model = solve.load("four_bar", options={"elements": 3})
    sweeps = solve.sweeps(
        solve.variants(model, "zeta", [0.02, 0.06]), speeds, ["coupler_midpoint_stress"], rtol=1e-4
    )
    light, heavy = sweeps.figures("coupler_midpoint_stress")
    assert int(light.argmax()) == 2
    assert list(heavy < light) == [False, True, True, False]


def test_follower_stress_at_0_662_m_peaks_near_180_degrees():
    """Thesis 8.5.1, Fig. 8.24. The transmission angle is largest there."""
    _, angle = peak("follower_midpoint_stress", 0.662, 17.0)
    assert angle == pytest.approx(180, abs=15)


def test_crank_stress_is_smallest_near_l4_of_0_645_m():
    """The model has one element per link; the speed is 30 rad/s."""
    lengths = [0.63, 0.64, 0.645, 0.65, 0.66]
    stress, angle = np.transpose([peak("crank_root_stress", L4, 30.0, 1) for L4 in lengths])
    assert lengths[int(stress.argmin())] == 0.645
    assert (angle[:3] < 30).all()
    assert (angle[3:] > 170).all()


def test_mean_frequencies_are_nearly_independent_of_l4():
    """Thesis 7.3. The first mean frequency changes by less than 0.5 % for L4 from 0.5 m to 0.65 m."""
    means = [
        solve.frequencies(model, np.linspace(0, 2 * np.pi, 36, endpoint=False), 1).mean[0]
        for model in (solve.load("four_bar", L4=L4) for L4 in (0.5, 0.547, 0.6, 0.65))
    ]
    assert max(means) / min(means) - 1 < 0.005


@pytest.mark.slow
def test_critical_speeds_but_not_peaks_are_nearly_independent_of_l4():
    """The peak of the deflection near 46 rad/s (harmonic 4) moves by less than 1 % for L4 from 0.5 m to 0.65
    m. Its height decreases to less than half, and does not decrease further above 0.6 m."""
    speeds = np.linspace(44.0, 48.0, 41)
    models = {str(L4): solve.load("four_bar", L4=L4) for L4 in (0.5, 0.547, 0.6, 0.65)}
    sweeps = solve.sweeps(models, speeds, ["follower_midpoint_deflection"])
    size = sweeps.figures("follower_midpoint_deflection", "rms")
    at, peaks = speeds[size.argmax(axis=1)], size.max(axis=1)
    assert at.max() / at.min() - 1 < 0.01
    assert (np.abs(at - 46.14) < 0.5).all()
    assert (np.diff(peaks[:3]) < 0).all()
    assert peaks[-1] < peaks[0] / 2


@pytest.mark.slow
def test_damping_lowers_peaks_but_not_all_stresses_between_them():
    """Thesis 7.4.2 and 9.1, with three elements per link. More damping lowers the resolved peaks, but not
    every stress at speeds between them."""
    names = [f"{place}_stress" for place in ("crank_root", "coupler_midpoint", "follower_midpoint")]
    model = solve.load("four_bar", options={"elements": 3})
    speeds = np.linspace(24.0, 44.0, 31)
    sweeps = solve.sweeps(solve.variants(model, "zeta", [0.02, 0.06]), speeds, names, rtol=1e-5)
    ratios = {"peak": [], "quiet": []}
    for name in names:
        for extreme in sweeps.extremes(name):
            ratios[extreme.kind].append(extreme.responses[1] / extreme.responses[0])
    assert len(ratios["peak"]) > 3
    assert max(ratios["peak"]) < 1
    assert max(ratios["quiet"]) > 1
