"""Figure of the deformed coupler: its data, and errors of the command."""

import re
import shlex
from pathlib import Path

import numpy as np
import pytest

import solve
from models.coupler.__main__ import run
from models.coupler.picture import bent, coupler_figure, round_magnification
from models.coupler.published import TABLE_2, link_angles
from solve.commands.app import run as run_solve

LABEL = "coupler, deflection magnified"


def solved(speed="600 rpm", options=None, **parameters):
    model = solve.load("coupler", options=options, **parameters)
    return model, solve.periodic(model, speed)


def line(axes, label) -> np.ndarray:
    (computed,) = (each for each in axes.lines if each.get_label() == label)
    x, y = computed.get_data()
    return np.asarray(x) + 1j * np.asarray(y)


def panels(figure):
    return [axes for axes in figure.axes if axes.lines]


@pytest.mark.parametrize("branch", ["open", "crossed"])
@pytest.mark.parametrize("theta", [0.0, 0.4])
def test_joints_match_the_loop_solved_by_hand(branch, theta):
    model, orbit = solved(options={"branch": branch}, theta=theta)
    phase = np.linspace(0.1, 6.2, 9)
    motion = link_angles(phase, orbit.speed, TABLE_2 | {"theta": theta}, branch)
    pin = 0.05 * np.exp(1j * phase)
    expected = [0 * pin, pin, pin + 0.8 * np.exp(1j * motion.phi3), 0 * pin + np.exp(1j * theta)]
    np.testing.assert_allclose(bent(model, orbit, phase, 1.0).joints, expected, rtol=0, atol=1e-14)


def test_line_deviates_from_the_chord_by_the_magnified_deflection():
    model, orbit = solved()
    for k, axes in enumerate(panels(coupler_figure(model, orbit, 8, 300))):
        first, last = line(axes, "chord of the coupler")
        along = (last - first) / abs(last - first)
        off = ((line(axes, LABEL) - first) / along).imag
        midspan = orbit.signal("midpoint_deflection")(np.array([k * np.pi / 4]))[0]
        assert off[len(off) // 2] == pytest.approx(300 * midspan, rel=1e-9)
        np.testing.assert_allclose(off[[0, -1]], 0, atol=1e-12)
        assert abs(first - 0.05 * np.exp(1j * k * np.pi / 4)) < 1e-12


@pytest.mark.parametrize("positions", [1, 5, 8, 12])
def test_figure_has_one_panel_per_crank_position(positions):
    model, orbit = solved()
    drawn = panels(coupler_figure(model, orbit, positions))
    angles = [float(axes.get_title().split("°")[0]) for axes in drawn]
    assert angles == pytest.approx([360 * k / positions for k in range(positions)])


def test_panels_state_the_true_deflection():
    model, orbit = solved()
    stated = panels(coupler_figure(model, orbit, 4))[1].get_title()
    midspan = orbit.signal("midpoint_deflection")(np.array([np.pi / 2]))[0]
    assert stated == f"90°: $w$ = {1e6 * midspan:.0f} µm"


@pytest.mark.parametrize(("given", "stated"), [(None, "500"), (100, "100"), (2.5, "2.5")])
def test_title_states_magnification(given, stated):
    figure = coupler_figure(*solved(), 4, given)
    assert figure.get_suptitle() == f"coupler, case table2, 600 rpm: deflection magnified {stated} times"


@pytest.mark.parametrize("speed", ["600 rpm", "900 rpm", "1500 rpm"])
def test_automatic_magnification_is_the_largest_round_factor(speed):
    model, orbit = solved(speed)
    factor = round_magnification(model, orbit)
    deflection = np.abs(model.field("w", np.linspace(0, 1, 101)) @ orbit.at(np.linspace(0, 6.3, 999))).max()
    assert f"{factor:.0e}"[0] in "125"
    assert f"{factor:g}".strip("0") in ("1", "2", "5")
    assert factor * deflection <= 0.2 * 0.8 < 2.5 * factor * deflection


def test_large_deflection_is_not_magnified():
    model, orbit = solved("1500 rpm", E=8e9)
    assert np.abs(orbit.outputs["midpoint_deflection"]).max() > 0.2 * 0.8
    assert round_magnification(model, orbit) == 1


def test_command_writes_the_figure_and_prints_warnings(tmp_path, capsys):
    file = tmp_path / "bent.png"
    assert run(["--case", "table1", "--speed", "1500 rpm", "--positions", "2", "--plot", str(file)]) == 0
    assert file.read_bytes().startswith(b"\x89PNG")
    err = capsys.readouterr().err
    assert "warning: the deflection is not small relative to the length" in err
    assert f"wrote {file}" in err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--positions", "0"], "--positions is 0; allowed: 1 … 12 crank positions"),
        (["--positions", "13"], "--positions is 13; allowed: 1 … 12 crank positions"),
        (["--positions", "two"], "'two' is not a whole number"),
        (["--magnification", "-3"], "--magnification is -3; allowed: a number > 0"),
        (["--magnification", "nan"], "--magnification is nan; allowed: a number > 0"),
        (["--case", "table3"], "unknown case of coupler 'table3'"),
        (["--set", "l2=0.9"], "the crank cannot turn fully"),
        (["--speed", "600"], "'600' has no unit"),
        (["--plot", "bent.txt"], "picture file 'bent.txt' ends in '.txt'"),
    ],
)
def test_invalid_input_is_refused_in_one_line(arguments, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    usual = {"--speed": "600 rpm", "--plot": "bent.png"}
    flags = [part for flag, value in usual.items() if flag not in arguments for part in (flag, value)]
    assert run([*flags, *arguments]) == 2
    written = capsys.readouterr()
    assert written.out == ""
    assert written.err.startswith("python -m models.coupler: ")
    assert message in written.err
    assert written.err.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_missing_speed_raises_an_error(capsys):
    assert run(["--plot", "bent.png"]) == 2
    assert "states no speed; give a speed, such as --speed" in capsys.readouterr().err


PAGE = Path(__file__).resolve().parents[3] / "docs" / "coupler.md"


@pytest.mark.parametrize(
    "line", re.findall(r"python -m (?:solve|models\.coupler) [^`\n]+", PAGE.read_text(encoding="utf-8"))
)
def test_every_command_of_the_page_runs(line, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    _, _, program, *arguments = shlex.split(line)
    assert {"solve": run_solve, "models.coupler": run}[program](arguments) == 0, capsys.readouterr().err
    if "--plot" in arguments:
        assert (tmp_path / arguments[arguments.index("--plot") + 1]).stat().st_size > 10_000
    else:
        assert "q1" in capsys.readouterr().out
