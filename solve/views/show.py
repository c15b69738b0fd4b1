"""Functions of a result by its class, which the result itself, commands and reports call."""

from collections.abc import Sequence
from functools import singledispatch
from io import StringIO
from typing import Any

from solve.results.result import Result
from solve.views.markup import html
from solve.views.style import Figure
from solve.views.tables import RenderableType, Table, console, heading, stacked, table_of

_LINES, _WIDTH = 15, 80
"""Most lines of a result as text, and its width."""


@singledispatch
def figure(result: Result, *_: Any, **__: Any) -> Figure:
    """Figure (matplotlib) of a result. Raises NotImplementedError for a class without one."""
    raise NotImplementedError(f"no figure of {type(result).__name__}")


@singledispatch
def tables(result: Result) -> Sequence[RenderableType]:
    """Tables and texts below the heading; by default one table of the columns that have headings."""
    return [table_of(result._title, result.columns)]


@singledispatch
def printout(result: Result, choices: Sequence[str] = (), **options: Any) -> RenderableType:
    """Everything that a command prints except warnings. choices: settings beyond the case; options: of the
    tables."""
    return stacked(heading_of(result, choices), *tables(result, **options))


@singledispatch
def brief(result: Result) -> RenderableType:
    """Content of the text of a result."""
    return printout(result)


def heading_of(result: Result, choices: Sequence[str] = ()) -> Table:
    """Model, speed and facts."""
    return heading(result.system, result.summary_values.get("speed"), choices, result.header_rows())


def as_text(result: Result) -> str:
    """A few lines without styles."""
    stream = StringIO()
    # In a notebook a console would show the text there, beside what `_repr_html_` gives.
    console(file=stream, width=_WIDTH, no_color=True, force_jupyter=False).print(brief(result))
    lines = [line.rstrip() for line in stream.getvalue().strip("\n").splitlines()]
    return "\n".join(lines if len(lines) <= _LINES else [*lines[: _LINES - 1], "…"])


def as_html(result: Result) -> str:
    """All tables and texts as HTML, for a notebook and the page of a report."""
    return html(printout(result))
