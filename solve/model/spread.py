"""Spreads of parameters: uniform within a tolerance, or normally distributed."""

import math
import re
from typing import NamedTuple

import numpy as np

from solve.arguments import number_or_nan
from solve.arrays import Array
from solve.errors import ValueOutOfBoundsError
from solve.units import apart, in_unit

_TOLERANCE = re.compile(r"(?:±|\+/-|\+-)\s*(.+)")
_DISTRIBUTION = re.compile(r"(normal|uniform)\s*\(\s*([^,]+?)\s*,\s*([^,]+?)\s*\)")

_FORMS = "write '±2 %', '±0.1', 'normal(8e4, 2e3)' or 'uniform(7e4, 9e4)', with units or in the model's unit"

EXTENT = 3.0
"""Distance from the mean, in standard deviations, within which the worst point of a normal distribution is
sought. Convention: this range contains 99.7 % of all values."""


class Spread(NamedTuple):
    """Spread of a parameter, in the unit of the model.

    normal: whether the distribution is normal; `first` and `second` are then its mean and standard deviation.
    Otherwise, they are the ends of a uniform distribution."""

    text: str
    normal: bool
    first: float
    second: float

    @property
    def low(self) -> float:
        """Lower end of the spread; for a normal distribution, EXTENT standard deviations below the mean."""
        return self.first - EXTENT * self.second if self.normal else self.first

    @property
    def high(self) -> float:
        """Upper end of the spread; for a normal distribution, EXTENT standard deviations above the mean."""
        return self.first + EXTENT * self.second if self.normal else self.second

    def values(self, z: Array) -> Array:
        """Parameter values for values of a standard normal variable z."""
        from scipy.special import ndtr

        if self.normal:
            return self.first + self.second * z
        # Round-off must not move values beyond the ends of the range.
        return np.clip(self.first + (self.second - self.first) * ndtr(z), self.first, self.second)

    def slopes(self, z: Array) -> Array:
        """Derivatives of the parameter values with respect to z."""
        if self.normal:
            return np.full(np.shape(z), self.second)
        return (self.second - self.first) * np.exp(-(z**2) / 2) / math.sqrt(2 * math.pi)


def spread_of(name: str, text: str, value: float, unit: str, file_unit: str | None = None) -> Spread:
    """Parse the spread of a parameter with a nominal value in the unit of the model.

    text: a tolerance about the nominal value, or a distribution. Numbers without a unit are in `file_unit`,
    by default the unit of the model. Raises ValueOutOfBoundsError, UnitError.

    >>> spread_of("k1", "±2 %", 100.0, "N/m")[1:], spread_of("k1", "normal(0.1, 0.01)", 0, "N/m", "N/mm")[1:]
    ((False, 98.0, 102.0), (True, 100.0, 10.0))
    """
    where = f"spread of {name}"

    def number(part: str) -> float:
        bare = file_unit is not None and not apart(part).partition(" ")[2]
        try:
            found = in_unit(f"{part} {file_unit}" if bare else part, unit, where)
        except ValueOutOfBoundsError:
            found = math.nan
        if not math.isfinite(found):
            raise ValueOutOfBoundsError(f"{where} is '{text}', but '{part}' is not a finite number; {_FORMS}")
        return found

    if tolerance := _TOLERANCE.fullmatch(text.strip()):
        part = tolerance[1]
        width = number(part) if not part.endswith("%") else _percent(part, text, where) * abs(value)
        if not width > 0:
            raise ValueOutOfBoundsError(
                f"{where} is '{text}' with the nominal value {value:g}, so that the range is empty; give a "
                "tolerance > 0; for a nominal value of 0, give the tolerance in the unit of the parameter"
            )
        return Spread(text, False, value - width, value + width)
    distribution = _DISTRIBUTION.fullmatch(text.strip())
    if distribution is None:
        raise ValueOutOfBoundsError(f"{where} is '{text}'; {_FORMS}")
    kind, first, second = distribution[1], number(distribution[2]), number(distribution[3])
    if kind == "normal" and not second > 0:
        raise ValueOutOfBoundsError(f"{where} is '{text}'; give a standard deviation > 0")
    if kind == "uniform" and not first < second:
        raise ValueOutOfBoundsError(
            f"{where} is '{text}', whose upper end is below its lower end; write uniform(A, B) with A < B"
        )
    return Spread(text, kind == "normal", first, second)


def _percent(part: str, text: str, where: str) -> float:
    """Fraction for a percentage in text form, such as "2 %"."""
    fraction = number_or_nan(part.removesuffix("%")) / 100
    if not math.isfinite(fraction):
        raise ValueOutOfBoundsError(f"{where} is '{text}', without a percentage; {_FORMS}")
    return fraction
