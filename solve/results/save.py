"""Results as files: .npz for NumPy, .csv for spreadsheets, .mat for MATLAB, .nc for xarray."""

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
from solve.results.contents import Column, Contents, is_of_the_state
from solve.results.files import checked
from solve.results.lasting import packed, unpacked

if TYPE_CHECKING:
    import xarray


class Saved(Protocol):
    """A result."""

    def contents(self) -> Contents: ...


def checked_data(path: str | Path) -> Path:
    """The path of a data file that can be written. Raises FileError."""
    return checked(path, DATA, "data")


def writer(result: Saved, file: Path) -> Callable[[BinaryIO], None]:
    """What fills a stream with the result as the file's ending says."""
    return partial(DATA[file.suffix.lower()], result)


@first_is(str, Path, such_as="'orbit.nc'")
def opened(path: str | Path) -> Any:
    """The result that `save` wrote to a file .nc or .npz, bit for bit: everything that it holds, and what was
    calculated with it. No code is run, and there are no equations in it: what needs them is refused.

    Raises FileError for other files, damaged ones, and kinds of results that are not known.
    """
    file = Path(path)
    kind = file.suffix.lower()
    if kind in DATA and kind not in _READ:
        raise FileError(f"'{path}' is an export, which cannot be read back; open the result's .nc or .npz")
    if kind not in _READ:
        raise FileError(f"'{path}' is no file of results; allowed: {', '.join(_READ)}")
    if not file.is_file():
        raise FileError(f"there is no file '{path}'; give the path of a result that was saved")
    try:
        return unpacked(_READ[kind](file))
    except ResultKindError as error:
        raise ResultKindError(error.kind, f"'{path}' cannot be opened: it") from None
    except FileError as error:
        raise FileError(f"'{path}' cannot be opened: {error}") from None
    except PermissionError:
        raise FileError(f"'{path}' cannot be read; its rights do not allow it") from None
    except Exception:  # The libraries raise whatever they meet in a damaged file.
        raise FileError(
            f"'{path}' is no result of this program, or it is damaged; save the result again"
        ) from None


def _read_npz(file: Path) -> dict[str, Array]:
    with np.load(file, allow_pickle=False) as arrays:
        return {name: arrays[name] for name in arrays.files if is_of_the_state(name)}


def _read_nc(file: Path) -> dict[str, Array]:
    import h5py

    with h5py.File(file) as whole:
        group = whole[_STATE]
        return {name: group[name][()] for name in group if is_of_the_state(name)}  # type: ignore[index,union-attr]


_STATE = "state"
_READ = {".nc": _read_nc, ".npz": _read_npz}


def dataset(contents: Contents) -> "xarray.Dataset":
    """A variable a column, with `units` and `long_name`; those that are named as an axis, and the time, are
    coordinates."""
    import xarray

    entries = {name: _entry(column) for name, column in {**contents.columns, **contents.further}.items()}
    named = [name for name, (axis, *_) in entries.items() if name == "time" or axis == (name,)]
    axes = {name: entries.pop(name) for name in named}
    # netCDF has no truth values; as numbers they are 0 and 1.
    known = {
        key: int(value) if isinstance(value, bool) else value
        for key, value in contents.metadata.items()
        if isinstance(value, str | int | float)
    }
    return xarray.Dataset(entries, axes, {**known, "metadata": contents.metadata_text})


def _entry(column: Column) -> tuple[Any, ...]:
    """Axes, values, attributes, and how they are written: what is missing is NaN anyway."""
    attributes = {"units": column.unit, "long_name": column.meaning}
    known = {key: text for key, text in attributes.items() if text}
    return column.axes, column.array, known, {"_FillValue": None}


def _write_npz(result: Saved, stream: BinaryIO) -> None:
    contents = result.contents()
    arrays: dict[str, Any] = {**contents.numbers, "metadata": np.array(contents.metadata_text)}
    np.savez(stream, allow_pickle=False, **arrays, **packed(result))


def _write_csv(result: Saved, stream: BinaryIO) -> None:
    contents = result.contents()
    titles = [f"{name} ({v.unit})" if v.unit else name for name, v in contents.columns.items()]
    rows = zip(*(column.tolist() for column in contents.table.values()), strict=True)
    text = TextIOWrapper(stream, encoding="utf-8", newline="")
    table = csv.writer(text, lineterminator="\n")
    table.writerow(titles)
    table.writerows(rows)
    text.detach()


def _write_mat(result: Saved, stream: BinaryIO) -> None:
    from scipy.io import savemat

    contents = result.contents()
    for name in contents.numbers:
        # The library leaves these out, or stops at them.
        if name.startswith("_") or max(name) > "\xff":
            raise ValueOutOfBoundsError(
                f"'{name}' cannot be the name of a variable in MATLAB; save .nc or .npz, or give the "
                "coordinate another"
            )

    # MATLAB knows cells of texts, not arrays of them.
    arrays = {
        name: values.astype(object) if values.dtype.kind == "U" else values
        for name, values in contents.numbers.items()
    }
    savemat(stream, {**arrays, "metadata": contents.metadata_text}, appendmat=False)


def _write_nc(result: Saved, stream: Any) -> None:
    import xarray

    state = {name: (f"length_of_{name}", array) for name, array in packed(result).items()}
    groups = {"/": dataset(result.contents()), f"/{_STATE}": xarray.Dataset(state)}
    xarray.DataTree.from_dict(groups).to_netcdf(stream, engine="h5netcdf")


DATA: dict[str, Callable[[Saved, BinaryIO], None]] = {
    ".npz": _write_npz,
    ".csv": _write_csv,
    ".mat": _write_mat,
    ".nc": _write_nc,
}
"""Writers by the file's ending."""
