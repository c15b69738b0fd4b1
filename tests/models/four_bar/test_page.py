"""The page on the elastic four-bar: its commands run as printed, but for fewer speeds."""

import re
from pathlib import Path

import pytest

from models.four_bar.__main__ import run as four_bar
from solve.commands.app import run as solve

DOCS = Path(__file__).resolve().parents[3] / "docs"
PAGE = (DOCS / "four_bar.md").read_text(encoding="utf-8")
PROGRAMS = {"python -m solve ": solve, "python -m models.four_bar ": four_bar}
COMMANDS = [line for line in PAGE.splitlines() if line.startswith(tuple(PROGRAMS))]


def fewer(command):
    """The two slowest of its speeds."""
    return re.sub(r'"(\d+):\d+:\d+ rad/s"', r'"\1:\1.5:2 rad/s"', command)


def test_the_page_has_its_commands_and_pictures():
    assert len(COMMANDS) >= 8
    for picture in re.findall(r"\]\((\w+\.png)\)", PAGE):
        assert (DOCS / picture).is_file()


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS, ids=range(len(COMMANDS)))
def test_every_command_of_the_page_runs(command, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    program = next(each for each in PROGRAMS if command.startswith(each))
    text = fewer(command).removeprefix(program)
    arguments = [part.strip('"') for part in re.findall(r'"[^"]*"|\S+', text)]
    assert PROGRAMS[program](arguments) == 0, capsys.readouterr().err
    for picture in re.findall(r"--plot (\S+)", command):
        assert (tmp_path / picture).stat().st_size > 10_000
