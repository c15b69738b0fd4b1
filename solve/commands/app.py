"""The commands together, and how they fail: one line on standard error, exit status 2."""

import importlib
import io
import os
import sys
from collections.abc import Callable, Sequence
from typing import Any

import typer

from solve.commands.groups import flattened
from solve.errors import SolveError

COMMANDS = {
    "periodic": "Periodic vibration, its spectrum and its stability.",
    "floquet": "Floquet multipliers, exponents and the verdict of stability.",
    "compare": "Methods side by side: error, steps and time.",
    "sweep": "Periodic vibration and stability over many speeds.",
    "bands": "Unstable bands between the lowest and the highest speed, their edges refined.",
    "chart": "Stability over two quantities, with named boundaries.",
    "critical": "Critical speeds: largest response, dominant multiplier, integer divisions of frequencies.",
    "frequencies": "Natural frequencies and mode shapes with the drive held still.",
}
"""Of `solve`: what `solve --help` says of each, the first line of its own help too."""

_UsageError: type[Exception] = typer.BadParameter.__mro__[1]
"""Of the Click that Typer brings along or depends on, whichever it is."""


def application(
    name: str, commands: Sequence[Callable[..., None]], about: str | None, example: str
) -> typer.Typer:
    """Commands under a name, each with the flags of its groups; one alone needs no name of its own."""
    made = typer.Typer(
        name=name,
        help=about,
        epilog=f"For example: {example}",
        add_completion=False,
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
        context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    )
    for command in commands:
        epilog = f"For example: {example}" if len(commands) == 1 else None
        made.command(command.__name__, epilog=epilog)(flattened(command))
    return made


def solve_application(called: str | None) -> typer.Typer:
    """The commands of `solve`; of these only the one that is called is loaded."""
    about = "Steady-state vibration and stability of systems with periodic coefficients."
    example = 'solve periodic cam --case 1 --speed "600 rpm" --plot cam.png'
    commands = {name: _named(name) for name in COMMANDS}
    if called in commands:
        commands[called] = getattr(importlib.import_module(f"solve.commands.{called}"), called)
    return application("solve", [*commands.values()], about, example)


def _named(name: str) -> Callable[..., None]:
    """What stands in the list of commands for one that is not called."""

    def listed() -> None: ...

    listed.__name__, listed.__doc__ = name, COMMANDS[name]
    return listed


def run(arguments: Sequence[str], commands: typer.Typer | None = None, name: str = "solve") -> int:
    """Run one of these commands, by default of `solve`, under the name that the user typed, and return its
    exit status."""
    commands = commands or solve_application(next(iter(arguments), None))
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
    try:
        status = commands(list(arguments) or ["--help"], prog_name=name, standalone_mode=False) or 0
        sys.stdout.flush()
        return status
    except SolveError as error:
        return _refused(str(error), name)
    except _UsageError as error:
        return _misused(error, name)
    except BrokenPipeError:
        # Whoever read the output has gone; nothing is left to say, the flush at exit included.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1


def _misused(error: Any, name: str) -> int:
    command = error.ctx.command_path if error.ctx else name
    message = error.format_message().rstrip(".")
    unknown = getattr(error, "option_name", None) if message.startswith("No such option") else None
    if unknown and any("--option" in each.opts for each in error.ctx.command.params):
        given = unknown.lstrip("-")
        message += f"; what belongs to the model is --option {given}=VALUE or --set {given}=NUMBER"
    return _refused(f"{message}. See: {command} --help", name)


def _refused(message: str, name: str) -> int:
    print(f"{name}: " + " ".join(message.split()), file=sys.stderr)
    return 2
