"""Exit status, messages and interruptions of a command line."""

import io
import os
import signal
import subprocess
import sys
import time
import weakref
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import pytest

from solve.terminal.command_line import run_cli

ROOT = Path(__file__).resolve().parents[3]


class RefusedError(Exception):
    pass


def ended(work, *arguments):
    """Return exit status, standard output and standard error of work run as a command."""
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        status = run_cli("program", work, arguments, RefusedError)
    return status, out.getvalue(), err.getvalue()


def raising(error):
    def work(_):
        print("before")
        raise error

    return work


@pytest.mark.parametrize("status", [None, 0, 1])
def test_returned_value_is_the_exit_status(status):
    assert ended(lambda _: status) == (status or 0, "", "")


def test_refusal_is_one_line_with_status_2():
    assert ended(raising(RefusedError("no\n such  thing"))) == (2, "before\n", "program: no such thing\n")


def test_long_message_is_truncated():
    _, _, error = ended(raising(RefusedError("given " + "9" * 5000 + "; allowed: 1")))
    assert len(error) < 950
    assert error.startswith("program: given 999")
    assert error.endswith("; allowed: 1\n")


def test_internal_error_is_one_line_with_status_70():
    status, _, error = ended(raising(ZeroDivisionError("by nothing")))
    assert status == 70
    assert error.count("\n") == 1
    assert "internal error, not caused by your input (ZeroDivisionError: by nothing); --debug shows" in error


def test_debug_shows_the_traceback_of_an_internal_error():
    status, _, error = ended(raising(ZeroDivisionError("by nothing")), "--debug")
    assert status == 70
    assert "raise error\nZeroDivisionError: by nothing\nprogram: internal error" in error


def test_out_of_memory_is_reported_in_one_line():
    status, _, error = ended(raising(MemoryError()))
    assert (status, error.count("\n")) == (2, 1)
    assert "this machine has too little memory" in error


def test_missing_package_is_reported():
    status, _, error = ended(raising(ModuleNotFoundError("No module named 'typer.core'", name="typer.core")))
    assert (status, error.count("\n")) == (2, 1)
    assert "typer.core is not installed" in error
    assert error.endswith("run: python -m pip install -e .\n")
    assert ended(raising(ModuleNotFoundError("No module named 'solve.lost'", name="solve.lost")))[0] == 70


def test_interruption_exits_with_130():
    assert ended(raising(KeyboardInterrupt())) == (130, "before\n", "program: interrupted\n")


def test_interruption_that_a_library_ignores_is_repeated():
    def work(_):
        try:
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(5)
        except KeyboardInterrupt:
            time.sleep(5)

    assert ended(work)[0] == 130
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)


def test_interruption_lost_in_a_callback_is_repeated(monkeypatch):
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


def test_interruption_converted_to_another_error_exits_with_130():
    def work(_):
        try:
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(5)
        except KeyboardInterrupt:
            raise RefusedError("the integration failed") from None

    assert ended(work) == (130, "", "program: interrupted\n")


def test_library_warnings_are_not_printed():
    code = (
        "import sys, warnings; from solve.terminal import command_line; sys.argv = ['solve']; "
        "command_line.main('solve', lambda _: warnings.warn('overflow', RuntimeWarning), ValueError)"
    )
    ran = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert (ran.returncode, ran.stderr) == (0, "")
