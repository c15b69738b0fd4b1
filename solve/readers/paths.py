"""Systems from paths of files, which commands accept in place of a model."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from solve.readers.arrays import Read
from solve.readers.formats import read_mat, read_netcdf, read_npz, read_op4
from solve.readers.matrix_market import read_matrix_market
from solve.readers.openfast import read_openfast

READERS: dict[str, Callable[..., Any]] = {
    ".lin": read_openfast,
    ".mat": read_mat,
    ".npz": read_npz,
    ".nc": read_netcdf,
    ".mtx": read_matrix_market,
    ".op4": read_op4,
}
"""Readers by the ending of a path or pattern."""


def read(text: str) -> Read:
    """System read from a path or pattern. Raises FileError, MatricesError."""
    return READERS[Path(text).suffix.lower()](text)
