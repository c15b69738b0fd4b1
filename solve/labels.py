"""What a system is called and shown with: names, units and meanings, in which results speak of it."""

from collections.abc import Iterable, Mapping
from functools import cached_property
from types import MappingProxyType
from typing import Any, Self

from solve.argument import listed
from solve.contracts import DrawnLink
from solve.errors import MissingValueError, require_name
from solve.units import RPM, ShownUnit, in_unit, raised, speed_in_si, unit_given

SPEED = "speed"
"""The name under which the speed Ω (rad/s) varies like a parameter."""


class Labels:
    """Names, numbers, units and meanings of a system, apart from its equations."""

    name: str = "system"
    title: str = ""
    """What it is, in a line."""
    case: str | None = None
    """The case of a model that the numbers come from, and the speed with unit that it names."""
    case_speed: str | None = None
    model_hash: str | None = None
    """Of the generated code that the equations come from."""
    solvable: bool = True
    """Whether it has equations: what is read from a file of results has labels alone."""
    options: Mapping[str, Any] = MappingProxyType({})
    parameters: Mapping[str, float] = MappingProxyType({})
    """Those that can be varied, in the units that the model declares."""
    parameter_labels: Mapping[str, tuple[str, str]] = MappingProxyType({})
    """Unit and meaning of each parameter."""
    parameter_sources: Mapping[str, str] = MappingProxyType({})
    """Where values of parameters come from, as the case says; nothing of those that were given otherwise."""
    equations: tuple[str, ...] = ()
    """As elements of HTML, MathML among them."""
    links: tuple[DrawnLink, ...] = ()
    """Of which mode shapes can be drawn."""
    sketch_unit: str = "m"
    """Of the places of `sketched`."""
    moves: bool = True
    """Whether the drive has positions: a structure may stand still."""
    vibrates: bool = True
    """Whether there are coordinates; the motion of a rigid mechanism is prescribed."""
    coordinates: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()
    """Names of the quantities that follow from the state; units and meanings hold theirs too."""
    outputs_apart: bool = False
    """Whether each output is calculated by itself when it is asked for, rather than all at once."""
    equation_warnings: tuple[str, ...] = ()
    """What is doubtful about the equations at any speed, a sentence each: terms of the mechanism that they
    leave out, the errors of fitted series."""
    largest_of: Mapping[str, tuple[str, ...]] = MappingProxyType({})
    """Names that stand for several outputs, of which the largest counts: a stress on either surface."""
    units: Mapping[str, str] = MappingProxyType({})
    meanings: Mapping[str, str] = MappingProxyType({})
    speed_unit: ShownUnit = RPM
    """In which its results show speeds, in tables, pictures and sentences."""

    def require_motion(self) -> None:
        """Raise NoMotionError or NoVibrationError if there are no equations of motion."""

    @property
    def n(self) -> int:
        """Number of coordinates."""
        return len(self.coordinates)

    def shown_in(self, speed: float) -> Self:
        """The same system, whose results show speeds in the unit in which this one was given, if it was given
        in one."""
        unit = unit_given(speed, self.speed_unit)
        if unit == self.speed_unit:
            return self
        known = self._by_speed_unit.get(unit)
        if known is None or not known._states(self):
            known = object.__new__(type(self))
            vars(known).update(vars(self), speed_unit=unit)
            self._by_speed_unit[unit] = known
        return known

    def _states(self, other: Self) -> bool:
        """Whether this has the attributes of the other, but for the unit and for what either calculated."""
        return all(
            vars(self).get(name) is value
            for name, value in vars(other).items()
            if name != "speed_unit" and not isinstance(getattr(type(self), name, None), cached_property)
        )

    @cached_property
    def _by_speed_unit(self) -> dict[ShownUnit, Self]:
        """Those that were asked for: what they calculated is kept."""
        return {self.speed_unit: self}

    def unit_of(self, name: str) -> ShownUnit:
        """In which values of a parameter, or of the "speed", are shown."""
        unit, _ = self.parameter_labels.get(name, ("", ""))
        return self.speed_unit if name == SPEED else ShownUnit(raised(unit), 1.0)

    def in_own_unit(self, name: str, value: float | str) -> float:
        """Value of a parameter in its own unit, from a number or a text such as "30 mm". Raises
        UnknownNameError, UnitError, and ValueError for a text that is not a number."""
        if not isinstance(value, str):
            return float(value)
        require_name(f"parameter of {self.name}", name, self.parameters)
        unit, _ = self.parameter_labels.get(name, ("", ""))
        return in_unit(value, unit or "1", name)

    def known_quantities(self, names: str | Iterable[str] | None = None) -> tuple[str, ...]:
        """Names of coordinates and outputs, by default all, each once; a text is one name. Raises
        UnknownNameError."""
        known = (*self.coordinates, *self.outputs)
        names = listed(known if names is None else names)
        for name in names:
            require_name(f"coordinate or output of {self.name}", name, known)
        return names

    def parts(self, quantity: str) -> tuple[str, ...]:
        """The coordinates or outputs of which a quantity is the largest: itself, or those that it stands
        for. Raises UnknownNameError."""
        known = (*self.coordinates, *self.outputs, *self.largest_of)
        require_name(f"coordinate or output of {self.name}", quantity, known)
        return self.largest_of.get(quantity, (quantity,))

    def speed_or_usual(self, speed: float | str | None) -> float:
        """Ω in rad/s of a speed (rad/s, or a text with unit), by default that of the case. Raises
        MissingValueError where neither is given, UnitError, ValueOutOfBoundsError."""
        given = self.case_speed if speed is None else speed
        if given is None:
            where = f"case '{self.case}' of {self.name}" if self.case else f"{self.name} has no case and"
            raise MissingValueError(f'{where} names no speed; give one, such as --speed "600 rpm"')
        return speed_in_si(given)


def require_vibration(system: Labels) -> None:
    """Raise NoVibrationError for a rigid mechanism."""
    if not system.vibrates:
        system.require_motion()
