"""Parsing of a program's command lines with Typer."""

import os
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import typer
from typer.core import TyperCommand

from solve.terminal import progress
from solve.terminal.command_line import UniqueOptions

_UsageError: type[Exception] = typer.BadParameter.__mro__[1]
"""Usage error of Click, imported in a way that works whether Typer contains Click or depends on it."""


class _Command(UniqueOptions, TyperCommand):
    """Typer command that rejects a second value of a single-value option."""


def application(
    program: str,
    listed: Mapping[str, str],
    load: Callable[[str], Callable[..., None]],
    about: str | None,
    example: str,
    called: str | None,
) -> typer.Typer:
    """Return the Typer application of a program. If there are several commands, only the called one is
    loaded, with its flags. A single command needs no name on the command line."""
    epilog, single = f"For example: {program} {example}", len(listed) == 1
    app = typer.Typer(
        name=program,
        help=about,
        epilog=epilog,
        add_completion=program == "solve",
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
        context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    )
    for name, description in listed.items():
        command = _with_flags(load(name)) if single or name == called else _placeholder(description)
        app.command(name, cls=_Command, epilog=epilog if single else None)(command)
    return app


def _with_flags(command: Callable[..., None]) -> Callable[..., None]:
    from solve.commands.flattened import flattened

    return flattened(command)


def _placeholder(description: str) -> Callable[..., None]:
    """Return a function that stands in for a command in the listing of `--help`."""

    def placeholder() -> None: ...

    placeholder.__doc__ = description
    return placeholder


def run_command(
    program: str, commands: Callable[[str | None], typer.Typer], arguments: Sequence[str]
) -> int | None:
    """Run the command named by the arguments and show its progress."""
    # Pictures are written to files, whatever backend the environment sets.
    os.environ["MPLBACKEND"] = "agg"
    app = commands(_command_in(arguments))
    try:
        with progress.show_progress(program):
            return app(list(arguments) or ["--help"], prog_name=program, standalone_mode=False)
    except _UsageError as error:
        _add_hint(error, commands)
        raise


def _command_in(arguments: Sequence[str]) -> str | None:
    """Return the name of the called command or, during shell completion, of the command on the line that is
    being completed."""
    line = os.environ.get("COMP_WORDS") or os.environ.get("_TYPER_COMPLETE_ARGS") or ""
    return next(iter([*arguments] or line.split()[1:]), None)


def _add_hint(error: Any, commands: Callable[[str | None], typer.Typer]) -> None:
    """Add a hint to the message about an unknown flag: the other commands that have this flag or, if no other
    command has it, the flags that set options and parameters of the model."""
    flag = getattr(error, "option_name", None) if "No such option" in error.message else None
    if flag is None:
        return
    group = error.ctx.parent.command if error.ctx.parent else None
    others = [name for name in getattr(group, "commands", ()) if flag in _flags_of(name, commands)]
    hint = f"{flag} is a flag of {', '.join(others)}"
    if not others:
        if "--option" not in _flags(error.ctx.command):
            return
        name = flag.lstrip("-")
        hint = f"options and parameters of the model are set by --option {name}=VALUE or --set {name}=NUMBER"
    error.message = f"{error.format_message().rstrip('.')}; {hint}"
    error.possibilities = None


def _flags_of(name: str, commands: Callable[[str | None], typer.Typer]) -> set[str]:
    """Return the flags of the command with this name."""
    program: Any = typer.main.get_command(commands(name))
    return _flags(program.commands[name])


def _flags(command: Any) -> set[str]:
    return {flag for parameter in command.params for flag in parameter.opts}
