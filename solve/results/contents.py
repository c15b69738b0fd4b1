"""What a record and a file of results hold, whatever their format. In records, the keys of `--json`, NaN and
infinity become None, complex numbers [re, im]."""

import cmath
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from solve.arrays import Array
from solve.errors import ValueOutOfBoundsError
from solve.system import PeriodicSystem


class Variable(NamedTuple):
    """A named array: its axis ("phase", "multiplier", …) or axes, unit ("" for texts and counts), meaning."""

    axis: str | tuple[str, ...]
    values: Array
    unit: str
    meaning: str


@dataclass(frozen=True)
class Contents:
    """columns: the table of .csv. further: what .nc holds besides. arrays: for .npz and .mat.
    metadata: plain data about the whole."""

    columns: Mapping[str, Variable]
    further: Mapping[str, Variable]
    arrays: Mapping[str, Array]
    metadata: Mapping[str, Any]

    @property
    def table(self) -> dict[str, Array]:
        """The columns with a row for each place on all their axes, in the order of the widest one."""
        widest = max(self.columns.values(), key=lambda column: column.values.ndim)
        axes, shape = _axes(widest), widest.values.shape
        sizes = dict(zip(axes, shape, strict=True))
        along = {
            name: v.values.reshape([sizes[axis] if axis in _axes(v) else 1 for axis in axes])
            for name, v in self.columns.items()
        }
        return {name: np.broadcast_to(values, shape).ravel() for name, values in along.items()}

    @property
    def metadata_text(self) -> str:
        return json.dumps(self.metadata, ensure_ascii=False, allow_nan=False)


def require_different_names(variables: Sequence[tuple[str, Variable]]) -> None:
    """Raise ValueOutOfBoundsError where a name stands for two variables, of which one would be lost."""
    known: dict[str, Variable] = {}
    for name, variable in variables:
        first = known.setdefault(name, variable)
        if first is not variable:
            raise ValueOutOfBoundsError(
                f"'{name}' is the name of two quantities ({first.meaning or 'a coordinate'}; "
                f"{variable.meaning or 'a coordinate'}); give the coordinate or output another"
            )


def _axes(variable: Variable) -> tuple[str, ...]:
    return (variable.axis,) if isinstance(variable.axis, str) else variable.axis


def table_contents(
    columns: Mapping[str, tuple[Sequence[Any], str, str]],
    metadata: Mapping[str, Any],
    axes: tuple[str, ...] = ("row",),
) -> Contents:
    """Columns of a table by name: values, unit, meaning; over all axes, or over the one that they name."""
    made = {
        name: Variable((name,) if name in axes else axes, np.array(values), unit, meaning)
        for name, (values, unit, meaning) in columns.items()
    }
    return Contents(made, {}, {name: column.values for name, column in made.items()}, plain(metadata))


def rows_contents(
    rows: Sequence[Mapping[str, Any]],
    columns: Mapping[str, tuple[Any, str, str]],
    metadata: Mapping[str, Any],
) -> Contents:
    """Rows of a table; columns by name: what stands where a row has None, unit, meaning."""
    made = {
        name: ([missing if row[name] is None else row[name] for row in rows], unit, meaning)
        for name, (missing, unit, meaning) in columns.items()
    }
    return table_contents(made, metadata)


def plain(value: Any) -> Any:
    """Python's own numbers, lists and dictionaries.

    >>> plain({"rho": np.array([0.5 + 0.25j]), "error": math.nan})
    {'rho': [[0.5, 0.25]], 'error': None}
    """
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, complex | np.complexfloating):
        return [float(value.real), float(value.imag)] if cmath.isfinite(value) else None
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
        "parameters": dict(system.parameters),
        "options": dict(system.options),
    }
