"""The command `derive`: generate, check or show a mechanism's equations."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option
from typer.core import TyperCommand

from derive import freshness, loader
from derive.errors import UsageError
from derive.loader import Source
from solve.terminal import progress
from solve.terminal.command_line import UniqueOptions

app = typer.Typer(
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)


class _Command(UniqueOptions, TyperCommand):
    """Command that rejects a second value of a single-value option."""


def run(arguments: Sequence[str]) -> int | None:
    """Run the command and return its exit status: 1 if a check fails."""
    with progress.show_progress("derive"):
        return app(list(arguments), prog_name="derive", standalone_mode=False)


@app.command(cls=_Command)
def derive(
    models: Annotated[
        list[str] | None, Argument(metavar="MODEL...", help="Names, or paths that end in .py.")
    ] = None,
    every: Annotated[bool, Option("--all", help="All mechanisms of the package.")] = False,
    new: Annotated[
        str | None,
        Option(metavar="FILE", help="Write a first mechanism, with its case file, that you edit."),
    ] = None,
    out: Annotated[Path | None, Option(metavar="DIR", help="Folder of the generated modules.")] = None,
    check: Annotated[
        bool,
        Option("--check", help="Compare hashes only, by default of all modules; exit 1 if one is stale."),
    ] = False,
    full: Annotated[bool, Option("--full", help="With --check: regenerate and show the difference.")] = False,
    show: Annotated[
        bool, Option("--show", help="Print the linearised equations as LaTeX; write nothing.")
    ] = False,
    numbers: Annotated[
        str | None, Option(metavar="CASE", help="With --show: insert the parameters of a case.")
    ] = None,
    debug: Annotated[bool, Option("--debug", help="Show the traceback of an internal error.")] = False,
) -> None:
    """Derive the equations of motion and generate CasADi code for them."""
    if new is not None:
        _begin(new, bool(models) or every or check or show or out is not None)
        return
    if (full and not check) or (show and check):
        raise UsageError("--full requires --check, and --show excludes both")
    if numbers is not None and not show:
        raise UsageError("--numbers requires --show")
    sources = _sources(models or [], every or (check and not models), out)
    if show:
        _show(sources, numbers)
    elif check:
        raise typer.Exit(1 if sum(_is_stale(source, full) for source in _reported(sources)) else 0)
    else:
        _write(sources)


def _begin(file: str, has_more: bool) -> None:
    """Write a first mechanism and its case file."""
    if has_more:
        raise UsageError(
            "--new takes one file name and no other arguments; to derive that file, run derive again "
            "without --new"
        )
    from derive.new import new_mechanism

    path, cases = new_mechanism(file)
    run = f"python -m derive {path} && python -m solve periodic {path}"
    typer.echo(f"wrote {path} and {cases}; next: {run}", err=True)


def _sources(models: list[str], every: bool, out: Path | None) -> list[Source]:
    if every == bool(models):
        raise UsageError(f"give one or more mechanisms, or --all (known: {', '.join(loader.names())})")
    return [loader.find(model, out) for model in (loader.names() if every else models)]


def _text(source: Source, report: Callable[[str], object] = lambda _: None) -> str:
    """Derived text of the generated module; SymPy is imported only here, because its import is slow.

    report: callback for each sentence on terms of the statement that the equations ignore.
    """
    if source.name == loader.BEAM_ELEMENTS:
        from derive.beam import beam_elements_text

        return beam_elements_text(source.sha256, source.command)
    from derive.structure_text import generated_text

    mechanism = loader.load(source)
    with loader.located(source, mechanism):
        return generated_text(mechanism, source.sha256, source.command, report)


def _write(sources: list[Source]) -> None:
    for source in sources:
        if source.installed:
            raise UsageError(
                f"{source.name} belongs to the installed package, whose files are not changed; give "
                "--out DIR, or work in a checkout"
            )
    for source in _reported(sources):
        freshness.write(source.target, _text(source, partial(_noted, source)))
        typer.echo(f"wrote {source.target}", err=True)


def _reported(sources: list[Source]) -> Iterator[Source]:
    """Sources, one after another, with progress reports."""
    with progress.task("mechanisms", len(sources)):
        for source in sources:
            with progress.subtask("mechanisms"), progress.task(source.name):
                yield source


def _noted(source: Source, sentence: str) -> None:
    typer.echo(f"{source.name}: {sentence}", err=True)


def _is_stale(source: Source, full: bool) -> bool:
    """Whether a generated module is out of date; the reason is printed. full: compare every byte."""
    present = source.target.read_text("utf-8", errors="replace") if source.target.is_file() else ""
    why = freshness.staleness(present, source.sha256) if present else "it is missing"
    if full:
        difference = freshness.difference(source.target, present, _text(source))
        typer.echo(difference, nl=False)
        why = why or ("it differs from what derive would write" if difference else "")
    if why:
        typer.echo(f"{source.target} is stale: {why}. Run: python -m derive {source.renewal}")
    return bool(why)


def _show(sources: list[Source], case: str | None) -> None:
    from derive.show import case_numbers, elements, equations

    for source in _reported(sources):
        if source.name == loader.BEAM_ELEMENTS:
            typer.echo(elements())
            continue
        mechanism = loader.load(source)
        numbers = case_numbers(source.cases, case, mechanism) if case is not None else {}
        with loader.located(source, mechanism):
            typer.echo(equations(mechanism, numbers))
