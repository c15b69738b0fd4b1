"""Commands on the page about the elastic four-bar linkage, run as printed but with fewer speeds."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from models.four_bar.__main__ import run as four_bar
from solve import load, periodic
from solve.commands.app import run as solve

DOCS = Path(__file__).resolve().parents[3] / "docs"
PAGE = (DOCS / "four_bar.md").read_text(encoding="utf-8")
PROGRAMS = {"python -m solve ": solve, "python -m models.four_bar ": four_bar}
COMMANDS = [line for line in PAGE.splitlines() if line.startswith(tuple(PROGRAMS))]


def fewer(command):
    """Command with only the two lowest of its speeds."""
    return re.sub(r'"(\d+):\d+:\d+ rad/s"', r'"\1:\1.5:2 rad/s"', command)


def test_page_contains_commands_and_figures():
    assert len(COMMANDS) >= 8
    for picture in re.findall(r"\]\((\w+\.png)\)", PAGE):
        assert (DOCS / picture).is_file()


def run(command, capsys):
    """Standard output of a command on the page."""
    program = next(each for each in PROGRAMS if command.startswith(each))
    text = fewer(command).removeprefix(program)
    arguments = [part.strip('"') for part in re.findall(r'"[^"]*"|\S+', text)]
    status = PROGRAMS[program](arguments)
    written = capsys.readouterr()
    assert status == 0, written.err
    return written.out


@pytest.mark.slow
def test_figures_of_section_7_3(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    printed = [command for command in COMMANDS if "--over L4=" in command]
    first, second = (json.loads(run(f"{command} --json", capsys)) for command in printed)
    assert (first["figure"], set(first["extremes"])) == ("rms", {"follower_midpoint_deflection"})
    assert (second["figure"], set(second["extremes"])) == ("max_abs", {"crank_root_stress", "strain_energy"})
    model = load("four_bar", L4=0.65)
    orbit = periodic(model, second["speeds"][0], rtol=1e-6)
    phase = np.linspace(0.0, 2 * np.pi, 4000)
    surfaces = [model.stress("crank", 0.0, surface, phase, orbit.at(phase)) for surface in ("plus", "minus")]
    computed = second["systems"][-1]["responses"]["crank_root_stress"][0]
    assert computed == pytest.approx(np.abs(surfaces).max(), rel=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS, ids=range(len(COMMANDS)))
def test_every_command_of_the_page_runs(command, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    run(command, capsys)
    for picture in re.findall(r"--plot (\S+)", command):
        assert (tmp_path / picture).stat().st_size > 10_000
