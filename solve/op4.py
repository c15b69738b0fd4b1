"""Matrices in OUTPUT4 files of NASTRAN (.op4), text or binary.

A matrix has a header and one record per nonzero column. A record begins with the number of the column, the
row of the first value (0 for a sparse column), and the number of values or words. A sparse column consists of
strings of consecutive rows. The header of a string contains a length in words and a row. Length and row are
stored in one integer or, for matrices with a negative number of rows (BIGMAT), in two. A record with a column
number above the number of columns ends the matrix. (MSC Nastran DMAP Programmer's Guide, OUTPUT4.)"""

import re
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np

from solve.arrays import Array
from solve.errors import FileError

_MOST_ROWS = 5000
"""Largest number of rows or columns. It is limited because matrices are stored as dense arrays. Chosen by
judgement."""

_FULL = 1, 2, 6
"""Forms of matrices for which the file contains all entries: square, rectangular and symmetric."""

_SHIFT = 16
"""Number of bits for the row, in the header of a string that consists of one integer."""

_FORMAT = re.compile(r"(\d+)[ED](\d+)\.\d+")
"""Pattern of the number of values per line and of their width, in a format such as 1P,3E23.16."""

_RECORD_LENGTHS = {24: 4, 48: 8}
"""Mapping from the length in bytes of the header of a binary matrix to the size of an integer in bytes. The
header consists of six integers."""


_STIFFNESS = re.compile(r"K([A-Z]{0,2})")
"""Pattern of the name of a stiffness matrix. The suffix is the set of coordinates, as in KAA."""


class _Header(NamedTuple):
    """Header of a matrix. kind: 1 or 2 for real numbers of single or double precision, 3 or 4 for complex
    numbers of single or double precision."""

    columns: int
    rows: int
    form: int
    kind: int
    name: str

    def checked(self) -> "_Header":
        """Return the header if the matrix can be read. Raises FileError."""
        if self.kind not in (1, 2, 3, 4) or self.form not in _FULL:
            raise FileError(
                f"matrix {self.name} has type {self.kind} and form {self.form}; allowed: types 1 to 4, forms "
                "1, 2 and 6"
            )
        if max(abs(self.rows), self.columns) > _MOST_ROWS:
            raise FileError(
                f"matrix {self.name} has {abs(self.rows)} rows and {self.columns} columns; allowed: up to "
                f"{_MOST_ROWS}; reduce it first"
            )
        return self

    def zeros(self) -> Array:
        """Zero matrix of the size in the header."""
        return np.zeros((abs(self.rows), self.columns), float if self.kind < 3 else complex)

    @property
    def is_single(self) -> bool:
        return self.kind in (1, 3)

    @property
    def integers_per_string(self) -> int:
        """Number of integers in the header of a string."""
        return 2 if self.rows < 0 else 1


class _Column(Protocol):
    """Content of the record of a column, read sequentially."""

    def integers(self, count: int) -> list[int]: ...

    def numbers(self, count: int) -> Array: ...


def op4_arrays(file: Path) -> dict[str, Array]:
    """Mapping from names to the matrices of a file. Raises FileError, and other exceptions for a damaged
    file."""
    content = file.read_bytes()
    for order in "<>":
        integer = _RECORD_LENGTHS.get(int(np.frombuffer(content[:4], f"{order}i4")[0]))
        if integer is not None:
            return _read_binary(content, order, integer)
    return _read_text(iter(content.decode("ascii").splitlines()))


def op4_matrices(file: Path) -> dict[str, Array]:
    """Mapping from M, K and, if present, C to the matrices of one set of coordinates, such as MAA, KAA and
    BAA.

    If the file contains no pair of M and K, the mapping contains all matrices with their names. Raises
    FileError for pairs of several sets, and other exceptions for a damaged file."""
    arrays = op4_arrays(file)
    suffixes = [found[1] for name in arrays if (found := _STIFFNESS.fullmatch(name))]
    pairs = [suffix for suffix in suffixes if f"M{suffix}" in arrays]
    if len(pairs) > 1:
        names = ", ".join(f"K{suffix}" for suffix in pairs)
        raise FileError(f"it contains matrices of several sets, {names}; write the matrices of one set")
    if not pairs:
        return arrays
    damping = next((name for name in (f"B{pairs[0]}", f"C{pairs[0]}") if name in arrays), None)
    names = {"M": f"M{pairs[0]}", "K": f"K{pairs[0]}"} | ({} if damping is None else {"C": damping})
    return {symbol: arrays[name] for symbol, name in names.items()}


