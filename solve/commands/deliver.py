"""What a command does with its result: picture, file, then tables or JSON, then warnings."""

import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from solve.commands.groups import Results
from solve.results.contents import Contents
from solve.results.report import RenderableType
from solve.results.save import save
from solve.results.style import Figure, save_figure


def deliver(
    results: Results,
    warnings: Sequence[str],
    record: Callable[[], dict[str, Any]],
    report: Callable[[], RenderableType],
    figure: Callable[[], Figure],
    contents: Callable[[], Contents],
) -> None:
    """Write and print what the flags ask for; standard output has the tables or the JSON, no more."""
    picture, data = results.files()
    written = []
    if picture is not None:
        save_figure(figure(), picture)
        written.append(picture)
    if data is not None:
        save(contents(), data)
        written.append(data)
    if results.json:
        print(json.dumps(record(), ensure_ascii=False, allow_nan=False))
    else:
        from rich.console import Console

        Console(highlight=False).print(report())
    sys.stdout.flush()
    _tell(warnings, written)


def _tell(warnings: Sequence[str], written: Sequence[Path]) -> None:
    from rich.console import Console
    from rich.text import Text

    console = Console(stderr=True, highlight=False)
    for warning in warnings:
        line = Text("warning: ", style="bold yellow").append(warning, style="not bold")
        console.print(line, soft_wrap=not console.is_terminal)
    for file in written:
        console.print(Text(f"wrote {file}", style="dim"), soft_wrap=True)
