"""Natural frequencies with the mechanism at rest: at a position, over the turn, over a parameter."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from solve.arrays import Array
from solve.beams.eigen import lowest_frequencies
from solve.beams.model import StructureModel
from solve.beams.shapes import Shape, shapes
from solve.beams.wittrick_williams import exact_frequencies
from solve.errors import NoMotionError, SolveError, UnknownNameError, ValueOutOfBoundsError
from solve.system import PeriodicSystem
from solve.units import with_unit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from solve.loading import Model

USUAL_COUNT = 4
MOST = 200
"""Frequencies of a structure with exact elements, which has infinitely many."""

_MOST_ENTRIES = 2**22
"""Entries of a matrix over the positions that are looked at together; more are taken in parts."""

TURN = 36
"""Positions of a turn, by default."""


@dataclass(frozen=True)
class Frequencies:
    """values (m, k): the lowest k frequencies in rad/s, rising, at positions (m,) in rad.

    A frequency is NaN where the static stiffness is not positive: there the position is unstable.
    """

    system: PeriodicSystem
    positions: Array
    values: Array

    @property
    def mean(self) -> Array:
        """Mean over the positions (k,): for a whole turn the cycle's mean."""
        return self.values.mean(axis=0)

    @property
    def freedoms(self) -> int:
        """How many; of a structure those that no inextensible link takes away."""
        return _freedoms(self.system)

    def shapes(self, number: int = 0) -> list[Shape]:
        """How the links move in each mode at the position of that number. Raises ValueOutOfBoundsError
        for a system that is no structure of beams."""
        if not isinstance(self.system, StructureModel):
            raise ValueOutOfBoundsError(
                f"{self.system.name} has no links to draw; ask a structure of beams for its mode shapes"
            )
        return shapes(self.system.beams, float(self.positions[number]), self.values[number])

    def plot(self) -> "Figure":
        """Mode shapes at one position; frequencies over several."""
        from solve.results.frequencies_plot import shapes_figure, turn_figure

        return turn_figure(self) if len(self.positions) > 1 else shapes_figure(self)


@dataclass(frozen=True)
class Variation:
    """Frequencies over a parameter, (v,) values in SI units: figures (v, k) of each value's turn.

    mean, least, greatest over the positions; NaN where errors (v,) says why there are none. pinned: the
    lowest frequency of each link by itself, pinned at both ends, (v,) by name.
    """

    model: "Model"
    parameter: str
    values: Array
    positions: Array
    mean: Array
    least: Array
    greatest: Array
    pinned: dict[str, Array]
    errors: tuple[str | None, ...]

    def plot(self) -> "Figure":
        """The lowest frequency over the parameter beside those of the links alone (thesis Fig. 9.1)."""
        from solve.results.frequencies_plot import variation_figure

        return variation_figure(self)


def frequencies(
    system: PeriodicSystem, position: float | str | Sequence[float] | Array = 0.0, count: int | None = None
) -> Frequencies:
    """The lowest frequencies (4 by default) of M and K at speed 0 with the drive held at a position.

    position: rad, a text with unit such as "70 deg", or several in rad. Raises ValueOutOfBoundsError,
    UnitError, StructureError.
    """
    phase = with_unit(position, "rad") if isinstance(position, str) else position
    positions = np.atleast_1d(np.asarray(phase, dtype=float))
    if positions.ndim != 1 or not np.isfinite(positions).all():
        raise ValueOutOfBoundsError(f"position is {position}; allowed: finite angles in rad, or '70 deg'")
    return Frequencies(system, positions, _values(system, positions, count))


def moves(system: PeriodicSystem) -> bool:
    """Whether the system has positions: a structure may stand still."""
    return not isinstance(system, StructureModel) or system.module.MOVES


def require_position(system: PeriodicSystem, position: object) -> None:
    """Raise NoMotionError where a position is given for a structure that stands still."""
    if position is not None and not moves(system):
        raise NoMotionError(f"{system.name} stands still; leave out the position")


def turn(system: PeriodicSystem, count: int = TURN) -> Array:
    """Positions (count,) that divide the period evenly, from 0. Raises ValueOutOfBoundsError below 2."""
    require_position(system, count)
    if count < 2:
        raise ValueOutOfBoundsError(f"a turn of {count} positions; allowed: 2 or more, such as {TURN}")
    return np.linspace(0.0, system.period, count, endpoint=False)


def frequencies_over(
    model: "Model",
    parameter: str,
    values: Sequence[float] | Array,
    positions: Array,
    count: int | None = None,
) -> Variation:
    """Frequencies at the positions for each value (SI units) of a parameter.

    Values that the model refuses become NaN with their reason. Raises UnknownNameError.
    """
    if parameter not in model.parameters:
        raise UnknownNameError(f"parameter of {model.name}", parameter, model.parameters)
    k = _checked_count(model, count)
    figures = np.full((3, len(values), k), math.nan)
    links = [link.name for link in model.beams.freedoms.links] if isinstance(model, StructureModel) else []
    pinned = {link: np.full(len(values), math.nan) for link in links}
    errors: list[str | None] = []
    for number, value in enumerate(values):
        try:
            varied = model.varied({parameter: float(value)})
            found = _values(varied, positions, k)
        except SolveError as error:
            errors.append(str(error))
            continue
        errors.append(None)
        figures[:, number] = found.mean(axis=0), found.min(axis=0), found.max(axis=0)
        if isinstance(varied, StructureModel):
            for link, alone in varied.pinned_frequencies().items():
                pinned[link][number] = alone
    mean, least, greatest = figures
    return Variation(
        model,
        parameter,
        np.asarray(values, dtype=float),
        positions,
        mean,
        least,
        greatest,
        pinned,
        tuple(errors),
    )


def _values(system: PeriodicSystem, positions: Array, count: int | None) -> Array:
    k = _checked_count(system, count)
    if isinstance(system, StructureModel):
        parts = math.ceil(len(positions) * _freedoms(system) ** 2 / _MOST_ENTRIES)
        each = (_structure_values(system, part, k) for part in np.array_split(positions, max(parts, 1)))
        return np.concatenate(list(each))
    M, _, K, _ = system.at(positions, 0.0)
    squares = np.linalg.eigvals(np.linalg.solve(M, K))
    real = np.where(np.abs(squares.imag) > 1e-9 * np.abs(squares), np.nan, squares.real)
    return np.sort(np.sqrt(np.where(real >= 0, real, np.nan)), axis=1)[:, :k]


def _structure_values(system: StructureModel, positions: Array, k: int) -> Array:
    frozen = system.at_positions(positions)
    if system.beams.exact_links:
        return exact_frequencies(frozen, k)
    return lowest_frequencies(*frozen.matrices(), k)


def _checked_count(system: PeriodicSystem, count: int | None) -> int:
    infinite = isinstance(system, StructureModel) and system.beams.exact_links
    most = MOST if infinite else _freedoms(system)
    if count is None:
        return min(USUAL_COUNT, most)
    if not 1 <= count <= most:
        raise ValueOutOfBoundsError(f"count is {count}; allowed for {system.name} as chosen: 1 … {most}")
    return count


def _freedoms(system: PeriodicSystem) -> int:
    return system.at_positions(np.zeros(1)).n if isinstance(system, StructureModel) else system.n
