"""File formats of results: .npz for NumPy, .csv for spreadsheets, .mat for MATLAB, .nc for xarray."""

import csv
from collections.abc import Callable
from functools import partial
from io import TextIOWrapper
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Protocol

import numpy as np

from solve.arguments import first_is
from solve.arrays import Array
from solve.errors import FileError, ResultKindError, ValueOutOfBoundsError
from solve.results.contents import Column, FileContents, is_state_name
from solve.results.files import checked
from solve.results.serialization import from_arrays, to_arrays

if TYPE_CHECKING:
    import xarray

_STATE_GROUP = "state"
"""Name of the group in a netCDF file that contains the arrays from which the result is restored."""


class Saved(Protocol):
    """Protocol of results that can be saved."""

    def file_contents(self) -> FileContents: ...


def checked_data(path: str | Path) -> Path:
    """Return the path of a data file that can be written. Raises FileError."""
    return checked(path, _WRITERS, "data")


def writer(result: Saved, file: Path) -> Callable[[BinaryIO], None]:
    """Return a function that writes the result to a stream, in the format that the file's ending states."""
    return partial(_WRITERS[file.suffix.lower()], result)


@first_is(str, Path, such_as="'orbit.nc'")
def open(path: str | Path) -> Any:
    """Open a result that was written to a file by its method `save`.

    No code in the file is run. The result is identical to the saved one, bit for bit, except that it has no
    equations.

    Parameters
    ----------
    path : str or Path
        File that ends in .nc or .npz.

    Returns
    -------
    Result
        Object of the class that was saved. Methods that need the equations raise ReopenedError.

    Raises
    ------
    FileError
        If the file cannot be read, is damaged, or does not contain a result.
    """
    file = Path(path)
    kind = file.suffix.lower()
    if kind in _WRITERS and kind not in _READERS:
        raise FileError(f"'{path}' is an export, which cannot be read back; open the result's .nc or .npz")
    if kind not in _READERS:
        raise FileError(f"'{path}' is not a file of results; allowed: {', '.join(_READERS)}")
    if not file.is_file():
        raise FileError(f"there is no file '{path}'; give the path of a result that was saved")
    try:
        return from_arrays(_READERS[kind](file))
    except ResultKindError as error:
        raise ResultKindError(error.kind, f"'{path}' cannot be opened: it") from None
    except FileError as error:
        raise FileError(f"'{path}' cannot be opened: {error}") from None
    except PermissionError:
        raise FileError(f"'{path}' cannot be read; change its permissions") from None
    except Exception:  # Libraries raise many kinds of exceptions for a damaged file.
        raise FileError(
            f"'{path}' is not a result of this program, or is damaged; save the result again"
        ) from None


def _read_npz(file: Path) -> dict[str, Array]:
    with np.load(file, allow_pickle=False) as arrays:
        return {name: arrays[name] for name in arrays.files if is_state_name(name)}


def _read_nc(file: Path) -> dict[str, Array]:
    # For a damaged file, the finaliser of h5netcdf prints an exception; that of h5py does not.
    import h5py

    with h5py.File(file) as content:
        group = content[_STATE_GROUP]
        return {name: group[name][()] for name in group if is_state_name(name)}  # type: ignore[index,union-attr]


def dataset(contents: FileContents) -> "xarray.Dataset":
    """Return a Dataset with one variable per column; variables have the attributes `units` and `long_name`.
    The time becomes a coordinate of the Dataset, as does every column that has the name of its axis."""
    import xarray

    entries = {name: _variable(column) for name, column in {**contents.columns, **contents.others}.items()}
    indices = [name for name, (axes, *_) in entries.items() if name == "time" or axes == (name,)]
    coordinates = {name: entries.pop(name) for name in indices}
    # netCDF has no Boolean type.
    attributes = {
        key: int(value) if isinstance(value, bool) else value
        for key, value in contents.metadata.items()
        if isinstance(value, str | int | float)
    }
    return xarray.Dataset(entries, coordinates, {**attributes, "metadata": contents.metadata_text})


def _variable(column: Column) -> tuple[Any, ...]:
    """Return the axes, values, attributes and encoding of a column; missing values are NaN."""
    attributes = {"units": column.unit, "long_name": column.meaning}
    texts = {key: text for key, text in attributes.items() if text}
    return column.axes, column.array, texts, {"_FillValue": None}


def _write_npz(result: Saved, stream: BinaryIO) -> None:
    contents = result.file_contents()
    arrays: dict[str, Any] = {**contents.numbers, "metadata": np.array(contents.metadata_text)}
    np.savez(stream, allow_pickle=False, **arrays, **to_arrays(result))


def _write_csv(result: Saved, stream: BinaryIO) -> None:
    contents = result.file_contents()
    titles = [f"{name} ({v.unit})" if v.unit else name for name, v in contents.columns.items()]
    rows = zip(*(column.tolist() for column in contents.table.values()), strict=True)
    text = TextIOWrapper(stream, encoding="utf-8", newline="")
    table = csv.writer(text, lineterminator="\n")
    table.writerow(titles)
    table.writerows(rows)
    text.detach()


def _write_mat(result: Saved, stream: BinaryIO) -> None:
    from scipy.io import savemat

    contents = result.file_contents()
    for name in contents.numbers:
        # SciPy omits names that begin with an underscore, and raises an exception for characters beyond
        # Latin-1.
        if name.startswith("_") or max(name) > "\xff":
            raise ValueOutOfBoundsError(
                f"'{name}' cannot be the name of a variable in MATLAB; save .nc or .npz, or rename "
                "the coordinate"
            )
    # MATLAB stores texts of different lengths in cells, not in arrays.
    arrays = {
        name: values.astype(object) if values.dtype.kind == "U" else values
        for name, values in contents.numbers.items()
    }
    savemat(stream, {**arrays, "metadata": contents.metadata_text}, appendmat=False)


def _write_nc(result: Saved, stream: Any) -> None:
    import xarray

    state = {name: (f"length_of_{name}", array) for name, array in to_arrays(result).items()}
    groups = {"/": dataset(result.file_contents()), f"/{_STATE_GROUP}": xarray.Dataset(state)}
    xarray.DataTree.from_dict(groups).to_netcdf(stream, engine="h5netcdf")


_WRITERS: dict[str, Callable[[Saved, BinaryIO], None]] = {
    ".npz": _write_npz,
    ".csv": _write_csv,
    ".mat": _write_mat,
    ".nc": _write_nc,
}
_READERS = {".nc": _read_nc, ".npz": _read_npz}
