"""Conversion of values with units: speeds, and parameters in other units."""

import math
import re
from collections.abc import Iterable, Sequence
from functools import lru_cache
from numbers import Real
from typing import TYPE_CHECKING, Any, NamedTuple

from solve.arguments import NUMBERS_A_POINT, described, require_size
from solve.errors import UnitError, ValueOutOfBoundsError, listed

if TYPE_CHECKING:
    import pint

_NUMBER = r"(?<![\w.^])[-+]?(?:\d++\.?\d*+|\.\d++)(?:[eE][-+]?\d++)?+"
LARGEST = 1e60
"""Largest permitted modulus of a number; the smallest is its inverse. Products of five such numbers remain
within the range of float64, 1e±308."""

_POWER = r"(\s*(\^|\*\*)\s*-?\d{1,2}(\.\d{1,2})?)?"
_NAME = rf"(1|%|[^\W\d]\w*{_POWER})"
_PRODUCT = rf"{_NAME}((\s*[*/]\s*|\s+){_NAME})*+"
_FACTOR = rf"({_NAME}|\({_PRODUCT}\){_POWER})"
_UNIT = re.compile(rf"{_FACTOR}((\s*[*/]\s*|\s+){_FACTOR})*+")
"""Pattern of units: products and quotients of names with small powers, with at most one level of parentheses.
Nothing else is evaluated."""

_PREFIXES = {"G": 9, "M": 6, "k": 3, "c": -2, "m": -3, "u": -6, "µ": -6, "n": -9}
_DECIMAL = re.compile(rf"(?P<prefix>[{''.join(_PREFIXES)}])(?P<base>m|s|N|Pa|J|W)(?P<power>\^[2-4])?")

_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")

_LONGEST_UNIT = 80
"""Largest number of characters of a unit. Chosen by judgement."""

_RAD_PER_S = {"rpm": math.pi / 30, "rad/s": 1.0, "Hz": 2 * math.pi}


class ShownUnit(NamedTuple):
    """Display unit, and its size in SI units."""

    name: str
    size: float

    def from_si(self, values: Any) -> Any:
        """Convert numbers from SI units to the display unit."""
        return values / self.size

    @property
    def per_second(self) -> "ShownUnit":
        """Unit of acceleration that corresponds to this unit of speed.

        >>> RPM.per_second.name, RAD_PER_S.per_second.name
        ('rpm/s', 'rad/s²')
        """
        return ShownUnit("rad/s²" if self.name == RAD_PER_S.name else f"{self.name}/s", self.size)

    def text(self, value: float, form: str = ".6g") -> str:
        """Text of a number in SI units, after conversion to the display unit, followed by the unit.

        >>> RPM.text(math.pi)
        '30 rpm'
        """
        return f"{self.from_si(value):{form}} {self.name}".removesuffix(" 1").rstrip()

    def span(self, low: float, high: float, word: str = "to", form: str = ".6g") -> str:
        """Text of a range between two numbers in SI units, with enough digits to distinguish the two numbers.

        >>> RPM.span(math.pi, 2 * math.pi), RPM.span(math.pi, 1.00001 * math.pi)
        ('30 to 60 rpm', '30 to 30.0003 rpm')
        """
        if self.text(low, form) == self.text(high, form):
            form = ".10g"
        return f"{self.from_si(low):{form}} {word} {self.text(high, form)}"

    def spans(self, ranges: Iterable[tuple[float, float]]) -> str:
        """Text of several ranges of numbers in SI units. Only the first few are listed. A range with equal
        ends is written as one number.

        >>> RPM.spans([(math.pi, 2 * math.pi), (3 * math.pi, 3 * math.pi)])
        'from 30 to 60 rpm, at 90 rpm'
        """
        return listed(
            [
                f"from {self.span(low, high, form='.5g')}" if high > low else f"at {self.text(low, '.5g')}"
                for low, high in ranges
            ]
        )


USUAL = tuple(ShownUnit(*item) for item in _RAD_PER_S.items())
RPM, RAD_PER_S, _ = USUAL


_SAME_SPEED = 1e-9
"""Relative difference up to which two speeds count as equal and not as a range. Chosen by judgement."""


