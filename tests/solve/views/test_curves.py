"""Curves versus speed: they pass through their points, add no extrema, and omit unstable speeds."""

import numpy as np
import pytest
from matplotlib.figure import Figure

import solve
from solve.views.panels import draw_through, through
from solve.views.sweep import response_figure


def resonance(x):
    return 1 / np.hypot(1 - x**2, 0.02 * x)


@pytest.mark.parametrize("seed", range(5))
def test_interpolated_curve_adds_no_extrema(seed):
    x = np.random.default_rng(seed).permutation(np.linspace(0.2, 1.8, 23))
    fine, values = through(x, resonance(x))
    order = np.argsort(x)
    np.testing.assert_allclose(np.interp(x, fine, values), resonance(x), rtol=1e-12)
    for low, high in zip(x[order][:-1], x[order][1:], strict=True):
        inside = values[(fine >= low) & (fine <= high)]
        ends = sorted(resonance(np.array([low, high])))
        assert ends[0] * (1 - 1e-12) <= inside.min() <= inside.max() <= ends[1] * (1 + 1e-12)
    assert (
        np.abs(np.diff(np.diff(values) / np.diff(fine))).max()
        < np.abs(np.diff(np.diff(resonance(x[order])) / np.diff(x[order]))).max()
    )


def test_gaps_remain_and_repeated_points_are_drawn_once():
    x = np.array([1.0, 2.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    y = np.array([1.0, 2.0, 2.0, np.nan, 1.0, 2.0, 0.5])
    fine, values = through(x, y)
    assert np.isnan(values[(fine > 2) & (fine < 4)]).all()
    assert np.isfinite(values[(fine <= 2) | (fine >= 4)]).all()


def test_logarithmic_interpolation_of_a_power_is_straight():
    axes = Figure().subplots()
    x = np.linspace(0.0, 3.0, 5)
    draw_through(axes, x, np.append(0.0, 10.0 ** x[1:]), True)
    curve, dots = axes.lines
    known = np.isfinite(curve.get_ydata())
    np.testing.assert_allclose(np.log10(curve.get_ydata()[known]), curve.get_xdata()[known], atol=1e-9)
    assert not known[0]
    assert len(dots.get_xdata()) == 5


def test_response_curve_omits_unstable_speeds_and_their_edges():
    system, speeds = solve.load("cam"), np.linspace(0.2, 1.8, 23)
    bands = [(0.9, 1.1, "+1")]
    figure = response_figure(
        system, {"speed": speeds}, {"q1": resonance(speeds)}, np.ones(23), "max_abs", bands
    )
    curve, _, marks = figure.axes[0].lines
    shown = curve.get_xdata()[np.isfinite(curve.get_ydata())] * np.pi / 30
    assert not ((shown > 0.9) & (shown < 1.1)).any()
    assert len(marks.get_xdata()) == 0


def test_harmonic_labels_do_not_overlap_frame_or_frequencies(laid_out):
    critical = solve.critical_speeds(solve.load("cam"), "400:700:30 rpm", figure="rms", rtol=1e-6)
    figure = critical.plot(campbell=True)
    figure.draw_without_rendering()
    axes = figure.axes[-1]
    frame = axes.get_window_extent()
    (frequencies,) = (line for line in axes.lines if line.get_label() == "mean natural frequency")
    ray = axes.transData.transform(frequencies.get_xydata())
    assert {text.get_text() for text in axes.texts} >= {"6", "7", "8"}
    for text in axes.texts:
        box = text.get_window_extent()
        assert frame.x0 < box.x0 < box.x1 < frame.x1
        assert frame.y0 < box.y0 < box.y1 < frame.y1
        assert not any(box.contains(*place) for place in ray)
