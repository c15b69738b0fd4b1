"""Results as files: .npz for NumPy, .csv for spreadsheets, .mat for MATLAB, .nc for xarray; found fit before
the calculation, and written whole or not at all."""

import csv
import importlib.util
import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from solve.arrays import Array
from solve.errors import FileError, MissingExtraError
from solve.results.contents import Contents, Variable

if TYPE_CHECKING:
    import xarray

_NETCDF = ("xarray", "h5netcdf", "h5py")


PICTURES = (".png", ".pdf", ".svg")
"""Endings of pictures."""


def checked(path: str | Path, endings: Iterable[str], kind: str) -> Path:
    """The path of a file that can be written. Raises FileError for an unknown ending, a missing or
    read-only folder, a folder of that name, a read-only file."""
    file, allowed = Path(path), tuple(endings)
    if file.suffix.lower() not in allowed:
        given = f"ends in '{file.suffix}'" if file.suffix else "has no ending"
        raise FileError(f"{kind} file '{path}' {given}; allowed: {', '.join(allowed)}")
    if file.is_dir():
        raise FileError(f"{kind} file '{path}' is a folder; give the name of a file")
    if not file.parent.is_dir():
        raise FileError(f"{kind} file '{path}': there is no folder '{file.parent}'; make it first")
    try:
        # Only trying tells for certain: rights, full disks and read-only file systems alike.
        _part(file).touch(exist_ok=False)
        _part(file).unlink()
        writable = not file.exists() or os.access(file, os.W_OK)
    except OSError:
        writable = False
    if not writable:
        raise FileError(f"{kind} file '{path}' cannot be written; give a place where you may write")
    return file


def write_whole(file: Path, write: Callable[[Path], None]) -> None:
    """Let `write` fill a temporary file beside it, then rename. Raises FileError, leaving no trace."""
    part = _part(file)
    try:
        write(part)
        part.replace(file)
    except OSError as error:
        raise FileError(f"'{file}' cannot be written ({error.strerror or error}); nothing was") from None
    finally:
        part.unlink(missing_ok=True)


def _part(file: Path) -> Path:
    return file.with_name(f".{file.stem}.{os.getpid()}{file.suffix}")


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
    ".nc": lambda contents, part: dataset(contents).to_netcdf(part, engine="h5netcdf"),
}
"""Writers by the file's ending."""
