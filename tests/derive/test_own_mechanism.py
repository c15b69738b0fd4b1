"""The page "A mechanism of your own": its files are derived as printed."""

import re
import shlex
import shutil
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from modules import module_in

from derive.__main__ import main
from solve.commands.app import run as solve_command

ROOT = Path(__file__).resolve().parents[2]
MEASURED = [("text", "angle"), ("toml", r"\[case.measured")]
PAGE = (ROOT / "docs" / "own_mechanism.md").read_text(encoding="utf-8")


def block(name: str) -> str:
    """Code block of the page whose first line contains the name of the file."""
    match = re.search(rf"```\w+\n# {re.escape(name)}\n(.*?)```", PAGE, re.DOTALL)
    assert match, f"the page has no block for {name}"
    return match.group(1)


def derived(folder: Path, name: str):
    """Generated module of an example on the page, produced by the command on the page."""
    (folder / f"{name}.py").write_text(block(f"{name}.py"), encoding="utf-8")
    assert f"python -m derive {name}.py\n" in PAGE
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setattr(sys, "argv", ["derive", f"{name}.py"])
        with pytest.raises(SystemExit) as exit_:
            main()
    assert not exit_.value.code
    return module_in(folder / "generated" / f"{name}.py")


@pytest.fixture(scope="module")
def pump(tmp_path_factory):
    """Generated module of the pump, in its folder."""
    return derived(tmp_path_factory.mktemp("pump"), "pump")


@pytest.fixture
def in_pump_folder(pump, tmp_path, monkeypatch):
    """Make the folder of the pump the current folder."""
    shutil.copytree(Path(pump.__file__).parents[1], tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)


def test_terms_ignored_by_the_linearisation_are_named(tmp_path, capsys):
    module = derived(tmp_path, "duffing")
    messages = capsys.readouterr().err.splitlines()
    assert messages[:-1] == [f"duffing: {sentence}" for sentence in (*module.NONLINEAR, *module.SWITCHED)]
    assert "\n".join(messages[:-1]) in PAGE
    assert (len(module.NONLINEAR), len(module.SWITCHED)) == (1, 1)


def test_statement_of_the_pump_has_about_thirty_lines():
    lines = [line for line in block("pump.py").splitlines() if line.strip()]
    assert len(lines) <= 30


def test_linearised_pump_matches_hand_calculation(pump):
    """M, C, K and d of a crank drive at mid-stroke, where y′ = −r, y″ = r²/√(L² − r²) and y‴ = r."""
    J, m, r, L, A, k1, k2, c1, c2, P = p = [0.05, 4.5, 0.03, 0.14, 1.2e-3, 25e3, 6e7, 3.0, 900.0, 2e6]
    speed, load, curve = 20 * np.pi, P * A, r**2 / np.sqrt(L**2 - r**2)
    M, C, K, d = (part.full() for part in pump.linearised()(np.pi / 2, speed, [*p, 0, 0, 0, 0]))
    turning = 2 * m * speed * curve
    push = load + m * speed**2 * curve
    stiff = k1 + load * curve + m * speed**2 * (curve**2 - r**2)
    np.testing.assert_allclose(M, [[J + m * r**2, -m * r], [-m * r, m]], rtol=1e-12)
    np.testing.assert_allclose(C, [[c1 - r * turning, 0], [turning, c2]], rtol=1e-12)
    np.testing.assert_allclose(K, [[stiff, 0], [m * speed**2 * r, k2]], rtol=1e-12)
    np.testing.assert_allclose(d[:, 0], [push * r, -push], rtol=1e-12)


def test_case_file_contains_every_parameter(pump):
    cases = tomllib.loads(block("pump.toml"))
    for case in cases["case"].values():
        entries = cases["common"]["parameters"] | case["parameters"]
        given = set()
        for name, entry in entries.items():
            assert entry["unit"], name
            assert entry["source"], name
            given |= (
                {f"{name}{i}" for i in range(1, len(entry["values"]) + 1)} if "values" in entry else {name}
            )
        assert given == {name for name, *_ in pump.PARAMETERS}


def test_page_shows_the_equations_of_the_pump(in_pump_folder, capsys, monkeypatch):
    for arguments in (["--show", "pump.py"], ["--show", "--numbers", "delivering", "pump.py"]):
        assert " ".join(arguments[:-1]) in PAGE
        Path("pump.toml").write_text(block("pump.toml"), encoding="utf-8")
        monkeypatch.setattr(sys, "argv", ["derive", *arguments])
        with pytest.raises(SystemExit):
            main()
    shown = capsys.readouterr().out
    printed = re.findall(r"```text\n((?:l_a|M_).*?)```", PAGE, re.DOTALL)
    assert len(printed) == 2
    assert all(lines in shown for lines in printed)
    assert "M_{11} = 4.5 l_b^2 + 0.05" in shown
    assert "M_{11} = 4.5 l_b^2 + 0.05" in PAGE


def test_measured_pressure_of_the_page(in_pump_folder, capsys):
    rows, case = (re.findall(rf"```{kind}\n({start}.*?)```", PAGE, re.DOTALL)[0] for kind, start in MEASURED)
    Path("pressure.csv").write_text(rows, encoding="utf-8")
    Path("pump.toml").write_text(block("pump.toml") + case, encoding="utf-8")
    (line,) = re.findall(r"python -m solve (periodic pump.py --case measured .*)\n", PAGE)
    assert solve_command(shlex.split(line)) == 0
    (warning,) = re.findall(r"P is fitted to .*rms.*", PAGE)
    assert f"warning: {warning}\n" in capsys.readouterr().err
    assert Path("fit.png").stat().st_size > 10_000
    assert solve_command(shlex.split(line.replace("measured", "idle"))) == 2
    message = "solve: pump, case idle has no series from a table that --fits could draw; omit --fits\n"
    assert capsys.readouterr().err == message
