"""Run a command line, in this process or in another one, and check how it ends."""

import importlib
import io
import os
import random
import re
import signal
import subprocess
import sys
import warnings
from collections.abc import Iterator
from contextlib import chdir, contextmanager, redirect_stderr, redirect_stdout
from pathlib import Path
from typing import NamedTuple

from solve.terminal import progress
from solve.terminal.command_line import INTERRUPTED, run_cli
from tests.random_commands.lines import line

SECONDS = 60
"""Of this process's own time that a command may take without telling how far it is."""

_LONG, _TICK = 20, 10
"""Seconds after which a command that tells it is interrupted, and between two looks."""

_CHECKOUT = Path(__file__).resolve().parents[2]
_BESIDE = re.compile(
    r"wrote |compiling |(?!solve: |derive: )[a-z]\w*: |solve: finished points are stored in "
)
"""Beginnings of lines that are allowed besides a refusal."""

_USUAL = re.compile(r"warning: |wrote |compiling |[a-z]\w*: ")
"""How lines begin beside a result: those of derive with the name of the mechanism."""


class Ended(NamedTuple):
    """Exit status (None if the command took too long) and standard error."""

    status: int | None
    error: str


class TooLongError(BaseException):
    """Error that the command line does not catch."""


def random_commands(seed: int, count: int) -> Iterator[tuple[str, list[str]]]:
    """Return `count` command lines, which are the same for a seed in every run."""
    chance = random.Random(seed)
    return (line(chance) for _ in range(count))


def complaint(ended: Ended) -> str:
    """Return what is wrong with the end of a command, or an empty text."""
    lines = [line for line in ended.error.strip().splitlines() if " so far" not in line]
    if ended.status is None:
        return f"took more than {SECONDS} s"
    if ended.status not in (0, 1, 2, INTERRUPTED):
        return f"status {ended.status}: {lines[-1] if lines else ''}"
    refusals = [line for line in lines if not _BESIDE.match(line)]
    if ended.status == 2 and len(refusals) != 1:
        return f"{len(refusals)} lines of refusal"
    if ended.status == 0 and not all(map(_USUAL.match, lines)):
        return f"unexpected: {lines}"
    return ""


def inside(program: str, arguments: list[str], folder: Path) -> Ended:
    """Run the command in this process. Runtime warnings count as errors; other warnings are ignored, as in a
    program."""
    streams = io.StringIO(), io.StringIO()
    with chdir(folder), redirect_stdout(streams[0]), redirect_stderr(streams[1]), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        warnings.simplefilter("error", RuntimeWarning)
        try:
            with _watched():
                status: int | None = _run(program, arguments)
        except TooLongError:
            status = None
    return Ended(status, streams[1].getvalue())


def outside(program: str, arguments: list[str], folder: Path) -> Ended:
    """Run the command as a process."""
    command = [sys.executable, "-m", program, *arguments]
    environment = {**os.environ, "PYTHONPATH": str(_CHECKOUT), "PYTHONUTF8": "1"}
    try:
        done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, timeout=10 * SECONDS)
    except subprocess.TimeoutExpired:
        return Ended(None, "")
    return Ended(done.returncode, done.stderr.decode(errors="replace"))


def _run(program: str, arguments: list[str]) -> int:
    if program == "derive":
        from derive.command import run
        from derive.errors import DeriveError

        return run_cli("derive", run, arguments, DeriveError)
    module = "solve.commands.app" if program == "solve" else f"{program}.__main__"
    return importlib.import_module(module).run(arguments)


@contextmanager
def _watched() -> Iterator[None]:
    """Stop a command after a long time: by an interruption if it reports progress, otherwise by an exception
    when its time is over."""
    reports, used = 0, 0

    def tick(*_: object) -> None:
        nonlocal reports, used
        used += _TICK
        before, reports = reports, tracker.reports
        if reports > before and used >= _LONG:
            raise KeyboardInterrupt
        if used >= SECONDS:
            raise TooLongError

    before = signal.signal(signal.SIGPROF, tick)
    signal.setitimer(signal.ITIMER_PROF, _TICK, _TICK)
    try:
        with progress.listen() as tracker:
            yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)
