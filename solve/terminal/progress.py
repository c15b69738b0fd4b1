"""Progress of long computations: reports by the code that computes, and display on standard error.

Tasks are nested, for example a grid in a point in a sweep. Each task counts only its own parts. Without a
listener, the overhead is negligible."""

import math
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, NamedTuple

TERMINAL_DELAY, TERMINAL_INTERVAL = 1.0, 0.25
"""Seconds until the progress line appears on a terminal, and seconds between two updates of this line. Chosen
by judgement."""

LOG_DELAY, MAX_LOG_INTERVAL = 10.0, 60.0
"""Seconds until the first line in a file or pipe, and largest interval between two lines. The interval equals
the elapsed time, up to this limit. Chosen by judgement."""


class Task:
    """Task that consists of `total` parts; `total` is None if the number of parts is unknown.

    even: whether the parts take about equal times, so that the remaining time can be extrapolated."""

    def __init__(self, what: str, total: float | None, even: bool, report: Callable[[], None]):
        self.what, self.total, self.even = what, total, even
        self.done, self.under_way, self.started = 0.0, 0.0, time.monotonic()
        self._report = report

    def add(self, parts: float = 1) -> None:
        """Count further parts as done."""
        self.done += parts
        self._report()

    def step(self, what: str) -> None:
        """Start the next part, named `what`, of a task with unequal parts."""
        self.what = what
        self.add()

    def fraction(self, inner: float) -> float | None:
        """Completed fraction of the task; None if it is unknown. inner: completed fraction of the current
        parts."""
        if not self.total:
            return None
        return min((self.done + inner * self.under_way) / self.total, 1.0)

    def text(self, inner: float) -> str:
        """Description of the task, with the number of completed parts."""
        if self.total is None:
            return self.what
        if not self.even:
            return f"{self.what} (step {self.done:.0f} of {self.total:.0f})"
        done = min(self.done + inner * self.under_way, self.total)
        return f"{math.floor(done)} of {self.total:.0f} {self.what}"


class Status(NamedTuple):
    """Progress as text, and completed fraction. `fraction` is None if it is unknown."""

    text: str
    fraction: float | None


class Tracker:
    """Current tasks, the outermost one first.

    reports: number of reports received. listener: function that is called with the tracker at each report.
    idle: function that is called when the last task ends."""

    def __init__(self, listener: Callable[["Tracker"], object] | None = None):
        self.tasks: list[Task] = []
        self.reports, self.listener = 0, listener
        self.idle: Callable[[], object] = lambda: None

    def report(self) -> None:
        """Count a report and call the listener."""
        self.reports += 1
        if self.listener:
            self.listener(self)

    def status(self, now: float) -> Status | None:
        """Progress and estimated remaining time at the time `now` (monotonic clock); None if there is no
        task."""
        tasks = list(self.tasks)
        if not tasks:
            return None
        texts, inner, remaining, known = [], 0.0, "", None
        for task, outer in zip(tasks[::-1], [*tasks[-2::-1], None], strict=True):
            # Of nested tasks that count the same unit, only the outer one is shown.
            if outer is None or outer.what != task.what or outer.total is None:
                texts.append(task.text(inner))
            fraction = task.fraction(inner)
            inner = fraction or 0.0
            if fraction and task.even:
                known, left = fraction, (now - task.started) * (1 - fraction) / fraction
                remaining = f", about {duration(left)} to go"
            elif remaining and not task.even:
                remaining = f"{remaining.removesuffix(' in this step')} in this step"
        elapsed = duration(max(now - tasks[0].started, 0.0))
        return Status(f"{elapsed} so far{remaining}: {', '.join(texts[::-1])}", known)


def duration(seconds: float) -> str:
    """Duration as text.

    >>> [duration(seconds) for seconds in (4.6, 99, 100, 7200)]
    ['5 s', '99 s', '2 min', '2.0 h']
    """
    if seconds < 99.5:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5970 else f"{seconds / 3600:.1f} h"


_tracker: ContextVar[Tracker | None] = ContextVar("tracker", default=None)


@contextmanager
def listen(listener: Callable[[Tracker], object] | None = None) -> Iterator[Tracker]:
    """Context manager that tracks the progress reported in this thread.

    Parameters
    ----------
    listener : callable, optional
        Function that is called with the tracker at each report. If it is omitted, an enclosing tracker is
        reused.

    Yields
    ------
    Tracker
    """
    tracker = _tracker.get() if listener is None else None
    if tracker is not None:
        yield tracker
        return
    tracker = Tracker(listener)
    token = _tracker.set(tracker)
    try:
        yield tracker
    finally:
        _tracker.reset(token)