def _put(matrix: Array, column: int, first: int, count: int, words: tuple[int, int], source: _Column) -> None:
    """Write the values of a column into the matrix. Raises ValueError for rows outside the matrix.

    first: first row of the values, or 0 for a sparse column. words: number of words per value, and number of
    words per header of a string."""
    if first > 0:
        _place(matrix, column, first, source.numbers(count))
        return
    per_number, header = words
    while count > 0:
        integers = source.integers(header)
        if header == 1:
            integers = [integers[0] >> _SHIFT, integers[0] & (1 << _SHIFT) - 1]
        length, row = integers[0] - 1, integers[1]
        count -= header + length
        _place(matrix, column, row, source.numbers(length // per_number))


def _place(matrix: Array, column: int, row: int, values: Array) -> None:
    if np.iscomplexobj(matrix):
        values = values[::2] + 1j * values[1::2]
    if not (row >= 1 and column >= 1 and len(values) and row + len(values) - 1 <= len(matrix)):
        raise ValueError(f"{len(values)} values from row {row} of column {column}")
    matrix[row - 1 : row - 1 + len(values), column - 1] = values


def _add(matrices: dict[str, Array], name: str, matrix: Array) -> None:
    """Add a matrix to the matrices of a file. Raises FileError for a second matrix of the same name."""
    if name in matrices:
        raise FileError(f"it contains two matrices {name}; write each matrix once")
    matrices[name] = matrix


class _Text:
    """Lines of a text file, with the number format of the current matrix."""

    def __init__(self, lines: Iterator[str], per_line: int, width: int):
        self.lines, self.per_line, self.width = lines, per_line, width

    def integers(self, count: int) -> list[int]:
        line = next(self.lines)
        return [int(line)] if count == 1 else [int(line[8 * k : 8 * k + 8]) for k in range(count)]

    def numbers(self, count: int) -> Array:
        lines = [*islice(self.lines, -(-count // self.per_line))]
        ends = range(self.width, self.width * self.per_line + 1, self.width)
        texts = [line[end - self.width : end].replace("D", "E") for line in lines for end in ends]
        return np.array([float(text) for text in texts[:count]])


def _read_text(lines: Iterator[str]) -> dict[str, Array]:
    """Matrices of a text file. Integers have eight characters."""
    matrices: dict[str, Array] = {}
    for line in lines:
        if not line.strip():
            continue
        columns, rows, form, kind = (int(line[8 * k : 8 * k + 8]) for k in range(4))
        found = _FORMAT.search(line[40:])
        if found is None:
            raise ValueError(f"no format in {line!r}")
        header = _Header(columns, rows, form, kind, line[32:40].strip().upper()).checked()
        source = _Text(lines, int(found[1]), int(found[2]))
        matrix, words = header.zeros(), (1 if header.is_single else 2, header.integers_per_string)
        while True:
            column, first, count = source.integers(3)
            if column > header.columns:
                source.numbers(count)
                break
            _put(matrix, column, first, count, words, source)
        _add(matrices, header.name, matrix)
    return matrices


class _Record:
    """Content of a binary record. integer, real: NumPy types of integers and of real numbers."""

    def __init__(self, content: bytes, integer: np.dtype, real: np.dtype):
        self.content, self.integer, self.real, self.place = content, integer, real, 0

    def _array(self, kind: np.dtype, count: int) -> Array:
        values = np.frombuffer(self.content, kind, count, self.place)
        self.place += count * kind.itemsize
        return values

    def integers(self, count: int) -> list[int]:
        return self._array(self.integer, count).tolist()

    def numbers(self, count: int) -> Array:
        return self._array(self.real, count)


def _records(content: bytes, order: str) -> Iterator[bytes]:
    """Yield the records of a FORTRAN file. Each record is preceded and followed by its length in bytes.
    Raises ValueError."""
    place = 0
    while place < len(content):
        length = int(np.frombuffer(content, f"{order}i4", 1, place)[0])
        end = place + 4 + length
        if length < 0 or int(np.frombuffer(content, f"{order}i4", 1, end)[0]) != length:
            raise ValueError(f"the lengths of the record at byte {place} differ")
        yield content[place + 4 : end]
        place = end + 4


def _read_binary(content: bytes, order: str, size: int) -> dict[str, Array]:
    """Matrices of a binary file. order: byte order. size: size in bytes of an integer, and of a real number
    of single precision."""
    integer, matrices = np.dtype(f"{order}i{size}"), {}
    records = _records(content, order)
    for record in records:
        columns, rows, form, kind = np.frombuffer(record, integer, 4).tolist()
        name = record[4 * size :].decode("ascii").strip(" \0").upper()
        header = _Header(columns, rows, form, kind, name).checked()
        real = np.dtype(f"{order}f{size if header.is_single else 8}")
        per_number = real.itemsize // size
        matrix, words = header.zeros(), (per_number, header.integers_per_string)
        for content_of_column in records:
            source = _Record(content_of_column, integer, real)
            column, first, count = source.integers(3)
            if column > header.columns:
                break
            _put(matrix, column, first, count // per_number if first > 0 else count, words, source)
        else:
            raise ValueError(f"matrix {header.name} has no end")
        _add(matrices, header.name, matrix)
    return matrices
