"""Output of a command: first files, then tables or JSON, then warnings."""

import json
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from solve.commands.groups import Results
from solve.results.contents import to_json
from solve.results.files import AtomicFiles, write_atomic
from solve.results.result import Result
from solve.results.save import writer
from solve.views.show import printout
from solve.views.stability import proof_printout
from solve.views.style import Figure, drawn
from solve.views.tables import RenderableType, assembled, console, text

if TYPE_CHECKING:
    from solve.proof.result import Proof
    from solve.views.animation import Animation
    from solve.views.page import Report


class ContradictionError(Exception):
    """Contradiction between the proved and the numerical verdict: an internal error."""


def deliver_result(
    flags: Results,
    result: Result,
    choices: Sequence[str],
    notes: Sequence[str] = (),
    *,
    record: Callable[[], dict[str, Any]] | None = None,
    report: Callable[[], RenderableType] | None = None,
    figure: Callable[[], Figure] | None = None,
    beside: Mapping[Path, Callable[[], Figure | str]] | None = None,
    proof: "Proof | None" = None,
) -> None:
    """Write and print the output that the flags request. Standard output contains only tables or JSON.

    `record`, `report` and `figure` return the JSON object, the tables and the picture; by default, the
    methods of the result are used. `beside` maps further files to functions that return the content of a
    file: a figure or a text. `choices` are the texts of --set and --option, and `notes` are printed before
    the warnings. `proof` is also written to the file of --save. If the proof contradicts the result,
    ContradictionError is raised at the end.
    """
    picture, data = flags.files()
    pictures = {picture: figure or result.plot, **(beside or {})}
    with AtomicFiles() as files:
        for file, draw in pictures.items():
            if file is not None:
                content = draw()
                write = partial(_write_text, content) if isinstance(content, str) else drawn(content, file)
                files.write(file, write)
        if data is not None:
            files.write(data, writer(result if proof is None else proof, data))
    with _listing([file for file in (*pictures, data) if file is not None]):
        if flags.json:
            values = (record or result.record)()
            values |= {} if proof is None else {"proof": to_json(proof.record)}
            # On Windows, a pipe may have an older encoding that lacks Greek letters.
            escaped = not (sys.stdout.encoding or "").lower().replace("-", "").startswith("utf8")
            print(json.dumps(values, ensure_ascii=escaped, allow_nan=False))
        else:
            console().print(report() if report else printout(result, choices))
            if proof is not None:
                console().print(proof_printout(proof))
        sys.stdout.flush()
        print_warnings([*notes, *result.warnings, *([] if proof is None else proof.warnings)])
    if proof is not None and proof.contradicted:
        raise ContradictionError(
            f'the proved verdict is "{proof.verdict}", but the numerical verdict is "{result.verdict}"'
        )


def _write_text(text: str, stream: BinaryIO) -> None:
    stream.write(text.encode())


def deliver_page(report: "Report", file: Path) -> None:
    """Write a report to a checked file, and print its findings, its missing sections and its warnings."""
    write_atomic(file, report.write)
    with _listing([file]):
        for sentence in report.summary:
            console().print(sentence)
        sys.stdout.flush()
        headings = dict[str, list[str]]()
        for heading, reason in report.missing.items():
            headings.setdefault(reason, []).append(heading)
        missing = [f"omitted: {', '.join(names)}: {reason}" for reason, names in headings.items()]
        warnings = []
        for warning, names in report.warnings.items():
            orbits = ", ".join(filter(None, map(report.orbit_of, names)))
            warnings.append(f"{warning} ({orbits})" if orbits else warning)
        print_warnings([*missing, *warnings])


def deliver_animation(animation: "Animation", file: Path) -> None:
    """Write an animation to a checked file, and print its title."""
    animation.save(file)
    with _listing([file]):
        console().print(animation.title, soft_wrap=True)
        sys.stdout.flush()
        print_warnings(animation.warnings)


@contextmanager
def _listing(written: Sequence[Path]) -> Iterator[None]:
    """Context manager that lists the written files on standard error, even if the block raises."""
    try:
        yield
    finally:
        print_warnings([], written)


def print_warnings(warnings: Sequence[str], written: Sequence[Path] = ()) -> None:
    """Print warnings, and the names of written files, on standard error."""
    terminal = console(stderr=True)
    for warning in warnings:
        line = assembled(("warning: ", "bold yellow"), (warning, "yellow"))
        terminal.print(line, soft_wrap=not terminal.is_terminal)
    for file in written:
        terminal.print(text(f"wrote {file}", "dim"), soft_wrap=True)
