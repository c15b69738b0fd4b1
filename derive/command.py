"""The command `derive`: generate, check or show a mechanism's equations."""

import os
import re
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option
from typer.core import TyperCommand

from derive import freshness, loader
from derive.errors import MechanismFileError, UnwritableError, UsageError
from derive.loader import Source, require_own_name
from solve.terminal import progress
from solve.terminal.command_line import UniqueOptions

app = typer.Typer(
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)


class _Command(UniqueOptions, TyperCommand):
    """Typer command that rejects a second value of a single-value option."""


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
        Option(metavar="FILE", help="Write an example mechanism with its case file, for editing."),
    ] = None,
    out: Annotated[Path | None, Option(metavar="DIR", help="Folder of the generated modules.")] = None,
    check: Annotated[
        bool,
        Option("--check", help="Compare hashes of the given modules (default: all); exit 1 if one is stale."),
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
        raise UsageError("--full requires --check, and --show cannot be combined with --check or --full")
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
    """Write an example mechanism and its case file."""
    if has_more:
        raise UsageError(
            "--new takes one file name and no other arguments; to derive that file, run derive again "
            "without --new"
        )
    path, cases = new_mechanism(file)
    run = f"python -m derive {path} && python -m solve periodic {path}"
    typer.echo(f"wrote {path} and {cases}; next: {run}", err=True)


def _sources(models: list[str], every: bool, out: Path | None) -> list[Source]:
    if every == bool(models):
        raise UsageError(f"give one or more mechanisms, or --all (known: {', '.join(loader.names())})")
    found: dict[Path, Source] = {}
    for model in loader.names() if every else models:
        source = loader.find(model, out)
        other = found.setdefault(source.target.resolve(), source)
        if other is not source:
            same = other.path.resolve() == source.path.resolve()
            conflict = f"'{other.argument}' and '{model}' are " + ("the same file" if same else "two files")
            raise UsageError(
                f"{conflict}, for the generated module {source.target}; "
                + ("give it once" if same else "derive one of them with another --out")
            )
    return list(found.values())


def _text(source: Source, report: Callable[[str], object] = lambda _: None) -> str:
    """Derive the source code of the generated module. SymPy, whose import is slow, is first imported here.

    report: function that receives sentences about terms of the energies that the equations omit.
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
    """Yield the sources and report progress."""
    with progress.task("mechanisms", len(sources)):
        for source in sources:
            with progress.subtask("mechanisms"), progress.task(source.name):
                yield source


def _noted(source: Source, sentence: str) -> None:
    typer.echo(f"{source.name}: {sentence}", err=True)


def _is_stale(source: Source, full: bool) -> bool:
    """Print why a generated module is out of date, and return whether it is.

    full: whether to derive the module again and compare every byte.
    """
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


_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")

_MECHANISM = '''\
"""A table moved by an eccentric through a spring: replace it by your mechanism.

Equations:                python -m derive FILE
Vibration and stability:  python -m solve periodic FILE --plot NAME.png
Sliders in the browser:   python -m solve explore FILE
"""

from derive import Mechanism, cos, rate, sin


def mechanism():
    mine = Mechanism("NAME", "Table moved by an eccentric through a spring")

    # Coordinates are deviations from the motion of the rigid machine: name=(unit, meaning).
    twist, stretch = mine.coordinates(
        twist=("rad", "twist of the shaft"),
        stretch=("m", "displacement of the table relative to the eccentric"),
    )
    # Parameters have a unit, a meaning and a bound; their numbers are in NAME.toml.
    J, m, r = mine.parameters(
        J=("kg m^2", "moment of inertia of eccentric and flywheel", "> 0"),
        m=("kg", "mass of the table", "> 0"),
        r=("m", "eccentricity", "> 0"),
    )
    k1, k2, c1, c2, F = mine.parameters(
        k1=("N m/rad", "torsional stiffness of the shaft", "> 0"),
        k2=("N/m", "stiffness of the spring between eccentric and table", "> 0"),
        c1=("N m s/rad", "damping of the shaft", ">= 0"),
        c2=("N s/m", "damping of the spring", ">= 0"),
        F=("N", "largest load on the table, at phase 0"),
    )

    # mine.phase is the angle φ = Ωt of the drive; rate(…) is the derivative with respect to time.
    phi = mine.phase + twist
    x = r * cos(phi) + stretch
    mine.kinetic = (J * rate(phi) ** 2 + m * rate(x) ** 2) / 2
    mine.potential = (k1 * twist**2 + k2 * stretch**2) / 2
    mine.dissipation = (c1 * rate(twist) ** 2 + c2 * rate(stretch) ** 2) / 2
    mine.force(-F * (1 + cos(mine.phase)) / 2, along=x)

    # Further results, and the range in which the linear equations are valid.
    spring_force = k2 * stretch + c2 * rate(stretch)
    mine.output("spring_force", spring_force, "N", "force in the spring, tension positive")
    mine.trust(twist=0.05)

    # Lines of the animation. A length that occurs only there is a multiple of mine.metre.
    size = 0.02 * mine.metre
    left, right = x + size, x + 4 * size
    mine.sketch("eccentric", [(r * cos(mine.around), r * sin(mine.around))])
    mine.sketch("crank", [(0, 0), (r * cos(phi), r * sin(phi))])
    mine.sketch("table", [(left, -size), (right, -size), (right, size), (left, size), (left, -size)])
    return mine
'''

_CASES = """\
# Parameter values of NAME.py, each with its source and its unit, which may differ from that of the mechanism.
# The first case is the default; a case may state its speed.

[common.parameters]
J = { value = 0.02, unit = "kg m^2", source = "example" }
m = { value = 3, unit = "kg", source = "example" }
r = { value = 20, unit = "mm", source = "example" }
k1 = { value = 5e3, unit = "N m/rad", source = "example" }
k2 = { value = 400, unit = "N/mm", source = "example" }
c1 = { value = 0.5, unit = "N m s/rad", source = "example" }
c2 = { value = 60, unit = "N s/m", source = "example" }

[case.loaded]
speed = "600 rpm"
[case.loaded.parameters]
F = { value = 200, unit = "N", source = "example" }

[case.idle]
speed = "600 rpm"
[case.idle.parameters]
F = { value = 0, unit = "N", source = "example" }
"""


def new_mechanism(file: str) -> tuple[Path, Path]:
    """Write a complete example mechanism, which can be derived and solved, and its case file.

    Parameters
    ----------
    file : str
        Path that ends in .py; the case file has the same name with the ending .toml.

    Returns
    -------
    mechanism, cases : Path

    Raises
    ------
    MechanismFileError
        If the name is not a valid module name or one of the files exists. Existing files are not replaced.
    UnwritableError
        If the folder does not exist or cannot be written.
    """
    path = Path(file)
    if path.suffix != ".py" or not _NAME.fullmatch(path.stem):
        raise MechanismFileError(
            f"--new is '{file}'; give a name of letters, digits and _ that ends in .py, such as mine.py"
        )
    require_own_name(path)
    cases = path.with_suffix(".toml")
    for existing in (path, cases):
        if os.path.lexists(existing):
            raise MechanismFileError(
                f"{existing} exists, and --new does not replace files; give another name"
            )
    texts = {cases: _CASES, path: _MECHANISM}
    try:
        for target, text in texts.items():
            with target.open("x", encoding="utf-8", newline="\n") as stream:
                stream.write(text.replace("NAME", path.stem).replace("FILE", path.name))
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise UnwritableError(
            f"{path} cannot be written ({reason}); give a path in a writable folder"
        ) from error
    return path, cases
