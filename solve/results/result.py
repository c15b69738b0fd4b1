"""Base class of results, with tables, files, DataFrame, Dataset and repr."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, ClassVar

from solve.arguments import matches_annotations
from solve.arrays import Array
from solve.labels import SPEED
from solve.results.contents import Columns, FileContents, HeaderRows, model_info, rows_of, to_json
from solve.results.files import write_atomic
from solve.results.save import checked_data, dataset, writer
from solve.results.serialization import Serializable, stored_property
from solve.system import PeriodicSystem

if TYPE_CHECKING:
    import pandas
    import xarray

    from solve.views import Figure
else:
    Figure = object  # For annotations.


def views() -> ModuleType:
    """Return the package `solve.views` of tables, figures and HTML. It is imported at the first display,
    because views are a higher layer than results."""
    import solve.views

    return solve.views


class Result(Serializable):
    """Base class of all results. A subclass is a dataclass that contains the solved system. It defines
    `columns` and, if needed, `header_rows` and one of `_recorded` and `summary_values`.

    Attributes
    ----------
    system : PeriodicSystem
        System that the result belongs to.
    """

    _rows: ClassVar[str] = ""
    """Key under which the JSON record contains the rows; None if it has no rows."""
    _title: ClassVar[str] = ""
    """Title of the table."""
    _recorded: ClassVar[str] = ""
    """Names of the attributes that describe the result as a whole, in the order of the record."""

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        # Without this method, each dataclass would generate a `__repr__` with every array.
        if "__repr__" not in vars(cls):
            cls.__repr__ = Result.__repr__  # type: ignore[method-assign]

    system: PeriodicSystem
    doubts: Sequence[str] = ()
    """Reasons why the result is doubtful, one sentence each."""

    @stored_property
    def warnings(self) -> list[str]:
        """Warnings about the result, one sentence each."""
        return [*self._reduction, *self.doubts]

    @property
    def _reduction(self) -> list[str]:
        """Sentence on the reduction of the system, for results without an estimate of the reduction error."""
        reduction = self.system.capabilities.reduction
        return [] if reduction is None else [reduction.sentence]

    @property
    def summary(self) -> str:
        """Main finding in one or two sentences; empty for some classes of results."""
        return ""

    @property
    def columns(self) -> Columns:
        """Mapping from names to the columns of the result's table."""
        raise NotImplementedError

    @property
    def summary_values(self) -> dict[str, Any]:
        """Mapping from names to the values that describe the result as a whole."""
        return {name: getattr(self, name) for name in self._recorded.split()}

    def header_rows(self) -> HeaderRows:
        """Rows of the heading below the rows for model and speed. Each row is a label and a string."""
        return []

    def plot(self, *args: Any, **options: Any) -> Figure:
        """Figure (matplotlib) of the result."""
        return views().figure(self, *args, **options)

    def __repr__(self) -> str:
        return views().as_text(self)

    def _repr_html_(self) -> str:
        """All tables and texts as HTML, for a notebook and for reports."""
        return views().as_html(self)

    @property
    def model_info(self) -> dict[str, Any]:
        """Model, case, parameters and options."""
        return model_info(self.system)

    def record(self) -> dict[str, Any]:
        """JSON object that the command of this result prints if `--json` is given."""
        rows = {self._rows: rows_of(self.columns)} if self._rows else {}
        return to_json({**self.model_info, **self.summary_values, **rows, "warnings": self.warnings})

    @property
    def metadata(self) -> dict[str, Any]:
        """JSON object for the attributes of files: the record without the columns."""
        return to_json({**self.model_info, **self.summary_values, "warnings": self.warnings})

    def file_contents(self) -> FileContents:
        """Columns, arrays and metadata of files."""
        columns = {name: column for name, column in self.columns.items() if column.axes}
        return FileContents(columns, {}, self.metadata)

    @matches_annotations
    def save(self, path: str | Path) -> None:
        """Write the result to a file; an existing file is replaced completely or not at all.

        Parameters
        ----------
        path : str or Path
            File, whose ending selects the format: .npz (NumPy), .csv, .mat (MATLAB) or .nc (netCDF).
            `solve.open` reads .npz and .nc.

        Raises
        ------
        FileError
            If the ending is unknown or the file cannot be written.
        """
        file = checked_data(path)
        write_atomic(file, writer(self, file))

    def to_xarray(self) -> "xarray.Dataset":
        """Dataset with one variable per column. The variables have the attributes `units` and `long_name`;
        attributes of the dataset state the model, the case and the parameters."""
        return dataset(self.file_contents())

    def to_pandas(self) -> "pandas.DataFrame":
        """DataFrame with the same table as a .csv file, without units."""
        import pandas

        return pandas.DataFrame(self.file_contents().table)


class ResultOver(Result):
    """Base class of results versus speed or one parameter.

    Attributes
    ----------
    speeds : (P,) array
        Speeds in rad/s.
    parameters : mapping of str to (P,) array
        Values of the parameter that varies instead of the speed.
    """

    speeds: Array
    parameters: Mapping[str, Array]

    @property
    def over(self) -> str:
        """Name of the varied quantity: "speed", or a parameter."""
        return next(iter(self.parameters), SPEED)

    @property
    def values(self) -> Array:
        """Values (P,) of the varied quantity; speeds in rad/s."""
        return self.parameters.get(self.over, self.speeds)
