"""Figures of orbits: content, overlaps and files. The tests compare no pixels."""

import math
from itertools import combinations

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.text import Text
from numpy.testing import assert_allclose

import solve
from solve import PeriodicSystem
from solve.errors import UnknownNameError, ValueOutOfBoundsError
from solve.results.fit import Channel
from solve.views.fit import compared_figure
from solve.views.style import VERMILION, page, save_figure
from tests.solve.results.problems import SPEED, chain, multipliers, orbit, response, x_of

pytestmark = pytest.mark.usefixtures("laid_out")


@pytest.fixture(scope="module")
def result():
    return orbit()


def panels(figure):
    """Return the axes grouped into curves, spectra and multiplier planes."""
    curves = [axes for axes in figure.axes if axes.lines and len(axes.lines[0].get_xdata()) > 1000]
    spectra = [axes for axes in figure.axes if axes.collections and axes not in curves]
    planes = [axes for axes in figure.axes if axes.get_xlabel().startswith("Re ρ")]
    return curves, spectra, planes


def overlaps(figure):
    """Return pairs of panels whose frames, labels and titles overlap."""
    figure.draw_without_rendering()
    boxes = [(axes, axes.get_tightbbox()) for axes in figure.axes]
    return [
        (one.get_title(loc="left") or one.get_ylabel(), other.get_title(loc="left") or other.get_ylabel())
        for (one, a), (other, b) in combinations(boxes, 2)
        if min(a.x1, b.x1) - max(a.x0, b.x0) > 1 and min(a.y1, b.y1) - max(a.y0, b.y0) > 1
    ]


def test_figure_has_a_row_per_coordinate(result):
    curves, spectra, planes = panels(result.plot())
    assert [axes.get_title(loc="left") for axes in curves] == ["slide", "twist"]
    assert [axes.get_ylabel() for axes in curves] == ["x (mm)", "φ (mrad)"]
    assert [len(axes.lines) for axes in curves] == [1, 1]
    assert len(spectra) == 2
    assert len(planes) == 1
    assert result.plot().get_suptitle() == "two oscillators, 28.6479 rpm"


def test_long_meanings_are_wrapped_above_their_panels():
    """The meaning of the coupler's stress has 103 characters."""
    coupler = solve.load("coupler")
    figure = solve.periodic(coupler, "600 rpm", rtol=1e-4).plot(["axial_force", "stress"])
    titles = [axes.get_title(loc="left") for axes in panels(figure)[0]]
    meanings = [coupler.labels.meanings[name] for name in ("axial_force", "stress")]
    assert [title.replace("\n", " ") for title in titles] == meanings
    assert not overlaps(figure)


def test_curve_shows_the_motion_versus_phase_in_degrees(result):
    axes = panels(result.plot())[0][0]
    degrees, millimetres = axes.lines[0].get_data()
    assert (degrees[0], degrees[-1]) == (0.0, 360.0)
    assert_allclose(millimetres, 1e3 * x_of(np.radians(degrees)), atol=1e-4)
    assert panels(result.plot())[0][-1].get_xlabel() == "phase (°)"


def test_upper_axes_show_time_and_frequency_in_hertz(result):
    figure = result.plot()
    curves, spectra, _ = panels(figure)
    (time,), (hertz,) = curves[0].child_axes, spectra[0].child_axes
    figure.draw_without_rendering()
    assert time.get_xlabel() == "time (s)"
    assert hertz.get_xlabel() == "frequency (Hz)"
    assert time.get_xlim()[1] == pytest.approx(2 * math.pi / SPEED)
    assert hertz.get_xlim()[1] == pytest.approx(spectra[0].get_xlim()[1] * SPEED / (2 * math.pi))
    assert spectra[-1].get_xlabel() == "order of rotation"


def stems(axes):
    """Return the height of each stem as a mapping from its order."""
    return {round(foot[0]): head[1] for foot, head in axes.collections[0].get_segments()}


def test_spectra_show_only_nonzero_harmonics(result):
    _, (x, phi), _ = panels(result.plot())
    assert stems(x) == {1: pytest.approx(1e3 * abs(response(4.0, 0.4, 1)), rel=1e-6)}
    assert stems(phi) == {3: pytest.approx(1e3 * abs(response(9.0, 0.4, 3)), rel=1e-6)}


def test_decibels_are_relative_to_the_largest_harmonic(result):
    _, spectra, _ = panels(result.plot(["power"], scale="dB"))
    amplitudes = result.harmonics("power")[0]
    assert spectra[0].get_ylabel() == f"dB re {1e3 * amplitudes[2]:.3g} mW"
    assert stems(spectra[0])[2] == pytest.approx(0.0, abs=1e-12)
    assert spectra[0].get_ylim()[0] == -120.0


def test_quasi_static_curve_is_dashed(result):
    curves, _, _ = panels(result.plot(quasi_static=True))
    dynamic, static = curves[0].lines
    assert dynamic.get_linestyle() == "-"
    assert static.get_linestyle() == "--"
    phase = np.radians(static.get_xdata())
    assert_allclose(static.get_ydata(), 1e3 * (np.cos(phase) + 2.0) / 4.0, rtol=1e-12)
    assert [text.get_text() for text in curves[0].get_legend().get_texts()] == ["dynamic", "quasi-static"]


def test_requested_outputs_are_shown(result):
    curves, _, _ = panels(result.plot(["power", "x"]))
    assert [axes.get_title(loc="left") for axes in curves] == ["lost in the damper", "slide"]


def test_unknown_names_and_scales_are_refused(result):
    with pytest.raises(UnknownNameError, match="'power'"):
        result.plot(["powr"])
    with pytest.raises(UnknownNameError, match="linear"):
        result.plot(scale="liner")


