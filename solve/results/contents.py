"""Columns and metadata of results, from which records, tables and files are generated.

A record is the object that `--json` prints. In records, NaN and infinity become None, and complex numbers
become [re, im].
"""

import cmath
import functools
import json
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any, NamedTuple

import numpy as np

from solve.arrays import Array
from solve.errors import ValueOutOfBoundsError
from solve.labels import SPEED
from solve.results.formatting import fixed, headed, prefixed
from solve.system import PeriodicSystem

is_state_name = re.compile(r"seal|state\d*").fullmatch
"""Function that matches the names of the arrays from which a result is restored."""

_DISTRIBUTIONS = "parametric-vibration", "casadi", "numpy", "scipy"
"""Packages whose versions are stated in files."""

DEGREES = 361
"""Number of phases of a curve over a period in tables: one per degree of a revolution, and more than the
pixels of a narrow panel."""

HALF_DEGREES = 2 * DEGREES - 1
"""Number of phases of a curve over a period in figures, one for every half degree of a revolution."""

MOST_SHOWN = 6
"""Maximum number of quantities in a picture, and of coordinates in a table or a sentence: as many as fit."""


class Column(NamedTuple):
    """Quantity of a result, from which its record, tables and files are generated.

    Parameters
    ----------
    values : array_like
        Values along `axes`; None and NaN denote missing values.
    unit : str
        Unit; empty for strings and counts.
    meaning : str
        Description.
    heading : str
        Heading in tables; a column without a heading is not shown.
    text : callable or sequence of str
        Function that formats a value for tables, or the formatted texts.
    axes : tuple of str
        Names of the axes. A column without axes appears only in the record.
    """

    values: Any
    unit: str = ""
    meaning: str = ""
    heading: str = ""
    text: Callable[[Any], str] | Sequence[str] = str
    axes: tuple[str, ...] = ("row",)

    @property
    def array(self) -> Array:
        """Values as an array, in which NaN or an empty string replaces missing values."""
        if isinstance(self.values, np.ndarray):
            return self.values
        present = [value for value in self.values if value is not None]
        missing = "" if present and isinstance(present[0], str) else math.nan
        return np.array([missing if value is None else value for value in self.values])

    @property
    def texts(self) -> Sequence[str]:
        """Values formatted for tables."""
        if not callable(self.text):
            return self.text
        return [self.text(value) if known(value) else "–" for value in self.values]


def known(value: Any) -> bool:
    """Return whether a value is neither None nor NaN."""
    return value is not None and value == value


Columns = Mapping[str, Column]

HeaderRows = Sequence[tuple[str, str]]
"""Type of the rows of a result's heading: pairs of a label and a string."""


def digits(form: str, factor: float = 1.0) -> Callable[[float], str]:
    """Return a function that multiplies a number by a factor and formats the product.

    >>> digits(".2f", 1e3)(0.5), digits(".3g")(-0.0)
    ('500.00', '0')
    """
    # Values that round to zero are shown without a minus sign.
    form = f"z{form}" if form.startswith(".") else form
    return lambda value: f"{value * factor:{form}}"


def sized(
    values: Any, unit: str, meaning: str, heading: str, significant: int, largest: float | None = None
) -> Column:
    """Return a column of values in SI units. In tables, the unit prefix and the number of decimals are such
    that the value of largest modulus, or `largest` if given, has `significant` digits."""
    if largest is None:
        numbers = np.array([math.nan if value is None else value for value in values], dtype=float)
        largest = float(np.nanmax(np.abs(numbers), initial=0.0))
    factor, shown = prefixed(unit, largest)

    def text(value: float) -> str:
        return fixed(value * factor, largest * factor, significant)

    return Column(values, unit, meaning, headed(heading, shown), text)


def speeds_of(
    system: PeriodicSystem,
    speeds: Any,
    meaning: str = "speed of rotation",
    heading: str = "",
    form: str = ".6g",
    axes: tuple[str, ...] = ("row",),
) -> Column:
    """Return a column of speeds in rad/s. Tables show the speeds in the system's unit of speed, whose name
    replaces "{}" in the heading."""
    unit = system.labels.speed_unit
    return Column(
        speeds,
        "rad/s",
        meaning,
        heading.format(unit.name),
        lambda value: f"{unit.from_si(value):{form}}",
        axes,
    )


def varied_column(system: PeriodicSystem, name: str, values: Any, form: str = ".7g") -> Column:
    """Return a column of values of the speed (rad/s) or of a parameter."""
    if name == SPEED:
        return speeds_of(system, values, heading="{}", form=form)
    return Column(values, *system.labels.parameter_labels[name], name, digits(form))


def peak_columns(system: PeriodicSystem, peaks: Array, beside: int) -> list[tuple[str, Column]]:
    """Return columns of the largest absolute values (P, n) of the coordinates. Tables show as many of these
    as fit next to `beside` other columns."""
    numbered = enumerate(zip(system.coordinates, peaks.T, strict=True), start=beside)
    return [
        (f"{name}_max_abs", peak_column(system, name, values, number < MOST_SHOWN))
        for number, (name, values) in numbered
    ]


