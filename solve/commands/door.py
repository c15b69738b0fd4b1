"""How every command is read and how it ends: an exit status, and at most a few lines on standard error.

0: done, or whoever read the output has gone; 2: refused; 70: a fault of this program; 130: interrupted.
`derive` and `solve` each have this file, the same to the letter, since neither may import the other.
"""

import io
import os
import re
import signal
import sys
import threading
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout, suppress
from typing import Any, NoReturn

REFUSED, FAULT, INTERRUPTED = 2, 70, 130

_LONGEST = 900
"""Characters of a message; what was given may be longer than any screen."""

_TOO_LITTLE_MEMORY = "the memory of this machine does not suffice; ask for fewer points or steps"

_OURS = {"", "derive", "models", "solve"}
_NOT_INSTALLED = (
    "is not installed for this Python; in the folder of this program run: python -m pip install -e ."
)

_AGAIN = 0.3
"""Seconds after which an interruption comes again."""

_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069]")
"""Control characters, tab and line feed excepted: a terminal executes them (ECMA-48); and those that set
the direction of text or end lines, which change what is read (Unicode Standard Annex 9)."""

_STYLE = r"\x1b\[[0-9;]*m"
_OUTPUT = re.compile(rf"({_STYLE})|{_CONTROL.pattern}")
_ERROR_OUTPUT = re.compile(rf"({_STYLE}|\x1b\[(?:\?25[lh]|2K|1A)|\r)|{_CONTROL.pattern}")
"""Control characters; the group holds what Rich writes to a terminal: styles, and for progress on standard
error the cursor's moves."""


class ReadOnce:
    """Mixed into a command of Typer: a flag of one value that is given twice is refused."""

    def parse_args(self: Any, ctx: Any, args: list[str]) -> list[str]:
        import typer

        _, _, given = self.make_parser(ctx).parse_args(args=list(args))
        for flag, times in Counter(given).items():
            several = flag.multiple or getattr(flag, "is_flag", False) or flag.nargs != 1
            if times > 1 and not several and flag.param_type_name == "option":
                raise typer.BadParameter(f"{flag.opts[0]} is given {times} times; give it once", ctx=ctx)
        return super().parse_args(ctx, args)  # type: ignore[misc]


class _StreamError(Exception):
    """A standard stream cannot be written: `gone` where nobody reads it any more."""

    def __init__(self, error: OSError):
        super().__init__(f"standard output cannot be written: {error.strerror or error}")
        self.gone = isinstance(error, BrokenPipeError)


class _Stream(io.TextIOBase):
    """A standard stream that says itself when it fails, so that no library ends the process instead; one
    that was closed leads nowhere. What cannot be said on standard error is left unsaid."""

    def __init__(self, stream: Any, silent: bool):
        self._control = _ERROR_OUTPUT if silent else _OUTPUT
        self._stream = open(os.devnull, "w") if stream is None else stream  # noqa: SIM115
        self._silent = silent
        self._failure: _StreamError | None = None
        if hasattr(self._stream, "reconfigure"):
            self._stream.reconfigure(errors="replace")

    @property
    def encoding(self) -> str:  # type: ignore[override]
        return self._stream.encoding

    def isatty(self) -> bool:
        return self._stream.isatty()

    def fileno(self) -> int:
        return self._stream.fileno()

    def write(self, text: str) -> int:
        self._tried(self._stream.write, self._control.sub(_escape_unless_allowed, text))
        return len(text)

    def flush(self) -> None:
        self._tried(self._stream.flush)

    def close(self) -> None:
        """Nothing: the stream behind it stays open. A flush here would fail again, as Python ends."""

    def _tried(self, action: Callable[..., object], *text: str) -> None:
        try:
            action(*text)
        except OSError as error:
            self._failure = _StreamError(error)
            # What is left in its buffer goes nowhere, the flush when Python ends included.
            with suppress(OSError, ValueError):
                os.dup2(os.open(os.devnull, os.O_WRONLY), self._stream.fileno())
        # Once more each time: whoever writes may have passed over the first failure.
        if self._failure is not None and not self._silent:
            raise self._failure


