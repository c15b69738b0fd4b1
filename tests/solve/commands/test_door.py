"""Every command ends in a result, in one line and status 2, in 70 with one line, or in 130."""

import io
import os
import signal
import subprocess
import sys
import time
import weakref
from contextlib import redirect_stderr, redirect_stdout
from importlib import import_module
from pathlib import Path

import pytest

import solve
from solve.commands.door import door

ROOT = Path(__file__).resolve().parents[3]
RESULTS = {
    "solve": ("floquet", "mathieu", "--speed", "1 rad/s"),
    "models.four_bar": ("linkage",),
    "derive": ("--show", "mathieu"),
}
SPEED = ("--speed", "600 rpm")
PROGRAMS = (*RESULTS, "models.coupler")


class RefusedError(Exception):
    pass


def ended(work, *arguments):
    """Exit status, standard output and standard error of work within a door."""
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        status = door("program", work, arguments, RefusedError)
    return status, out.getvalue(), err.getvalue()


def raising(error):
    def work(_):
        print("before")
        raise error

    return work


def started(program, *arguments, **streams):
    return subprocess.run([sys.executable, "-m", program, *arguments], cwd=ROOT, text=True, **streams)


@pytest.fixture
def inside(monkeypatch, capsys):
    """Exit status, standard output and standard error of a program within this process."""

    def ran(program, *arguments):
        monkeypatch.setattr(sys, "argv", [program, *arguments])
        with pytest.raises(SystemExit) as left:
            import_module(f"{program}.__main__").main()
        return left.value.code, *capsys.readouterr()

    return ran


def test_both_programs_have_the_same_door():
    assert (ROOT / "derive" / "door.py").read_bytes() == (
        ROOT / "solve" / "commands" / "door.py"
    ).read_bytes()


@pytest.mark.parametrize("status", [None, 0, 1])
def test_what_the_work_returns_is_the_status(status):
    assert ended(lambda _: status) == (status or 0, "", "")


def test_a_refusal_is_one_line_and_status_2():
    assert ended(raising(RefusedError("no\n such  thing"))) == (2, "before\n", "program: no such thing\n")


def test_a_long_message_is_cut():
    _, _, error = ended(raising(RefusedError("given " + "9" * 5000 + "; allowed: 1")))
    assert len(error) < 950
    assert error.startswith("program: given 999")
    assert error.endswith("; allowed: 1\n")


def test_a_fault_of_ours_is_one_line_and_status_70():
    status, _, error = ended(raising(ZeroDivisionError("by nothing")))
    assert status == 70
    assert error.count("\n") == 1
    assert (
        "a fault of this program, not of your input (ZeroDivisionError: by nothing); --debug shows" in error
    )


def test_debug_shows_where_a_fault_arose():
    status, _, error = ended(raising(ZeroDivisionError("by nothing")), "--debug")
    assert status == 70
    assert "raise error\nZeroDivisionError: by nothing\nprogram: a fault" in error


def test_too_little_memory_is_said():
    status, _, error = ended(raising(MemoryError()))
    assert (status, error.count("\n")) == (2, 1)
    assert "memory of this machine does not suffice" in error


def test_a_package_that_is_not_installed_is_named():
    status, _, error = ended(raising(ModuleNotFoundError("No module named 'typer.core'", name="typer.core")))
    assert (status, error.count("\n")) == (2, 1)
    assert "typer.core is not installed" in error
    assert error.endswith("run: python -m pip install -e .\n")
    assert ended(raising(ModuleNotFoundError("No module named 'solve.lost'", name="solve.lost")))[0] == 70


def test_an_interruption_is_130():
    assert ended(raising(KeyboardInterrupt())) == (130, "before\n", "program: interrupted\n")


def test_an_interruption_that_a_library_passes_over_comes_again():
    def work(_):
        try:
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(5)
        except KeyboardInterrupt:
            time.sleep(5)

    assert ended(work)[0] == 130
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)


def test_an_interruption_that_is_lost_while_python_tidies_up_comes_again_and_is_not_shown(monkeypatch):
    class Gone:
        pass

    def interrupt(_):
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(1)

    def work(_):
        held = Gone()
        watched = weakref.ref(held, interrupt)
        del held
        time.sleep(5)
        return watched

    shown = []
    monkeypatch.setattr(sys, "unraisablehook", shown.append)
    assert ended(work) == (130, "", "program: interrupted\n")
    assert shown == []


def test_an_interruption_that_a_library_turns_into_an_error_of_its_own_is_130():
    def work(_):
        try:
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(5)
        except KeyboardInterrupt:
            raise RefusedError("the integration failed") from None

    assert ended(work) == (130, "", "program: interrupted\n")


