"""Separate process for long calculations of the live window. Sliders stay responsive, and calculations can be
cancelled at any time."""

import multiprocessing
import pickle
import signal
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Protocol

from solve.errors import SolveError
from solve.terminal import progress

_INTERVAL = 0.2
"""Seconds between two reports of the progress. A choice."""

_JOIN = 2.0
"""Seconds until a terminated process is killed. A choice."""


class Work(Protocol):
    """Calculation that can be sent to another process (protocol)."""

    def run(self) -> dict[str, Any]: ...


Report = Callable[[str, dict[str, Any]], object]
"""Type of the report function, which takes a kind ("progress", "done", "refused", "failed" or "cancelled")
and its values."""


class Background:
    """Process that performs one calculation at a time. It is started for the first calculation, and again
    after a cancellation.

    Reports are delivered from a thread of this object.
    """

    def __init__(self) -> None:
        self._context = multiprocessing.get_context("spawn")
        self._process: Any = None
        self._connection: Any = None
        self._lock = threading.Lock()
        self._running = False

    @property
    def busy(self) -> bool:
        """Whether a calculation is running."""
        return self._running

    def start(self, work: Work, report: Report) -> None:
        """Cancel the running calculation, if any, and start another."""
        self.cancel()
        content = pickle.dumps(work)
        with self._lock:
            if self._process is None or not self._process.is_alive():
                self._connection, other = self._context.Pipe()
                self._process = self._context.Process(target=_serve, args=(other,), daemon=True)
                self._process.start()
                other.close()
            self._running = True
            self._connection.send_bytes(content)
            listening = threading.Thread(target=self._listen, args=(self._connection, report), daemon=True)
        listening.start()

    def cancel(self) -> None:
        """Cancel the running calculation and end its process."""
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
        process.terminate()
        process.join(_JOIN)
        if process.is_alive():
            process.kill()
            process.join()

    def _listen(self, connection: Any, report: Report) -> None:
        """Deliver the reports of one calculation until it ends."""
        while True:
            try:
                kind, values = connection.recv()
            except (EOFError, OSError):
                with self._lock:
                    cancelled = connection is not self._connection or not self._running
                    self._running = self._running and connection is not self._connection
                message = "the process of this work has ended; it may have been short of memory"
                report("cancelled" if cancelled else "failed", {"message": message})
                return
            if kind != "progress":
                with self._lock:
                    self._running = False
            report(kind, values)
            if kind != "progress":
                return


def _serve(connection: Any) -> None:
    """Perform the calculations received from a connection until it is closed."""
    # An interruption of the terminal reaches all its processes; the window ends this one.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with suppress(EOFError, OSError):
        while True:
            kind, values = _outcome(connection, connection.recv_bytes())
            connection.send((kind, values))


def _outcome(connection: Any, content: bytes) -> tuple[str, dict[str, Any]]:
    reported = 0.0

    def listener(tracker: progress.Tracker) -> None:
        nonlocal reported
        now = time.monotonic()
        status = tracker.status(now)
        if status is not None and now - reported > _INTERVAL:
            reported = now
            connection.send(("progress", status._asdict()))

    try:
        with progress.listen(listener):
            work: Work = pickle.loads(content)
            return "done", work.run()
    except SolveError as error:
        return "refused", {"message": str(error)}
    except Exception as error:
        return "failed", {"message": internal_error(error)}


def internal_error(error: Exception) -> str:
    """Sentence that reports an error not caused by the user."""
    cause = " ".join(f"{type(error).__name__}: {error}".split())[:200]
    return f"internal error, not caused by your input ({cause}); please report it"
