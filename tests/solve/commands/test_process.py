"""The commands as processes: exit status, streams, and what the folder where the user stands may hold."""

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


def test_a_result_leaves_standard_error_clean():
    # A first compilation would be announced there.
    solve.floquet(solve.load("manipulator"), "50 rpm")
    ran = solved("floquet", "manipulator", "--json")
    assert (ran.returncode, ran.stderr) == (0, "")
    assert ran.stdout.startswith("{")
    assert ran.stdout.count("\n") == 1


def test_a_refusal_leaves_no_traceback():
    ran = solved("periodic", "cam", "--speed", "600")
    assert ran.returncode == 2
    assert ran.stdout == ""
    assert ran.stderr == "solve: '600' has no unit; write it like '600 rpm'\n"


def test_help_needs_no_heavy_package():
    code = (
        "import sys; from solve.commands.app import run; status = run(['periodic', '--help']); "
        "heavy = {'matplotlib', 'casadi', 'pint', 'xarray', 'rich.console', 'scipy.optimize'}; "
        "print(sorted(heavy & sys.modules.keys()), file=sys.stderr); sys.exit(status)"
    )
    ran = python("-c", code, cwd=ROOT)
    assert ran.returncode == 0
    assert "--quasi-static" in ran.stdout
    assert ran.stderr == "[]\n"


@pytest.mark.parametrize("line", ["periodic cam --speed 600rpm", "sweep gear_pair --speeds 900:1900:4rpm"])
def test_usual_commands_read_no_scipy(line):
    code = (
        f"import sys; from solve.commands.app import run; status = run({line.split()}); "
        "sys.exit(status or 10 * ('scipy.linalg' in sys.modules))"
    )
    assert python("-c", code, cwd=ROOT).returncode == 0


def test_pictures_need_no_pyplot(tmp_path):
    code = (
        "import sys; from solve.commands.app import run; "
        f"status = run(['floquet', 'manipulator', '--plot', {str(tmp_path / 'm.png')!r}]); "
        "sys.exit(status or 10 * ('matplotlib.pyplot' in sys.modules))"
    )
    assert python("-c", code, cwd=ROOT).returncode == 0
    assert (tmp_path / "m.png").read_bytes().startswith(b"\x89PNG")


def test_a_command_imports_only_the_displays_and_studies_it_needs():
    code = (
        "import sys; from solve.commands.app import run; "
        "status = run(['periodic', 'manipulator']); "
        "others = ('exports', 'studies.control', 'studies.optimise', 'newton', 'views.chart'); "
        "sys.exit(status or 10 * any(f'solve.{name}' in sys.modules for name in others))"
    )
    assert python("-c", code, cwd=ROOT).returncode == 0


def test_a_reader_that_goes_away_is_no_error():
    command = f"{sys.executable} -m solve periodic manipulator --json --harmonics 10000 | head -c 10"
    ran = subprocess.run(["bash", "-c", command], cwd=ROOT, capture_output=True, text=True)
    assert ran.stdout == '{"model": '
    assert "Traceback" not in ran.stderr


def test_tables_survive_a_stream_that_is_not_unicode():
    import os

    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    ran = python("-m", "solve", "floquet", "manipulator", cwd=ROOT, env=environment)
    assert ran.returncode == 0
    assert "asymptotically stable" in ran.stdout


def test_installed_command_ignores_modules_in_the_working_directory(tmp_path):
    installed = shutil.which("solve", path=sysconfig.get_path("scripts"))
    if installed is None:
        pytest.skip("the package is not installed, so there is no command `solve`")
    (tmp_path / "solve.py").write_text("raise SystemExit('the wrong solve')")
    (tmp_path / "models").mkdir()
    (tmp_path / "generated").mkdir()
    arguments = ("floquet", "manipulator", "--json")
    ran = subprocess.run([installed, *arguments], cwd=tmp_path, capture_output=True, text=True)
    assert (ran.returncode, ran.stderr) == (0, "")
    assert ran.stdout == solved(*arguments).stdout
    assert subprocess.run([installed], cwd=tmp_path, capture_output=True, text=True).stdout == solved().stdout


def test_listed_commands_match_their_docstrings():
    from models.four_bar.__main__ import PROGRAM
    from solve.commands.app import SOLVE

    for program in (SOLVE, PROGRAM):
        for name, words in program.listed.items():
            assert (program.command(name).__doc__ or "").splitlines()[0] == words


def test_only_the_command_that_is_called_is_loaded():
    code = (
        "import sys; from solve.commands.app import MODULES, run; status = run(['--help']); "
        "loaded = [name for name in MODULES.values() if f'solve.commands.{name}' in sys.modules]; "
        "print(loaded, file=sys.stderr); sys.exit(status)"
    )
    ran = python("-c", code, cwd=ROOT)
    assert (ran.returncode, ran.stderr) == (0, "[]\n")
    assert "Critical speeds: maxima of response" in ran.stdout
