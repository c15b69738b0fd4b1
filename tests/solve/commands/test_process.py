"""Commands as processes: exit status, standard streams and files in the current folder."""

import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

import solve

ROOT = Path(__file__).resolve().parents[3]


def python(*arguments, cwd, **settings):
    return subprocess.run(
        [sys.executable, *arguments], cwd=cwd, capture_output=True, text=True, encoding="utf-8", **settings
    )


def solved(*arguments, cwd=ROOT):
    return python("-m", "solve", *arguments, cwd=cwd)


def test_result_without_warnings_leaves_standard_error_empty():
    # A first compilation would be announced there.
    solve.floquet(solve.load("manipulator"), "50 rpm")
    ran = solved("floquet", "manipulator", "--json")
    assert (ran.returncode, ran.stderr) == (0, "")
    assert ran.stdout.startswith("{")
    assert ran.stdout.count("\n") == 1


def test_help_loads_no_command_and_no_large_package():
    code = (
        "import sys; from solve.commands.app import MODULES, run; status = run(['--help']); "
        "loaded = [name for name in MODULES.values() if f'solve.commands.{name}' in sys.modules]; "
        "heavy = {'numpy', 'scipy', 'casadi', 'matplotlib', 'rich.table'} & sys.modules.keys(); "
        "print(loaded, sorted(heavy), file=sys.stderr); sys.exit(status)"
    )
    ran = python("-c", code, cwd=ROOT)
    assert (ran.returncode, ran.stderr) == (0, "[] []\n")
    assert "Critical speeds: maxima of response" in ran.stdout


def test_help_of_a_command_loads_no_large_package():
    code = (
        "import sys; from solve.commands.app import run; status = run(['periodic', '--help']); "
        "heavy = {'matplotlib', 'casadi', 'pint', 'xarray', 'rich.console', 'scipy.optimize'}; "
        "print(sorted(heavy & sys.modules.keys()), file=sys.stderr); sys.exit(status)"
    )
    ran = python("-c", code, cwd=ROOT)
    assert ran.returncode == 0
    assert "--quasi-static" in ran.stdout
    assert ran.stderr == "[]\n"


LOADED = """
import sys
from solve.commands.app import run

for line in ("periodic cam --speed 600rpm", "sweep gear_pair --speeds 900:1900:4rpm"):
    assert run(line.split()) == 0
    assert "scipy.linalg" not in sys.modules
    if line.startswith("periodic"):
        others = ("exports", "studies.control", "studies.optimise", "newton", "views.chart")
        assert not any(f"solve.{name}" in sys.modules for name in others)
assert run(["floquet", "manipulator", "--plot", "m.png"]) == 0
assert "matplotlib.pyplot" not in sys.modules
"""


def test_common_commands_load_neither_scipy_nor_pyplot(tmp_path):
    """An invalid matplotlib backend therefore has no effect."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "MPLBACKEND": "nonsense"}
    ran = python("-c", LOADED, cwd=tmp_path, env=environment)
    assert ran.returncode == 0, ran.stderr
    assert (tmp_path / "m.png").read_bytes().startswith(b"\x89PNG")


def test_closed_output_pipe_is_not_an_error():
    command = f"{sys.executable} -m solve periodic manipulator --json --harmonics 2000 | head -c 10"
    ran = subprocess.run(["bash", "-c", command], cwd=ROOT, capture_output=True, text=True)
    assert ran.stdout == '{"model": '
    assert "Traceback" not in ran.stderr


def test_tables_are_printed_to_an_ascii_stream():
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    ran = python("-m", "solve", "floquet", "manipulator", cwd=ROOT, env=environment)
    assert ran.returncode == 0
    assert "asymptotically stable" in ran.stdout


def test_installed_command_ignores_modules_in_the_working_directory(tmp_path, command):
    installed = shutil.which("solve", path=sysconfig.get_path("scripts"))
    if installed is None:
        pytest.skip("the package is not installed, so there is no command `solve`")
    (tmp_path / "solve.py").write_text("raise SystemExit('the wrong solve')")
    (tmp_path / "models").mkdir()
    (tmp_path / "generated").mkdir()
    arguments = ("floquet", "manipulator", "--json")
    ran = subprocess.run([installed, *arguments], cwd=tmp_path, capture_output=True, text=True)
    assert (ran.returncode, ran.stderr) == (0, "")
    assert ran.stdout == command(*arguments).out


def test_listed_commands_match_their_docstrings():
    from models.four_bar.__main__ import PROGRAM
    from solve.commands.app import SOLVE

    for program in (SOLVE, PROGRAM):
        for name, words in program.listed.items():
            assert (program.command(name).__doc__ or "").splitlines()[0] == words
