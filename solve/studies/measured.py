"""Measured vibration: curves over a turn or in time, amplitudes of orders, or natural frequencies; and an
orbit beside it."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from solve.arrays import Array
from solve.errors import CaseFileError, MissingValueError, UnitError, ValueOutOfBoundsError, require_name
from solve.model.tables import size_in_header
from solve.results.fit import Channel
from solve.results.orbit import Orbit
from solve.studies.records import AXES, Record, record
from solve.system import PeriodicSystem
from solve.units import GivenSpeed, speed_in_si

_SPEED, _PHASE, _POSITION = "speed", "_phase", "position"

_MOST_ORDERS, _LARGEST = 10**5, 1e100
"""Orders, and values whose squares can be summed."""

_ALIKE = 1e-3
"""Relative difference of the speeds of an orbit and of what is drawn beside it."""

FREQUENCY = "frequency"
"""The channel of natural frequencies."""


@dataclass(frozen=True)
class Measured:
    """What was measured at one speed (rad/s), in SI units.

    orders: whether `at` (k,) are orders, counted per period, or else phases. channels: values (k,) by
    coordinate or output, complex amplitudes where orders have phase angles, moduli where they have none.
    position: the phase at which natural frequencies were measured at rest; `at` are then their modes, from 1
    on, and FREQUENCY is the only channel.
    """

    speed: float
    orders: bool
    at: Array
    channels: Mapping[str, Array]
    position: float | None = None


def measured(file: str | Path, system: PeriodicSystem, speed: float | None) -> list[Measured]:
    """Of a file, see `solve.studies.records.record`, whose columns have titles with units: first
    "phase (deg)", "time (s)" or "order (1)", then coordinates and outputs, "q3 (m)"; of orders their phase
    angles too, "q3_phase (deg)". Or first "mode (1)", then "frequency (Hz)", and where it matters
    "position (deg)".

    A column "speed (rpm)", anywhere, tells several speeds apart; else all is of the speed (rad/s) given. The
    phase beside the time, as in files of orbits, is not read. Raises CaseFileError, UnitError,
    UnknownNameError, MissingValueError, ValueOutOfBoundsError.
    """
    read = record(file)
    names = [re.sub(r"\s*\([^()]*\)\s*$", "", title) for title in read.titles]
    if len(set(names)) < len(names):
        raise CaseFileError(f"data: {read.path.name} has two columns of one name; give each its own")
    first = next((place for place, name in enumerate(names) if name != _SPEED), 0)
    axis = names[first]
    require_name(f"first column of {read.path.name}", axis, AXES)
    places = [place for place, name in enumerate(names) if place == first or name not in AXES]
    columns = {names[place]: _column(read, names, system, axis, place) for place in places}
    at = columns.pop(axis)
    if axis == "mode":
        return _frequencies(read, at, columns, system)
    if _SPEED not in columns and speed is None:
        raise MissingValueError(
            f"data: {read.path.name} has no column 'speed (rpm)'; add one, or give --speed"
        )
    speeds = columns.pop(_SPEED, np.full(len(at), speed))
    channels = _channels(columns, axis == "order")
    if not channels or not len(at):
        raise CaseFileError(f"data: {read.path.name} has no coordinate or output, or no rows; give both")
    _require_sound(read.path.name, axis, at, speeds, channels)
    given, found = _speed_unit(read.titles[names.index(_SPEED)]) if _SPEED in names else speed, []
    unit = getattr(given, "unit", None)
    for omega in dict.fromkeys(speeds.tolist()):
        rows_of = speeds == omega
        here = at[rows_of] * (omega if axis == "time" else 1.0)
        own = {name: values[rows_of] for name, values in channels.items()}
        found.append(Measured(GivenSpeed(omega, unit), axis == "order", here, own))
    return found


def beside(orbit: Orbit, sets: Sequence[Measured]) -> list[Channel]:
    """Measured and computed values of every channel that was measured at the speed of an orbit. Raises
    ValueOutOfBoundsError where there is none."""
    found = []
    for each in sets:
        if each.position is not None or not np.isclose(each.speed, orbit.speed, rtol=_ALIKE):
            continue
        for name, values in each.channels.items():
            if each.orders:
                computed = _orders_of(orbit, name, each.at, np.iscomplexobj(values))
            else:
                computed = orbit.signal(name)(each.at)
            found.append(Channel(each.speed, each.orders, name, each.at, values, computed))
    if not found:
        unit = orbit.system.speed_unit
        speeds = ", ".join(unit.text(each.speed) for each in sets if each.position is None) or "none"
        raise ValueOutOfBoundsError(
            f"nothing is measured at {unit.text(orbit.speed)}; the data are of: {speeds}"
        )
    return found


def _orders_of(orbit: Orbit, name: str, orders: Array, angles: bool) -> Array:
    """Complex amplitudes (k,) of orders, or moduli, but for the mean's sign."""
    size, angle = orbit.harmonics(name, round(orders.max()))
    at = np.round(orders).astype(int)
    return (size * np.exp(1j * angle))[at] if angles else size[at]