class GivenSpeed(float):
    """Speed in rad/s, with the unit in which it was given. `unit` is None for a number without unit."""

    __slots__ = ("unit",)
    unit: ShownUnit | None

    def __new__(cls, omega: float, unit: ShownUnit | None = None) -> "GivenSpeed":
        speed = super().__new__(cls, omega)
        speed.unit = unit
        return speed

    def __getnewargs__(self) -> tuple[float, ShownUnit | None]:  # type: ignore[override]
        return float(self), self.unit


def raised(unit: str) -> str:
    """Unit with powers as superscripts.

    >>> raised("kg m^2/s^3"), raised("1/s^10"), raised("N/m^1.5")
    ('kg m²/s³', '1/s¹⁰', 'N/m^1.5')
    """
    return re.sub(r"\^(-?\d++)(?!\.)", lambda power: power[1].translate(_RAISED), unit)


def unit_given(speed: float, otherwise: ShownUnit = RPM) -> ShownUnit:
    """Unit in which a speed was given, or `otherwise` if it was given without unit."""
    return getattr(speed, "unit", None) or otherwise


def speed_in_si(speed: float | str, zero: bool = False) -> GivenSpeed:
    """Convert a number in rad/s, or a string such as "600 rpm", "62.8 rad/s" or "10 Hz", to a speed in rad/s
    with its unit.

    Raises UnitError for a string without a unit of rotation. Raises ValueOutOfBoundsError unless the speed is
    finite and > 0 (with `zero`, ≥ 0).

    >>> round(speed_in_si("600 rpm"), 6)
    62.831853
    """
    return (_text_in_si if isinstance(speed, str) else _in_si)(speed, zero)


def _in_si(speed: float | str, zero: bool) -> GivenSpeed:
    """Result of `speed_in_si`. Results for strings are cached."""
    unit = getattr(speed, "unit", None)
    try:
        omega = with_unit(speed, "rad/s") if isinstance(speed, str) else float(speed)
    except (TypeError, ValueError):
        omega = math.nan
    if isinstance(speed, bool) or not (math.isfinite(omega) and (omega > 0 or (zero and omega == 0))):
        allowed = "finite, 0 or more" if zero else "finite and > 0"
        given = speed if isinstance(speed, str | Real) else described(speed)
        raise ValueOutOfBoundsError(f"speed is {given}; allowed: {allowed}, such as '600 rpm'")
    require_size_of_number("speed", omega)
    if isinstance(speed, str):
        name = apart(speed).partition(" ")[2].strip()
        unit = ShownUnit(name, _RAD_PER_S.get(name) or conversion(name, "rad/s"))
    return GivenSpeed(omega, unit)


_text_in_si = lru_cache(_in_si)


def require_size_of_number(what: str, value: float) -> None:
    """Raise ValueOutOfBoundsError for a finite number in SI units whose modulus is too large or too small for
    computations."""
    if math.isfinite(value) and value != 0 and not 1 / LARGEST <= abs(value) <= LARGEST:
        raise ValueOutOfBoundsError(
            f"{what} is {value:g}; allowed: 0, or {1 / LARGEST:g} … {LARGEST:g} in magnitude, in SI units"
        )


def speeds_given(speeds: float | str | Iterable[float | str]) -> list[GivenSpeed]:
    """Convert speeds to rad/s. `speeds` is a number in rad/s, a string with a unit, a sequence of these, or
    one string with several speeds, such as "1:3:3 rad/s".

    Raises UnitError, ValueOutOfBoundsError.

    >>> speeds_given("1:3:3 rad/s") == speeds_given([1.0, "2 rad/s", 3]) == [1.0, 2.0, 3.0]
    True
    """
    if isinstance(speeds, str):
        return speeds_in_si(speeds)
    try:
        sequence = [speeds] if isinstance(speeds, float | int | Real) else speeds
        omegas = [speed_in_si(speed) for speed in sequence]
    except TypeError:
        raise ValueOutOfBoundsError(
            f"speeds are {speeds!r}; give a sequence of numbers in rad/s or of texts such as '600 rpm'"
        ) from None
    if not omegas:
        raise ValueOutOfBoundsError("no speeds given; give speeds, such as '100:900:81 rpm'")
    return omegas


def speeds_between(speeds: float | str | Iterable[float | str], what: str) -> list[GivenSpeed]:
    """Distinct speeds in rad/s, in ascending order. Raises ValueOutOfBoundsError for fewer than two speeds.
    what: name of the calculation that requires two speeds, for the message."""
    distinct = sorted(set(speeds_given(speeds)))
    if len(distinct) < 2:
        raise ValueOutOfBoundsError(
            f"{what} require at least two speeds; give a range, such as '100:900:81 rpm'"
        )
    return distinct


