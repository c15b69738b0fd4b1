"""What every result can: files, a table of pandas, a dataset of xarray, and a few lines of itself."""

from collections.abc import Sequence
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

from solve.results.contents import Contents
from solve.results.report import RenderableType
from solve.results.save import checked_data, dataset, save

if TYPE_CHECKING:
    import pandas
    import xarray

_LINES, _WIDTH, _PAGE = 15, 80, 100
"""Most lines of a result as text, its width, and that of a page of HTML."""

_HTML = '<pre style="font-family: monospace; line-height: 1.2">{code}</pre>'


class Result:
    """A result states its `report` and its `contents`."""

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        # A dataclass writes a `__repr__` of its own, with every array, unless its class has one.
        if "__repr__" not in vars(cls):
            cls.__repr__ = Result.__repr__  # type: ignore[method-assign]

    def report(self, choices: Sequence[str] = ()) -> RenderableType:
        """Everything that the command of this result prints but its warnings."""
        raise NotImplementedError

    def contents(self) -> Contents:
        """What its files hold."""
        raise NotImplementedError

    def save(self, path: str | Path) -> None:
        """Write the result as the file's ending says: .npz, .csv, .mat or .nc; whole or not at all.

        Raises FileError.
        """
        save(self.contents(), checked_data(path))

    def to_xarray(self) -> "xarray.Dataset":
        """A variable a column, with `units` and `long_name`; attributes say of which model it is."""
        return dataset(self.contents())

    def to_pandas(self) -> "pandas.DataFrame":
        """The table that .csv holds, without the units."""
        import pandas

        return pandas.DataFrame(self.contents().table)

    def _brief(self) -> RenderableType:
        """What a few lines say of it."""
        return self.report()

    def __repr__(self) -> str:
        from rich.console import Console

        stream = StringIO()
        Console(file=stream, width=_WIDTH, highlight=False, no_color=True).print(self._brief())
        lines = [line.rstrip() for line in stream.getvalue().strip("\n").splitlines()]
        return "\n".join(lines if len(lines) <= _LINES else [*lines[: _LINES - 1], "…"])

    def _repr_html_(self) -> str:
        from rich.console import Console

        console = Console(file=StringIO(), width=_PAGE, highlight=False, record=True)
        console.print(self.report())
        return console.export_html(inline_styles=True, code_format=_HTML)
