"""A program's commands, read by Typer."""

import os
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import typer
from typer.core import TyperCommand

from solve.terminal import progress
from solve.terminal.command_line import UniqueOptions

_UsageError: type[Exception] = typer.BadParameter.__mro__[1]
"""Of the Click that Typer brings along or depends on, whichever it is."""


class _Command(UniqueOptions, TyperCommand):
    """Command that refuses a second value for a single-value option."""


def application(
    program: str,
    listed: Mapping[str, str],
    load: Callable[[str], Callable[..., None]],
    about: str | None,
    example: str,
    called: str | None,
) -> typer.Typer:
    """The commands of a program, each with the flags of its groups, but those of several that are not called;
    one alone needs no name of its own."""
    epilog, alone = f"For example: {program} {example}", len(listed) == 1
    made = typer.Typer(
        name=program,
        help=about,
        epilog=epilog,
        add_completion=program == "solve",
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
        context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    )
    for name, words in listed.items():
        command = _with_flags(load(name)) if alone or name == called else _named(words)
        made.command(name, cls=_Command, epilog=epilog if alone else None)(command)
    return made


def _with_flags(command: Callable[..., None]) -> Callable[..., None]:
    from solve.commands.groups import flattened

    return flattened(command)


def _named(about: str) -> Callable[..., None]:
    """What stands in the list of commands for one that is not called."""

    def listed() -> None: ...

    listed.__doc__ = about
    return listed


def called(
    program: str, commands: Callable[[str | None], typer.Typer], arguments: Sequence[str]
) -> int | None:
    """Run the command named by the arguments, showing its progress."""
    # Pictures go into files, whatever is set for windows.
    os.environ["MPLBACKEND"] = "agg"
    loaded = commands(_command_in(arguments))
    try:
        with progress.show_progress(program):
            return loaded(list(arguments) or ["--help"], prog_name=program, standalone_mode=False)
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
