"""Command lines: exit status, messages on standard error, and interruptions.

The exit status is 0 if the command is completed, or if the reader has closed the output pipe; 2 for invalid
input; 70 for an internal error; and 130 after an interruption. Each failure prints one line on standard
error."""

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
from typing import Any, NoReturn, TypeGuard

REFUSED, INTERNAL_ERROR, INTERRUPTED = 2, 70, 130
"""Exit statuses. The status of an interrupted process is 128 + SIGINT."""

_MAX_MESSAGE = 900
"""Largest number of characters of a message. Arguments quoted in a message may be much longer."""

_OUT_OF_MEMORY = "this machine has too little memory; request fewer points or steps"

_NOT_INSTALLED = (
    "is not installed for this Python; in the folder of this program run: python -m pip install -e ."
)

_REPEAT_INTERVAL = 0.3
"""Seconds between repetitions of an interruption."""

_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069]")
"""Pattern of control characters, which a terminal would execute (ECMA-48). Tab and line feed are excluded.
Characters that set the direction of text or end lines are included, because they change how text is displayed
(Unicode Standard Annex 9)."""

_STYLE = r"\x1b\[[0-9;]*m"
_OUTPUT = re.compile(rf"({_STYLE})|{_CONTROL.pattern}")
_ERROR_OUTPUT = re.compile(rf"({_STYLE}|\x1b\[(?:\?25[lh]|2K|1A)|\r)|{_CONTROL.pattern}")
"""Pattern of control characters on standard error. Its first group matches the sequences that Rich writes:
styles, and cursor movements of the progress line."""


class UniqueOptions:
    """Mixin for Typer commands. It rejects a second value of an option that takes a single value, and equal
    values of an option that may be repeated."""

    def parse_args(self: Any, ctx: Any, args: list[str]) -> list[str]:
        """Parse the arguments. Raises Typer's usage error for a repeated option or value."""
        values, _, given = self.make_parser(ctx).parse_args(args=list(args))
        for option, count in Counter(given).items():
            repeatable = option.multiple or getattr(option, "is_flag", False) or option.nargs != 1
            if count > 1 and not repeatable and option.param_type_name == "option":
                listed = ", with its values separated by commas" if "commas" in (option.help or "") else ""
                ctx.fail(f"{option.opts[0]} is given {count} times; give it once{listed}")
            if count > 1 and option.multiple:
                (text, most), *_ = Counter(values[option.name]).most_common(1)
                if most > 1:
                    ctx.fail(f"{option.opts[0]} {text} is given {most} times; give it once")
        return super().parse_args(ctx, args)  # type: ignore[misc]


class _StreamError(Exception):
    """Raised if a standard stream cannot be written.

    closed_by_reader: whether the reader has closed the pipe.
    """

    def __init__(self, error: OSError):
        super().__init__(f"standard output cannot be written: {error.strerror or error}")
        self.closed_by_reader = isinstance(error, BrokenPipeError)


class _Stream(io.TextIOBase):
    """Wrapper of a standard stream that escapes control characters and raises _StreamError.

    A closed stream (None) is replaced by the null device. If `silent`, failures are ignored."""

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
        self._attempt(self._stream.write, self._control.sub(_escape_unless_allowed, text))
        return len(text)

    def flush(self) -> None:
        self._attempt(self._stream.flush)

    def close(self) -> None:
        """Do nothing, so that the wrapped stream stays open and is not flushed again."""

    def _attempt(self, action: Callable[..., object], *text: str) -> None:
        try:
            action(*text)
        except OSError as error:
            self._failure = _StreamError(error)
            # Discard the remaining buffer, so that the flush at interpreter exit does not fail.
            with suppress(OSError, ValueError):
                os.dup2(os.open(os.devnull, os.O_WRONLY), self._stream.fileno())
        # The exception is raised on every call, because a library may have suppressed the first one.
        if self._failure is not None and not self._silent:
            raise self._failure


def run_cli(
    name: str,
    work: Callable[[Sequence[str]], int | None],
    arguments: Sequence[str],
    refusals: type[Exception],
) -> int:
    """Run a command and return its exit status.

    Parameters
    ----------
    name : str
        Name of the program as the user typed it. Messages begin with this name.
    work : callable
        Function of the arguments that runs the command and returns its exit status; None counts as 0.
    arguments : sequence of str
        Command-line arguments.
    refusals : type
        Exception class for invalid input. Its message is printed in one line, with exit status 2. Typer's
        usage errors are treated in the same way.
    """
    with redirect_stdout(_Stream(sys.stdout, False)), redirect_stderr(_Stream(sys.stderr, True)):
        for argument in filter(_CONTROL.search, arguments):
            return _fail(
                name,
                f"'{_escaped(argument)}' contains a control character; write the argument "
                "without control characters",
            )
        interruptions: list[object] = []
        try:
            with _repeat_sigint(interruptions):
                status = work(arguments) or 0
                sys.stdout.flush()
            return _interrupted(name) if status == INTERRUPTED else status
        except KeyboardInterrupt:
            return _interrupted(name)
        except _StreamError as error:
            return 0 if error.closed_by_reader else _fail(name, str(error))
        except Exception as error:
            # A library may convert an interruption into an exception of its own.
            if interruptions:
                return _interrupted(name)
            if isinstance(error, refusals):
                return _fail(name, str(error))
            if isinstance(error, MemoryError):
                return _fail(name, _OUT_OF_MEMORY)
            if _is_missing_library(error):
                return _fail(name, f"{error.name} {_NOT_INSTALLED}")
            if hasattr(error, "format_message"):
                return _usage_error(name, error)
            return _internal_error(name, error, "--debug" in arguments)


