"""Measured vibration from a CSV file: curves over a turn or in time, or amplitudes of orders."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from solve.arrays import Array
from solve.errors import CaseFileError, MissingValueError, UnitError, require_name
from solve.model.tables import cells_of, number_in, size_in_header
from solve.system import PeriodicSystem
from solve.units import GivenSpeed, speed_in_si

_AXES = {"phase": "rad", "time": "s", "order": "1"}
"""Names of the column of which the others are functions, and its unit."""

_SPEED, _PHASE = "speed", "_phase"


@dataclass(frozen=True)
class Measured:
    """What was measured at one speed (rad/s), in SI units.

    orders: whether `at` (k,) are orders, counted per period, or else phases. channels: values (k,) by
    coordinate or output, complex amplitudes where orders have phase angles, moduli where they have none.
    """

    speed: float
    orders: bool
    at: Array
    channels: Mapping[str, Array]


def measured(file: str | Path, system: PeriodicSystem, speed: float | None) -> list[Measured]:
    """Of a file whose header names each column with its unit: first "phase (deg)", "time (s)" or "order (1)",
    then coordinates and outputs, "q3 (m)"; of orders their phase angles too, "q3_phase (deg)".

    A column "speed (rpm)" tells several speeds apart; else all is of the speed (rad/s) given. The phase
    beside the time, as in files of orbits, is not read. Raises CaseFileError, UnitError, UnknownNameError,
    MissingValueError.
    """
    path = Path(file)
    header, *rows = cells_of("data", path)
    names = [re.sub(r"\s*\([^()]*\)\s*$", "", title) for title in header]
    if len(set(names)) < len(names):
        raise CaseFileError(f"data: {path.name} has two columns of one name; give each its own")
    require_name(f"first column of {path.name}", names[0], _AXES)
    read = [place for place, name in enumerate(names) if place == 0 or name not in _AXES]
    columns = {names[place]: _column(path, names, header, rows, system, place) for place in read}
    axis, at = names[0], columns.pop(names[0])
    if _SPEED not in columns and speed is None:
        raise MissingValueError(f"data: {path.name} has no column 'speed (rpm)'; add one, or give --speed")
    speeds = columns.pop(_SPEED, np.full(len(at), speed))
    channels = _channels(columns, axis == "order")
    if not channels or not len(at):
        raise CaseFileError(f"data: {path.name} has no coordinate or output, or no rows; give both")
    given, found = _speed_unit(header[names.index(_SPEED)]) if _SPEED in names else speed, []
    unit = getattr(given, "unit", None)
    for omega in dict.fromkeys(speeds.tolist()):
        rows_of = speeds == omega
        here = at[rows_of] * (omega if axis == "time" else 1.0)
        own = {name: values[rows_of] for name, values in channels.items()}
        found.append(Measured(GivenSpeed(omega, unit), axis == "order", here, own))
    return found


def _column(
    path: Path, names: list[str], header: list[str], rows: list[list[str]], system: PeriodicSystem, place: int
) -> Array:
    """A column (k,) in SI units."""
    name = names[place]
    if place == 0:
        unit = _AXES[name]
    elif name == _SPEED:
        unit = "rad/s"
    elif names[0] == "order" and name.endswith(_PHASE):
        unit = "rad"
    else:
        (name,) = system.known_quantities([name])
        unit = system.units.get(name, "") or "1"
    values = np.array([number_in("data", path, row, place) for row in rows])
    return values * _size(header[place], unit)


def _size(title: str, unit: str) -> float:
    return _speed_unit(title) if unit == "rad/s" else size_in_header("data", title, unit)


def _speed_unit(title: str) -> GivenSpeed:
    """One of the unit in which a column of speeds is given."""
    found = re.search(r"\(([^()]*)\)\s*$", title)
    if found is None:
        raise UnitError(f"data: column '{title}' has no unit; write it as in 'speed (rpm)'")
    return speed_in_si(f"1 {found[1].strip()}")


def _channels(columns: dict[str, Array], orders: bool) -> dict[str, Array]:
    angles = {name.removesuffix(_PHASE): name for name in columns if orders and name.endswith(_PHASE)}
    return {
        name: values * np.exp(1j * columns[angles[name]]) if name in angles else values
        for name, values in columns.items()
        if name not in angles.values()
    }
