"""What a command does with its result: picture, file, then tables or JSON, then warnings."""

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
from solve.views.proof import proof_printout
from solve.views.show import printout
from solve.views.style import Figure, drawn
from solve.views.tables import RenderableType, assembled, console, text

if TYPE_CHECKING:
    from solve.proof.result import Proof
    from solve.views.animation import Animation
    from solve.views.page import Report


class ContradictionError(Exception):
    """A proof and the ordinary verdict contradict each other: an internal error."""


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
    """Write and print what the flags ask for; standard output has the tables or the JSON, no more.

    Record, report and figure are the result's own where none is given; beside: further pictures, and
    texts. choices: what the user set beyond the case; notes come before the warnings. Raises
    ContradictionError, in the end, for a proof that the result contradicts.
    """
    picture, data = flags.files()
    pictures = {picture: figure or result.plot, **(beside or {})}
    with AtomicFiles() as files:
        for file, draw in pictures.items():
            if file is not None:
                made = draw()
                files.write(file, partial(_write_text, made) if isinstance(made, str) else drawn(made, file))
        if data is not None:
            files.write(data, writer(result, data))
    with _naming([file for file in (*pictures, data) if file is not None]):
        if flags.json:
            made = (record or result.record)()
            made |= {} if proof is None else {"proof": to_json(proof.record)}
            print(json.dumps(made, ensure_ascii=False, allow_nan=False))
        else:
            console().print(report() if report else printout(result, choices))
            if proof is not None:
                console().print(proof_printout(proof))
        sys.stdout.flush()
        print_warnings([*notes, *result.warnings, *([] if proof is None else proof.warnings)])
    if proof is not None and proof.contradicted:
        raise ContradictionError(f"{proof.verdict} is proved, but the ordinary verdict is {result.verdict}")


def _write_text(words: str, stream: BinaryIO) -> None:
    stream.write(words.encode())


def deliver_page(made: "Report", file: Path) -> None:
    """Write the page of a report to a checked file; print what was found, and what is missing on it."""
    write_atomic(file, made.write)
    with _naming([file]):
        for sentence in made.summary:
            console().print(sentence)
        sys.stdout.flush()
        headings = dict[str, list[str]]()
        for heading, reason in made.missing.items():
            headings.setdefault(reason, []).append(heading)
        missing = [f"left out: {', '.join(each)}: {reason}" for reason, each in headings.items()]
        doubts = []
        for said, headings in made.warnings.items():
            orbits = ", ".join(filter(None, map(made.orbit_of, headings)))
            doubts.append(f"{said} ({orbits})" if orbits else said)
        print_warnings([*missing, *doubts])


def deliver_animation(made: "Animation", file: Path) -> None:
    """Write the animation to a checked file; print what it shows."""
    made.save(file)
    with _naming([file]):
        console().print(made.title, soft_wrap=True)
        sys.stdout.flush()
        print_warnings(made.warnings)


@contextmanager
def _naming(written: Sequence[Path]) -> Iterator[None]:
    """List the written files on standard error, even if the output that follows fails."""
    try:
        yield
    finally:
        print_warnings([], written)


def print_warnings(warnings: Sequence[str], written: Sequence[Path] = ()) -> None:
    """What is doubtful, then which files were written, on standard error."""
    terminal = console(stderr=True)
    for warning in warnings:
        line = assembled(("warning: ", "bold yellow"), (warning, "yellow"))
        terminal.print(line, soft_wrap=not terminal.is_terminal)
    for file in written:
        terminal.print(text(f"wrote {file}", "dim"), soft_wrap=True)
