"""Systems read from paths of files, which commands accept in place of a model."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from solve.readers.arrays import Read
from solve.readers.formats import read_mat, read_netcdf, read_npz
from solve.readers.matrix_market import read_matrix_market
from solve.readers.openfast import read_openfast

READERS: dict[str, Callable[..., Any]] = {
    ".lin": read_openfast,
    ".mat": read_mat,
    ".npz": read_npz,
    ".nc": read_netcdf,
    ".mtx": read_matrix_market,
}
"""Readers by the ending of a path or pattern."""


def read(text: str) -> Read:
    """Read a system from a path or pattern. Raises FileError, MatricesError."""
    return READERS[Path(text).suffix.lower()](text)