def test_figure_of_many_coordinates_has_no_overlaps():
    import solve

    many = solve.periodic(chain(20), SPEED, rtol=1e-4)
    figure = many.plot()
    assert len(panels(figure)[0]) == 6
    assert figure.get_size_inches()[1] <= 11.0
    with pytest.raises(ValueOutOfBoundsError, match=r"7 .* up to 6"):
        many.plot([f"q{k}" for k in range(1, 8)])


def test_small_multipliers_have_an_enlarged_view():
    near, far = orbit(damping=0.4), orbit(damping=4.0)
    radius = multipliers(damping=4.0)
    assert multipliers(damping=0.4) > 0.4 > radius
    assert len(panels(near.plot())[2]) == 1
    circle, closer = panels(far.plot())[2]
    assert circle.get_xlim()[1] == pytest.approx(1.15)
    power = math.floor(math.log10(radius))
    assert power == -2
    assert closer.get_xlabel() == "Re ρ (10⁻²)"
    assert closer.get_xlim()[1] == pytest.approx(1.15 * radius / 10.0**power, rel=1e-6)
    drawn = closer.lines[-1].get_xdata() + 1j * closer.lines[-1].get_ydata()
    assert_allclose(drawn * 10.0**power, far.multipliers, rtol=1e-12)


def test_unstable_verdict_is_highlighted():
    import solve

    def growing(phase, speed):
        one = np.ones((len(phase), 1, 1))
        return one, -0.2 * one, 4.0 * one, one[:, 0]

    figure = solve.floquet(solve.PeriodicSystem(growing, ["q"]), SPEED).plot()
    texts = {text.get_text(): to_hex(text.get_color()) for axes in figure.axes for text in axes.texts}
    assert texts["unstable"] == VERMILION.lower()
    circle = panels(figure)[2][0]
    assert circle.get_xlim()[1] > math.exp(0.1 * 2 * math.pi / SPEED)


@pytest.mark.parametrize("settings", [{}, {"quasi_static": True, "scale": "dB"}, {"names": ["power"]}])
def test_plot_elements_do_not_overlap(result, settings):
    assert overlaps(result.plot(**settings)) == []


@pytest.mark.parametrize("model", ["cam", "manipulator", "gear_pair"])
def test_full_model_plot_has_no_overlaps(model):
    import solve

    system = solve.load(model)
    orbit = solve.periodic(system, "300 rpm", rtol=1e-4)
    assert overlaps(orbit.plot([*system.coordinates, *system.outputs][:6], quasi_static=True)) == []


@pytest.mark.parametrize(("ending", "start"), [(".png", b"\x89PNG"), (".pdf", b"%PDF"), (".svg", b"<?xml")])
def test_figure_files_match_their_extension_and_are_reproducible(result, tmp_path, ending, start):
    files = [tmp_path / f"{name}{ending}" for name in ("first", "second")]
    for file in files:
        save_figure(result.plot(["x"]), file)
    first, second = (file.read_bytes() for file in files)
    assert first.startswith(start)
    assert first == second


def test_dollar_signs_in_user_text_are_shown_unchanged(tmp_path):
    """matplotlib would interpret "$_ $" as mathematics and raise an error."""

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        return one, 0.4 * one, 4.0 * one, np.cos(phase)[:, None]

    system = PeriodicSystem(matrices, ["5 $_ $"])
    for figure in (solve.periodic(system, SPEED).plot(), solve.sweep(system, [SPEED, 2 * SPEED]).plot()):
        save_figure(figure, tmp_path / "picture.svg")
        assert any("5 $" in text.get_text() for text in figure.findobj(Text))


def test_tick_labels_use_plain_text():
    """Parsing mathematical text takes as long as the remaining drawing."""
    with page(2.0, "small") as figure:
        axes = figure.add_subplot()
        axes.set_yticks([-1e-7, 0.0, 1e-7])
    figure.draw_without_rendering()
    assert [label.get_text() for label in axes.get_yticklabels()] == ["−1", "0", "1"]
    assert axes.yaxis.get_offset_text().get_text() == "1e−7"


def test_compared_spectra_end_below_the_measured_values():
    """Beyond the first, the computed harmonics are round-off."""
    at = np.arange(32) * (2 * np.pi / 32)
    noisy = np.cos(at) + 1e-3 * np.random.default_rng(1).standard_normal(32)
    channel = Channel(SPEED, False, "q1", at, noisy, np.cos(at))
    _, spectra = compared_figure(chain(1), [channel], "measured").axes
    measured, computed = (line.get_ydata() for line in spectra.lines)
    bottom, top = spectra.get_ylim()
    assert computed[1:].max() < 1e-12 < bottom < measured.min() < measured.max() < top
    assert bottom == pytest.approx(measured.min() / 10)


def test_figure_of_a_controller_states_how_many_inputs_and_states_are_omitted():
    def matrices(phase, speed):
        one = np.broadcast_to(np.eye(9), (len(phase), 9, 9))
        return one, one, one, np.zeros((len(phase), 9)), one[..., :7]

    names = [f"q{k}" for k in range(1, 10)]
    system = PeriodicSystem(matrices, names, inputs=[f"u{k}" for k in range(1, 8)])
    controller = solve.lqr(system, 1.0, dict.fromkeys(names, 1.0), dict.fromkeys(system.inputs, 1.0))
    figure = controller.plot()
    assert figure.get_suptitle().endswith("; the first 6 of 7 signals")
    panels = [axes for axes in figure.axes if axes.get_title(loc="left").startswith("gain of u")]
    assert len(panels) == 6
    assert all(axes.get_title(loc="left").endswith("; the first 8 of 18 states") for axes in panels)
