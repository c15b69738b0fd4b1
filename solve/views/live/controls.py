"""Sliders of the live window: ranges of sliders, from the bounds of the model, and typed values with
units."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from solve.equations import require_bounds
from solve.errors import MissingValueError, ValueOutOfBoundsError, require_name
from solve.labels import SPEED, in_own_unit, speed_or_usual
from solve.model.bounds import clauses
from solve.model.model import Model
from solve.results.formatting import greek
from solve.studies.frequencies import frequencies
from solve.units import GivenSpeed, ShownUnit, raised, speed_in_si, unit_given

_SPAN = 10.0
"""For the slider of a positive parameter: ratio of the upper end to the initial value, and ratio of the
initial value to the lower end. Chosen by judgement."""

_SPEEDS = 0.2, 3.0
"""Ends of the slider of the speed, relative to the initial speed. Chosen by judgement."""

_BELOW_RESONANCE = 0.1
"""Initial speed, relative to the lowest natural frequency, if the case states no speed. Only the tenth and
higher harmonics of the motion then reach a natural frequency. Chosen by judgement."""

_DIGITS = 4
"""Number of significant digits of slider values."""


@dataclass(frozen=True)
class Range:
    """Range of a slider in the unit of its quantity.

    `logarithmic` is True if the scale of the slider is logarithmic, and `integer` if only whole numbers are
    allowed.
    """

    low: float
    high: float
    logarithmic: bool = False
    integer: bool = False


@dataclass(frozen=True)
class Control:
    """Slider of a parameter or of the speed.

    `value` is in `unit`, and `bound` is the text of the bound in the model. `further` is True if the
    parameter is shown among the less important ones, because its value is 0.
    """

    name: str
    label: str
    unit: str
    meaning: str
    bound: str
    value: float
    range: Range
    further: bool = False

    def record(self) -> dict[str, Any]:
        """Data of the slider for the page, as a JSON object."""
        return asdict(self)


def controls_of(model: Model, speed: GivenSpeed) -> list[Control]:
    """Return the slider of the speed, followed by the sliders of the parameters in the order of the model."""
    unit = unit_given(speed, model.labels.speed_unit)
    value = rounded(unit.from_si(float(speed)), 12)
    drive = Control(SPEED, "Ω", unit.name, "speed of the drive", "> 0", value, speed_range(value))
    return [drive, *(_of_parameter(model, *row) for row in model.module.PARAMETERS)]


def _of_parameter(model: Model, name: str, unit: str, meaning: str, bound: str) -> Control:
    value = float(model.parameters[name])
    similar = [
        abs(float(model.parameters[other]))
        for other, other_unit, *_ in model.module.PARAMETERS
        if other_unit == unit and _family(other) == _family(name)
    ]
    span = parameter_range(value, bound, max(similar, default=0.0) or 1.0)
    shown = raised(unit) if unit != "1" else ""
    return Control(name, greek(name), shown, meaning, bound, value, span, further=value == 0)


def _family(name: str) -> str:
    """Return the name of a parameter without its trailing number.

    >>> _family("a12")
    'a'
    """
    return name.rstrip("0123456789")


def first_speed(model: Model, speed: float | str | None) -> GivenSpeed:
    """Return the initial speed in rad/s with its unit: the given speed, otherwise the speed of the case,
    otherwise a speed well below the lowest natural frequency. Raises SolveError subclasses for bad input, and
    MissingValueError if no speed can be determined."""
    try:
        return speed_in_si(speed_or_usual(model, speed))
    except MissingValueError:
        if not model.labels.vibrates:
            raise
    modes = [value for value in frequencies(model).values.ravel().tolist() if value > 0]
    if not modes:
        raise MissingValueError(
            f'{model.labels.name} states no speed; give a speed, such as --speed "600 rpm"'
        )
    rpm = model.labels.speed_unit.from_si(_BELOW_RESONANCE * min(modes))
    return speed_in_si(f"{rounded(rpm, 2)!r} {model.labels.speed_unit.name}")


def speed_range(value: float) -> Range:
    """Return the range of the slider of the speed, around a value."""
    low, high = (rounded(factor * value, 2) for factor in _SPEEDS)
    return Range(low, high)


def parameter_range(value: float, bound: str, scale: float) -> Range:
    """Return the range of the slider of a parameter, within the parameter's bounds.

    `scale` is the half-width of the range if the value is 0 and there are no bounds.

    >>> parameter_range(8e4, "> 0", 1.0)
    Range(low=8000.0, high=800000.0, logarithmic=True, integer=False)
    >>> parameter_range(0.0, ">= 0", 2.0)
    Range(low=0.0, high=2.0, logarithmic=False, integer=False)
    """
    conditions = clauses(bound)
    integer = "integer" in conditions
    lower, upper = _limits(conditions)
    if value > 0 and lower == 0 and upper == math.inf:
        low, high = rounded(value / _SPAN), rounded(value * _SPAN)
        if integer:
            return Range(max(1.0, math.ceil(low)), math.ceil(high), integer=True)
        return Range(low, high, logarithmic=True)
    width = 2 * abs(value) or scale
    low = value - width if lower == -math.inf else lower
    high = value + width if upper == math.inf else upper
    # A bound such as "> 0" excludes the end itself.
    margin = 1e-3 * (high - low)
    low += margin * any(text.startswith("> ") for text in conditions)
    high -= margin * any(text.startswith("< ") for text in conditions)
    if integer:
        return Range(math.ceil(low), math.floor(high), integer=True)
    return Range(rounded(low), rounded(high))


def _limits(conditions: Sequence[str]) -> tuple[float, float]:
    """Return the lower and upper limits implied by conditions; infinite where no condition applies."""
    relations = [text.split() for text in conditions if text != "integer"]
    lower = (float(limit) for relation, limit in relations if relation.startswith(">"))
    upper = (float(limit) for relation, limit in relations if relation.startswith("<"))
    return max(lower, default=-math.inf), min(upper, default=math.inf)


def widened(span: Range, value: float) -> Range:
    """Return a range, widened if necessary to contain a value.

    >>> widened(Range(1.0, 10.0), 12.0).high
    12.0
    """
    logarithmic = span.logarithmic and value > 0
    return Range(min(span.low, value), max(span.high, value), logarithmic, span.integer)


def rounded(value: float, digits: int = _DIGITS) -> float:
    """Round a number to a few significant digits.

    >>> rounded(123456.0), rounded(0.0)
    (123500.0, 0.0)
    """
    return float(f"{value:.{digits}g}")


def number(value: float) -> str:
    """Return the shortest text that represents a number exactly.

    >>> number(8e4), number(0.1)
    ('80000', '0.1')
    """
    return repr(value).removesuffix(".0")


def typed(model: Model, name: str, text: str, unit: ShownUnit) -> float:
    """Convert a typed text to a value in the unit of the slider.

    Parameters
    ----------
    model : Model
        Model with the values of all other parameters.
    name : str
        Parameter, or "speed".
    text : str
        Number with or without a unit, such as "30 mm".
    unit : ShownUnit
        Unit of the slider of the speed. A speed without a unit is in this unit.

    Returns
    -------
    float

    Raises
    ------
    UnknownNameError, UnitError, ValueOutOfBoundsError
    """
    text = text.strip()
    if name == SPEED:
        return rounded(unit.from_si(float(speed_in_si(with_speed_unit(text, unit)))), 12)
    require_name(f"parameter of {model.labels.name}", name, model.parameters)
    try:
        value = in_own_unit(model, name, text)
    except ValueOutOfBoundsError:
        own_unit = model.labels.parameter_labels[name][0]
        raise ValueOutOfBoundsError(
            f"{name} is '{text}'; give a number, in {own_unit} unless a unit follows, such as "
            f"'1.5 {own_unit}'".replace(" 1'", "'")
        ) from None
    require_bounds(model, {name: value})
    return value


def with_speed_unit(text: str, unit: ShownUnit) -> str:
    """Return the text of a speed. If the text contains no unit, the unit of the slider is appended."""
    try:
        return f"{number(float(text))} {unit.name}"
    except ValueError:
        return text


def changed_parameters(model: Model, texts: Mapping[str, str]) -> dict[str, Any]:
    """Convert the texts of the page to a mapping from parameters to values. A value is a number in the unit
    of the model, or a string with a unit. Raises ValueOutOfBoundsError, UnitError, UnknownNameError."""
    for name in texts:
        require_name(f"parameter of {model.labels.name}", name, model.parameters)
    return {name: in_own_unit(model, name, text) for name, text in texts.items()}
