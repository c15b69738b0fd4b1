"""How far long work is: reported where it is done, shown on standard error.

Stages lie within each other, a grid within a point within a curve over speed, and each knows its own parts
alone. What nobody listens to costs next to nothing. `derive` and `solve` each have this file, the same to the
letter, since neither may import the other.
"""

import math
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, NamedTuple

DRAWN_AFTER, DRAWN_EVERY = 1.0, 0.25
"""Seconds after which a terminal shows how far work is, and between two pictures."""

LINE_AFTER, LONGEST_PAUSE = 10.0, 60.0
"""Seconds after which a file or a pipe gets its first line; the next comes after twice the time, and then
each after this pause."""


class Stage:
    """Work of which so many parts are done, of a total if that is known.

    even: whether parts take about equal times, so that those done tell when the others will be.
    """

    def __init__(self, what: str, total: float | None, even: bool, report: Callable[[], None]):
        self.what, self.total, self.even = what, total, even
        self.done, self.under_way, self.begun = 0.0, 0.0, time.monotonic()
        self._report = report

    def add(self, parts: float = 1) -> None:
        """So many more are done."""
        self.done += parts
        self._report()

    def step(self, what: str) -> None:
        """The next of uneven parts begins, under its own name."""
        self.what = what
        self.add()

    def fraction(self, within: float) -> float | None:
        """What is done of the total, with a fraction of the parts under way; None where that is unknown."""
        if not self.total:
            return None
        return min((self.done + within * self.under_way) / self.total, 1.0)

    def text(self, within: float) -> str:
        if self.total is None:
            return self.what
        if not self.even:
            return f"{self.what} (step {self.done:.0f} of {self.total:.0f})"
        done = min(self.done + within * self.under_way, self.total)
        return f"{math.floor(done)} of {self.total:.0f} {self.what}"


class Far(NamedTuple):
    """How far work is, in words, and what is done of it, None where nobody knows."""

    text: str
    fraction: float | None


class Work:
    """What is under way: its stages, the outermost first. reports: how many came since it
    began; listener is called each time, and `idle` when nothing is under way any more."""

    def __init__(self, listener: Callable[["Work"], object] | None = None):
        self.stages: list[Stage] = []
        self.reports, self.listener = 0, listener
        self.idle: Callable[[], object] = lambda: None

    def report(self) -> None:
        self.reports += 1
        if self.listener:
            self.listener(self)

    def far(self, now: float) -> Far | None:
        """How far it is at a time of the monotonic clock, and how long it will still take; None where nothing
        is under way."""
        stages = list(self.stages)
        if not stages:
            return None
        parts, within, rest, known = [], 0.0, "", None
        for stage, outer in zip(stages[::-1], [*stages[-2::-1], None], strict=True):
            # Two that count the same are named by the outer one, of which the inner one is a part.
            if outer is None or outer.what != stage.what or outer.total is None:
                parts.append(stage.text(within))
            part = stage.fraction(within)
            within = part or 0.0
            if part and stage.even:
                known, left = part, (now - stage.begun) * (1 - part) / part
                rest = f", about {duration(left)} to go"
            elif rest and not stage.even:
                rest = f"{rest.removesuffix(' in this step')} in this step"
        return Far(
            f"{duration(max(now - stages[0].begun, 0.0))} so far{rest}: {', '.join(parts[::-1])}", known
        )


def duration(seconds: float) -> str:
    """A time in words.

    >>> [duration(seconds) for seconds in (4.6, 99, 100, 7200)]
    ['5 s', '99 s', '2 min', '2.0 h']
    """
    if seconds < 99.5:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5970 else f"{seconds / 3600:.1f} h"


_heard: ContextVar[Work | None] = ContextVar("heard", default=None)


@contextmanager
def heard(listener: Callable[[Work], object] | None = None) -> Iterator[Work]:
    """What is reported within, in this thread; the listener is called with it each time. Where somebody
    listens already, a call without listener gives the same."""
    work = _heard.get() if listener is None else None
    if work is not None:
        yield work
        return
    work = Work(listener)
    token = _heard.set(work)
    try:
        yield work
    finally:
        _heard.reset(token)


@contextmanager
def steps(total: int) -> Iterator[Callable[[str], None]]:
    """Work with so many parts that have little in common; each begins with a call of its name."""
    with stage("", total, even=False) as made:
        yield made.step


@contextmanager
def stage(what: str, total: float | None = None, even: bool = True) -> Iterator[Stage]:
    """Work with so many parts, such as "speeds", that take about equal times."""
    work = _heard.get()
    if work is None:
        yield Stage(what, total, even, lambda: None)
        return
    made = Stage(what, total, even, work.report)
    work.stages.append(made)
    work.report()
    try:
        yield made
    finally:
        if made in work.stages:
            del work.stages[work.stages.index(made) :]
        if not work.stages:
            work.idle()


@contextmanager
def part(what: str, parts: float = 1) -> Iterator[None]:
    """What is done within makes so many parts of the innermost stage, if that counts these."""
    counting = _counting(what)
    if counting is None:
        yield
        return
    counting.under_way = parts
    yield
    counting.under_way = 0.0
    counting.add(parts)


def foreseen(what: str, done: float, total: Callable[[], float]) -> None:
    """For the innermost stage, if it counts these: what is done, and the total as it is foreseen now."""
    counting = _counting(what)
    if counting is not None:
        counting.total, counting.done = max(total(), done), done
        counting.add(0)


def _counting(what: str) -> Stage | None:
    work = _heard.get()
    innermost = work.stages[-1] if work and work.stages else None
    return innermost if innermost is not None and innermost.what == what else None


@contextmanager
def shown(name: str) -> Iterator[None]:
    """What is reported within is shown on standard error, under the name of the program, where it takes long:
    on a terminal in a line that disappears, else in lines, few and fewer."""
    with heard() as work:
        screen, ended = _Screen(), threading.Event()
        work.idle = screen.clear
        loop = threading.Thread(target=_show, args=(name, work, screen, ended), daemon=True)
        loop.start()
        try:
            yield
        finally:
            ended.set()
            loop.join()
            work.idle = lambda: None
            screen.clear()


def _show(name: str, work: Work, screen: "_Screen", ended: threading.Event) -> None:
    terminal, begun = sys.stderr.isatty(), time.monotonic()
    pause = DRAWN_AFTER if terminal else LINE_AFTER
    while not ended.wait(pause):
        now = time.monotonic()
        pause = DRAWN_EVERY if terminal else min(now - begun, LONGEST_PAUSE)
        if terminal:
            screen.draw(work, now)
        elif far := work.far(now):
            print(f"{name}: {far.text}", file=sys.stderr, flush=True)


class _Screen:
    """A line of a terminal that is drawn over itself."""

    def __init__(self) -> None:
        self._live: Any = None
        self._lock = threading.Lock()

    def draw(self, work: Work, now: float) -> None:
        from rich.console import Console
        from rich.live import Live
        from rich.progress_bar import ProgressBar
        from rich.table import Table
        from rich.text import Text

        with self._lock:
            far = work.far(now)
            if far is None:
                return
            line = Table.grid(padding=(0, 1))
            bar = ProgressBar(1.0, far.fraction or 0.0, 20, pulse=far.fraction is None)
            line.add_row(bar, Text(far.text, overflow="ellipsis", no_wrap=True))
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
            self._live.update(line, refresh=True)

    def clear(self) -> None:
        """Leave nothing on the terminal."""
        with self._lock:
            live, self._live = self._live, None
            if live is not None:
                live.stop()
