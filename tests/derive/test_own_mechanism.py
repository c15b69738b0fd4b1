"""The page on a user's own mechanism: its files are derived as printed."""

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
    """The code block whose first line names the file."""
    match = re.search(rf"```\w+\n# {re.escape(name)}\n(.*?)```", PAGE, re.DOTALL)
    assert match, f"the page has no block for {name}"
    return match.group(1)


def derived(folder: Path, name: str):
    """The derived module of an example of the page, by its name, made by the page's own command."""
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
    """The module, in its folder."""
    return derived(tmp_path_factory.mktemp("pump"), "pump")


@pytest.fixture
def beside_the_pump(pump, tmp_path, monkeypatch):
    """The current folder has the pump's files."""
    shutil.copytree(Path(pump.__file__).parents[1], tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)


def test_terms_ignored_by_the_linearisation_are_named(tmp_path, capsys):
    module = derived(tmp_path, "duffing")
    said = capsys.readouterr().err.splitlines()
    assert said[:-1] == [f"duffing: {sentence}" for sentence in (*module.NONLINEAR, *module.SWITCHED)]
    assert "\n".join(said[:-1]) in PAGE
    assert (len(module.NONLINEAR), len(module.SWITCHED)) == (1, 1)


def test_the_statement_takes_about_thirty_lines():
    lines = [line for line in block("pump.py").splitlines() if line.strip()]
    assert len(lines) <= 30


def test_the_page_derives_the_pump(pump):
    """M, C, K, d of a crank drive at mid-stroke, where y′ = −r, y″ = r²/√(L² − r²) and y‴ = r."""
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


def test_the_case_file_gives_every_parameter(pump):
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


def test_the_page_shows_the_pumps_equations(beside_the_pump, capsys, monkeypatch):
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


def test_the_pages_measured_pressure(beside_the_pump, capsys):
    rows, case = (re.findall(rf"```{kind}\n({start}.*?)```", PAGE, re.DOTALL)[0] for kind, start in MEASURED)
    Path("pressure.csv").write_text(rows, encoding="utf-8")
    Path("pump.toml").write_text(block("pump.toml") + case, encoding="utf-8")
    (line,) = re.findall(r"python -m solve (periodic pump.py --case measured .*)\n", PAGE)
    assert solve_command(shlex.split(line)) == 0
    (warning,) = re.findall(r"P is fitted to .*rms.*", PAGE)
    assert f"warning: {warning}\n" in capsys.readouterr().err
    assert Path("fit.png").stat().st_size > 10_000
    assert solve_command(shlex.split(line.replace("measured", "idle"))) == 2
    message = "solve: pump, case idle has no series from a table; nothing to draw for --fits\n"
    assert capsys.readouterr().err == message