@pytest.mark.parametrize("program", PROGRAMS)
def test_an_interruption_while_packages_are_read_or_while_it_works_is_130(program):
    long = ("sweep", "four_bar", "--speeds", "20:400:4000 rad/s")
    reads = {"solve": long, "models.four_bar": ("linkage", "--help")}
    arguments = reads.get(program, ("--help",))
    for seconds in (0.15, 1.0) if program == "solve" else (0.15,):
        process = subprocess.Popen(
            [sys.executable, "-c", SLOW.format(program), *arguments],
            cwd=ROOT,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        assert process.stdout is not None
        process.stdout.readline()
        time.sleep(seconds)
        process.send_signal(signal.SIGINT)
        _, error = process.communicate(timeout=60)
        assert process.returncode == 130, error
        assert error.splitlines()[-1].endswith(": interrupted")
        assert "Traceback" not in error


SLOW = """
import importlib, sys, time, typer

class Waits:
    def find_spec(self, name, *_):
        if name.endswith((".groups", ".command", "four_bar.commands")):
            print("reading", flush=True)
            time.sleep(0.5)

sys.meta_path.insert(0, Waits())
sys.argv[0] = {0!r}
importlib.import_module("{0}.__main__").main()
"""


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="there is no /dev/full")
@pytest.mark.parametrize(
    ("program", "buffered"), [*((program, True) for program in RESULTS), ("solve", False)]
)
def test_a_full_standard_output_is_one_line(program, buffered):
    # A first compilation would be announced as well.
    solve.floquet(solve.load("mathieu"), 1.0)
    environment = {**os.environ, "PYTHONUNBUFFERED": "" if buffered else "1"}
    with open("/dev/full", "w") as full:
        ran = started(program, *RESULTS[program], stdout=full, stderr=subprocess.PIPE, env=environment)
    assert ran.returncode == 2
    assert ran.stderr.endswith("standard output cannot be written: No space left on device\n")
    assert ran.stderr.count("\n") == 1


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="there is no /dev/full")
def test_a_full_standard_error_changes_no_status():
    with open("/dev/full", "w") as full:
        assert started("solve", "periodic", "cam", stdout=full, stderr=full).returncode == 2


@pytest.mark.parametrize("program", RESULTS)
def test_a_closed_pipe_is_no_error(program):
    reading, writing = os.pipe()
    os.close(reading)
    ran = started(program, *RESULTS[program], stdout=writing, stderr=subprocess.PIPE)
    os.close(writing)
    assert (ran.returncode, ran.stderr) == (0, "")


def test_closed_streams_are_no_error():
    command = f"{sys.executable} -m solve floquet mathieu --speed '1 rad/s' >&- 2>&-"
    assert subprocess.run(["bash", "-c", command], cwd=ROOT).returncode == 0


@pytest.mark.parametrize("program", PROGRAMS)
def test_help_has_two_names(program, inside):
    status, shown, _ = inside(program, "-h")
    assert inside(program, "--help") == (status, shown, "") == (0, shown, "")
    assert "--help" in shown
    assert "Show this message and exit." in shown


@pytest.mark.parametrize(
    ("program", "arguments", "flag"),
    [
        ("solve", ("periodic", "cam", "--speed", "1 rpm", "--speed", "2 rpm"), "--speed"),
        ("solve", ("sweep", "cam", "--rtol", "1e-3", "--speeds", "1 2 rpm", "--rtol=1e-3"), "--rtol"),
        ("models.four_bar", ("linkage", "--branch", "open", "--branch", "open"), "--branch"),
        ("models.coupler", ("--plot", "a.png", "--plot", "b.png"), "--plot"),
        ("derive", ("cam", "--out", "a", "--out", "b"), "--out"),
    ],
)
def test_a_flag_of_one_value_given_twice_is_refused(program, arguments, flag, inside):
    status, _, error = inside(program, *arguments)
    assert status == 2
    assert f"{flag} is given 2 times; give it once" in error
    assert error.count("\n") == 1


def test_repeatable_flags_stay_repeatable(command):
    ran = command(
        "floquet", "cam", "--speed", "600 rpm", "--set", "k1=8e4", "--set", "k2=8e7", "--rtol", "1e-3"
    )
    assert ran.status == 0


@pytest.mark.parametrize(
    "arguments",
    [
        ("sweep", "cam", "--speeds", "600 700 rpm", "--method", "rk4", "--steps", "20"),
        ("critical", "cam", "--speeds", "600 601 rpm", "--method", "rk4", "--set", "c1=1e30"),
        ("chart", "cam", "--x", "k1=1:2:2", "--y", "k2=1:2:2", "--set", "c1=1e30", "--method", "rk4", *SPEED),
        ("compare", "cam", "--speed", "600 rpm", "--method", "rk4", "--steps", "20", "--rtol", "1e-14"),
    ],
)  # fmt: skip
def test_a_command_without_any_result_exits_2(command, arguments):
    ran = command(*arguments)
    assert ran.status == 2, ran.out
    assert ran.out == ""
    assert ran.err.count("\n") == 1


def test_no_setting_for_windows_matters(tmp_path):
    environment = {**os.environ, "MPLBACKEND": "nonsense"}
    file = tmp_path / "m.png"
    ran = started("solve", *RESULTS["solve"], "--plot", str(file), env=environment, capture_output=True)
    assert (ran.returncode, ran.stderr) == (0, f"wrote {file}\n")


def test_what_libraries_warn_of_stays_inside():
    code = (
        "import sys, warnings; from solve.commands import door; sys.argv = ['solve']; "
        "door.enter('solve', lambda _: warnings.warn('overflow', RuntimeWarning), ValueError)"
    )
    ran = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert (ran.returncode, ran.stderr) == (0, "")
