"""Figure of a quantity over one period with one curve per speed, read back from the drawn figure."""

import numpy as np
import pytest

import solve
from solve.commands.app import run
from solve.errors import UnknownNameError, ValueOutOfBoundsError
from solve.views.over_time import turn_figure


def orbits(*speeds, model="mathieu", **parameters):
    system = solve.load(model, **parameters)
    return [solve.periodic(system, speed) for speed in speeds]


@pytest.fixture
def coupler():
    return orbits("1500 rpm", "600 rpm", model="coupler")


def curves(figure):
    """Return the curves of the legend as a mapping from their labels."""
    (axes,) = figure.axes
    return {
        line.get_label(): np.array(line.get_data())
        for line in axes.lines
        if not line.get_label().startswith("_")
    }


def test_figure_has_one_curve_per_speed_over_the_period(coupler):
    drawn = curves(turn_figure(coupler, "midpoint_deflection"))
    assert list(drawn) == ["600", "1500"]
    for orbit, label in zip(coupler, ("1500", "600"), strict=True):
        phase, values = drawn[label]
        assert (phase[0], phase[-1]) == (0, 360)
        assert values[0] == pytest.approx(values[-1])
        range_ = orbit.statistics("midpoint_deflection")
        assert values.max() == pytest.approx(1e3 * range_.max, rel=1e-5)
        assert values.min() == pytest.approx(1e3 * range_.min, rel=1e-5)


def test_legend_and_axis_show_speeds_and_unit(coupler):
    figure = turn_figure(coupler, "midpoint_deflection")
    (legend,) = figure.legends
    assert legend.get_title().get_text() == "speed (rpm)"
    assert [text.get_text() for text in legend.get_texts()] == ["1500", "600"]
    assert figure.axes[0].get_ylabel().endswith("(mm)")
    assert figure.get_suptitle() == "coupler, case table2: midpoint deflection over one period"


def test_axis_of_a_half_revolution_period_ends_at_180_degrees():
    computed = orbits("1 rad/s", "2 rad/s", delta=3.0, epsilon=0.5, zeta=0.1)
    drawn = curves(turn_figure(computed, computed[0].coordinates[0]))
    assert {values[0, -1] for values in drawn.values()} == {180.0}


def test_twelve_curves_are_distinguishable():
    computed = orbits(*(f"{rpm} rpm" for rpm in range(600, 1800, 100)), model="coupler")
    (axes,) = turn_figure(computed, "q1").axes
    lines = [line for line in axes.lines if not line.get_label().startswith("_")]
    assert len({tuple(np.atleast_1d(line.get_color())) for line in lines}) == 12
    neighbours = [line.is_dashed() for line in lines]
    assert neighbours.count(False) == 3


def test_nearly_equal_speeds_have_separate_curves():
    computed = orbits("600 rpm", "600.0002 rpm", "600.0004 rpm", model="coupler")
    assert list(curves(turn_figure(computed, "midpoint_deflection"))) == ["600", "600.0002", "600.0004"]


def test_command_draws_separate_curves_for_nearly_equal_values(tmp_path):
    picture = tmp_path / "turn.svg"
    line = ["sweep", "mathieu", "--over", "delta=2:2.0000004:3", "--turn", "q", "--plot", str(picture)]
    assert run(line) == 0
    assert "δ = 2.0000002" in picture.read_text("utf-8")


def test_invalid_figures_are_refused(coupler):
    with pytest.raises(UnknownNameError, match="did you mean 'midpoint_deflection'"):
        turn_figure(coupler, "midpoint")
    with pytest.raises(ValueOutOfBoundsError, match="13 curves to draw in one picture; allowed: up to 12"):
        turn_figure(coupler[:1] * 13, "q1")


def test_command_draws_the_curves(tmp_path, capsys):
    file = tmp_path / "turn.svg"
    arguments = ["sweep", "coupler", "--speeds", "600 900 rpm", "--turn", "q1", "--plot", str(file)]
    assert run(arguments) == 0
    assert "<svg" in file.read_text()
    assert f"wrote {file}" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--turn", "q1"], "--turn q1 draws a picture; add the file, such as --plot turn.png"),
        (["--turn", "q9", "--plot", "t.png"], "unknown coordinate or output of coupler 'q9'"),
        (["--turn", "q1", "--waterfall", "q1", "--plot", "t.png"], "give one of them"),
        (["--turn", "q1", "--plot", "t.png", "--speeds", "600:900:13 rpm"], "13 curves to draw"),
    ],
)
def test_command_refuses_invalid_arguments_in_one_line(arguments, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    speeds = [] if "--speeds" in arguments else ["--speeds", "600 900 rpm"]
    assert run(["sweep", "coupler", *speeds, *arguments]) == 2
    written = capsys.readouterr()
    assert written.out == ""
    assert message in written.err
    assert written.err.count("\n") == 1
    assert not list(tmp_path.iterdir())


AT_REST = ["sweep", "mathieu", "--set", "delta=4", "--set", "epsilon=0", "--set", "zeta=0", "--turn", "q"]


def test_speed_without_a_result_is_omitted(tmp_path, capsys):
    """Without damping, the natural frequency of 2 rad/s is excited at 1 rad/s, not at 2 rad/s."""
    file = tmp_path / "turn.png"
    assert run([*AT_REST, "--speeds", "1 2 rad/s", "--plot", str(file)]) == 0
    assert "no result: I - Φ is singular" in capsys.readouterr().err
    assert file.exists()


def test_figure_without_any_result_is_refused(tmp_path, capsys):
    file = tmp_path / "turn.png"
    assert run([*AT_REST, "--speeds", "1 rad/s", "--plot", str(file)]) == 2
    assert "1 point, none with a result: I - Φ is singular" in capsys.readouterr().err
    assert not file.exists()
