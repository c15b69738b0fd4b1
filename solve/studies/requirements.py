"""Requirements on designs, parsed from strings: bounds on quantities, and statistics or curves to be kept
unchanged. Spreads of parameters are parsed here too."""

import math
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from solve.arguments import unique_names
from solve.arrays import Array
from solve.equations import require_bounds
from solve.errors import MissingValueError, ValueOutOfBoundsError, require_name
from solve.model.model import Model
from solve.model.spread import Spread, spread_of
from solve.period.named import RADIUS, Named
from solve.period.signals import FIGURES
from solve.system import PeriodicSystem
from solve.units import apart, in_unit, quantity

RANGE = "range"
"""Name of the statistic that is the maximum minus the minimum. It is used in requirements that keep a
quantity unchanged."""

_RELATION = re.compile(r"\s*(\S+?)\s*(<=|>=|<|>)\s*(\S.*?)\s*")
_CURVE_PHASES = 33
"""Number of phases at which a curve is kept unchanged: Chebyshev points of the interval. Chosen by
judgement."""

_TOLERANCE = 1e-9
"""Largest permitted change of a quantity that is kept unchanged without a stated tolerance, relative to the
largest modulus of the quantity. Chosen by judgement."""


@dataclass(frozen=True)
class Bound:
    """Upper (`sign` 1) or lower (`sign` -1) bound `value` of a quantity, in the SI unit of the quantity."""

    text: str
    quantity: Named
    sign: float
    value: float

    @classmethod
    def parse(cls, system: PeriodicSystem, text: str) -> "Bound":
        """Bound from a string such as "spectral_radius < 0.9". Raises ValueOutOfBoundsError,
        UnknownNameError, UnitError."""
        parts = _RELATION.fullmatch(text)
        if parts is None:
            raise ValueOutOfBoundsError(
                f"'{text}' is not a bound; write a quantity, < or >, and a number, such as 'rho1.abs < 0.9'"
            )
        named = real_quantity(system, parts[1])
        value = in_unit(_quantity(parts[3], text), named.unit, text)
        return cls(text.strip(), named, 1.0 if "<" in parts[2] else -1.0, value)


@dataclass(frozen=True)
class Kept:
    """Statistic of a quantity, or its curve at the phases `phases` (k,), that an optimisation must not
    change. `figures` is the name of the statistic, or two names for the difference of two statistics.
    `tolerance` is the largest permitted change in the SI unit; None if no tolerance is stated.
    """

    text: str
    name: str
    figures: tuple[str, ...] = ()
    phases: Array | None = None
    tolerance: float | None = None

    @classmethod
    def parse(cls, system: PeriodicSystem, text: str) -> "Kept":
        """Quantity to be kept unchanged, from a string such as "lift.range", "lift@80:100 deg" or "lift.max
        within 0.1 mm". Raises ValueOutOfBoundsError, UnknownNameError, UnitError."""
        what, within, width = (part.strip() for part in text.partition(" within "))
        name, at, interval = what.partition("@")
        name, _, figure = name.partition(".")
        require_name(
            f"coordinate or output of {system.labels.name}", name, (*system.coordinates, *system.outputs)
        )
        unit = system.labels.units.get(name, "1")
        tolerance = in_unit(_quantity(width, text), unit, text) if within else None
        if tolerance is not None and not tolerance > 0:
            raise ValueOutOfBoundsError(f"'{text}' has the tolerance {width}; allowed: numbers > 0")
        if at:
            return cls(text, name, (), _phases(interval, text), tolerance)
        if not figure:
            raise ValueOutOfBoundsError(
                f"'{text}' contains no statistic; write {name}.{RANGE}, "
                f"or {name}@80:100 deg for this interval"
            )
        require_name(f"figure of {name}", figure, [RANGE, *FIGURES])
        return cls(text, name, ("max", "min") if figure == RANGE else (figure,), None, tolerance)

    def allowed(self, values: Array) -> float:
        """Largest allowed change of a quantity with the initial values (k,)."""
        if self.tolerance is not None:
            return self.tolerance
        return _TOLERANCE * (float(np.abs(values).max()) or 1.0)


def real_quantity(system: PeriodicSystem, text: str) -> Named:
    """Return the quantity with this name, which must have real values. Raises UnknownNameError,
    ValueOutOfBoundsError."""
    named = Named.parse(system, text)
    if named.figure == "" and named.subject != RADIUS:
        raise ValueOutOfBoundsError(f"'{text}' is complex; give its real part, {text}.re, for example")
    if named.figure.endswith("_phase"):
        raise ValueOutOfBoundsError(
            f"'{text}' is the phase of an extremum, which has no derivatives; give another statistic, such "
            f"as {named.subject}.max_abs"
        )
    return named


def bounds_of(system: PeriodicSystem, texts: Sequence[str]) -> list[Bound]:
    """Parse bounds; see `Bound.parse`."""
    return [Bound.parse(system, text) for text in unique_names(texts)]


def kept_of(system: PeriodicSystem, texts: Sequence[str]) -> list[Kept]:
    """Parse quantities to be kept unchanged; see `Kept.parse`."""
    return [Kept.parse(system, text) for text in unique_names(texts)]


def spreads_of(model: Model, vary: Mapping[str, str]) -> dict[str, Spread]:
    """Return the spreads of the varying parameters: those of the case, replaced or supplemented by `vary`.
    Raises SolveError subclasses."""
    case, found = model.setup.case, {}
    for name in {**case.spreads, **vary}:
        require_name(f"parameter of {model.labels.name}", name, model.parameters)
        unit, value = model.labels.parameter_labels[name][0], model.parameters[name]
        if name in vary:
            found[name] = spread_of(name, vary[name], value, unit)
        else:
            found[name] = spread_of(name, case.spreads[name], value, unit, case.units.get(name))
        ends = [found[name].first] if found[name].normal else [found[name].low, found[name].high]
        for end in ends:
            require_bounds(model, {name: end})
    if not found:
        raise MissingValueError(
            "no parameter has a tolerance; state some in the case file, such as tolerance = '±2 %', or give "
            "them, such as --vary k1=±2%"
        )
    model.derivatives.by(list(found))
    return found


def _quantity(text: str, whole: str) -> float | str:
    with suppress(ValueError):
        value = quantity(text)
        if isinstance(value, str) or math.isfinite(value):
            return value
    raise ValueOutOfBoundsError(
        f"'{text}' in '{whole}' is not a finite number; write one, such as 0.9, or with a unit, such as "
        "'0.1 mm'"
    )


def _phases(interval: str, whole: str) -> Array:
    """Return the Chebyshev points (k,) in rad of an interval "A:B deg". Raises ValueOutOfBoundsError,
    UnitError."""
    numbers, _, unit = apart(interval).partition(" ")
    try:
        low, high = (
            in_unit(f"{float(end)!r} {unit.strip() or 'rad'}", "rad", whole) for end in numbers.split(":")
        )
    except ValueError:
        raise ValueOutOfBoundsError(
            f"'{whole}' has no valid interval A:B; write it as in lift@80:100 deg"
        ) from None
    if not low < high:
        raise ValueOutOfBoundsError(f"the interval of '{whole}' ends before it begins; write A:B with A < B")
    return (low + high) / 2 - (high - low) / 2 * np.cos(np.linspace(0.0, np.pi, _CURVE_PHASES))