def speeds_in_si(text: str) -> list[GivenSpeed]:
    """Convert a string to speeds in rad/s. The string is "A:B:N unit", for N speeds from A to B, or a list
    such as "600 900 1200 rpm"."""
    *numbers, unit = apart(text).split() or [""]
    usage = f"speeds are '{text}'; give 'A:B:N unit' or numbers with one unit, such as '600 900 1200 rpm'"
    if len(numbers) == 1 and ":" in numbers[0]:
        ends = numbers[0].split(":")
        try:
            low, high, count = float(ends[0]), float(ends[1]), int(ends[2])
        except (ValueError, IndexError):
            raise UnitError(usage) from None
        if len(ends) != 3 or count < 2:
            raise ValueOutOfBoundsError(usage + ", N at least 2")
        return [speed_in_si(f"{value!r} {unit}") for value in spaced(low, high, count)]
    if not numbers or not all(map(is_number, numbers)) or is_number(unit):
        raise UnitError(usage)
    return [speed_in_si(f"{number} {unit}") for number in numbers]


def ramp_in_si(speeds: str | Sequence[float | str]) -> tuple[float, float]:
    """Return the first and the last speed of a ramp, in rad/s. `speeds` is a string "A:B unit", or two
    numbers in rad/s or strings with a unit.

    One of the speeds may be 0. The relative difference between the speeds must exceed 1e-9. Raises UnitError,
    ValueOutOfBoundsError.

    >>> ramp_in_si("0:60 rad/s"), ramp_in_si((0, "60 rad/s"))
    ((0.0, 60.0), (0.0, 60.0))
    """
    usage = f"speeds are {speeds!r}; give two, such as '300:600 rpm', not both 0"
    if isinstance(speeds, str):
        *numbers, unit = apart(speeds).split() or [""]
        if not numbers and all(map(is_number, unit.split(":"))):
            raise UnitError(f"speeds are {speeds!r}, without a unit; add a unit, as in '{unit} rpm'")
        ends = numbers[0].split(":") if len(numbers) == 1 else []
        if not all(map(is_number, ends)):
            raise UnitError(usage)
        both = [f"{end} {unit}" for end in ends]
    else:
        both = [*speeds] if isinstance(speeds, Iterable) else []
    if len(both) != 2:
        raise UnitError(usage)
    first, last = (speed_in_si(speed, zero=True) for speed in both)
    if not first + last:
        raise UnitError(usage)
    if abs(last - first) <= _SAME_SPEED * max(first, last):
        raise ValueOutOfBoundsError(
            f"speeds are {speeds!r}; give two different speeds, such as '300:600 rpm', or a single speed"
        )
    return first, last


def evenly(text: str, name: str) -> list[float] | list[str]:
    """Return N equidistant values from A to B: numbers for a string "A:B:N", or strings for "A:B:N unit".

    name: name of the quantity in messages. Raises ValueOutOfBoundsError.

    >>> evenly("0.2:0.6:3", "L2"), evenly("200:600:3 mm", "L2")
    ([0.2, 0.4, 0.6], ['200.0 mm', '400.0 mm', '600.0 mm'])
    """
    limits, _, unit = apart(text).partition(" ")
    flag, _, quantity_name = name.rpartition(" ")
    ends = limits.split(":")[:2]
    example = ""
    if len(ends) == 2 and all(map(is_number, ends)):
        suggested = f"{quantity_name}={':'.join(ends)}:11 {unit}".strip()
        example = f', such as {flag} "{suggested}"' if flag else f", such as '{suggested}'"
    usage = (
        f"{name}={text}: write {name}=A:B:N, N > 1 numbers from A to B in the model's unit, or with a unit "
        f"after N{example}"
    )
    try:
        first, last, number = limits.split(":")
        low, high, count = float(first), float(last), int(number)
    except ValueError:
        raise ValueOutOfBoundsError(usage) from None
    if count < 2:
        raise ValueOutOfBoundsError(usage)
    numbers = spaced(low, high, count)
    return [f"{value!r} {unit.strip()}" for value in numbers] if unit.strip() else numbers