def _require_sound(file: str, axis: str, at: Array, speeds: Array, channels: Mapping[str, Array]) -> None:
    """Raise ValueOutOfBoundsError for phases, orders, speeds or channels that cannot be."""
    if not np.isfinite(at).all():
        raise ValueOutOfBoundsError(f"data: {file} has a {axis} that is no finite number; leave the row out")
    if axis == "order" and not ((at == np.round(at)) & (at >= 0)).all():
        other = at[(at != np.round(at)) | (at < 0)][0]
        raise ValueOutOfBoundsError(
            f"data: {file} has the order {other:g}; allowed: whole numbers from 0 on, counted per period"
        )
    if not (speeds > 0).all():
        raise ValueOutOfBoundsError(f"data: {file} has a speed of {speeds.min():g} rad/s; allowed: above 0")
    if axis == "order" and at.max() > _MOST_ORDERS:
        raise ValueOutOfBoundsError(
            f"data: {file} has the order {at.max():g}; allowed: up to {_MOST_ORDERS}, counted per period"
        )
    for name, values in channels.items():
        if not (np.abs(values) < _LARGEST).all():
            raise ValueOutOfBoundsError(
                f"data: {file} has {np.abs(values).max():g} for {name}; allowed: below {_LARGEST:g} in "
                "SI units"
            )
        if axis == "order" and np.isrealobj(values) and (values[at > 0] < 0).any():
            raise ValueOutOfBoundsError(
                f"data: {file} has the amplitude {values[at > 0].min():g} for {name}; allowed: 0 and "
                f"above, or with a column '{name}{_PHASE} (deg)'"
            )
    nothing = [name for name, values in channels.items() if not values.any()]
    if nothing:
        raise ValueOutOfBoundsError(f"data: {file} has nothing but zeros for {nothing[0]}; leave it out")


def _frequencies(
    read: Record, modes: Array, columns: Mapping[str, Array], system: PeriodicSystem
) -> list[Measured]:
    """Natural frequencies at each of the positions."""
    if FREQUENCY not in columns or not len(modes):
        raise CaseFileError(f"data: {read.path.name} has no column 'frequency (Hz)', or no rows; give both")
    most = system.most_frequencies
    if not ((modes == np.round(modes)) & (modes >= 1) & (modes <= most)).all():
        raise ValueOutOfBoundsError(
            f"data: {read.path.name} has modes from {modes.min():g} to {modes.max():g}; {system.name} has "
            f"the modes 1 to {most}, counted from the lowest frequency"
        )
    if not (columns[FREQUENCY] > 0).all():
        raise ValueOutOfBoundsError(
            f"data: {read.path.name} has a natural frequency of {columns[FREQUENCY].min() / (2 * np.pi):g} "
            "Hz; allowed: above 0; leave rigid-body modes out"
        )
    positions = columns.get(_POSITION, np.zeros(len(modes)))
    found = []
    for position in dict.fromkeys(positions.tolist()):
        here = positions == position
        found.append(Measured(0.0, False, modes[here], {FREQUENCY: columns[FREQUENCY][here]}, position))
    return found


def _column(read: Record, names: list[str], system: PeriodicSystem, axis: str, place: int) -> Array:
    """A column (k,) in SI units."""
    name = names[place]
    of_modes = {FREQUENCY: "rad/s", _POSITION: "rad"} if axis == "mode" else {}
    if name == axis:
        unit = AXES[name]
    elif name in of_modes:
        unit = of_modes[name]
    elif name == _SPEED:
        unit = "rad/s"
    elif axis == "order" and name.endswith(_PHASE):
        unit = "rad"
    else:
        (name,) = system.known_quantities([name])
        unit = system.units.get(name, "") or "1"
    return read.values(place) * _size(read.titles[place], unit)


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
