"""Measured vibration read from files, and computed values at the same points. The files contain curves versus
phase or time, amplitudes of orders, or natural frequencies."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from solve.arguments import require_size
from solve.arrays import Array
from solve.equations import most_frequencies
from solve.errors import (
    CaseFileError,
    MissingLibraryError,
    MissingValueError,
    UnitError,
    ValueOutOfBoundsError,
    cause,
    require_name,
)
from solve.labels import SPEED, known_quantities
from solve.model.tables import cells_of, number_in, size_in_header
from solve.results.fit import Channel
from solve.results.orbit import Orbit
from solve.system import PeriodicSystem
from solve.units import LARGEST, GivenSpeed, speed_in_si

_PHASE, _POSITION = "_phase", "position"

ENDINGS = ".csv", ".mat", ".uff", ".unv"

AXES = {"phase": "rad", "time": "s", "order": "1", "mode": "1"}
"""Mapping from the allowed names of the independent variable to their units."""

_ABSCISSAS = {"s": "time", "deg": "phase", "rad": "phase", "order": "order", "1": "order"}
"""Mapping from labels of units in universal files to names of the independent variable."""


_MOST_ORDERS = 10**5
"""Largest permitted order. Chosen by judgement."""

_ALIKE = 1e-3
"""Relative difference up to which the speeds of an orbit and of a measurement count as equal. Chosen by
judgement."""

FREQUENCY = "frequency"
"""Name of the channel that contains natural frequencies."""


class Record(NamedTuple):
    """Content of a measurement file. Each title in `titles` ends in a unit. `columns` contains the values
    (k,) of each column. For a CSV table, `columns` is None, and `texts` contains the unparsed rows. A column
    is parsed only when it is used, so that unused columns may contain anything."""

    path: Path
    titles: Sequence[str]
    columns: Sequence[Array] | None
    texts: Sequence[Sequence[str]] = ()

    def values(self, place: int) -> Array:
        """Values (k,) of the column with index `place`. Raises CaseFileError."""
        if self.columns is not None:
            return self.columns[place]
        return np.array([number_in("data", self.path, row, place) for row in self.texts])


def record(file: str | Path) -> Record:
    """Read the columns of a file. Raises CaseFileError, and MissingLibraryError for universal files without
    pyuff."""
    path = Path(file)
    ending = path.suffix.lower()
    if ending not in ENDINGS:
        raise CaseFileError(f"data: '{path.name or path}' ends in '{ending}'; allowed: {', '.join(ENDINGS)}")
    if ending == ".csv":
        titles, *rows = cells_of("data", path)
        return Record(path, titles, None, rows)
    try:
        require_size(f"bytes in '{path}'", path.stat().st_size, 1)
        return (_matlab if ending == ".mat" else _universal)(path)
    except (OSError, ValueError, TypeError, KeyError, IndexError, NotImplementedError) as error:
        raise CaseFileError(
            f"data: '{path}' cannot be read ({cause(error)}); give a complete {ending} file"
        ) from None


def _matlab(path: Path) -> Record:
    """Read a .mat file that contains vectors of equal length and a struct `units` with the unit of each
    vector. A scalar applies to all rows."""
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    try:
        content = loadmat(str(path), squeeze_me=True, struct_as_record=False, appendmat=False)
    except MatReadError:
        raise ValueError from None
    units: Any = content.get("units")
    vectors = {
        name: np.atleast_1d(value).astype(float)
        for name, value in content.items()
        if not name.startswith("__") and isinstance(value, np.ndarray | float | int) and np.ndim(value) < 2
    }
    axis = next((name for name in AXES if name in vectors), None)
    if axis is None:
        *others, last = AXES
        raise CaseFileError(
            f"data: {path.name} has no vector named {', '.join(others)} or {last}; add one of them"
        )
    count = len(vectors[axis])
    names = [axis, *(name for name in vectors if name not in AXES)]
    other = [name for name in names if len(vectors[name]) not in (1, count)]
    if other:
        raise CaseFileError(
            f"data: {path.name}: {other[0]} and {axis} have different lengths; give one value per row"
        )
    titles = [f"{name} ({getattr(units, name)})" if hasattr(units, name) else name for name in names]
    return Record(path, titles, [np.broadcast_to(vectors[name], count) for name in names])


def _universal(path: Path) -> Record:
    """Read a universal file that contains functions at nodal degrees of freedom (dataset 58) with a common
    abscissa. The first text line of each function names the coordinate or output."""
    try:
        import pyuff
    except ImportError:
        raise MissingLibraryError.of_extra("a universal file", "pyuff", "uff") from None
    if not path.is_file():
        raise OSError
    read_sets = pyuff.UFF(str(path)).read_sets()
    sets = [
        function
        for function in (read_sets if isinstance(read_sets, list) else [read_sets])
        if function.get("type") == 58
    ]
    if not sets:
        raise CaseFileError(f"data: {path.name} has no dataset 58; export functions of time, angle or order")
    label = _label(sets[0], "abscissa") or "s"
    if label not in _ABSCISSAS:
        raise CaseFileError(
            f"data: {path.name} has an abscissa in '{label}'; allowed: s, deg, rad, or order for spectra"
        )
    axis, x = _ABSCISSAS[label], np.asarray(sets[0]["x"], dtype=float)
    titles, columns = [f"{axis} ({'1' if axis == 'order' else label})"], [x]
    for function in sets:
        if len(function["x"]) != len(x) or not np.allclose(function["x"], x, rtol=1e-9, atol=0.0):
            raise CaseFileError(
                f"data: {path.name} has functions of several abscissas; export functions of a single one"
            )
        name, values = str(function["id1"]).strip(), np.asarray(function["data"])
        titles.append(f"{name} ({_label(function, 'ordinate') or '1'})")
        columns.append(np.abs(values) if np.iscomplexobj(values) else values)
        if np.iscomplexobj(values):
            titles.append(f"{name}_phase (rad)")
            columns.append(np.angle(values))
    return Record(path, titles, columns)


def _label(dataset: dict[str, Any], axis: str) -> str:
    return str(dataset.get(f"{axis}_axis_units_lab") or "").strip().removeprefix("NONE")


@dataclass(frozen=True)
class Measured:
    """Measurement at one speed (rad/s), in SI units.

    `at` (k,) contains phases in rad or, if `orders` is True, orders counted per period. `channels` maps each
    coordinate or output to its values (k,); amplitudes of orders are complex if phase angles are given,
    otherwise moduli. For natural frequencies, `position` is the phase at which the mechanism was at rest,
    `at` contains the numbers of the modes, from 1, and FREQUENCY is the only channel.
    """

    speed: float
    orders: bool
    at: Array
    channels: Mapping[str, Array]
    position: float | None = None


def measured(file: str | Path, system: PeriodicSystem, speed: float | None) -> list[Measured]:
    """Read measurements from a .csv, .mat, .uff or .unv file, one measurement per speed or position.

    Each title of a column ends in a unit. The first column is "phase (deg)", "time (s)" or "order (1)". The
    next columns are coordinates and outputs, for example "q3 (m)". Phase angles of orders may be added, for
    example "q3_phase (deg)". Alternatively, the first column is "mode (1)", followed by "frequency (Hz)" and,
    if needed, "position (deg)".

    A column "speed (rpm)" at any place distinguishes measurements at several speeds. Without this column,
    `speed` (rad/s) applies. If the first column is the time, a column of the phase, as in files of orbits, is
    not read. Raises CaseFileError, UnitError, UnknownNameError, MissingValueError, ValueOutOfBoundsError.
    """
    read = record(file)
    names = [re.sub(r"\s*\([^()]*\)\s*$", "", title) for title in read.titles]
    if len(set(names)) < len(names):
        raise CaseFileError(f"data: {read.path.name} has two columns of the same name; rename one")
    first = next((place for place, name in enumerate(names) if name != SPEED), 0)
    axis = names[first]
    require_name(f"first column of {read.path.name}", axis, AXES)
    kept = [place for place, name in enumerate(names) if place == first or name not in AXES]
    columns = {names[place]: _column(read, names, system, axis, place) for place in kept}
    at = columns.pop(axis)
    if axis == "mode":
        return _frequencies(read, at, columns, system)
    if SPEED not in columns and speed is None:
        raise MissingValueError(
            f"data: {read.path.name} has no column 'speed (rpm)'; add one, or give --speed"
        )
    speeds = columns.pop(SPEED, np.full(len(at), speed))
    channels = _channels(columns, axis == "order")
    if not channels or not len(at):
        raise CaseFileError(
            f"data: {read.path.name} has no column of a coordinate or output, or no rows; give at least "
            "one of each"
        )
    _require_valid(read.path.name, axis, at, speeds, channels)
    speed_given = _speed_unit(read.titles[names.index(SPEED)]) if SPEED in names else speed
    unit, sets = getattr(speed_given, "unit", None), []
    for omega in dict.fromkeys(speeds.tolist()):
        rows_of = speeds == omega
        here = at[rows_of] * (omega if axis == "time" else 1.0)
        at_speed = {name: values[rows_of] for name, values in channels.items()}
        sets.append(Measured(GivenSpeed(omega, unit), axis == "order", here, at_speed))
    return sets


def compared_at_speed(orbit: Orbit, sets: Sequence[Measured]) -> list[Channel]:
    """Return the measured and the computed values of every channel that was measured at the speed of an
    orbit. Raises ValueOutOfBoundsError if there are no measurements at this speed."""
    channels = []
    for measurement in sets:
        if measurement.position is not None or not np.isclose(measurement.speed, orbit.speed, rtol=_ALIKE):
            continue
        for name, values in measurement.channels.items():
            if measurement.orders:
                computed = _orders_of(orbit, name, measurement.at, np.iscomplexobj(values))
            else:
                computed = orbit.signal(name)(measurement.at)
            channels.append(
                Channel(measurement.speed, measurement.orders, name, measurement.at, values, computed)
            )
    if not channels:
        unit = orbit.system.labels.speed_unit
        speeds = (
            ", ".join(unit.text(measurement.speed) for measurement in sets if measurement.position is None)
            or "none"
        )
        raise ValueOutOfBoundsError(
            f"nothing was measured at {unit.text(orbit.speed)}; the speeds of the data are: {speeds}"
        )
    return channels


def _orders_of(orbit: Orbit, name: str, orders: Array, angles: bool) -> Array:
    """Return complex amplitudes (k,) of orders. If `angles` is False, moduli are returned instead, except
    that the mean keeps its sign."""
    size, angle = orbit.harmonics(name, round(orders.max()))
    at = np.round(orders).astype(int)
    return (size * np.exp(1j * angle))[at] if angles else size[at]


def _require_valid(file: str, axis: str, at: Array, speeds: Array, channels: Mapping[str, Array]) -> None:
    """Raise ValueOutOfBoundsError for invalid phases, orders, speeds or channels."""
    if not np.isfinite(at).all():
        raise ValueOutOfBoundsError(f"data: {file} has a {axis} that is not finite; omit the row")
    if axis == "order" and not ((at == np.round(at)) & (at >= 0)).all():
        other = at[(at != np.round(at)) | (at < 0)][0]
        raise ValueOutOfBoundsError(
            f"data: {file} has the order {other:g}; allowed: whole numbers of at least 0, counted per period"
        )
    if not (speeds > 0).all():
        raise ValueOutOfBoundsError(f"data: {file} has a speed of {speeds.min():g} rad/s; allowed: above 0")
    if axis == "order" and at.max() > _MOST_ORDERS:
        raise ValueOutOfBoundsError(
            f"data: {file} has the order {at.max():g}; allowed: up to {_MOST_ORDERS}, counted per period"
        )
    for name, values in channels.items():
        if not (np.abs(values) < LARGEST).all():
            raise ValueOutOfBoundsError(
                f"data: {file} has {np.abs(values).max():g} for {name}; allowed: below {LARGEST:g} in "
                "SI units"
            )
        if axis == "order" and np.isrealobj(values) and (values[at > 0] < 0).any():
            raise ValueOutOfBoundsError(
                f"data: {file} has the amplitude {values[at > 0].min():g} for {name}; allowed: 0 and "
                f"above, or any value with a column '{name}{_PHASE} (deg)'"
            )
    zero = [name for name, values in channels.items() if not values.any()]
    if zero:
        raise ValueOutOfBoundsError(f"data: {file} has only zeros for {zero[0]}; omit this column")


def _frequencies(
    read: Record, modes: Array, columns: Mapping[str, Array], system: PeriodicSystem
) -> list[Measured]:
    """Return the measured natural frequencies, one set for each position."""
    if FREQUENCY not in columns or not len(modes):
        raise CaseFileError(
            f"data: {read.path.name} has no column 'frequency (Hz)', or no rows; give the column, with at "
            "least one row"
        )
    most = most_frequencies(system)
    invalid = modes[(modes != np.round(modes)) | (modes < 1) | (modes > most)]
    if len(invalid):
        raise ValueOutOfBoundsError(
            f"data: {read.path.name} contains the mode {invalid[0]:g}; {system.labels.name} has the modes "
            f"1 to {most}, counted from the lowest frequency"
        )
    if not (columns[FREQUENCY] > 0).all():
        raise ValueOutOfBoundsError(
            f"data: {read.path.name} has a natural frequency of {columns[FREQUENCY].min() / (2 * np.pi):g} "
            "Hz; allowed: above 0; omit rigid-body modes"
        )
    positions = columns.get(_POSITION, np.zeros(len(modes)))
    measurements = []
    for position in dict.fromkeys(positions.tolist()):
        here = positions == position
        measurements.append(
            Measured(0.0, False, modes[here], {FREQUENCY: columns[FREQUENCY][here]}, position)
        )
    return measurements


def _column(read: Record, names: list[str], system: PeriodicSystem, axis: str, place: int) -> Array:
    """Return the values (k,) of a column in SI units."""
    name = names[place]
    of_modes = {FREQUENCY: "rad/s", _POSITION: "rad"} if axis == "mode" else {}
    if name == axis:
        unit = AXES[name]
    elif name in of_modes:
        unit = of_modes[name]
    elif name == SPEED:
        unit = "rad/s"
    elif axis == "order" and name.endswith(_PHASE):
        unit = "rad"
    else:
        (name,) = known_quantities(system, [name])
        unit = system.labels.units.get(name, "") or "1"
    return read.values(place) * _size(read.titles[place], unit)


def _size(title: str, unit: str) -> float:
    return _speed_unit(title) if unit == "rad/s" else size_in_header("data", title, unit)


def _speed_unit(title: str) -> GivenSpeed:
    """Return the speed in rad/s that corresponds to one unit in a column of speeds."""
    match = re.search(r"\(([^()]*)\)\s*$", title)
    if match is None:
        raise UnitError(f"data: column '{title}' has no unit; write it as in 'speed (rpm)'")
    return speed_in_si(f"1 {match[1].strip()}")


def _channels(columns: dict[str, Array], orders: bool) -> dict[str, Array]:
    angles = {name.removesuffix(_PHASE): name for name in columns if orders and name.endswith(_PHASE)}
    return {
        name: values * np.exp(1j * columns[angles[name]]) if name in angles else values
        for name, values in columns.items()
        if name not in angles.values()
    }