def main(name: str, work: Callable[[Sequence[str]], int | None], refusals: type[Exception]) -> NoReturn:
    """Run `sys.argv` as a program and exit with its status. For the parameters, see `run_cli`.

    Warnings of libraries are hidden, because results contain their own warnings. They are shown if Python was
    started with -W."""
    if not sys.warnoptions:
        warnings.simplefilter("ignore")
    status = run_cli(name, work, sys.argv[1:], refusals)
    if status == INTERRUPTED and any(thread.daemon for thread in threading.enumerate()):
        # At shutdown, a daemon thread that still runs library code could block or crash the interpreter.
        with suppress(AttributeError, OSError, ValueError):
            sys.stdout.flush()
        os._exit(status)
    sys.exit(status)


@contextmanager
def _repeat_sigint(received: list[object]) -> Iterator[None]:
    """Repeat an interruption until the block ends. Some libraries suppress interruptions while they are
    imported.

    received: list that collects the signal numbers."""

    def interrupt(signal_number: object, _: object) -> None:
        received.append(signal_number)
        signal.setitimer(signal.ITIMER_REAL, _REPEAT_INTERVAL)
        raise KeyboardInterrupt

    defaults = {signal.SIGINT: signal.default_int_handler, getattr(signal, "SIGALRM", None): signal.SIG_DFL}
    in_main_thread = threading.current_thread() is threading.main_thread()
    if not in_main_thread or any(
        number is None or signal.getsignal(number) is not handler for number, handler in defaults.items()
    ):
        yield
        return
    unraisable_hook = sys.unraisablehook

    def ignore_interruption(unraisable: Any) -> None:
        # Python would print the traceback of an interruption that is raised in a finaliser or callback.
        if unraisable.exc_type is not KeyboardInterrupt:
            unraisable_hook(unraisable)

    try:
        for number in defaults:
            signal.signal(number, interrupt)
        sys.unraisablehook = ignore_interruption
        yield
    finally:
        sys.unraisablehook = unraisable_hook
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        for number, handler in defaults.items():
            signal.signal(number, handler)


def _is_missing_library(error: Exception) -> TypeGuard[ModuleNotFoundError]:
    """Whether an error is caused by a missing module of another distribution."""
    if not isinstance(error, ModuleNotFoundError):
        return False
    return (error.name or "").partition(".")[0] not in ("", "derive", "models", "solve")


def _interrupted(name: str) -> int:
    # If an interruption has left code run by `exec`, Python ends by the signal. Another `exec` prevents this.
    exec("")
    return _fail(name, "interrupted", INTERRUPTED)


def _usage_error(name: str, error: Any) -> int:
    """Report an option or argument that Typer does not accept."""
    command = error.ctx.command_path if error.ctx else name
    message = error.format_message().rstrip(".")
    options = [option for each in error.ctx.command.params for option in each.opts] if error.ctx else []
    assignment = re.search(r"unexpected extra argument\S* \(.*?(\w+)=(?!\S*:)", message)
    if assignment and "--set" in options:
        flag = f"--{assignment[1]}"
        remedy = f"{flag} VALUE" if flag in options else f"--set {assignment[1]}=NUMBER"
        message += f"; to change {assignment[1]}, use {remedy}"
    return _fail(name, f"{message}{'' if message.endswith('?') else '.'} See: {command} --help")


def _internal_error(name: str, error: Exception, debug: bool) -> int:
    if debug:
        import traceback

        traceback.print_exception(error)
    cause = " ".join(f"{type(error).__name__}: {error}".split())[:200]
    message = f"internal error, not caused by your input ({cause}); --debug shows where; please report it"
    return _fail(name, message, INTERNAL_ERROR)


def _escaped(text: str) -> str:
    """Escape control characters in a text as in JSON, so that JSON remains valid.

    >>> _escaped("a\x1b[31m")
    'a\\\\u001b[31m'
    """
    return _CONTROL.sub(lambda match: f"\\u{ord(match[0]):04x}", text)


def _escape_unless_allowed(match: re.Match[str]) -> str:
    return match[1] or _escaped(match[0])


def _fail(name: str, message: str, status: int = REFUSED) -> int:
    """Print one line on standard error and return the exit status."""
    line = _escaped(" ".join(message.split()))
    if len(line) > _MAX_MESSAGE:
        line = f"{line[: _MAX_MESSAGE // 2]} … {line[-_MAX_MESSAGE // 2 :]}"
    print(f"{name}: {line}", file=sys.stderr)
    return status
