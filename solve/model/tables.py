"""Fourier series fitted by least squares to measured functions of an angle. The measured values are read from
CSV files."""

import csv
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np

from solve.arguments import number_or_nan, require_size
from solve.arrays import Array
from solve.errors import CaseFileError, UnitError, cause, counted
from solve.units import conversion

_NUMBERS_A_BYTE = 8
"""Upper estimate of the memory for reading a table, in numbers per byte of the file. It is compared with the
memory limit."""

_SAME_ANGLE = 1e-9
"""Distance in revolutions below which two angles count as equal. Chosen by judgement."""


class Series(NamedTuple):
    """Fourier series declared by a generated module, with harmonics k = 1 … `harmonics`.

    form: "cosine-sine" or "amplitude-phase". integrated: whether the parameters are coefficients of the
    derivative of the series. mean: name of the parameter for the mean, or "". first, second: prefixes of the
    names of the other parameters, FIRST1, … and SECOND1, …."""

    name: str
    form: str
    integrated: bool
    mean: str
    first: str
    second: str
    harmonics: int


@dataclass(frozen=True, eq=False)
class Fit:
    """Fit of a series to the rows of a table.

    name: name of the series, followed by ' if its derivative is fitted. angles (m,): angles in rad. values
    (m,): values in `unit`. coefficients (1 + 2 harmonics,): mean, cosine coefficients, sine coefficients.
    parameters: the corresponding parameters of the model."""

    name: str
    table: str
    unit: str
    angles: Array
    values: Array
    coefficients: Array
    parameters: Mapping[str, float]

    @property
    def harmonics(self) -> int:
        return len(self.coefficients) // 2

    def at(self, angles: Array) -> Array:
        """Values of the fitted series at `angles`."""
        return _columns(angles, self.harmonics) @ self.coefficients

    @cached_property
    def errors(self) -> Array:
        """Errors (m,) of the fitted series at the rows of the table."""
        return self.at(self.angles) - self.values

    @property
    def sentence(self) -> str:
        """Sentence about the fitted series and its errors."""
        largest, rms = np.abs(self.errors).max(), math.sqrt(np.mean(self.errors**2))
        percent = 100 * largest / (np.ptp(self.values) or 1.0)
        return (
            f"{self.name} is fitted to {self.table} with {counted(self.harmonics, 'harmonic')}: "
            f"deviation up to {largest:.3g} {self.unit}, {percent:.3g} % of the range, "
            f"rms {rms:.3g} {self.unit}"
        )


def fitted(
    name: str, path: Path, columns: Sequence[str], harmonics: int | None, series: Series, unit: str
) -> Fit:
    """Fit a declared series to a table. Harmonics that are not fitted are zero.

    name: name of the series, followed by ' for its derivative. columns: headers of the columns of angles and
    values, with units in brackets. harmonics: number of fitted harmonics, by default all declared harmonics.
    unit: unit of the parameters. Raises CaseFileError, UnitError."""
    most = series.harmonics
    if harmonics is not None and (type(harmonics) is not int or not 1 <= harmonics <= most):
        raise CaseFileError(
            f"{name} is fitted with harmonics = {harmonics}; allowed: 1 … {most}, as declared"
        )
    derivative = name.endswith("'")
    if derivative and not series.integrated:
        raise CaseFileError(
            f"{name} cannot be fitted, because its coefficients follow from {name[:-1]}; give a "
            f"table of {name[:-1]}"
        )
    order = most if harmonics is None else harmonics
    angles, values = _read(name, path, columns, unit)
    _require_revolution(name, path, angles, order)
    has_mean = bool(series.mean) or (series.integrated and not derivative)
    matrix = _columns(angles, order)[:, 0 if has_mean else 1 :]
    solution = np.linalg.lstsq(matrix, values)[0]
    coefficients = solution if has_mean else np.concatenate([[0.0], solution])
    parameters = _parameters(series, derivative, coefficients)
    return Fit(name, path.name, unit, angles, values, coefficients, parameters)


def _columns(angles: Array, harmonics: int) -> Array:
    phases = np.multiply.outer(angles, np.arange(1, harmonics + 1))
    return np.concatenate([np.ones((len(angles), 1)), np.cos(phases), np.sin(phases)], axis=1)


