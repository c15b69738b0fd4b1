"""Results as files: .npz for NumPy, .csv for spreadsheets, .mat for MATLAB, .nc for xarray."""

import csv
import importlib.util
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from solve.arrays import Array
from solve.errors import MissingExtraError
from solve.results.contents import Contents, Variable
from solve.results.files import checked, write_whole

if TYPE_CHECKING:
    import xarray

_NETCDF = ("xarray", "h5netcdf", "h5py")


def checked_data(path: str | Path) -> Path:
    """The path of a data file that can be written. Raises FileError, MissingExtraError."""
    file = checked(path, DATA, "data")
    if file.suffix.lower() == ".nc":
        _require(*_NETCDF)
    return file


def save(contents: Contents, file: Path) -> None:
    """Write the contents to a checked file."""
    write_whole(file, lambda part: DATA[file.suffix.lower()](contents, part))


def dataset(contents: Contents) -> "xarray.Dataset":
    """A variable a column, with `units` and `long_name`, over the phase where there is one. Raises
    MissingExtraError without xarray."""
    _require("xarray")
    import xarray

    entries = {name: _entry(column) for name, column in {**contents.columns, **contents.further}.items()}
    axes = {name: entries.pop(name) for name in ("phase", "time") if name in entries}
    # netCDF has no truth values; as numbers they are 0 and 1.
    known = {
        key: int(value) if isinstance(value, bool) else value
        for key, value in contents.metadata.items()
        if isinstance(value, str | int | float)
    }
    return xarray.Dataset(entries, axes, {**known, "metadata": contents.metadata_text})


def _entry(variable: Variable) -> tuple[str, Array, dict[str, str]]:
    attributes = {"units": variable.unit, "long_name": variable.meaning}
    return variable.axis, variable.values, {key: text for key, text in attributes.items() if text}


def _write_npz(contents: Contents, part: Path) -> None:
    with part.open("wb") as stream:
        arrays: dict[str, Any] = {**contents.arrays, "metadata": np.array(contents.metadata_text)}
        np.savez(stream, **arrays)


def _write_csv(contents: Contents, part: Path) -> None:
    titles = [f"{name} ({v.unit})" if v.unit else name for name, v in contents.columns.items()]
    rows = zip(*(column.values.tolist() for column in contents.columns.values()), strict=True)
    with part.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(titles)
        writer.writerows(rows)


def _write_mat(contents: Contents, part: Path) -> None:
    from scipy.io import savemat

    # MATLAB knows cells of texts, not arrays of them.
    arrays = {
        name: values.astype(object) if values.dtype.kind == "U" else values
        for name, values in contents.arrays.items()
    }
    savemat(part, {**arrays, "metadata": contents.metadata_text}, appendmat=False)


def _write_nc(contents: Contents, part: Path) -> None:
    dataset(contents).to_netcdf(part, engine="h5netcdf")


def _require(*packages: str) -> None:
    missing = [name for name in packages if importlib.util.find_spec(name) is None]
    if missing:
        raise MissingExtraError(
            f"{', '.join(missing)} not installed; install the extra: "
            "pip install 'parametric-vibration[netcdf]'"
        )


DATA: dict[str, Callable[[Contents, Path], None]] = {
    ".npz": _write_npz,
    ".csv": _write_csv,
    ".mat": _write_mat,
    ".nc": _write_nc,
}
"""Writers by the file's ending."""
