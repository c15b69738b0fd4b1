"""Every command printed on a page exits with status 0, in a folder with the files of the page and with fewer
points than printed. Pages with separate tests are omitted, and repeated commands run once."""

import re
import shlex
import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

import solve
from derive.__main__ import main as derive
from tests.pages import EVERY, ROOT

OWN_TESTS = {
    "believe": "tests/test_site.py",
    "coupler": "tests/models/coupler/test_picture.py",
    "first_hour": "tests/test_site.py",
    "four_bar": "tests/models/four_bar/test_page.py",
    "four_bar_design": "tests/models/four_bar/test_design_page.py",
    "live": "tests/solve/views/live/test_server.py",
    "readers": "tests/solve/readers/test_page.py",
    "machines": "tests/published/test_machines.py",
    "sources": "tests/published/test_sources_page.py",
    "walk": "tests/solve/test_walk_page.py",
}
EXCEPTIONS = {
    "pump.py --case measured": "needs its table: tests/derive/test_own_mechanism.py",
    "--show pump.py": "compared with the page by tests/derive/test_own_mechanism.py",
    "arm.py": "tests/solve/beams/test_docs.py",
    "prop.py": "tests/solve/beams/test_docs.py",
    "design --allowable": "a minute; with other elements by tests/models/four_bar/test_design_page.py",
    'floquet "run.*.lin"': "tests/solve/readers/test_page.py",
    "--robust 95%": "two minutes; with an oscillator by tests/solve/studies/test_robust.py",
    "optimise cam --case dwell": "tests/solve/studies/test_optimise.py",
    "compare cam --case 1": "as the README's, since the first case is the default",
}
_OWN = ("duffing", "mesh", "chain", "tower", "rocker", "press", "column")
"""Mechanisms of docs/own_mechanism.md that tests/consistency and tests/derive derive and solve as printed."""


def commands(page: Path) -> list[str]:
    """Return complete commands: lines of code, and inline code with the name of a model and no
    placeholder."""
    text = page.read_text(encoding="utf-8")
    program = r"(?:python -m )?(?:solve|derive|models\.\w+) "
    lines = re.findall(rf"^(?:    )?({program}[^#\n]*)$", text, flags=re.MULTILINE)
    spans = re.findall(rf"`({program}[^`\n]+)`", text)
    whole = [
        span
        for span in spans
        if re.search(r"solve \w+ \w+ .*--|derive (?:--\w+ )?\w+$|models\.\w+ .*--", span)
    ]
    return [each.strip() for each in lines + whole if not re.search(r"\b(?:[A-Z]{3,}|mine\.py)\b|…", each)]


def key(command: str) -> str:
    """Return the parts that are equal in commands that differ only in the name of their figure file."""
    return re.sub(r"--(plot|out) \S+", r"--\1", command.removeprefix("python -m "))


PRINTED = {key(command): (page, command) for page in EVERY for command in commands(page)}
ELSEWHERE = {key(command) for page in EVERY if page.stem in OWN_TESTS for command in commands(page)}
ASKED = {
    name: (page, command)
    for name, (page, command) in PRINTED.items()
    if name not in ELSEWHERE
    and not any(text in command for text in EXCEPTIONS)
    and not any(f"{own}.py" in command for own in _OWN)
    and not any(other.startswith(f"{name} ") for other in PRINTED)
}


def fewer(command: str) -> str:
    """Reduce a range of more than nine points to five, and a transient to two periods."""
    command = re.sub(r"(:\d+):\d\d+(?= rpm| rad/s| |\"|$)", r"\1:5", command)
    return re.sub(r"--turns \d+", "--turns 2", command)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Return an empty folder with the measured torque that some pages use."""
    monkeypatch.chdir(tmp_path)
    orbit = solve.periodic(solve.load("cam", k1=9e4), "400 rpm", rtol=1e-6)
    angles = np.arange(0, 360, 2.0)
    torque = orbit.signal("shaft_torque")(np.radians(angles))
    rows = [f"{angle},{value}" for angle, value in zip(angles, torque, strict=True)]
    Path("torque.csv").write_text("\n".join(["phase (deg),shaft_torque (N m)", *rows]))
    return tmp_path


def status(words: list[str], monkeypatch: pytest.MonkeyPatch) -> int:
    program, *arguments = words
    if program != "derive":
        home = "solve.commands.app" if program == "solve" else f"{program}.__main__"
        return import_module(home).run(arguments)
    monkeypatch.setattr(sys, "argv", words)
    with pytest.raises(SystemExit) as left:
        derive()
    return int(left.value.code or 0)


@pytest.mark.slow
@pytest.mark.parametrize(("page", "command"), ASKED.values(), ids=ASKED)
def test_printed_command_runs(page, command, folder, monkeypatch, capsys):
    for name, text in re.findall(r"```\w+\n# (\w+\.\w+)\n(.*?)```", page.read_text("utf-8"), flags=re.DOTALL):
        Path(name).write_text(text, encoding="utf-8")
    for own in re.findall(r"\w+\.py\b", command) if "--new" not in command else ():
        assert status(["derive", own], monkeypatch) == 0
    for file in re.findall(r"--controller (\S+)", command):
        (saving,) = (each for each in commands(page) if f"--save {file}" in each)
        assert status(shlex.split(saving.removeprefix("python -m ")), monkeypatch) == 0
    words = shlex.split(fewer(command).removeprefix("python -m "))
    assert status(words, monkeypatch) == 0, capsys.readouterr().err
    for file in re.findall(r"--(?:plot|save|out|toml) (\S+)", command):
        assert Path(file).stat().st_size > 100


def test_excluded_commands_are_printed_and_their_tests_exist():
    assert len(ASKED) > 30
    for text in EXCEPTIONS:
        assert any(text in command for _, command in PRINTED.values()), text
    for stem, test in OWN_TESTS.items():
        assert (ROOT / test).is_file()
        assert any(page.stem == stem for page in EVERY)