def in_unit(value: float | str, unit: str, name: str) -> float:
    """Convert a number, or a string with or without a unit, to a number in `unit`.

    name: name of the quantity in messages. Raises UnitError, and ValueOutOfBoundsError if the value is not a
    number.

    >>> in_unit("30 mm", "m", "r"), in_unit("0.03", "m", "r"), in_unit(0.03, "m", "r")
    (0.03, 0.03, 0.03)
    """
    try:
        number = quantity(value) if isinstance(value, str) else float(value)
    except (TypeError, ValueError, OverflowError):
        example = "1.5" if unit in ("", "1") else f"1.5, in {unit}, or '1.5 {unit}'"
        raise ValueOutOfBoundsError(
            f"{name} is {described(value)}; give a number, such as {example}"
        ) from None
    try:
        return with_unit(number, unit) if isinstance(number, str) else number
    except UnitError as error:
        raise UnitError(f"{name}: {error}") from None


def apart(text: str) -> str:
    """Text with a space between a number and its unit.

    >>> apart("30mm"), apart("1e3 rpm"), apart("1e3N/m^2")
    ('30 mm', '1e3 rpm', '1e3 N/m^2')
    """
    return re.sub(_NUMBER + r"(?=[^\W\d_]|°)", r"\g<0> ", text.strip())


def quantity(text: str) -> float | str:
    """Convert a string without a unit to a number; return a string with a unit unchanged. Raises ValueError
    for other strings.

    >>> quantity("1.5e3"), quantity("30mm")
    (1500.0, '30mm')
    """
    number, _, unit = apart(text).partition(" ")
    return text if math.isfinite(float(number)) and unit else float(number)


def spaced(low: float, high: float, count: int) -> list[float]:
    """Equidistant numbers from `low` to `high`, both included. Raises ValueOutOfBoundsError if the memory
    limit is exceeded."""
    require_size("values in one range", count, NUMBERS_A_POINT)
    return [*(low + (high - low) * i / (count - 1) for i in range(count - 1)), high]


def is_number(text: str) -> bool:
    """Whether a string is a number without a unit."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def with_unit(text: str, unit: str) -> float:
    """Convert a string such as "70 deg" to a number in `unit`. Raises UnitError."""
    number, _, text_unit = apart(text).partition(" ")
    example = {"rad/s": "'600 rpm'", "rad": "'70 deg'"}.get(unit, f"'1 {unit}'")
    try:
        value = float(number)
    except ValueError:
        raise UnitError(f"'{text}' is not a number with a unit; write it like {example}") from None
    if not text_unit.strip():
        raise UnitError(f"'{text}' has no unit; write it like {example}")
    require_size_of_number(f"'{text}'", value)
    if unit == "rad/s" and text_unit.strip() in _RAD_PER_S:
        return value * _RAD_PER_S[text_unit.strip()]
    return value * conversion(text_unit.strip(), unit)


@lru_cache
def conversion(given: str, unit: str) -> float:
    """Size of the unit `given`, expressed in `unit`. One hertz is one revolution per second.

    Raises UnitError for units of different dimensions, units with different zero points (degC), and units
    that may count revolutions or radians (1/min)."""
    decimal = _DECIMAL.fullmatch(given)
    if given == unit:
        return 1.0
    if decimal and unit == decimal["base"] + (decimal["power"] or ""):
        # Loading Pint's registry takes longer than many commands.
        return float(f"1e{_PREFIXES[decimal['prefix']] * int((decimal['power'] or '^1')[1:])}")
    registry = _registry()
    try:
        if len(given) > _LONGEST_UNIT or not _UNIT.fullmatch(given):
            raise ValueError(given)
        units = registry.parse_units(given)
        zero, size = (registry.Quantity(x, units).to(unit).magnitude for x in (0.0, 1.0))
    except Exception:
        allowed = "rpm, rad/s or Hz" if unit == "rad/s" else f"units of the same kind as '{unit}'"
        raise UnitError(f"unit '{given}' does not convert to '{unit}'; allowed: {allowed}") from None
    if zero != 0.0:
        raise UnitError(
            f"unit '{given}' has a different zero point from '{unit}'; give the value in '{unit}'"
        )
    bare = all(registry.get_dimensionality(name) == {"[time]": 1} for name in units._units)
    if unit == "rad/s" and bare and size != 1.0:
        raise UnitError(f"unit '{given}' may count revolutions or radians; write rpm, Hz or rad/s")
    return float(size)


@lru_cache
def _registry() -> "pint.UnitRegistry":
    import pint

    registry = pint.UnitRegistry()
    registry.define("hertz = 2 * pi * radian / second = Hz")
    return registry
