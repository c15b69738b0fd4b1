"""Natural frequencies: at positions of the drive, and over a parameter."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from solve.arrays import Array
from solve.errors import ValueOutOfBoundsError
from solve.results.frequencies_plot import shapes_figure, turn_figure, variation_figure
from solve.system import ModeShape, PeriodicSystem

if TYPE_CHECKING:
    from matplotlib.figure import Figure


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
        return self.system.freedoms

    def shapes(self, number: int = 0) -> list[ModeShape]:
        """How the links move in each mode at the position of that number. Raises ValueOutOfBoundsError
        for a system that is no structure of beams."""
        return self.system.mode_shapes(float(self.positions[number]), self.values[number])

    def plot(self) -> "Figure":
        """Mode shapes at one position; frequencies over several. Raises ValueOutOfBoundsError where there
        are no links to draw."""
        if len(self.positions) > 1:
            return turn_figure(self.system, self.positions, self.values)
        if not self.system.links:
            raise ValueOutOfBoundsError(
                f"{self.system.name} at one position has nothing to draw; draw the whole turn: --turn 36"
            )
        return shapes_figure(self.system, float(self.positions[0]), self.shapes())


@dataclass(frozen=True)
class Variation:
    """Frequencies over a parameter, (v,) values in SI units: figures (v, k) of each value's turn.

    mean, least, greatest over the positions; NaN where errors (v,) says why there are none. pinned: the
    lowest frequency of each link by itself, pinned at both ends, (v,) by name.
    """

    system: PeriodicSystem
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
        figures = {"mean": self.mean, "min": self.least, "max": self.greatest}
        lowest = {name: values[:, 0] for name, values in figures.items()}
        whole = len(self.positions) > 1
        return variation_figure(self.system, self.parameter, self.values, lowest, self.pinned, whole)