def door(
    name: str,
    work: Callable[[Sequence[str]], int | None],
    arguments: Sequence[str],
    refusals: type[Exception],
) -> int:
    """Exit status of a command under the name that the user typed, which `work` carries out; what it raises
    of the class `refusals`, or Typer for what was mistyped, is said in one line."""
    with redirect_stdout(_Stream(sys.stdout, False)), redirect_stderr(_Stream(sys.stderr, True)):
        for argument in filter(_CONTROL.search, arguments):
            return _ended(name, f"'{_escaped(argument)}' contains a control character; write it without")
        interruptions: list[object] = []
        try:
            with _insistent(interruptions):
                status = work(arguments) or 0
                sys.stdout.flush()
            return _interrupted(name) if status == INTERRUPTED else status
        except KeyboardInterrupt:
            return _interrupted(name)
        except _StreamError as error:
            return 0 if error.gone else _ended(name, str(error))
        except Exception as error:
            # Libraries turn an interruption into errors of their own.
            if interruptions:
                return _interrupted(name)
            if isinstance(error, refusals):
                return _ended(name, str(error))
            if isinstance(error, MemoryError):
                return _ended(name, _TOO_LITTLE_MEMORY)
            if isinstance(error, ModuleNotFoundError) and (error.name or "").partition(".")[0] not in _OURS:
                return _ended(name, f"{error.name} {_NOT_INSTALLED}")
            if hasattr(error, "format_message"):
                return _misused(name, error)
            return _fault(name, error, "--debug" in arguments)


def _interrupted(name: str) -> int:
    # Python would end by the signal where it met the interruption within code made from a text.
    exec("")
    return _ended(name, "interrupted", INTERRUPTED)


@contextmanager
def _insistent(came: list[object]) -> Iterator[None]:
    """An interruption that a library passes over, as some do while they are imported, comes again until the
    command has ended; those that came are kept."""

    def interrupt(signal_number: object, _: object) -> None:
        came.append(signal_number)
        signal.setitimer(signal.ITIMER_REAL, _AGAIN)
        raise KeyboardInterrupt

    usual = {signal.SIGINT: signal.default_int_handler, getattr(signal, "SIGALRM", None): signal.SIG_DFL}
    main = threading.current_thread() is threading.main_thread()
    if not main or any(each is None or signal.getsignal(each) is not how for each, how in usual.items()):
        yield
        return
    unraisable = sys.unraisablehook

    def lost(raised: Any) -> None:
        # One that comes while Python tidies up would be shown with its traceback.
        if raised.exc_type is not KeyboardInterrupt:
            unraisable(raised)

    try:
        for each in usual:
            signal.signal(each, interrupt)
        sys.unraisablehook = lost
        yield
    finally:
        sys.unraisablehook = unraisable
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        for each, how in usual.items():
            signal.signal(each, how)


def enter(name: str, work: Callable[[Sequence[str]], int | None], refusals: type[Exception]) -> NoReturn:
    """The command as a program with the arguments that the user typed. What libraries warn of is left out,
    unless Python was asked for it: results that are doubtful say so themselves."""
    if not sys.warnoptions:
        warnings.simplefilter("ignore")
    status = door(name, work, sys.argv[1:], refusals)
    if status == INTERRUPTED and any(thread.daemon for thread in threading.enumerate()):
        # A thread that is left at work in a library could hang or crash where Python takes that down.
        with suppress(AttributeError, OSError, ValueError):
            sys.stdout.flush()
        os._exit(status)
    sys.exit(status)


def _misused(name: str, error: Any) -> int:
    """A flag or an argument that Typer does not understand."""
    command = error.ctx.command_path if error.ctx else name
    return _ended(name, f"{error.format_message().rstrip('.')}. See: {command} --help")


def _fault(name: str, error: Exception, debug: bool) -> int:
    if debug:
        import traceback

        traceback.print_exception(error)
    what = " ".join(f"{type(error).__name__}: {error}".split())[:200]
    message = f"a fault of this program, not of your input ({what}); --debug shows where, please report it"
    return _ended(name, message, FAULT)


def _escaped(text: str) -> str:
    """The text with control characters as JSON writes them, so that JSON stays what it is.

    >>> _escaped("a\x1b[31m")
    'a\\\\u001b[31m'
    """
    return _CONTROL.sub(lambda found: f"\\u{ord(found[0]):04x}", text)


def _escape_unless_allowed(found: re.Match[str]) -> str:
    return found[1] or _escaped(found[0])


def _ended(name: str, message: str, status: int = REFUSED) -> int:
    line = _escaped(" ".join(message.split()))
    if len(line) > _LONGEST:
        line = f"{line[: _LONGEST // 2]} … {line[-_LONGEST // 2 :]}"
    print(f"{name}: {line}", file=sys.stderr)
    return status