def peak_column(system: PeriodicSystem, name: str, peaks: Array, is_shown: bool) -> Column:
    """Return a column of the largest absolute values of a coordinate or output. Tables show it if `is_shown`
    is True."""
    unit, meaning = system.labels.units.get(name, ""), system.labels.meanings.get(name, name)
    factor, shown = prefixed(unit, float(np.nanmax(peaks, initial=0.0)))
    heading = headed(f"max|{name}|", shown) if is_shown else ""
    return Column(peaks, unit, f"max_abs of {meaning}", heading, digits(".5g", factor))


@dataclass(frozen=True)
class FileContents:
    """Content of a result's files. `columns` are the columns of the table, for .csv and .nc files; `others`
    are additional columns for .nc files. `metadata` is a JSON object. `arrays` are the arrays for .npz and
    .mat files, by default the columns."""

    columns: Columns
    others: Columns
    metadata: Mapping[str, Any]
    arrays: Mapping[str, Array] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Raise ValueOutOfBoundsError for names that a file cannot contain."""
        for name in (*self.columns, *self.others, *self.arrays):
            if not name or "/" in name or name == "metadata" or is_state_name(name):
                raise ValueOutOfBoundsError(
                    f"'{name}' cannot be the name of a column in a file; rename the coordinate"
                )

    @property
    def table(self) -> dict[str, Array]:
        """Columns of equal length, with one row for each combination of values of the axes. The table has the
        axes of the column with the largest number of axes."""
        widest = max(self.columns.values(), key=lambda column: len(column.axes))
        axes, shape = widest.axes, widest.array.shape
        sizes = dict(zip(axes, shape, strict=True))
        reshaped = {
            name: column.array.reshape([sizes[axis] if axis in column.axes else 1 for axis in axes])
            for name, column in self.columns.items()
        }
        return {name: np.broadcast_to(values, shape).ravel() for name, values in reshaped.items()}

    @property
    def numbers(self) -> Mapping[str, Array]:
        """Arrays for .npz and .mat files."""
        return self.arrays or {name: column.array for name, column in self.columns.items()}

    @property
    def metadata_text(self) -> str:
        """Metadata and versions of packages as JSON text."""
        return json.dumps({**self.metadata, "versions": versions()}, ensure_ascii=False, allow_nan=False)


@functools.cache
def versions() -> dict[str, str]:
    """Versions of this program and of the numerical libraries."""
    from importlib.metadata import version

    return {name: version(name) for name in _DISTRIBUTIONS}


def curves_of(
    system: PeriodicSystem, time: Array, phase: Array, q: Array, outputs: Mapping[str, Array]
) -> list[tuple[str, Column]]:
    """Return columns of time, phase, coordinates (n, k) and outputs (k,) at k phases."""
    curves = [("time", (time, "s", "time")), ("phase", (phase, "rad", "phase of the drive"))]
    for name, values in (*zip(system.coordinates, q, strict=True), *outputs.items()):
        curves.append(
            (name, (values, system.labels.units.get(name, ""), system.labels.meanings.get(name, "")))
        )
    return [(name, Column(*curve, axes=("phase",))) for name, curve in curves]


def columns_by_name(columns: Sequence[tuple[str, Column]]) -> Columns:
    """Return a mapping from names to columns. Raises ValueOutOfBoundsError for duplicate names, because one
    of the columns would be lost."""
    by_name: dict[str, Column] = {}
    for name, column in columns:
        first = by_name.setdefault(name, column)
        if first is not column:
            raise ValueOutOfBoundsError(
                f"'{name}' is the name of two quantities ({first.meaning or 'a coordinate'}; "
                f"{column.meaning or 'a coordinate'}); rename the coordinate, output or parameter"
            )
    return by_name


def rows_of(columns: Columns) -> list[dict[str, Any]]:
    """Return the rows of a record, from columns."""
    rows = zip(*(column.values for column in columns.values()), strict=True)
    return [dict(zip(columns, row, strict=True)) for row in rows]


def to_json(value: Any) -> Any:
    """Convert a value to JSON data. Dataclasses and named tuples become dictionaries.

    >>> to_json({"rho": np.array([0.5 + 0.25j]), "error": math.nan})
    {'rho': [[0.5, 0.25]], 'error': None}
    """
    if hasattr(value, "_asdict"):
        value = value._asdict()
    elif is_dataclass(value):
        value = {field.name: getattr(value, field.name) for field in fields(value)}
    if isinstance(value, Mapping):
        return {key: to_json(item) for key, item in value.items()}
    if isinstance(value, complex | np.complexfloating):
        return [float(value.real), float(value.imag)] if cmath.isfinite(value) else [None, None]
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, np.integer | np.bool_):
        return value.item()
    if isinstance(value, Iterable) and not isinstance(value, str):
        return [to_json(item) for item in value]
    return value


def model_info(system: PeriodicSystem) -> dict[str, Any]:
    """Return the model, the case, the hash of the generated code, the parameters and the options. A system
    defined by the user has no case."""
    return {
        "model": system.labels.name,
        "case": system.labels.case,
        "model_hash": system.labels.model_hash,
        "parameters": dict(system.labels.parameters),
        "options": dict(system.labels.options),
    }
