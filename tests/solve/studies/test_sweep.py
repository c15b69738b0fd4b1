"""Sweeps over speed: stored quantities and failed points."""

import numpy as np
import pytest

import solve
from derive import Max, Mechanism, Rational, rate
from solve.errors import MissingValueError, StepsError, UnitError, UnknownNameError, ValueOutOfBoundsError
from solve.system import relabelled
from tests.solve import systems


def test_sweep_keeps_the_given_order_of_speeds():
    sweep = solve.sweep(solve.load("manipulator"), ["50 rpm", 3.0, "2 Hz"])
    np.testing.assert_allclose(sweep.speeds, [50 * np.pi / 30, 3.0, 4 * np.pi])
    assert len(sweep.points) == 3
    assert [point.speed for point in sweep.points] == sweep.speeds.tolist()
    assert sweep.points[-1].speed == sweep.points[2].speed
    assert [point.speed for point in sweep.points[1:]] == sweep.speeds[1:].tolist()
    for name in ("q1", "drive_torque"):
        kept = [point.statistics[name].rms for point in sweep.points]
        assert sweep.figures(name, "rms").tolist() == kept
    np.testing.assert_array_equal(sweep.spectral_radius, [point.spectral_radius for point in sweep.points])


def resonant():
    """Return an undamped oscillator of frequency 2. The first harmonic of its load is resonant at 2 rad/s."""

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        return one, 0 * one, 4 * one, np.cos(phase)[:, None]

    return systems.system(matrices, 1)


def test_one_requested_quantity_may_be_given_as_text():
    sweep = solve.sweep(solve.load("manipulator"), [3.0, 4.0])
    assert len(sweep.plot("q1").axes) == len(sweep.plot(["q1"]).axes) == 2
    with pytest.raises(UnknownNameError, match="'drive_torqe'; did you mean 'drive_torque'"):
        sweep.plot("drive_torqe")


def test_sweep_shows_the_requested_quantity():
    sweep = solve.sweep(solve.load("manipulator"), [3.0, 4.0], quantities="load_torque")
    assert sweep.results.kept.names == ("load_torque",)
    assert "max|load_torque|" in str(sweep)
    assert sweep.plot().axes[0].get_ylabel().startswith("max|load")


def test_resonance_fails_without_affecting_other_speeds():
    sweep = solve.sweep(resonant(), [1.5, 2.0, 2.5])
    assert [point.error is None for point in sweep.points] == [True, False, True]
    assert "multiplier is at +1" in sweep.points[1].error
    assert sweep.points[1].stable is None
    assert np.isnan(sweep.spectral_radius[1])
    assert np.isnan(sweep.figures("q1")[1])
    np.testing.assert_allclose(sweep.figures("q1")[[0, 2]], [1 / (4 - 1.5**2), 1 / (2.5**2 - 4)], rtol=1e-9)


def test_invalid_matrices_fail_with_a_reason():
    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        stiffness = one * (np.nan if speed > 1.9 else 3.0)
        return one, 0.1 * one, stiffness, one[:, 0]

    sweep = solve.sweep(systems.system(matrices, 1), np.linspace(1.0, 2.0, 11))
    failed = [point.error is not None for point in sweep.points]
    assert failed == [False] * 10 + [True]
    assert "NaN or infinite" in sweep.points[-1].error


def test_warning_of_neglected_terms_is_given_once():
    left_out = "c is left out"
    system = relabelled(systems.random_system(3, 2), equation_warnings=(left_out,))
    sweep = solve.sweep(system, [1.0, 1.2])
    assert all(left_out in point.warnings for point in sweep.points)
    assert [text for text in sweep.warnings if left_out in text] == [left_out]


def test_sweep_stores_only_the_requested_quantities():
    model = solve.load("cam")
    sweep = solve.sweep(model, ["300 rpm"], quantities=["q3", "q1"])
    assert list(sweep.points[0].statistics) == ["q3", "q1"]
    orbit = solve.periodic(model, "300 rpm")
    assert sweep.figures("q3")[0] == pytest.approx(orbit.statistics("q3").max_abs, rel=1e-10)
    assert any("linearisation" in text for text in sweep.points[0].warnings)
    with pytest.raises(UnknownNameError, match="q2"):
        sweep.figures("q2")


def test_spectra_match_those_of_single_solutions():
    model = solve.load("manipulator")
    sweep = solve.sweep(model, [4.0, 5.0], spectra=["q2", "drive_torque"], harmonics=12)
    for row, speed in enumerate((4.0, 5.0)):
        orbit = solve.periodic(model, speed)
        for name in ("q2", "drive_torque"):
            amplitudes = orbit.harmonics(name, 12)[0]
            np.testing.assert_allclose(sweep.spectrum(name)[row], amplitudes, atol=1e-10 * amplitudes.max())
    with pytest.raises(UnknownNameError, match="q1"):
        sweep.spectrum("q1")