def _parameters(series: Series, derivative: bool, coefficients: Array) -> dict[str, float]:
    """Mapping from names of parameters to values, from the coefficients of a series."""
    k = np.arange(1, len(coefficients) // 2 + 1)
    cosine, sine = coefficients[1:].reshape(2, -1)
    if series.integrated and not derivative:
        cosine, sine = k * sine, -k * cosine
    if series.form == "amplitude-phase":
        cosine, sine = np.hypot(cosine, sine), np.arctan2(-sine, cosine)
    parameters = {series.mean: float(coefficients[0])} if series.mean else {}
    for prefix, numbers in ((series.first, cosine), (series.second, sine)):
        padded = [*numbers.tolist(), *[0.0] * (series.harmonics - len(k))]
        parameters |= {f"{prefix}{i}": number for i, number in enumerate(padded, start=1)}
    return parameters


def _require_revolution(name: str, path: Path, angles: Array, harmonics: int) -> None:
    """Raise CaseFileError unless the angles are distinct and cover one revolution densely enough for the
    harmonics."""
    if len(angles) < 2 * harmonics + 1:
        raise CaseFileError(
            f"{name}: {path.name} has {counted(len(angles), 'row')}; "
            f"{counted(harmonics, 'harmonic requires', 'harmonics require')} {2 * harmonics + 1} or more"
        )
    ordered = np.sort(angles)
    gaps, span = np.diff(ordered), float(ordered[-1] - ordered[0])
    if gaps.min() < _SAME_ANGLE * math.tau:
        twice = math.degrees(ordered[np.argmin(gaps)])
        raise CaseFileError(f"{name}: {path.name} has the angle {twice:.6g} deg twice; give each angle once")
    if span > math.tau * (1 + _SAME_ANGLE):
        raise CaseFileError(
            f"{name}: {path.name} covers {math.degrees(span):.6g} deg; give one revolution, 360 deg"
        )
    gaps = np.append(gaps, math.tau - span)
    widest, wave = float(gaps.max()), math.tau / harmonics
    if widest >= wave / 2 * (1 - _SAME_ANGLE):
        start = math.degrees(ordered[np.argmax(gaps)])
        raise CaseFileError(
            f"{name}: {path.name} does not cover the revolution: no row between {start:.6g} deg and "
            f"{start + math.degrees(widest):.6g} deg; this gap is not shorter than half a period of harmonic "
            f"{harmonics}; add rows or fit fewer harmonics"
        )


def _read(name: str, path: Path, columns: Sequence[str], unit: str) -> tuple[Array, Array]:
    """Return the angles in rad and the values in `unit`."""
    sizes = [size_in_header(name, column, to) for column, to in zip(columns, ("rad", unit), strict=True)]
    header, *rows = cells_of(name, path)
    positions = []
    for column in columns:
        if header.count(column) != 1:
            given = "several columns" if column in header else "no column"
            raise CaseFileError(
                f"{name}: {path.name} has {given} '{column}'; one is required, and its header has: "
                + ", ".join(header)
            )
        positions.append(header.index(column))
    numbers = np.array([[number_in(name, path, row, place) for place in positions] for row in rows])
    return tuple(numbers.reshape(-1, 2).T * np.array(sizes)[:, None])


def cells_of(name: str, path: Path) -> list[list[str]]:
    """Cells of the nonempty lines of a CSV file; the first line is the header. Separators are commas,
    semicolons or tabs."""
    try:
        if path.exists() and not path.is_file():
            raise CaseFileError(f"{name}: table '{path}' does not exist or is not a file; give a CSV file")
        require_size(f"bytes in table '{path}'", path.stat().st_size, _NUMBERS_A_BYTE)
        lines = [line for line in path.read_text(encoding="utf-8-sig").splitlines() if line.strip()]
    except (OSError, UnicodeDecodeError, ValueError) as error:
        raise CaseFileError(
            f"{name}: table '{path}' cannot be read ({cause(error)}); give a CSV file; paths in "
            "a case file are relative to it"
        ) from None
    if not lines:
        raise CaseFileError(f"{name}: table '{path}' is empty; give a header and rows")
    delimiter = max(",;\t", key=lines[0].count)
    header, *rows = ([cell.strip() for cell in row] for row in csv.reader(lines, delimiter=delimiter))
    long = next((row for row in rows if any(row[len(header) :])), None)
    if long is not None:
        raise CaseFileError(
            f"{name}: {path.name} has more values than columns in the row '{', '.join(long)[:60]}'; "
            "give one value per column, with a decimal point"
        )
    return [header, *rows]


def number_in(name: str, path: Path, row: Sequence[str], place: int) -> float:
    """Finite number in cell `place` of a row. Raises CaseFileError."""
    text = row[place] if place < len(row) else ""
    number = number_or_nan(text)
    if not math.isfinite(number):
        raise CaseFileError(
            f"{name}: {path.name} has '{text}' in the row '{', '.join(row)[:60]}'; give finite numbers with "
            "a decimal point"
        )
    return number


def size_in_header(name: str, column: str, unit: str) -> float:
    """Conversion factor from the unit in brackets at the end of a column header to `unit`."""
    bracket = re.search(r"\(([^()]*)\)\s*$", column)
    if not bracket:
        raise CaseFileError(f"{name}: column '{column}' has no unit; write it as in 'angle (deg)'")
    try:
        return conversion(bracket[1].strip(), unit)
    except UnitError as error:
        raise UnitError(f"{name}: column '{column}': {error}") from None


def series_of(rows: Sequence[Sequence]) -> Mapping[str, Series]:
    """Mapping from names to series, from rows of a generated module."""
    return {row[0]: Series(*row) for row in rows}
