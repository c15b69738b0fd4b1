"""Text and HTML of results. The class of a result selects the functions that display it."""

import itertools
from collections.abc import Callable, Sequence
from functools import singledispatch, update_wrapper
from html import escape
from importlib import import_module
from io import StringIO
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from solve.results.result import Result
from solve.views.style import Figure
from solve.views.tables import RenderableType, Table, console, heading, stacked, table_of

_LINES, _WIDTH = 15, 80
"""Maximum number of lines, and width in characters, of a result as text."""

_VIEWS = {
    "bands": "sweep",
    "branch": "branches",
    "chart": "chart",
    "comparison": "comparison",
    "controller": "controller",
    "critical_speeds": "critical_speeds",
    "fit": "fit",
    "followed_modes": "followed_modes",
    "frequencies": "frequencies",
    "optimum": "optimum",
    "orbit": "orbit",
    "scatter": "branches",
    "sensitivities": "fit",
    "special_curves": "branches",
    "special_orbits": "orbit",
    "stability": "stability",
    "sweep": "sweep",
    "sweeps": "sweep",
    "tolerances": "tolerances",
    "transient": "over_time",
}
"""Mapping from modules of `solve.results` to the modules of this package that display their classes."""

T = TypeVar("T")


class ByClass(Generic[T]):
    """Function of a result, with one implementation per class of results, as with `functools.singledispatch`.

    The modules that register functions for classes of `solve.results` are imported at the first call.
    """

    def __init__(self, default: Callable[..., T]) -> None:
        self._selected = singledispatch(default)
        update_wrapper(self, default)

    def register(self, kind: type) -> Callable[[Callable[..., T]], Callable[..., T]]:
        """Decorator that registers a function for a class of results."""
        return self._selected.register(kind)

    def __call__(self, result: Result, *arguments: Any, **options: Any) -> T:
        for base in type(result).__mro__:
            package, _, name = base.__module__.rpartition(".")
            if package == "solve.results" and name in _VIEWS:
                import_module(f"solve.views.{_VIEWS[name]}")
        return self._selected(result, *arguments, **options)


@ByClass
def figure(result: Result, *_: Any, **__: Any) -> Figure:
    """Figure (matplotlib) of a result. Raises NotImplementedError for a class without a figure."""
    raise NotImplementedError(f"{type(result).__name__} has no figure")


@ByClass
def waterfall(result: Result, name: str) -> Figure:
    """Figure of the spectra of a quantity versus the varied quantity."""
    raise NotImplementedError(f"{type(result).__name__} has no spectra versus speed")


@ByClass
def tables(result: Result) -> Sequence[RenderableType]:
    """Return the tables and texts below the title of a result: by default, one table of the columns that have
    a header."""
    return [table_of(result._title, result.columns)]


@ByClass
def printout(result: Result, choices: Sequence[str] = (), **options: Any) -> RenderableType:
    """Everything that a command prints except warnings. `choices` are settings other than the case; `options`
    are options of the tables."""
    return stacked(heading_of(result, choices), *tables(result, **options))


@ByClass
def brief(result: Result) -> RenderableType:
    """Tables and texts of the short form of a result."""
    return printout(result)


def heading_of(result: Result, choices: Sequence[str] = ()) -> Table:
    """Heading of a result: model, speed and header rows."""
    return heading(result.system, result.summary_values.get("speed"), choices, result.header_rows())


def as_text(result: Result) -> str:
    """Short text of a result, without styles."""
    stream = StringIO()
    # In a notebook a console would also display the text itself.
    console(file=stream, width=_WIDTH, no_color=True, force_jupyter=False).print(brief(result))
    lines = [line.rstrip() for line in stream.getvalue().strip("\n").splitlines()]
    return "\n".join(lines if len(lines) <= _LINES else [*lines[: _LINES - 1], "…"])


def as_html(result: Result) -> str:
    """All tables and texts of a result as HTML, for a notebook and for reports."""
    return html(printout(result))


if TYPE_CHECKING:
    from rich.table import Table
else:
    Table = object

_LEFT = ' style="text-align: left"'
"""CSS style of cells with text. It is needed because notebooks align all cells to the right."""


def html(printed: RenderableType) -> str:
    """HTML of Rich renderables: tables as `<table>`, texts as `<p>`.

    >>> from solve.views.tables import table, text
    >>> print(html(table("Speeds", "", "Hz", rows=[("slow", "1")])))
    <table>
    <caption>Speeds</caption>
    <thead><tr><th scope="col" class="text" style="text-align: left"></th><th scope="col">Hz</th></tr></thead>
    <tbody>
    <tr><th scope="row" style="text-align: left">slow</th><td>1</td></tr>
    </tbody>
    </table>
    >>> print(html(text("1 < 2", "bold")))
    <p><strong>1 &lt; 2</strong></p>
    """
    from rich.console import Group
    from rich.table import Table

    if isinstance(printed, Group):
        return "\n".join(html(item) for item in printed.renderables)
    return _table(printed) if isinstance(printed, Table) else f"<p>{_words(printed)}</p>"


def _table(table: Table) -> str:
    """Return the HTML of a table, whose first column contains the headings of the rows."""
    lines = ["<table>"]
    title = _words(table.title or "")
    if title:
        lines.append(f"<caption>{title}</caption>")
    if table.show_header:
        headings = [f'<th scope="col"{_kind(each)}>{_words(each.header)}</th>' for each in table.columns]
        lines.append(f"<thead><tr>{''.join(headings)}</tr></thead>")
    lines.append("<tbody>")
    kinds = [_kind(column) for column in table.columns[1:]]
    rows = zip(*(column.cells for column in table.columns), strict=True)
    for number, ((first, *others), row) in enumerate(zip(rows, table.rows, strict=True), start=1):
        name = f'<th scope="row"{_LEFT}>{_words(first)}</th>' if first else "<td></td>"
        cells = zip(kinds, others, strict=True)
        lines.append(f"<tr>{name}{''.join(f'<td{kind}>{_words(cell)}</td>' for kind, cell in cells)}</tr>")
        if row.end_section and number < len(table.rows):
            lines.append("</tbody>\n<tbody>")
    lines.append("</tbody>")
    if table.caption:
        width = len(table.columns)
        lines.append(f'<tfoot><tr><td colspan="{width}">{_words(table.caption)}</td></tr></tfoot>')
    return "\n".join([*lines, "</table>"])


def _kind(column: Any) -> str:
    return f' class="text"{_LEFT}' if column.justify == "left" else ""


def _words(content: Any) -> str:
    """Return the HTML of a text. Line feeds become positions at which a long name may be broken."""
    from rich.console import Console

    console = Console(markup=False, emoji=False, no_color=True)
    text = console.render_str(content, highlight=False) if isinstance(content, str) else content.copy()
    if text.style:
        text.stylize(text.style)
    pieces = itertools.dropwhile(lambda piece: not piece[0].strip(), text.render(console, end=""))
    parts = [
        f"<strong>{escape(words)}</strong>" if style is not None and style.bold else escape(words)
        for words, style, _ in pieces
    ]
    return "".join(parts).strip().replace("\n", "<wbr/>")
