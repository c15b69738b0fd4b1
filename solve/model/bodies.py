"""Reduced matrices of elastic bodies, from the files named in a case."""

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from solve.array_files import matrix_market, named_arrays
from solve.arrays import Array
from solve.errors import CaseFileError, FileError, MatricesError, UnitError, ValueOutOfBoundsError, counted
from solve.model.craig_bampton import CraigBampton, craig_bampton
from solve.units import conversion

_ASYMMETRY = 1e-6
"""Difference between a matrix and its transpose, relative to the largest entry of the matrix, up to which the
difference counts as round-off in the digits of a file. Chosen by judgement."""

EXAMPLE = '{ file = "blade.mat", unit = "m kg s", source = "…" }'


class Body(NamedTuple):
    """Elastic body declared by a generated module.

    units: unit of each interface displacement, "m" or "rad". entries: one per parameter, with its name,
    matrix ("M", "K" or "C"), row and column; rows and columns are counted from 1."""

    name: str
    units: Sequence[str]
    modes: int
    entries: Sequence[tuple[str, str, int, int]]

    @property
    def has_damping(self) -> bool:
        return any(matrix == "C" for _, matrix, *_ in self.entries)


def body_parameters(body: Body, entry: Mapping[str, Any], path: Path) -> tuple[dict[str, float], str]:
    """Return the parameters that an entry of a case file defines for a body, and their source. The source
    includes the hash of the matrix file.

    The matrix file contains M, K and, if declared, C. The matrices may be full finite-element matrices or
    already reduced. In the entry, `interface` lists the rows of the interface coordinates, counted from 1. By
    default, these are the first rows. Raises CaseFileError."""
    file, where = path.parent / str(entry["file"]), f"{body.name} in {path.name}"
    try:
        arrays, digest = _arrays(file, body.has_damping)
        given = entry.get("sha256", digest)
        if not isinstance(given, str) or len(given) < 8 or not digest.startswith(given.lower()):
            raise CaseFileError(
                f"the SHA-256 of '{file}' is {digest}, but the case states {given!r}; give the file with "
                "the stated hash, or correct the case"
            )
        rows = _interface(entry, arrays, len(body.units))
        M, K, C = _in_si(arrays, rows, body, _sizes(entry.get("unit")))
        reduced = craig_bampton(M, K, rows, body.modes)
    except (CaseFileError, FileError, MatricesError, UnitError, ValueOutOfBoundsError) as error:
        raise CaseFileError(f"{where}: {error}") from None
    matrices = {"M": reduced.mass, "K": reduced.stiffness, "C": reduced.basis.T @ C @ reduced.basis}
    values = {name: float(matrices[matrix][i - 1, j - 1]) for name, matrix, i, j in body.entries}
    return values, f"{entry['source']}; {entry['file']}, SHA-256 {digest[:16]}, {_discarded(reduced)}"


def _discarded(reduced: CraigBampton) -> str:
    if np.isinf(reduced.discarded):
        return "no modes discarded"
    return f"modes of {reduced.discarded:.4g} rad/s and above discarded"


def _arrays(file: Path, has_damping: bool) -> tuple[dict[str, Any], str]:
    """Return a mapping from names to square matrices, and the SHA-256 of their files. Raises FileError."""
    symbols = "MKC" if has_damping else "MK"
    if file.suffix.lower() == ".mtx":
        files = [file.with_suffix(f".{symbol}.mtx") for symbol in symbols]
        arrays: dict[str, Any] = {s: matrix_market(each) for s, each in zip(symbols, files, strict=True)}
    else:
        files, arrays = [file], dict(named_arrays(file))
    missing = [symbol for symbol in symbols if symbol not in arrays]
    if missing:
        raise FileError(f"'{file}' has no {missing[0]}; give {', '.join(symbols)}")
    n = np.shape(arrays["K"])[:1]
    arrays = {symbol: _symmetric(arrays[symbol], symbol, n, file) for symbol in symbols}
    digest = hashlib.sha256(b"".join(each.read_bytes() for each in files))
    return arrays, digest.hexdigest()


def _symmetric(values: Any, symbol: str, n: tuple[int, ...], file: Path) -> Array:
    """Return `values` as a finite symmetric matrix with real entries. Raises FileError."""
    matrix = values.toarray() if hasattr(values, "toarray") else np.asarray(values)
    if matrix.dtype.kind not in "fiu" or matrix.shape != n * 2 or not np.isfinite(matrix).all():
        raise FileError(
            f"'{file}': {symbol} has shape {matrix.shape} and type {matrix.dtype}; expected a square "
            "matrix of finite real numbers, of the same size for every matrix"
        )
    if np.abs(matrix - matrix.T).max(initial=0.0) > _ASYMMETRY * np.abs(matrix).max(initial=0.0):
        raise FileError(f"'{file}': {symbol} is not symmetric; give symmetric matrices")
    return (matrix + matrix.T) / 2


def _interface(entry: Mapping[str, Any], arrays: Mapping[str, Any], count: int) -> Array:
    """Rows (count,) of the interface coordinates, counted from 0. Raises ValueOutOfBoundsError."""
    n = len(arrays["K"])
    rows = np.asarray(entry.get("interface", range(1, count + 1)))
    if rows.shape != (count,) or rows.dtype.kind != "i" or not ((rows >= 1) & (rows <= n)).all():
        raise ValueOutOfBoundsError(
            f"interface is {rows.tolist()}; give {counted(count, 'row number')} of the matrices, from 1 to "
            f"{n}"
        )
    return rows - 1


def _sizes(unit: Any) -> tuple[float, float, float]:
    """Return the units of length, mass and time of the matrices, in SI units. Raises UnitError."""
    words = unit.split() if isinstance(unit, str) else []
    if len(words) != 3:
        raise UnitError(f'unit is {unit!r}; give the units of length, mass and time, such as "mm t s"')
    length, mass, time = (conversion(word, si) for word, si in zip(words, ("m", "kg", "s"), strict=True))
    return length, mass, time


def _in_si(
    arrays: Mapping[str, Any], rows: Array, body: Body, sizes: tuple[float, float, float]
) -> tuple[Array, Array, Array]:
    """Return M, K and C (n, n) for interface displacements in SI units and energies in joules. Interior
    coordinates keep their units, which do not affect the reduction."""
    length, mass, time = sizes
    scale = np.ones(len(arrays["K"]))
    scale[rows] = [1 / length if unit == "m" else 1.0 for unit in body.units]
    energies = mass * length**2 / time ** np.array([0, 2, 1])
    K = arrays["K"]
    matrices = arrays["M"], K, arrays["C"] if body.has_damping else np.zeros_like(K)
    M, K, C = (e * scale[:, None] * each * scale for e, each in zip(energies, matrices, strict=True))
    return M, K, C
