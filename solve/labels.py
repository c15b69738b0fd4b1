"""Names, parameter values, units and meanings of a system, as results display them."""

from collections.abc import Iterable, Mapping
from functools import cached_property
from types import MappingProxyType
from typing import Any, Self

from solve.arguments import unique_names
from solve.contracts import DrawnLink
from solve.errors import MissingValueError, ValueOutOfBoundsError, require_name
from solve.units import RPM, ShownUnit, in_unit, raised, speed_in_si, unit_given

SPEED = "speed"
"""Name of the speed Ω (rad/s) where it varies like a parameter."""


class Labels:
    """Names, parameter values, units and meanings of a system, without its equations."""

    name: str = "system"
    title: str = ""
    """Description in one line."""
    case: str | None = None
    """Name of the case; `case_speed` is its speed with unit."""
    case_speed: str | None = None
    model_hash: str | None = None
    """Hash of the generated code of the equations."""
    solvable: bool = True
    """Whether the system has equations; one read from a file of results has labels only."""
    options: Mapping[str, Any] = MappingProxyType({})
    parameters: Mapping[str, float] = MappingProxyType({})
    """Parameters that can be varied, in the units declared by the model."""
    parameter_labels: Mapping[str, tuple[str, str]] = MappingProxyType({})
    """Unit and meaning of each parameter."""
    parameter_sources: Mapping[str, str] = MappingProxyType({})
    """Sources of values stated by the case; parameters set by other means are absent."""
    equations: tuple[str, ...] = ()
    """Equations as HTML elements with MathML."""
    links: tuple[DrawnLink, ...] = ()
    """Links in drawings of mode shapes."""
    sketch_unit: str = "m"
    """Unit of the coordinates returned by `sketched`."""
    moves: bool = True
    """Whether the drive moves; False for a structure at rest."""
    vibrates: bool = True
    """Whether there are coordinates; False for a rigid mechanism, whose motion is prescribed."""
    coordinates: tuple[str, ...] = ()
    states: tuple[str, ...] = ()
    """Coordinates without second derivatives, which are the last ones."""
    inputs: tuple[str, ...] = ()
    """Names of the inputs u, such as forces of drives, which are zero unless a controller sets them."""
    outputs: tuple[str, ...] = ()
    """Names of the quantities computed from the state; `units` and `meanings` contain theirs too."""
    outputs_apart: bool = False
    """Whether outputs are computed individually on access, rather than all together."""
    equation_warnings: tuple[str, ...] = ()
    """Warnings about the equations that hold at any speed: neglected terms, errors of fitted series."""
    largest_of: Mapping[str, tuple[str, ...]] = MappingProxyType({})
    """Names for the largest of several outputs, such as the stress on either surface."""
    units: Mapping[str, str] = MappingProxyType({})
    meanings: Mapping[str, str] = MappingProxyType({})
    speed_unit: ShownUnit = RPM
    """Display unit of speeds in results."""

    def require_motion(self) -> None:
        """Raise NoMotionError or NoVibrationError if there are no equations of motion."""

    @property
    def n(self) -> int:
        """Number of coordinates."""
        return len(self.coordinates)

    @property
    def first_order(self) -> int:
        """Number of coordinates without second derivatives, which are the last ones."""
        return len(self.states)

    @property
    def multiplier_count(self) -> int:
        """Number of Floquet multipliers: one per first-order coordinate, two per other coordinate."""
        return 2 * self.n - self.first_order

    def shown_in(self, speed: float) -> Self:
        """Copy of the system with the unit of the given speed as display unit, if the speed has one."""
        unit = unit_given(speed, self.speed_unit)
        if unit == self.speed_unit:
            return self
        copied = self._by_speed_unit.get(unit)
        if copied is None or not copied._agrees_with(self):
            copied = object.__new__(type(self))
            vars(copied).update(vars(self), speed_unit=unit)
            self._by_speed_unit[unit] = copied
        return copied

    def _agrees_with(self, other: Self) -> bool:
        """Whether all attributes except the unit and cached values equal those of another system."""
        return all(
            vars(self).get(name) is value
            for name, value in vars(other).items()
            if name != "speed_unit" and not isinstance(getattr(type(self), name, None), cached_property)
        )

    @cached_property
    def _by_speed_unit(self) -> dict[ShownUnit, Self]:
        """Copies of the system by display unit, stored so that their cached values are reused."""
        return {self.speed_unit: self}

    def unit_of(self, name: str) -> ShownUnit:
        """Display unit of a parameter, or of the "speed"."""
        unit, _ = self.parameter_labels.get(name, ("", ""))
        return self.speed_unit if name == SPEED else ShownUnit(raised(unit), 1.0)

    def in_own_unit(self, name: str, value: float | str) -> float:
        """Value of a parameter in its declared unit, from a number or a text such as "30 mm". Raises
        UnknownNameError, UnitError, and ValueError for a text that is not a number."""
        if not isinstance(value, str):
            return float(value)
        require_name(f"parameter of {self.name}", name, self.parameters)
        unit, _ = self.parameter_labels.get(name, ("", ""))
        return in_unit(value, unit or "1", name)

    def bounds_in_own_unit(self, name: str, ends: tuple[float | str, float | str]) -> tuple[float, float]:
        """Lower and upper bound of a parameter in its declared unit. The bounds must contain the parameter's
        value. Raises UnknownNameError, UnitError, ValueOutOfBoundsError."""
        require_name(f"parameter of {self.name}", name, self.parameters)
        low, high = (self.in_own_unit(name, end) for end in ends)
        value = float(self.parameters[name])
        if not low < high or not low <= value <= high:
            raise ValueOutOfBoundsError(
                f"bounds of {name} are {low:g} to {high:g}, but its initial value is {value:g}; give "
                f"bounds that contain this value, or another value with --set {name}=NUMBER"
            )
        return low, high

    def known_quantities(self, names: str | Iterable[str] | None = None) -> tuple[str, ...]:
        """Names of coordinates and outputs without repetitions; all of them if `names` is None. A string is a
        single name. Raises UnknownNameError."""
        allowed = (*self.coordinates, *self.outputs)
        names = unique_names(allowed if names is None else names)
        for name in names:
            require_name(f"coordinate or output of {self.name}", name, allowed)
        return names

    def parts(self, quantity: str) -> tuple[str, ...]:
        """Coordinates or outputs that belong to a quantity: the quantity itself, or the members of a group
        whose maximum it denotes. Raises UnknownNameError."""
        allowed = (*self.coordinates, *self.outputs, *self.largest_of)
        require_name(f"coordinate or output of {self.name}", quantity, allowed)
        return self.largest_of.get(quantity, (quantity,))

    def speed_or_usual(self, speed: float | str | None) -> float:
        """Ω in rad/s from a speed (rad/s, or a text with unit); by default the speed of the case. Raises
        MissingValueError without either, UnitError, ValueOutOfBoundsError."""
        chosen = self.case_speed if speed is None else speed
        if chosen is None:
            where = f"case '{self.case}' of {self.name}" if self.case else f"{self.name} has no case and"
            raise MissingValueError(f'{where} states no speed; give a speed, such as --speed "600 rpm"')
        return speed_in_si(chosen)


def require_vibration(system: Labels) -> None:
    """Raise NoVibrationError for a mechanism without coordinates."""
    if not system.vibrates:
        system.require_motion()
