"""Formatting of numbers, units and names: unit prefixes, significant digits, Greek letters."""

import math
import re

from solve.arrays import ROUND_OFF

_PREFIXES = {9: "G", 6: "M", 3: "k", 0: "", -3: "m", -6: "µ", -9: "n", -12: "p"}
_LARGEST = {"m": 0, "s": 0, "rad": 0, "N": 9, "Pa": 9, "W": 9, "J": 9, "Hz": 9}
"""Symbols of units that take a prefix, with the largest power of ten that is usual for each."""


_SPELT = "alpha beta gamma delta epsilon zeta eta theta kappa lambda mu nu xi rho sigma tau phi chi psi omega"
_LETTERS: dict[str, str] = dict(zip(_SPELT.split(), "αβγδεζηθκλμνξρστφχψω", strict=True))
_GREEK = re.compile(rf"(?<![A-Za-z])({'|'.join(_LETTERS)})(?![A-Za-z])")


def linearisation(error: float) -> str:
    """Return a string that states a relative linearisation error in percent.

    >>> linearisation(0.0123), linearisation(3e-15), linearisation(math.nan)
    ('1.2 %', 'none above round-off', 'unknown')
    """
    # Models without nonlinear terms reach 2e-15.
    if error <= ROUND_OFF:
        return "none above round-off"
    return "unknown" if math.isnan(error) else f"{float(f'{100 * error:.2g}'):g} %"


def greek(name: str) -> str:
    """Replace names of Greek letters in a name by the letters.

    >>> greek("phi1"), greek("theta_max"), greek("max|epsilon|"), greek("mumps")
    ('φ1', 'θ_max', 'max|ε|', 'mumps')
    """
    return _GREEK.sub(lambda match: _LETTERS[match[0]], name)


def headed(name: str, unit: str) -> str:
    """Return the heading of a column: its name, and its unit if there is one.

    >>> headed("max|q1|", "mm"), headed("zeta", "1")
    ('max|q1| (mm)', 'ζ')
    """
    return greek(name) + (f" ({unit})" if unit not in ("", "1") else "")


def round_magnification(allowed: float) -> float:
    """Return the largest of the numbers 1, 2, 5, 10, 20, … that does not exceed `allowed`; at least 1.

    >>> round_magnification(37.0), round_magnification(0.2)
    (20.0, 1.0)
    """
    decade = 10.0 ** math.floor(math.log10(max(allowed, 1.0)))
    return decade * max(digit for digit in (1, 2, 5) if digit * decade <= max(allowed, 1.0))


def prefixed(unit: str, magnitude: float) -> tuple[float, str]:
    """Return the factor and the prefixed unit with which the magnitude lies between 1 and 1000, if prefixes
    are usual for the unit.

    The unit "1" is not shown.

    >>> prefixed("N m", 2571665.2)
    (1e-06, 'MN m')
    >>> prefixed("m", 7.0e-6)
    (1000000.0, 'µm')
    """
    symbol = re.match(r"[A-Za-z]+(?!\^|[A-Za-z])", unit)
    if symbol is None or symbol[0] not in _LARGEST or not (math.isfinite(magnitude) and magnitude > 0):
        return 1.0, unit if unit != "1" else ""
    power = 3 * math.floor(math.log10(magnitude) / 3 + 1e-12)
    power = min(max(power, min(_PREFIXES)), _LARGEST[symbol[0]])
    return 10.0**-power, _PREFIXES[power] + unit


def measured(value: float, unit: str) -> str:
    """Format a value with three digits and a prefixed unit.

    >>> measured(0.00208, "m")
    '2.08 mm'
    """
    factor, shown = prefixed(unit, abs(value))
    return f"{value * factor:.3g} {shown}".rstrip()


def named(figure: str, quantity: str) -> str:
    """Return the short name of a statistic of a quantity.

    >>> named("max_abs", "q1")
    'max|q1|'
    """
    return f"max|{quantity}|" if figure == "max_abs" else f"{figure} {quantity}"


def fixed(value: float, magnitude: float, digits: int = 7) -> str:
    """Format a value with as many decimals as show `magnitude` with `digits` significant digits.

    >>> fixed(-1.25, 768.4522)
    '-1.2500'
    """
    if not math.isfinite(value):
        return "–"
    if magnitude > 0 and not 1e-3 <= magnitude < 1e6:
        return f"{value:.{min(digits, 5) - 1}e}" if value else "0"
    integer_digits = math.floor(math.log10(magnitude)) + 1 if magnitude > 0 else 1
    text = f"{value:.{min(max(digits - integer_digits, 0), digits)}f}"
    return text.removeprefix("-") if float(text) == 0.0 else text
