"""Which quantities a picture shows, and how; refused before anything is calculated."""

from collections.abc import Sequence

from solve.errors import UnknownNameError, ValueOutOfBoundsError
from solve.system import PeriodicSystem

MOST_ROWS = 6
"""Rows of curves that one page can hold."""

SCALES = ("linear", "dB")


def shown(system: PeriodicSystem, names: Sequence[str] | None) -> list[str]:
    """The names to show: those given, or the first coordinates. Raises UnknownNameError, and
    ValueOutOfBoundsError for more rows than a page holds."""
    if not names:
        return list(system.coordinates[:MOST_ROWS])
    known = system.known_quantities(names)
    if len(names) > MOST_ROWS:
        raise ValueOutOfBoundsError(
            f"{len(names)} quantities to show; allowed: up to {MOST_ROWS} in one picture"
        )
    return list(known)


def checked_scale(scale: str) -> str:
    """The scale itself. Raises UnknownNameError."""
    if scale not in SCALES:
        raise UnknownNameError("scale", scale, SCALES)
    return scale
