"""What a record and a file of results hold, whatever their format. In records, the keys of `--json`, NaN and
infinity become None, complex numbers [re, im]."""

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
from solve.results.quantities import fixed, headed, prefixed
from solve.system import PeriodicSystem

is_of_the_state = re.compile(r"seal|state\d*").fullmatch
"""Whether a name in a file is that of what a result is read back from."""

_DISTRIBUTIONS = "parametric-vibration", "casadi", "numpy", "scipy"


MOST_SHOWN = 6
"""Quantities in one picture, and coordinates beside each other in tables and sentences."""


class Column(NamedTuple):
    """A quantity of a result, stated once for its record, its tables and its files.

    values along the axes; unit ("" for texts and counts), meaning; in a table under `heading`, where it has
    one, each value by `text`, or in the texts given. Without axes it is of the record alone.
    """

    values: Any
    unit: str = ""
    meaning: str = ""
    heading: str = ""
    text: Callable[[Any], str] | Sequence[str] = str
    axes: tuple[str, ...] = ("row",)

    @property
    def array(self) -> Array:
        """The values; NaN or an empty text where there is none."""
        if isinstance(self.values, np.ndarray):
            return self.values
        some = [each for each in self.values if each is not None]
        missing = "" if some and isinstance(some[0], str) else math.nan
        return np.array([missing if each is None else each for each in self.values])

    @property
    def texts(self) -> Sequence[str]:
        """What a table shows."""
        if not callable(self.text):
            return self.text
        return [self.text(value) if known(value) else "–" for value in self.values]


def known(value: Any) -> bool:
    """Whether it is neither None nor NaN."""
    return value is not None and value == value


Columns = Mapping[str, Column]

Facts = Sequence[tuple[str, str]]
"""Rows of the heading of a result: a word, and what it stands for."""


def digits(form: str, factor: float = 1.0) -> Callable[[float], str]:
    """Numbers times a factor as texts of this form.

    >>> digits(".2f", 1e3)(0.5), digits(".3g")(-0.0)
    ('500.00', '0')
    """
    # Without the sign of values that round to zero.
    form = f"z{form}" if form.startswith(".") else form
    return lambda value: f"{value * factor:{form}}"


def sized(
    values: Any, unit: str, meaning: str, heading: str, places: int, largest: float | None = None
) -> Column:
    """Numbers in SI units, in a table in the unit that suits the largest, with so many digits of it."""
    if largest is None:
        known = np.array([math.nan if value is None else value for value in values], dtype=float)
        largest = float(np.nanmax(np.abs(known), initial=0.0))
    factor, shown = prefixed(unit, largest)

    def text(value: float) -> str:
        return fixed(value * factor, largest * factor, places)

    return Column(values, unit, meaning, headed(heading, shown), text)


def speeds_of(
    system: PeriodicSystem,
    speeds: Any,
    meaning: str = "speed of rotation",
    heading: str = "",
    form: str = ".6g",
    axes: tuple[str, ...] = ("row",),
) -> Column:
    """Speeds (rad/s), in a table in the unit in which results of the system show them, which "{}" in the
    heading stands for."""
    unit = system.speed_unit
    return Column(
        speeds, "rad/s", meaning, heading.format(unit.name), lambda value: f"{unit.of(value):{form}}", axes
    )


@dataclass(frozen=True)
class Contents:
    """columns: the table of .csv. further: what .nc holds besides. arrays: for .npz and .mat, by default the
    columns. metadata: plain data about the whole."""

    columns: Columns
    further: Columns
    metadata: Mapping[str, Any]
    arrays: Mapping[str, Array] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Raise ValueOutOfBoundsError for names of columns that no file can hold."""
        for name in (*self.columns, *self.further, *self.arrays):
            if not name or "/" in name or name == "metadata" or is_of_the_state(name):
                raise ValueOutOfBoundsError(
                    f"'{name}' cannot be the name of a column in a file; give the coordinate another"
                )

    @property
    def table(self) -> dict[str, Array]:
        """The columns with a row for each place on all their axes, in the order of the widest one."""
        widest = max(self.columns.values(), key=lambda column: len(column.axes))
        axes, shape = widest.axes, widest.array.shape
        sizes = dict(zip(axes, shape, strict=True))
        along = {
            name: column.array.reshape([sizes[axis] if axis in column.axes else 1 for axis in axes])
            for name, column in self.columns.items()
        }
        return {name: np.broadcast_to(values, shape).ravel() for name, values in along.items()}

    @property
    def numbers(self) -> Mapping[str, Array]:
        """What .npz and .mat hold."""
        return self.arrays or {name: column.array for name, column in self.columns.items()}

    @property
    def metadata_text(self) -> str:
        whole = {**self.metadata, "versions": versions()}
        return json.dumps(whole, ensure_ascii=False, allow_nan=False)


@functools.cache
def versions() -> dict[str, str]:
    """Of this program and of what it calculates with."""
    from importlib.metadata import version

    return {name: version(name) for name in _DISTRIBUTIONS}


def curves_of(
    system: PeriodicSystem, time: Array, phase: Array, q: Array, outputs: Mapping[str, Array]
) -> list[tuple[str, Column]]:
    """Time, phase, coordinates (n, k) and outputs (k,) by name, at k phases."""
    curves = [("time", (time, "s", "time")), ("phase", (phase, "rad", "phase of the drive"))]
    for name, values in (*zip(system.coordinates, q, strict=True), *outputs.items()):
        curves.append((name, (values, system.units.get(name, ""), system.meanings.get(name, ""))))
    return [(name, Column(*curve, axes=("phase",))) for name, curve in curves]


def require_different_names(variables: Sequence[tuple[str, Column]]) -> None:
    """Raise ValueOutOfBoundsError where a name stands for two columns, of which one would be lost."""
    known: dict[str, Column] = {}
    for name, variable in variables:
        first = known.setdefault(name, variable)
        if first is not variable:
            raise ValueOutOfBoundsError(
                f"'{name}' is the name of two quantities ({first.meaning or 'a coordinate'}; "
                f"{variable.meaning or 'a coordinate'}); give the coordinate, output or parameter another"
            )


def rows_of(columns: Columns) -> list[dict[str, Any]]:
    """The rows of a record."""
    return [
        dict(zip(columns, row, strict=True))
        for row in zip(*(column.values for column in columns.values()), strict=True)
    ]


def plain(value: Any) -> Any:
    """Python's own numbers, lists and dictionaries; dataclasses and named tuples as these.

    >>> plain({"rho": np.array([0.5 + 0.25j]), "error": math.nan})
    {'rho': [[0.5, 0.25]], 'error': None}
    """
    if hasattr(value, "_asdict"):
        value = value._asdict()
    elif is_dataclass(value):
        value = {field.name: getattr(value, field.name) for field in fields(value)}
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, complex | np.complexfloating):
        return [float(value.real), float(value.imag)] if cmath.isfinite(value) else [None, None]
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, np.integer | np.bool_):
        return value.item()
    if isinstance(value, Iterable) and not isinstance(value, str):
        return [plain(item) for item in value]
    return value


def model_record(system: PeriodicSystem) -> dict[str, Any]:
    """Which model, with which numbers; a system of a user's own has neither case nor parameters."""
    return {
        "model": system.name,
        "case": system.case,
        "model_hash": system.model_hash,
        "parameters": dict(system.parameters),
        "options": dict(system.options),
    }