def test_unstable_ranges_have_edges_and_a_kind():
    model = solve.load("mathieu", zeta=0.0)
    sweep = solve.sweep(model, np.linspace(0.6, 1.7, 56))
    runs = sweep.unstable
    assert [kind for *_, kind in runs] == ["+1", "-1"]
    for (low, high, _), band in zip(runs, solve.bands(model, np.linspace(0.6, 1.7, 56)), strict=True):
        assert abs(low - band.low) <= 0.02
        assert abs(high - band.high) <= 0.02


@pytest.mark.parametrize(
    ("speeds", "chosen", "error", "text"),
    [
        ([100.0, -1.0], {}, ValueOutOfBoundsError, "finite and > 0"),
        (["100"], {}, UnitError, "no unit"),
        ([100.0], {"quantities": ["q9"]}, UnknownNameError, "did you mean 'q"),
        ([100.0], {"spectra": ["torque"]}, UnknownNameError, "did you mean '"),
        ([100.0], {"rtol": 0.0}, ValueOutOfBoundsError, "rtol"),
        ([100.0], {"steps": 0}, StepsError, "steps is 0"),
        ([100.0], {"steps": 9.5}, StepsError, "steps is 9.5"),
        ([100.0], {"steps": True}, ValueOutOfBoundsError, "steps is True; allowed: whole number"),
        ([100.0], {"method": "gaus"}, UnknownNameError, "did you mean 'gauss'"),
    ],
)
def test_invalid_input_is_refused(speeds, chosen, error, text):
    with pytest.raises(error, match=text):
        solve.sweep(solve.load("cam"), speeds, **chosen)


def test_figure_shows_responses_radius_and_unstable_speeds():
    model = solve.load("mathieu")
    figure = solve.sweep(model, np.linspace(0.6, 1.7, 23)).plot()
    response, radius = figure.axes
    assert response.get_ylabel().startswith("max|q")
    assert radius.get_xlabel() == "speed (rpm)"
    names = [text.get_text() for text in radius.get_legend().get_texts()]
    assert names == ["ρ = +1: period T", "ρ = −1: period 2T"] or names == ["ρ = −1: period 2T"]


def test_waterfall_has_a_column_per_speed_and_row_per_harmonic():
    sweep = solve.sweep(solve.load("manipulator"), np.linspace(2, 6, 7), spectra=["q1"], harmonics=9)
    axes, bar = sweep.waterfall("q1").axes
    assert axes.collections[0].get_array().shape == (9, 7)
    assert axes.get_ylabel() == "order of rotation"
    assert "dB re" in bar.get_ylabel()


OVER = {"k1": [6e4, 9e4], "m3": "40:60:3"}


def test_parameter_sweep_matches_single_models():
    model = solve.load("cam")
    sweep = solve.sweep(model, ["300 rpm", "200 rpm"], rtol=1e-9, over=OVER)
    at = [(point.parameters["k1"], point.parameters["m3"], point.speed) for point in sweep.points]
    speeds = [10 * np.pi, 20 * np.pi / 3]
    assert at == [
        (k1, m3, pytest.approx(speed)) for k1 in (6e4, 9e4) for m3 in (40, 50, 60) for speed in speeds
    ]
    for point in sweep.points:
        alone = solve.periodic(solve.load("cam", **point.parameters), point.speed, rtol=1e-9)
        assert point.spectral_radius == pytest.approx(alone.spectral_radius, rel=1e-7)
        assert point.statistics["q1"].max_abs == pytest.approx(alone.statistics("q1").max_abs, rel=1e-7)


def test_parameter_sweep_uses_the_speed_of_the_case():
    sweep = solve.sweep(solve.load("mathieu", zeta=0), over="epsilon=0:4:5")
    assert sweep.speeds.tolist() == [1.0] * 5
    for point in sweep.record()["points"]:
        own = solve.floquet(solve.load("mathieu", zeta=0, **point["parameters"]), 1.0)
        assert point["spectral_radius"] == pytest.approx(own.spectral_radius, rel=1e-7)
    np.testing.assert_array_equal(sweep.file_contents().columns["epsilon"].values, [0, 1, 2, 3, 4])
    assert sweep.unstable == []
    label = sweep.plot().axes[-1].get_xlabel().replace("\n", " ")
    assert label == "ε (1/s²): amplitude of the stiffness, which varies twice per revolution"


def test_failed_parameter_point_does_not_affect_other_points():
    sweep = solve.sweep(solve.load("coupler"), "600 rpm", over={"l2": [0.04, 0.9]})
    failed, point = sweep.points[1], sweep.record()["points"][1]
    assert "cannot turn fully" in failed.error
    assert point["parameters"] == {"l2": 0.9}
    assert sweep.points[0].error is None
    assert "(at 1 of 2 points)" in sweep.warnings[-1]


