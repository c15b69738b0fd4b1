"""Natural frequencies with the mechanism at rest: at a position, over the turn, over a parameter."""

import math
from collections.abc import Sequence

import numpy as np

from solve.arrays import Array
from solve.errors import NoMotionError, NoResultError, SolveError, ValueOutOfBoundsError, require_name
from solve.results.frequencies import Frequencies, Variation
from solve.sizes import NUMBERS_A_POINT, require_size
from solve.system import PeriodicSystem, of_system
from solve.units import require_size_of_number, with_unit

USUAL_COUNT = 4

TURN = 36
"""Positions of a turn, by default."""


@of_system
def frequencies(
    system: PeriodicSystem, position: float | str | Sequence[float] | Array = 0.0, count: int | None = None
) -> Frequencies:
    """The lowest frequencies (4 by default) of M and K at speed 0 with the drive held at a position.

    position: rad, a text with unit such as "70 deg", or several in rad. Raises ValueOutOfBoundsError,
    UnitError, StructureError.
    """
    phase = with_unit(position, "rad") if isinstance(position, str) else position
    positions = np.atleast_1d(np.asarray(phase, dtype=float))
    if positions.ndim != 1 or positions.size == 0 or not np.isfinite(positions).all():
        raise ValueOutOfBoundsError(f"position is {position}; allowed: finite angles in rad, or '70 deg'")
    for value in positions:
        require_size_of_number("position", float(value))
    require_size("positions", len(positions), system.freedoms**2 + NUMBERS_A_POINT)
    return Frequencies(system, positions, system.frequencies(positions, _checked_count(system, count)))


def require_position(system: PeriodicSystem, position: object) -> None:
    """Raise NoMotionError where a position is given for a structure that stands still."""
    if position is not None and not system.moves:
        raise NoMotionError(f"{system.name} stands still; leave out the position")


def turn(system: PeriodicSystem, count: int = TURN) -> Array:
    """Positions (count,) that divide the period evenly, from 0. Raises ValueOutOfBoundsError below 2."""
    require_position(system, count)
    if count < 2:
        raise ValueOutOfBoundsError(f"a turn of {count} positions; allowed: 2 or more, such as {TURN}")
    require_size("positions", count, NUMBERS_A_POINT)
    return np.linspace(0.0, system.period, count, endpoint=False)


@of_system
def frequencies_over(
    system: PeriodicSystem,
    parameter: str,
    values: Sequence[float | str] | Array,
    positions: Array,
    count: int | None = None,
) -> Variation:
    """Frequencies at the positions for each value of a parameter, in its own unit or a text with unit.

    Values that the system refuses become NaN with their reason. Raises UnknownNameError, UnitError, and
    NoResultError where it refuses all.
    """
    require_name(f"parameter of {system.name}", parameter, system.parameters)
    if len(values) == 0 or len(positions) == 0:
        raise ValueOutOfBoundsError(f"{len(values)} values at {len(positions)} positions; give one of each")
    k = _checked_count(system, count)
    require_size(
        "values at all positions", len(values) * len(positions), system.freedoms**2 + NUMBERS_A_POINT
    )
    numbers = np.array([system.in_own_unit(parameter, value) for value in values])
    found = np.full((len(values), len(positions), k), math.nan)
    pinned = {link.name: np.full(len(values), math.nan) for link in system.links}
    errors: list[str | None] = []
    for number, value in enumerate(numbers.tolist()):
        try:
            varied = system.varied({parameter: value})
            found[number] = varied.frequencies(positions, _checked_count(varied, k))
        except SolveError as error:
            errors.append(str(error))
            continue
        errors.append(None)
        for link, alone in varied.pinned_frequencies().items():
            pinned[link][number] = alone
    if all(errors):
        raise NoResultError(f"none of the {len(errors)} values of {parameter} has a result: {errors[0]}")
    return Variation(system, parameter, numbers, positions, found, pinned, tuple(errors))


def _checked_count(system: PeriodicSystem, count: int | None) -> int:
    most = system.most_frequencies
    if count is None:
        return min(USUAL_COUNT, most)
    if not (isinstance(count, int | np.integer) and 1 <= count <= most):
        raise ValueOutOfBoundsError(f"count is {count}; allowed for {system.name} as chosen: 1 … {most}")
    return count