@contextmanager
def steps(total: int) -> Iterator[Callable[[str], None]]:
    """Context manager for a task of `total` steps of different duration. It yields a function that starts the
    next step; its argument is the name of the step."""
    with task("", total, even=False) as uneven:
        yield uneven.step


@contextmanager
def task(what: str, total: float | None = None, even: bool = True) -> Iterator[Task]:
    """Context manager for a task of `total` parts; `total` is None if the number of parts is unknown. `what`
    names the parts, for example "speeds". even: whether the parts take about equal times."""
    tracker = _tracker.get()
    if tracker is None:
        yield Task(what, total, even, lambda: None)
        return
    opened = Task(what, total, even, tracker.report)
    tracker.tasks.append(opened)
    tracker.report()
    try:
        yield opened
    finally:
        if opened in tracker.tasks:
            del tracker.tasks[tracker.tasks.index(opened) :]
        if not tracker.tasks:
            tracker.idle()


@contextmanager
def subtask(what: str, parts: float = 1) -> Iterator[None]:
    """Context manager for a subtask. It completes `parts` parts of the innermost task if that task counts
    `what`."""
    counting = _innermost(what)
    if counting is None:
        yield
        return
    counting.under_way = parts
    yield
    counting.under_way = 0.0
    counting.add(parts)


def set_total(what: str, done: float, total: Callable[[], float]) -> None:
    """Set the number of completed parts and the expected total of the innermost task, if that task counts
    `what`."""
    counting = _innermost(what)
    if counting is not None:
        counting.total, counting.done = max(total(), done), done
        counting.add(0)


def _innermost(what: str) -> Task | None:
    tracker = _tracker.get()
    innermost = tracker.tasks[-1] if tracker and tracker.tasks else None
    return innermost if innermost is not None and innermost.what == what else None


@contextmanager
def show_progress(name: str) -> Iterator[None]:
    """Context manager that shows the progress of long computations on standard error.

    On a terminal, a line is shown that disappears at the end. A file or pipe receives a few lines.

    Parameters
    ----------
    name : str
        Name of the program. Each line in a file or pipe begins with this name.
    """
    with listen() as tracker:
        line, ended = _ProgressLine(), threading.Event()
        tracker.idle = line.clear
        thread = threading.Thread(target=_show, args=(name, tracker, line, ended), daemon=True)
        thread.start()
        try:
            yield
        finally:
            ended.set()
            thread.join()
            tracker.idle = lambda: None
            line.clear()


def _show(name: str, tracker: Tracker, line: "_ProgressLine", ended: threading.Event) -> None:
    is_terminal, started = sys.stderr.isatty(), time.monotonic()
    interval = TERMINAL_DELAY if is_terminal else LOG_DELAY
    while not ended.wait(interval):
        now = time.monotonic()
        interval = TERMINAL_INTERVAL if is_terminal else min(now - started, MAX_LOG_INTERVAL)
        if is_terminal:
            line.draw(tracker, now)
        elif status := tracker.status(now):
            print(f"{name}: {status.text}", file=sys.stderr, flush=True)


class _ProgressLine:
    """Line on a terminal that is redrawn in place."""

    def __init__(self) -> None:
        self._live: Any = None
        self._lock = threading.Lock()

    def draw(self, tracker: Tracker, now: float) -> None:
        from rich.console import Console
        from rich.live import Live
        from rich.progress_bar import ProgressBar
        from rich.table import Table
        from rich.text import Text

        with self._lock:
            status = tracker.status(now)
            if status is None:
                return
            row = Table.grid(padding=(0, 1))
            bar = ProgressBar(1.0, status.fraction or 0.0, 20, pulse=status.fraction is None)
            row.add_row(bar, Text(status.text, overflow="ellipsis", no_wrap=True))
            if self._live is None:
                console = Console(stderr=True)
                self._live = Live(
                    console=console,
                    transient=True,
                    auto_refresh=False,
                    redirect_stdout=False,
                    redirect_stderr=False,
                )
                self._live.start()
            self._live.update(row, refresh=True)

    def clear(self) -> None:
        """Remove the line."""
        with self._lock:
            live, self._live = self._live, None
            if live is not None:
                live.stop()
