"""Long LAPACK calls can be interrupted."""

import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

import solve
from solve.errors import MatricesError
from solve.threads import interruptible
from tests.solve import systems


def test_interruptible_call_returns_results_and_raises_errors():
    assert interruptible(lambda: 3) == 3

    def refused():
        raise MatricesError("no")

    with pytest.raises(MatricesError, match="no"):
        interruptible(refused)


def test_settings_of_the_caller_apply_within_the_call():
    with np.errstate(divide="raise"):
        assert interruptible(np.geterr)["divide"] == "raise"


def test_interruption_does_not_wait_for_the_result(monkeypatch):
    """The eigenvalues for harmonic balance with 600 unknowns take a long time."""
    ended = threading.Event()
    monkeypatch.setattr("solve.methods.fourier.np.linalg.eig", lambda _: ended.wait())
    before = signal.signal(signal.SIGALRM, signal.default_int_handler)
    signal.setitimer(signal.ITIMER_REAL, 0.2)
    begun = time.monotonic()
    try:
        with pytest.raises(KeyboardInterrupt):
            solve.periodic(systems.random_system(1, 3), 1.0, "fourier", steps=101)
        assert time.monotonic() - begun < 30
    finally:
        signal.signal(signal.SIGALRM, before)
        ended.set()


LEFT_AT_WORK = """
import signal, sys, time
import numpy as np
from solve.terminal.command_line import main
from solve.threads import interruptible

def work(arguments):
    print("before")
    signal.setitimer(signal.ITIMER_REAL, 0.3)
    signal.signal(signal.SIGALRM, signal.default_int_handler)
    interruptible({work})

{end}
"""
FOR_LONG = "lambda: [np.linalg.eig(np.random.default_rng(0).random((900, 900))) for _ in range(100)]"
AS_A_COMMAND = 'main("program", work, ValueError)'
AS_A_SCRIPT = """
try:
    work(())
except KeyboardInterrupt:
    print("interrupted")
"""


def left_at_work(work, end):
    program = LEFT_AT_WORK.format(work=work, end=end)
    return subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60)


@pytest.mark.parametrize("attempt", range(4))
def test_interrupted_command_ends_at_once(attempt):
    done = left_at_work(FOR_LONG, AS_A_COMMAND)
    assert (done.returncode, done.stdout, done.stderr) == (130, "before\n", "program: interrupted\n")


def test_interrupted_script_waits_for_lapack_before_it_ends():
    """Libraries are unloaded when a process ends."""
    done = left_at_work("lambda: (time.sleep(1), print('ended'))", AS_A_SCRIPT)
    assert (done.returncode, done.stdout) == (0, "before\ninterrupted\nended\n")
