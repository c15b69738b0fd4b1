"""The arm on the page on structures is derived and solved as printed and agrees with a closed form."""

import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest

import solve
from derive.__main__ import main as derive
from solve.commands.app import run

PAGE = (Path(__file__).resolve().parents[3] / "docs" / "structures.md").read_text(encoding="utf-8")


def block(name):
    """Return the code block whose first line contains the file name."""
    match = re.search(rf"```\w+\n# {re.escape(name)}\n(.*?)```", PAGE, re.DOTALL)
    assert match, f"the page has no block for {name}"
    return match.group(1)


@pytest.fixture
def arm(tmp_path, monkeypatch):
    """Return a folder with the files of the page, after running its `derive` commands."""
    monkeypatch.chdir(tmp_path)
    for name in ("arm.py", "arm.toml", "prop.py"):
        (tmp_path / name).write_text(block(name), encoding="utf-8")
    for name in ("arm.py", "prop.py"):
        assert f"python -m derive {name}\n" in PAGE
        monkeypatch.setattr(sys, "argv", ["derive", name])
        with pytest.raises(SystemExit) as exit_:
            derive()
        assert not exit_.value.code
    return tmp_path


def commands():
    return [
        line.removeprefix("python -m solve ")
        for line in PAGE.splitlines()
        if line.startswith("python -m solve ")
    ]


def test_all_commands_on_the_page_run(arm, capsys):
    assert len(commands()) == 4
    for line in commands():
        arguments = [part.strip('"') for part in re.findall(r'"[^"]*"|\S+', line)]
        assert run(arguments) == 0, capsys.readouterr().err
        out = capsys.readouterr().out
        if "--json" in line:
            assert len(json.loads(out)["over"]["mean"]) == 13
    assert (arm / "arm.png").stat().st_size > 10_000
    assert (arm / "shapes.png").stat().st_size > 10_000


def test_stretched_arm_is_a_stepped_cantilever(arm):
    """At phase 0, both rods are collinear. If the mass of the rods is small compared with the load, the
    stiffness at the load is that of two rods in series."""
    model = solve.load("arm.py", options={"element": "dynamic"}, m=1e4, rho=1.0)
    p = model.parameters
    EI = [p["E"] * np.pi * p[d] ** 4 / 64 for d in ("d1", "d2")]
    L1, L2 = p["L1"], p["L2"]
    give = (L1**3 / 3 + L1**2 * L2 + L1 * L2**2) / EI[0] + L2**3 / (3 * EI[1])
    assert solve.frequencies(model).values[0, 0] == pytest.approx(1 / np.sqrt(give * 1e4), rel=1e-4)
