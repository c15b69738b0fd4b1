"""What LAPACK does for long can be interrupted."""

import signal
import threading
import time

import numpy as np
import pytest

import solve
from solve.errors import MatricesError
from solve.threads import interruptible
from tests.solve import systems


def test_it_returns_and_raises_what_the_work_does():
    assert interruptible(lambda: 3) == 3

    def refused():
        raise MatricesError("no")

    with pytest.raises(MatricesError, match="no"):
        interruptible(refused)


def test_the_settings_of_the_caller_hold_within():
    with np.errstate(divide="raise"):
        assert interruptible(np.geterr)["divide"] == "raise"


def test_an_interruption_does_not_wait_for_the_end_of_the_work(monkeypatch):
    """A balance of 600 unknowns whose eigenvalues take for ever."""
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
