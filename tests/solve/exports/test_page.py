"""The examples on the page on interfaces run as printed."""

import doctest
import re
import shlex
import shutil
import subprocess
from pathlib import Path

import casadi
import pytest

from solve.commands.app import run

PAGE = Path(__file__).resolve().parents[3] / "docs" / "interfaces.md"
TEXT = PAGE.read_text("utf-8")
COMPILER = next(filter(None, map(shutil.which, ("cc", "gcc", "clang"))), None)
needs_compiler = pytest.mark.skipif(COMPILER is None, reason="there is no C compiler")
COMMANDS = re.findall(r"^    python -m solve (export .*)$", TEXT, re.MULTILINE)


@pytest.mark.slow
@needs_compiler
def test_python_examples_run(tmp_path, monkeypatch):
    pytest.importorskip("control", reason="python-control is not installed")
    pytest.importorskip("fmpy", reason="FMPy is not installed")
    if not hasattr(casadi.DaeBuilder, "compile_fmu"):
        pytest.skip("CasADi is older than 3.8")
    monkeypatch.chdir(tmp_path)
    computed = doctest.testfile(str(PAGE), module_relative=False)
    assert computed.attempted > 20
    assert computed.failed == 0


@pytest.mark.parametrize("line", [command for command in COMMANDS if not command.endswith(".fmu")])
def test_command_examples_run(line, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run(shlex.split(line)) == 0
    assert list(tmp_path.iterdir())


@needs_compiler
def test_c_example_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (program,) = re.findall(r"```c\n(.*?)```", TEXT, re.DOTALL)
    Path("main.c").write_text(program)
    assert run(["export", "cam", "--out", "cam.c"]) == 0
    (line,) = re.findall(r"^    (cc main\.c .*)$", TEXT, re.MULTILINE)
    build = line.partition(" && ")[0].replace("cc", COMPILER, 1)
    subprocess.run(shlex.split(build), check=True)
    printed = subprocess.run(["./main"], capture_output=True, text=True, check=True).stdout
    assert f"prints `{printed.strip()}`" in TEXT
