"""Separate process for long computations of the live window. Sliders stay responsive, and computations can be
cancelled at any time."""

import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any, BinaryIO, Protocol

from solve.errors import SolveError
from solve.terminal import progress

INTERVAL = 0.2
"""Time in seconds between two progress reports. Chosen by judgement."""

_JOIN = 2.0
"""Time in seconds after which a process that ignores termination is killed. Chosen by judgement."""


class Work(Protocol):
    """Protocol of computations that can be sent to another process."""

    def run(self) -> dict[str, Any]: ...


Report = Callable[[str, dict[str, Any]], object]
"""Type of functions that report on a computation, with a kind ("progress", "done", "refused", "failed" or
"cancelled") and values."""


class Background:
    """Process that performs one computation at a time. The process is started for the first computation, and
    again after a cancellation.

    Reports are delivered from a thread of this object.

    Notes
    -----
    The process is a new interpreter. A process of `multiprocessing` would run the script that opened the
    window again.
    """

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._lock = threading.Lock()
        self._running = False

    def start(self, work: Work, report: Report) -> None:
        """Cancel the running computation, if there is one, and start another."""
        self.cancel()
        content = pickle.dumps(work)
        with self._lock:
            if self._process is None or self._process.poll() is not None:
                self._process = _started()
            self._running = True
            process = self._process
            listening = threading.Thread(target=self._listen, args=(process, report), daemon=True)
        listening.start()
        # If the process has ended, the listening thread reports it.
        with suppress(OSError):
            _write(process.stdin, content)

    def cancel(self) -> None:
        """Cancel the running computation and end its process."""
        with self._lock:
            if not self._running:
                return
            self._end_process()

    def close(self) -> None:
        """End the background process."""
        with self._lock:
            if self._process is not None:
                self._end_process()

    def _end_process(self) -> None:
        process, self._process, self._running = self._process, None, False
        assert process is not None
        process.terminate()
        try:
            process.wait(_JOIN)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()

    def _listen(self, process: "subprocess.Popen[bytes]", report: Report) -> None:
        """Deliver the reports of one computation until it ends."""
        while True:
            try:
                kind, values = pickle.load(process.stdout)  # pyright: ignore[reportArgumentType]
            except (EOFError, OSError, ValueError, pickle.UnpicklingError):
                with self._lock:
                    cancelled = process is not self._process or not self._running
                    self._running = self._running and process is not self._process
                message = "the process of this calculation has ended, perhaps for lack of memory"
                report("cancelled" if cancelled else "failed", {"message": message})
                return
            if kind != "progress":
                with self._lock:
                    self._running = False
            report(kind, values)
            if kind != "progress":
                return


def _started() -> "subprocess.Popen[bytes]":
    """Start a new interpreter that has the same import paths and calls `serve`."""
    command = [sys.executable, "-c", f"from {__name__} import serve; serve()"]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment)


def _write(stream: Any, content: object) -> None:
    pickle.dump(content, stream)
    stream.flush()


def serve() -> None:
    """Perform the computations that are received on standard input, until standard input is closed."""
    # The terminal sends an interruption to all processes, but it is the window that ends this process.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    reports = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    with suppress(EOFError, OSError):
        while True:
            _write(reports, _outcome(reports, pickle.load(sys.stdin.buffer)))


def _outcome(reports: BinaryIO, content: bytes) -> tuple[str, dict[str, Any]]:
    reported = 0.0

    def listener(tracker: progress.Tracker) -> None:
        nonlocal reported
        now = time.monotonic()
        status = tracker.status(now)
        if status is not None and now - reported > INTERVAL:
            reported = now
            _write(reports, ("progress", status._asdict()))

    try:
        with progress.listen(listener):
            work: Work = pickle.loads(content)
            return "done", work.run()
    except SolveError as error:
        return "refused", {"message": str(error)}
    except Exception as error:
        return "failed", {"message": internal_error(error)}


def internal_error(error: Exception) -> str:
    """Return a sentence that reports an error not caused by the user."""
    cause = " ".join(f"{type(error).__name__}: {error}".split())[:200]
    return f"internal error, not caused by your input ({cause}); please report it"
