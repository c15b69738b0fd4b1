"""Labels of a system: names, parameter values, units and meanings, as results show them."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

from solve.arguments import unique_names
from solve.contracts import DrawnLink
from solve.errors import (
    MissingValueError,
    NoMotionError,
    NoVibrationError,
    ValueOutOfBoundsError,
    require_name,
)
from solve.units import RPM, ShownUnit, in_unit, raised, speed_in_si

SPEED = "speed"
"""Name of the speed Ω (rad/s) if the speed is varied like a parameter."""


@dataclass(frozen=True)
class Labels:
    """Names, parameter values, units and meanings of a system, without its equations."""

    name: str = "system"
    title: str = ""
    """Description in one line."""
    case: str | None = None
    """Name of the case."""
    case_speed: str | None = None
    model_hash: str | None = None
    """Hash of the generated code of the equations."""
    solvable: bool = True
    """Whether the system has equations. A system read from a result file has only labels."""
    options: Mapping[str, Any] = field(default_factory=dict)
    parameters: Mapping[str, float] = field(default_factory=dict)
    """Parameters that can be varied, in the units declared by the model."""
    parameter_labels: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    """Mapping from parameters to units and meanings."""
    parameter_sources: Mapping[str, str] = field(default_factory=dict)
    """Mapping from parameters to the sources of their values. Only values from the case have a source."""
    equations: tuple[str, ...] = ()
    """Equations as HTML elements with MathML."""
    links: tuple[DrawnLink, ...] = ()
    """Links in drawings of mode shapes."""
    sketch_unit: str = "m"
    """Unit of the points of the sketch."""
    moves: bool = True
    """Whether the drive moves; False for a structure at rest."""
    vibrates: bool = True
    """Whether there are coordinates; False for a rigid mechanism, whose motion is prescribed."""
    outputs_apart: bool = False
    """Whether outputs are computed individually on access, rather than all together."""
    equation_warnings: tuple[str, ...] = ()
    """Warnings about the equations that apply at any speed: neglected terms, errors of fitted series."""
    largest_of: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Mapping from each quantity that is the largest of several outputs to these outputs, for example to the
    stresses on both surfaces."""
    units: Mapping[str, str] = field(default_factory=dict)
    meanings: Mapping[str, str] = field(default_factory=dict)
    speed_unit: ShownUnit = RPM
    """Display unit of speeds in results."""
    no_motion: str = ""
    """Reason why there are no equations of motion."""


class Labelled(Protocol):
    """System with labels."""

    labels: Labels

    @property
    def coordinates(self) -> tuple[str, ...]: ...

    @property
    def outputs(self) -> tuple[str, ...]: ...


def unit_of(system: Labelled, name: str) -> ShownUnit:
    """Display unit of a parameter, or of the "speed"."""
    unit, _ = system.labels.parameter_labels.get(name, ("", ""))
    return system.labels.speed_unit if name == SPEED else ShownUnit(raised(unit), 1.0)


def in_own_unit(system: Labelled, name: str, value: float | str) -> float:
    """Convert a value of a parameter, a number or a string such as "30 mm", to the declared unit of the
    parameter. Raises UnknownNameError, UnitError, and ValueOutOfBoundsError if the value is not a number."""
    labels = system.labels
    if isinstance(value, str):
        require_name(f"parameter of {labels.name}", name, labels.parameters)
    unit, _ = labels.parameter_labels.get(name, ("", ""))
    return in_unit(value, unit or "1", name)


def bounds_in_own_unit(
    system: Labelled, name: str, ends: tuple[float | str, float | str]
) -> tuple[float, float]:
    """Return the lower and the upper bound of a parameter in its declared unit. The initial value of the
    parameter must lie between them. Raises UnknownNameError, UnitError, ValueOutOfBoundsError."""
    labels = system.labels
    require_name(f"parameter of {labels.name}", name, labels.parameters)
    low, high = (in_own_unit(system, name, end) for end in ends)
    value = float(labels.parameters[name])
    if not low < high:
        raise ValueOutOfBoundsError(
            f"bounds of {name} are {low:g} to {high:g}; give two numbers, the lower one first"
        )
    if not low <= value <= high:
        raise ValueOutOfBoundsError(
            f"bounds of {name} are {low:g} to {high:g}, but its initial value is {value:g}; give "
            f"bounds that contain this value, or another value with --set {name}=NUMBER"
        )
    return low, high


def known_quantities(system: Labelled, names: str | Iterable[str] | None = None) -> tuple[str, ...]:
    """Names of coordinates and outputs without repetitions; all of them if `names` is None. A string counts
    as one name. Raises UnknownNameError."""
    allowed = (*system.coordinates, *system.outputs)
    names = unique_names(allowed if names is None else names)
    for name in names:
        require_name(f"coordinate or output of {system.labels.name}", name, allowed)
    return names


def parts_of(system: Labelled, quantity: str) -> tuple[str, ...]:
    """Names of the coordinates or outputs that a quantity consists of: the quantity itself or, if it is the
    largest of several outputs, these outputs. Raises UnknownNameError."""
    largest_of = system.labels.largest_of
    allowed = (*system.coordinates, *system.outputs, *largest_of)
    require_name(f"coordinate or output of {system.labels.name}", quantity, allowed)
    return largest_of.get(quantity, (quantity,))


def speed_or_usual(system: Labelled, speed: float | str | None) -> float:
    """Convert a speed, a number in rad/s or a string with a unit, to rad/s. If `speed` is None, the speed of
    the case is used. Raises UnitError and ValueOutOfBoundsError, and MissingValueError if the case has no
    speed."""
    labels = system.labels
    chosen = labels.case_speed if speed is None else speed
    if chosen is None:
        where = f"case '{labels.case}' of {labels.name}" if labels.case else f"{labels.name} has no case and"
        raise MissingValueError(f'{where} states no speed; give a speed, such as --speed "600 rpm"')
    return speed_in_si(chosen)


def require_vibration(system: Labelled) -> None:
    """Raise NoVibrationError for a rigid mechanism."""
    if not system.labels.vibrates:
        raise NoVibrationError(system.labels.no_motion)


def require_motion(system: Labelled) -> None:
    """Raise NoMotionError or NoVibrationError if there are no equations of motion."""
    require_vibration(system)
    if system.labels.no_motion:
        raise NoMotionError(system.labels.no_motion)
