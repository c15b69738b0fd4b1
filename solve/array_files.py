"""Reading of named arrays from .mat, .npz, netCDF and .op4 files, and of matrices from Matrix Market
files."""

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from solve.arrays import Array
from solve.errors import FileError, UnitError
from solve.op4 import op4_matrices
from solve.units import conversion

_LARGEST = 5000
"""Largest number of rows of a matrix in a Matrix Market file. It is limited because matrices are stored as
dense arrays. Chosen by judgement."""


def named_arrays(file: Path, ending: str = "") -> Mapping[str, Any]:
    """Mapping from names to the arrays of a file, without conversion.

    ending: the only permitted ending; by default, any of `ENDINGS`. Raises FileError."""
    allowed = [ending] if ending else [*ENDINGS]
    if file.suffix.lower() not in allowed:
        raise FileError(f"'{file}' ends in '{file.suffix}'; allowed: {', '.join(allowed)}")
    require_file(file)
    kind = file.suffix.lower()
    try:
        return ENDINGS[kind](file)
    except FileError as error:
        message = str(error)
        raise FileError(message if str(file) in message else f"'{file}': {message}") from None
    except PermissionError:
        raise FileError(f"'{file}' cannot be read; change its permissions") from None
    except Exception:  # For a damaged file, libraries raise exceptions of many kinds.
        raise FileError(f"'{file}' cannot be read: it is damaged, or is not a {kind} file") from None


def require_file(path: str | Path) -> None:
    """Raise FileError if there is no file at the path."""
    if not Path(path).is_file():
        raise FileError(f"there is no file '{path}'; give the path of a file that exists")


def matrix_market(file: Path) -> Array:
    """Dense real matrix of a Matrix Market file. Raises FileError."""
    from scipy.io import mminfo, mmread
    from scipy.sparse import issparse

    try:
        rows, columns, *_, field, _ = mminfo(file)
        if max(rows, columns) > _LARGEST:
            raise FileError(f"'{file}' has {rows} × {columns} entries; allowed: up to {_LARGEST} rows")
        if field not in ("real", "integer", "double", "unsigned-integer"):
            raise FileError(f"'{file}' has {field} entries; expected real numbers")
        matrix: Any = mmread(file)
    except FileError:
        raise
    except Exception as error:
        reason = re.sub(r"\s+", " ", str(error)) or "it is damaged"
        raise FileError(f"'{file}' cannot be read as Matrix Market: {reason}") from None
    return matrix.toarray() if issparse(matrix) else np.asarray(matrix)


def _mat_arrays(file: Path) -> dict[str, Any]:
    from scipy.io import loadmat

    try:
        content = loadmat(file)
    except NotImplementedError:
        raise FileError(
            f"'{file}' has the format of MATLAB 7.3; save it with the option -v7, or as netCDF"
        ) from None
    return {name: values for name, values in content.items() if not name.startswith("__")}


def _npz_arrays(file: Path) -> dict[str, Any]:
    with np.load(file, allow_pickle=False) as content:
        return {name: content[name] for name in content.files}


def _nc_arrays(file: Path) -> dict[str, Any]:
    import h5py

    with h5py.File(file) as content:
        datasets = {name: each for name, each in content.items() if isinstance(each, h5py.Dataset)}
        for name in datasets.keys() & _NETCDF_UNITS.keys():
            unit = datasets[name].attrs.get("units", "")
            _require_unit(name, "" if isinstance(unit, h5py.Empty) else unit)
        return {name: _netcdf_values(each) for name, each in datasets.items()}


_NETCDF_UNITS = {"phase": "rad", "phase_period": "rad", "speed": "rad/s"}
"""Mapping from variables to the units in which they are read."""


def _require_unit(name: str, attribute: Any) -> None:
    """Raise FileError unless the attribute `units` of a variable is empty or a spelling of the unit in which
    the variable is read. Some programs write the attribute as an array with one text."""
    texts = [each.decode() if isinstance(each, bytes) else str(each) for each in np.ravel(attribute)]
    given, expected = " ".join(texts).strip(), _NETCDF_UNITS[name]
    try:
        # Conventions write "rad s-1" or "rad.s-1" for "rad s^-1".
        usual = re.sub(r"(?<=[a-z])(?=-?\d)", "^", given.replace(".", " "))
        size = conversion(usual, expected) if given else 1.0
    except UnitError:
        size = np.nan
    if size != 1.0:
        raise FileError(f"{name} has the units '{given}'; write it in {expected}")


def _netcdf_values(dataset: Any) -> Any:
    """Values of a variable, unpacked by its attributes scale_factor and add_offset. Missing values are NaN
    (NetCDF Climate and Forecast Metadata Conventions, sections 2.5.1 and 8.1)."""
    import h5py

    if h5py.check_string_dtype(dataset.dtype):
        return dataset.asstr()[()]
    values, attributes = np.asarray(dataset[()]), dataset.attrs
    marks = [attributes[name] for name in ("_FillValue", "missing_value") if name in attributes]
    if "scale_factor" in attributes or "add_offset" in attributes:
        scale, offset = attributes.get("scale_factor", 1.0), attributes.get("add_offset", 0.0)
        unpacked = values * np.ravel(scale)[0] + np.ravel(offset)[0]
    else:
        unpacked = values
    missing = np.isin(values, np.concatenate([np.ravel(mark) for mark in marks])) if marks else False
    return np.where(missing, np.nan, unpacked) if np.any(missing) else unpacked


ENDINGS: dict[str, Callable[[Path], Mapping[str, Any]]] = {
    ".mat": _mat_arrays,
    ".npz": _npz_arrays,
    ".nc": _nc_arrays,
    ".op4": op4_matrices,
}
"""Mapping from endings of files with named arrays to the functions that read them."""
