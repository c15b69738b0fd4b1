"""Tables and texts for a terminal of 80 columns."""

import functools
import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

from solve.labels import unit_of
from solve.results.contents import Columns, HeaderRows
from solve.results.formatting import greek, prefixed
from solve.system import PeriodicSystem
from solve.units import USUAL, ShownUnit, is_number

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, RenderableType, RenderResult
    from rich.table import Table
else:
    # For annotations only: rich is imported when something is printed.
    Console = ConsoleOptions = RenderableType = RenderResult = Table = object


MOST_ROWS = 40
"""Maximum number of rows of long tables, so that they fit on two screens. In longer ones, every k-th row is
shown."""

MOST_LISTED = 20
"""Maximum number of rows of tables in order of importance. The number of the remaining rows is stated."""

WIDEST = 48
"""Maximum width of the longest texts, in characters, beside the columns of numbers in a table of 80
characters."""


def stacked(*items: RenderableType) -> RenderableType:
    """Group tables and texts one below the other."""
    from rich.console import Group

    return Group(*items)


def text(content: str, style: str = "") -> RenderableType:
    """Renderable text in a Rich style."""
    from rich.text import Text

    return Text(content, style)


def assembled(*pieces: str | tuple[str, str]) -> RenderableType:
    """Renderable text from pieces, each of which may have a Rich style."""
    from rich.text import Text

    return Text.assemble(*pieces)


def console(**options: Any) -> Console:
    """Console that prints names and numbers unchanged, including brackets and colons."""
    from rich.console import Console

    return Console(highlight=False, markup=False, emoji=False, **options)


def table(
    title: str,
    *headings: str,
    left: int = 1,
    rows: Iterable[Sequence[Any]] = (),
    caption: str | None = None,
) -> Table:
    """Table whose first `left` columns are aligned to the left. Names of Greek letters are replaced by
    symbols."""
    from rich.box import SIMPLE_HEAD

    table = _number_table()(
        title="\n" + greek(title),
        caption=caption,
        box=SIMPLE_HEAD,
        show_edge=False,
        padding=(0, 1, 0, 1),
        collapse_padding=True,
        pad_edge=False,
    )
    for index, heading in enumerate(headings):
        justify = "left" if index < left else "right"
        table.add_column(greek(heading), justify=justify, no_wrap=index > 0, overflow="fold")
    for row in rows:
        table.add_row(*row)
    return table


def table_of(
    title: str, columns: Columns, left: int = 0, most: int | None = None, caption: str | None = None
) -> Table:
    """Table of the columns that have a heading. If there are more rows than `most`, only every k-th row is
    shown, and the title states this."""
    shown = [column for column in columns.values() if column.heading]
    rows = [*zip(*(column.texts for column in shown), strict=True)]
    step = math.ceil(len(rows) / (most or len(rows) or 1)) or 1
    title += f"; one row in {step} of {len(rows)}" if step > 1 else ""
    headings = (column.heading for column in shown)
    return table(title, *headings, left=left, rows=rows[::step], caption=caption)


@functools.cache
def _number_table() -> type[Table]:
    """Return a class of tables that do not truncate numbers. In a narrow terminal, long names continue on the
    next line."""
    import rich.table
    from rich.text import Text

    class NumberTable(rich.table.Table):
        def add_row(self, *cells: Any, **style: Any) -> None:
            super().add_row(*(greek(cell) if isinstance(cell, str) else cell for cell in cells), **style)

        def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
            # No table wraps at this width.
            unbroken = console.measure(self, options=options.update_width(10_000)).maximum
            if unbroken > options.max_width:
                for column in self.columns:
                    # Each unit is put on a separate line.
                    column.header = str(column.header).replace(" (", "\n(")
            for column in self.columns:
                if column.justify == "right":
                    widths = (console.measure(cell).maximum for cell in column.cells)
                    column.min_width = max(widths, default=0)
            # Rich would wrap title and caption at the table's width.
            above, below = self.title, self.caption
            self.title = self.caption = None
            rows = [*super().__rich_console__(console, options)]
            self.title, self.caption = above, below
            yield from (Text(str(above), "bold"), *rows)
            if below:
                yield Text(str(below), "dim italic")

    return NumberTable


def heading(
    system: PeriodicSystem, speed: float | None, choices: Sequence[str], rows: HeaderRows = ()
) -> Table:
    """Heading with the model, the speed (rad/s), the settings of the user, and further rows."""
    from rich.table import Table
    from rich.text import Text

    grid = Table.grid(padding=(0, 2))
    grid.add_column(style="dim", no_wrap=True)
    grid.add_column()
    case = f", case {system.labels.case}" if system.labels.case else ""
    grid.add_row("model", Text(system.labels.name + case, style="bold"))
    if system.labels.title:
        grid.add_row("", Text(system.labels.title))
    numbers = (_with_unit(system, choice) for choice in choices)
    chosen = dict.fromkeys([*(f"{name}={value}" for name, value in system.labels.options.items()), *numbers])
    if chosen:
        grid.add_row("with", Text(", ".join(chosen)))
    if speed is not None:
        period = system.period / speed
        factor, unit = prefixed("s", period)
        grid.add_row(
            "speed", f"{in_every_unit(speed, system.labels.speed_unit)}; period {period * factor:.6g} {unit}"
        )
    for row in rows:
        grid.add_row(*row)
    return grid


def _with_unit(system: PeriodicSystem, choice: str) -> str:
    """Return the text NAME=NUMBER of a parameter with its unit added."""
    name, _, value = choice.partition("=")
    unit = unit_of(system, name).name if name in system.labels.parameter_labels else ""
    return choice if unit in ("", "1") or not is_number(value) else f"{choice} {unit}"


def in_every_unit(speed: float, first: ShownUnit) -> str:
    """Format a speed (rad/s) in the usual units, beginning with `first`.

    >>> from solve.units import RPM
    >>> in_every_unit(1.0, RPM)
    '9.5493 rpm = 1 rad/s = 0.159155 Hz'
    """
    units = dict.fromkeys([first, *USUAL])
    return " = ".join(unit.text(speed, ".7g" if unit.size == 1 else ".6g") for unit in units)
