"""The commands together."""

import importlib
import inspect
import os
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import typer
from typer.core import TyperCommand

from solve.commands.door import ReadOnce, door
from solve.errors import SolveError
from solve.progress import shown

COMMANDS = {
    "periodic": "Periodic vibration, its spectrum and its stability.",
    "floquet": "Floquet multipliers, exponents and the verdict of stability.",
    "compare": "Methods side by side: error, steps and time.",
    "sweep": "Periodic vibration and stability over many speeds, and values of parameters.",
    "bands": "Unstable bands between the lowest and the highest speed, their edges refined.",
    "chart": "Stability over two quantities, with named boundaries.",
    "critical": "Critical speeds: largest response, dominant multiplier, integer divisions of frequencies.",
    "transient": "Start-up from any state, until the periodic vibration is reached; run-up to a speed.",
    "sensitivity": "What matters most: derivatives by parameters and the speed, at one speed or at many.",
    "fit": "Parameters of the model from measured vibration, with intervals.",
    "branch": "Nonlinear orbits over the speed, followed through the speeds where they turn back.",
    "validity": "How far the linear model is off over speed, and up to which speed to trust it.",
    "report": "Everything about a model on one page of HTML.",
    "animate": "The mechanism in motion, its vibration magnified, as an animation or a picture.",
    "export": "The equations for another tool: MATLAB, C, or an FMU.",
    "frequencies": "Natural frequencies and mode shapes with the drive held still.",
}
"""Of `solve`: what `solve --help` says of each, the first line of its own help too."""

_UsageError: type[Exception] = typer.BadParameter.__mro__[1]
"""Of the Click that Typer brings along or depends on, whichever it is."""


class _Command(ReadOnce, TyperCommand):
    """A command whose flags of one value are given once."""


def application(
    name: str, commands: Sequence[Callable[..., None]], about: str | None, example: str
) -> typer.Typer:
    """Commands under a name, each with the flags of its groups; one alone needs no name of its own."""
    made = typer.Typer(
        name=name,
        help=about,
        epilog=f"For example: {example}",
        add_completion=name == "solve",
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
        context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    )
    for command in commands:
        epilog = f"For example: {example}" if len(commands) == 1 else None
        made.command(command.__name__, cls=_Command, epilog=epilog)(_with_flags(command))
    return made


def _with_flags(command: Callable[..., None]) -> Callable[..., None]:
    """The command with the flags of its groups; one that only stands in a list has none."""
    if not inspect.signature(command).parameters:
        return command
    from solve.commands.groups import flattened

    return flattened(command)


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
    exit status: 2 with one line on standard error for bad input."""
    return door(name, partial(called, commands=commands, name=name), arguments, SolveError)


def called(arguments: Sequence[str], commands: typer.Typer | None = None, name: str = "solve") -> int | None:
    """The same within a door that is already open."""
    # Pictures go into files, whatever is set for windows.
    os.environ["MPLBACKEND"] = "agg"
    commands = commands or solve_application(_command_in(arguments))
    try:
        with shown(name):
            return commands(list(arguments) or ["--help"], prog_name=name, standalone_mode=False)
    except _UsageError as error:
        _hint(error)
        raise


def _command_in(arguments: Sequence[str]) -> str | None:
    """The command that is called, or whose line a shell wants to complete."""
    line = os.environ.get("COMP_WORDS") or os.environ.get("_TYPER_COMPLETE_ARGS") or ""
    return next(iter([*arguments] or line.split()[1:]), None)


def _hint(error: Any) -> None:
    """Say how what belongs to the model is given, where an unknown flag may be meant for it."""
    unknown = getattr(error, "option_name", None) if "No such option" in error.message else None
    if unknown and any("--option" in each.opts for each in error.ctx.command.params):
        given = unknown.lstrip("-")
        message = error.format_message().rstrip(".")
        error.message = (
            f"{message}; what belongs to the model is --option {given}=VALUE or --set {given}=NUMBER"
        )
        error.possibilities = None