@pytest.mark.parametrize(
    ("speeds", "over", "error", "message"),
    [
        (None, {"k1": [1.0]}, MissingValueError, "no speeds given, and the case states none; give speeds"),
        (None, None, ValueOutOfBoundsError, "speeds are None; give a sequence of numbers in rad/s"),
        (50.0, {"k9": [1.0]}, UnknownNameError, "unknown quantity of cam 'k9'; did you mean 'k"),
        (50.0, {"k1": [-1.0, 1.0]}, ValueOutOfBoundsError, "k1 .* is -1 N m/rad; allowed: > 0"),
        (
            50.0,
            {"k1": []},
            ValueOutOfBoundsError,
            r"'over' gives k1 = \[\]; give finite numbers in the model's own units",
        ),
        (50.0, {"k1": [np.nan]}, ValueOutOfBoundsError, "give finite numbers in the model's own units"),
        (50.0, {"k1": ["stiff"]}, ValueOutOfBoundsError, "give finite numbers in the model's own units"),
        (50.0, {"k1": 3.0}, ValueOutOfBoundsError, "'k1': 3.0}; allowed: str, sequence of str or mapping"),
        (50.0, "k1", ValueOutOfBoundsError, "over is 'k1'; write NAME=A:B:N"),
        (50.0, ["k1=1:2:2", "k1=1:2:3"], ValueOutOfBoundsError, "'over' gives k1 twice; give it once"),
        (50.0, "k1=1:2:99999999", ValueOutOfBoundsError, "values in one range; allowed"),
        (50.0, "speed=1:2:3", ValueOutOfBoundsError, "speed is given twice"),
    ],
)
def test_invalid_parameter_ranges_are_refused(speeds, over, error, message):
    with pytest.raises(error, match=message):
        solve.sweep(solve.load("cam"), speeds, over=over)


def test_nearly_equal_values_have_one_line_each():
    values = [2.0, 2.0000002, 2.0000004]
    sweep = solve.sweep(solve.load("mathieu"), "1:2:3 rad/s", over={"delta": values})
    (legend,) = sweep.plot().legends
    assert [text.get_text() for text in legend.get_texts()] == [f"δ = {value:.8g} 1/s²" for value in values]


def test_too_many_lines_for_one_figure_are_refused():
    sweep = solve.sweep(solve.load("mathieu"), "1:2:2 rad/s", over={"epsilon": np.linspace(0, 1, 13)})
    with pytest.raises(
        ValueOutOfBoundsError,
        match="13 curves to draw, one for each epsilon; allowed: up to 12; give fewer values of epsilon",
    ):
        sweep.plot()
    many = {"epsilon": np.linspace(0, 1, 7), "delta": [1.0, 2.0]}
    with pytest.raises(ValueOutOfBoundsError, match=r"14 curves .*; give fewer values of epsilon or delta"):
        solve.sweep(solve.load("mathieu"), "1:2:2 rad/s", over=many).plot()
    with pytest.raises(
        ValueOutOfBoundsError, match="epsilon, speed vary; a spectrum is drawn versus one quantity"
    ):
        solve.sweep(
            solve.load("mathieu"), "1:2:2 rad/s", spectra=["q"], over={"epsilon": [0.1, 0.2]}
        ).waterfall("q")


def test_parameter_values_are_in_the_units_of_the_model():
    """The mass is in grams, on a Hertzian contact."""

    def hanging():
        scale = Mechanism("hanging", "Weight on a preloaded contact")
        q = scale.coordinate("q", "m", "deflection")
        m, kh, q0 = scale.parameters(m=("g", "mass"), kh=("N/mm^1.5", "contact"), q0=("mm", "preload"))
        scale.kinetic = m * rate(q) ** 2 / 2
        contact = Rational(2, 5) * Max(0, q + q0) ** Rational(5, 2)
        scale.potential = kh * (contact - q0 ** Rational(3, 2) * q)
        scale.force(m * scale.parameter("g", "m/s^2", "gravity"), along=q)
        return scale

    model = solve.load(hanging, m=1, kh=2, q0="40 um", g=9.81)
    sweep = solve.sweep(model, 3.0, over="m=2:6:3")
    for point, grams in zip(sweep.points, (2.0, 4.0, 6.0), strict=True):
        assert point.parameters == {"m": grams}
        stiffness = 1.5 * 2 * 1000**1.5 * np.sqrt(40e-6)
        assert point.statistics["q"].mean == pytest.approx(1e-3 * grams * 9.81 / stiffness, rel=1e-8)
