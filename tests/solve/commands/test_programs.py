"""The installed programs: exit status, standard streams, interruptions and repeated options."""

import os
import signal
import subprocess
import sys
import time
from importlib import import_module
from pathlib import Path

import pytest

import solve
from solve.commands.groups import stored_in

ROOT = Path(__file__).resolve().parents[3]
RESULTS = {
    "solve": ("floquet", "mathieu", "--speed", "1 rad/s"),
    "models.four_bar": ("linkage",),
    "derive": ("--show", "mathieu"),
}
SPEED = ("--speed", "600 rpm")
PROGRAMS = (*RESULTS, "models.coupler")


def started(program, *arguments, **streams):
    return subprocess.run([sys.executable, "-m", program, *arguments], cwd=ROOT, text=True, **streams)


@pytest.fixture
def inside(monkeypatch, capsys):
    """Return a function that runs a program in this process. It returns the exit status, standard output and
    standard error."""

    def ran(program, *arguments):
        monkeypatch.setattr(sys, "argv", [program, *arguments])
        with pytest.raises(SystemExit) as left:
            import_module(f"{program}.__main__").main()
        return left.value.code, *capsys.readouterr()

    return ran


@pytest.mark.parametrize("program", PROGRAMS)
def test_interruption_during_import_or_work_exits_with_130(program):
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
        if name.endswith((".groups", ".command", "four_bar.studies")):
            print("reading", flush=True)
            time.sleep(0.5)

sys.meta_path.insert(0, Waits())
sys.argv[0] = {0!r}
importlib.import_module("{0}.__main__").main()
"""


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="there is no /dev/full")
@pytest.mark.parametrize("program", RESULTS)
def test_full_standard_output_is_reported_in_one_line(program, inside, monkeypatch):
    # A first compilation would be announced as well.
    solve.floquet(solve.load("mathieu"), 1.0)
    with open("/dev/full", "w") as full:
        monkeypatch.setattr(sys, "stdout", full)
        status, _, error = inside(program, *RESULTS[program])
    assert status == 2
    assert error.endswith("standard output cannot be written: No space left on device\n")
    assert error.count("\n") == 1


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="there is no /dev/full")
@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_full_standard_streams_of_a_process_exit_with_2(unbuffered):
    environment = {**os.environ, "PYTHONUNBUFFERED": unbuffered}
    with open("/dev/full", "w") as full:
        ran = started("solve", *RESULTS["solve"], stdout=full, stderr=full, env=environment)
    assert ran.returncode == 2


@pytest.mark.parametrize(("program", "arguments"), [("solve", RESULTS["solve"]), ("derive", ("--help",))])
def test_closed_pipe_is_not_an_error(program, arguments):
    reading, writing = os.pipe()
    os.close(reading)
    ran = started(program, *arguments, stdout=writing, stderr=subprocess.PIPE)
    os.close(writing)
    assert (ran.returncode, ran.stderr) == (0, "")


def test_closed_streams_are_not_an_error():
    command = f"{sys.executable} -m solve floquet mathieu --speed '1 rad/s' >&- 2>&-"
    assert subprocess.run(["bash", "-c", command], cwd=ROOT).returncode == 0


@pytest.mark.parametrize("program", PROGRAMS)
def test_short_and_long_help_flags_are_equal(program, inside):
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
def test_flag_of_one_value_given_twice_is_refused(program, arguments, flag, inside):
    status, _, error = inside(program, *arguments)
    assert status == 2
    assert f"{flag} is given 2 times; give it once" in error
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "end"),
    [
        (("floquet", "cam", "b=-5"), "(b=-5); to change b, use --set b=NUMBER. See: solve floquet --help"),
        (("critical", "cam", "x", "k=2 N/m"), "use --set k=NUMBER. See: solve critical --help"),
        (("sweep", "cam", "rtol=1e-5"), "to change rtol, use --rtol VALUE. See: solve sweep --help"),
        (("chart", "cam", "k1=1:2:3"), "(k1=1:2:3). See: solve chart --help"),
        (("floquet", "cam", "more"), "(more). See: solve floquet --help"),
        (("flouet", "cam"), "Did you mean 'floquet'? See: solve --help"),
    ],
)
def test_usage_error_ends_with_advice(arguments, end, inside):
    status, _, error = inside("solve", *arguments)
    assert status == 2
    assert " ".join(error.split()).endswith(end)


@pytest.mark.parametrize("is_created", [True, False])
def test_interruption_reports_an_existing_store(is_created, tmp_path, capsys):
    store = tmp_path / "store"
    if is_created:
        store.mkdir()
    with pytest.raises(KeyboardInterrupt), stored_in(str(store)):
        raise KeyboardInterrupt
    assert ("finished points are stored" in capsys.readouterr().err) == is_created


@pytest.mark.parametrize("command_line", ["optimise cam --minimise q3.max_abs", "fit cam --data q.csv"])
def test_free_parameter_given_twice_is_refused(inside, command_line):
    status, _, error = inside("solve", *command_line.split(), "--free", "k1, k2,k1")
    assert status == 2
    assert "--free k1 is given 2 times; give it once" in error


def test_repeatable_flags_may_be_repeated(command):
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
def test_command_without_any_result_exits_with_2(command, arguments):
    ran = command(*arguments)
    assert ran.status == 2, ran.out
    assert ran.out == ""
    assert ran.err.count("\n") == 1
