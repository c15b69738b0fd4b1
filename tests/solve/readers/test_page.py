"""The examples in docs/readers.md run, and its table lists all reader functions."""

import json
import re
import shlex
from pathlib import Path

import numpy as np
import pytest

import solve
from derive.command import run as derive
from solve.commands.app import run
from solve.readers.paths import READERS
from tests.solve.readers.fmi2_unit import require_fmu_tools
from tests.solve.readers.lin_files import write_set
from tests.solve.readers.test_formats import PHASES, second_order, write, write_matrix_market

PAGE = (Path(__file__).parents[3] / "docs" / "readers.md").read_text(encoding="utf-8")


def test_examples_run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_set(tmp_path)
    for example in re.findall(r"```python\n(.*?)```", PAGE, flags=re.DOTALL):
        if not example.startswith(("# fmu", "# rig.py", "# frame.npz", "# pendulum.py")):
            exec(example, {})
    assert capsys.readouterr().out.startswith("asymptotically stable")


def test_example_of_an_fmu_runs(tmp_path, monkeypatch, capsys):
    require_fmu_tools()
    monkeypatch.chdir(tmp_path)
    (example,) = re.findall(r"```python\n(# fmu.*?)```", PAGE, flags=re.DOTALL)
    exec(example, {})
    (command_of_page,) = re.findall(r"python -m solve (.*\.fmu.*)", PAGE)
    assert run([*shlex.split(command_of_page), "--json"]) == 0, capsys.readouterr().err
    for point in json.loads(capsys.readouterr().out)["points"]:
        expected = solve.nonlinear(solve.load("manipulator"), point["speed"]).spectral_radius
        assert point["spectral_radius"] == pytest.approx(expected, rel=1e-6)


def test_python_system_on_the_page_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (example,) = re.findall(r"```python\n(# pendulum\.py.*?)```", PAGE, flags=re.DOTALL)
    (tmp_path / "pendulum.py").write_text(example, encoding="utf-8")
    floquet, chart = re.findall(r"python -m solve (.*pendulum.*)", PAGE)
    assert run([*shlex.split(floquet), "--json"]) == 0, capsys.readouterr().err
    found = json.loads(capsys.readouterr().out)
    assert found["parameters"] == {"depth": 0.4, "damping": 0.1}
    # Liouville: the product of the multipliers is exp(-damping T).
    assert np.prod([complex(*rho) for rho in found["multipliers"]]) == pytest.approx(np.exp(-0.1 * np.pi))
    assert run(shlex.split(chart)) == 0, capsys.readouterr().err


def test_reduced_body_vibrates_as_the_full_body_does(tmp_path, monkeypatch, capsys):
    """The amplitude of the motor is computed from all four masses. With two of three modes, its error is
    4e-4."""
    monkeypatch.chdir(tmp_path)
    blocks = dict(re.findall(r"```python\n# (rig\.py|frame\.npz).*?\n(.*?)```", PAGE, flags=re.DOTALL))
    Path("rig.py").write_text(blocks["rig.py"], encoding="utf-8")
    (case,) = re.findall(r"```toml\n(.*?)```", PAGE, flags=re.DOTALL)
    Path("rig.toml").write_text(case, encoding="utf-8")
    frame = {}
    exec(blocks["frame.npz"], frame)
    for command in re.findall(r"^python -m derive (.*)$", PAGE, flags=re.MULTILINE):
        assert derive(shlex.split(command)) in (0, None)
    for command in re.findall(r"^python -m solve (.* rig\.py .*)$", PAGE, flags=re.MULTILINE):
        assert run(shlex.split(command)) == 0, capsys.readouterr().err
    speed = 10 * np.pi
    dynamic = frame["stiffness"] - speed**2 * np.diag([3.0, 3.0, 3.0, 7.0])
    expected = np.linalg.solve(dynamic, [0, 0, 0, 0.01 * speed**2])[3]
    assert solve.periodic(solve.load("rig.py"), speed).harmonics("x")[0][1] == pytest.approx(
        expected, rel=1e-3
    )


def test_commands_on_the_page_run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_set(tmp_path)
    write({**second_order(), "phase": PHASES}, tmp_path / "rotor.mat")
    for file in Path(write_matrix_market(tmp_path)).parent.glob("run.*.mtx"):
        file.rename(file.with_name(file.name.replace("run", "rotor")))
    commands = re.findall(r"^    python -m solve (.*)$", PAGE, flags=re.MULTILINE)
    assert len(commands) == 3
    for command in commands:
        assert run(shlex.split(command.replace(":21 rpm", ":2 rpm"))) == 0, capsys.readouterr().err


def test_table_lists_all_readers():
    listed = set(re.findall(r"`solve\.(read_\w+)`", PAGE))
    assert listed == {"read_fmu", *(reader.__name__ for reader in READERS.values())}
    assert listed == {name for name in solve.__all__ if name.startswith("read_")}
