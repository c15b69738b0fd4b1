"""What every result can: files, a table of pandas, a dataset of xarray, and a few lines of itself."""

from functools import cached_property
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, ClassVar

from solve.results.contents import Columns, Contents, Facts, model_record, plain, rows_of
from solve.results.files import write_whole
from solve.results.lasting import Lasting
from solve.results.save import checked_data, dataset, writer
from solve.system import PeriodicSystem

if TYPE_CHECKING:
    import pandas
    import xarray

    from solve.views import Figure
else:
    Figure = object  # For annotations.


def views() -> ModuleType:
    """The package that shows results: tables, figures, HTML. It is above all that computes, and a result that
    is shown is the only thing below that needs it; hence this import, at that moment."""
    import solve.views

    return solve.views


class Result(Lasting):
    """A result states its columns and what it tells of the whole; record, files and tables follow."""

    _calculated: ClassVar[tuple[str, ...]] = ("warnings",)
    _rows: ClassVar[str] = ""
    """Key of the rows in the record."""
    _title: ClassVar[str] = ""
    """Title of the table of its columns."""

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        # A dataclass writes a `__repr__` of its own, with every array, unless its class has one.
        if "__repr__" not in vars(cls):
            cls.__repr__ = Result.__repr__  # type: ignore[method-assign]

    system: PeriodicSystem

    @cached_property
    def warnings(self) -> list[str]:
        """What is doubtful about this result, a sentence each."""
        return self._reduction

    @property
    def _reduction(self) -> list[str]:
        """Sentence on the error of the reduction of the system, for results without their own estimate."""
        reduction = self.system.reduction
        return [] if reduction is None else [reduction.sentence]

    @property
    def summary(self) -> str:
        """What was found, in a plain sentence or two; none of most results."""
        return ""

    @property
    def columns(self) -> Columns:
        """Its table, by name."""
        raise NotImplementedError

    @property
    def whole(self) -> dict[str, Any]:
        """What it tells beside the table."""
        return {}

    def facts(self) -> Facts:
        """Rows of its heading, below the model and the speed: a word, and what it stands for."""
        return []

    def plot(self, *args: Any, **options: Any) -> Figure:
        """Figure of matplotlib."""
        return views().figure(self, *args, **options)

    def __repr__(self) -> str:
        return views().as_text(self)

    def _repr_html_(self) -> str:
        """All of it as tables of HTML, in a notebook and in the page of `report`."""
        return views().as_html(self)

    @property
    def about(self) -> dict[str, Any]:
        """Which model, with which numbers."""
        return model_record(self.system)

    def record(self) -> dict[str, Any]:
        """The object that its command prints with `--json`."""
        rows = {self._rows: rows_of(self.columns)} if self._rows else {}
        return plain({**self.about, **self.whole, **rows, "warnings": self.warnings})

    @property
    def metadata(self) -> dict[str, Any]:
        """What its files say of the whole."""
        return plain({**self.about, **self.whole, "warnings": self.warnings})

    def contents(self) -> Contents:
        """What its files hold."""
        columns = {name: column for name, column in self.columns.items() if column.axes}
        return Contents(columns, {}, self.metadata)

    def save(self, path: str | Path) -> None:
        """Write the result as the file's ending says: .npz, .csv, .mat or .nc; whole or not at all.

        Raises FileError.
        """
        file = checked_data(path)
        write_whole(file, writer(self, file))

    def to_xarray(self) -> "xarray.Dataset":
        """A variable a column, with `units` and `long_name`; attributes say of which model it is."""
        return dataset(self.contents())

    def to_pandas(self) -> "pandas.DataFrame":
        """The table that .csv holds, without the units."""
        import pandas

        return pandas.DataFrame(self.contents().table)
