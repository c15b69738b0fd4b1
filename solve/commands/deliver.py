"""What a command does with its result: picture, file, then tables or JSON, then warnings."""

import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from solve.commands.groups import Results
from solve.results.contents import Contents
from solve.results.report import RenderableType
from solve.results.save import Whole, writer
from solve.results.style import Figure, drawn


def deliver_result(
    flags: Results,
    result: Any,
    choices: Sequence[str],
    notes: Sequence[str] = (),
    **otherwise: Callable[[], Any],
) -> None:
    """`deliver` a result by its own warnings, record, report, plot and contents, but for what is given
    `otherwise`. choices: what the user set beyond the case; notes come before the warnings."""
    own = {"record": result.record, "report": lambda: result.report(choices), "figure": result.plot}
    deliver(flags, [*notes, *result.warnings], **{**own, "contents": result.contents, **otherwise})


def deliver(
    results: Results,
    warnings: Sequence[str],
    record: Callable[[], dict[str, Any]],
    report: Callable[[], RenderableType],
    figure: Callable[[], Figure],
    contents: Callable[[], Contents],
) -> None:
    """Write and print what the flags ask for; standard output has the tables or the JSON, no more."""
    from rich.console import Console

    picture, data = results.files()
    with Whole() as files:
        if picture is not None:
            files.write(picture, drawn(figure(), picture))
        if data is not None:
            files.write(data, writer(contents(), data))
    if results.json:
        print(json.dumps(record(), ensure_ascii=False, allow_nan=False))
    else:
        Console(highlight=False).print(report())
    sys.stdout.flush()
    _print_warnings(warnings, [file for file in (picture, data) if file is not None])


def _print_warnings(warnings: Sequence[str], written: Sequence[Path]) -> None:
    from rich.console import Console
    from rich.text import Text

    console = Console(stderr=True, highlight=False)
    for warning in warnings:
        line = Text("warning: ", style="bold yellow").append(warning, style="not bold")
        console.print(line, soft_wrap=not console.is_terminal)
    for file in written:
        console.print(Text(f"wrote {file}", style="dim"), soft_wrap=True)
