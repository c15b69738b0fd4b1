"""Radau IIA (B. L. Ehle, 1969; E. Hairer, G. Wanner, Solving ODEs II, IV.5): L-stable, order 2s - 1."""

from dataclasses import dataclass
from functools import cached_property

from scipy.special import roots_jacobi

from solve.errors import ValueOutOfBoundsError
from solve.methods.collocation import Collocation, discretise
from solve.methods.grid import Grid
from solve.methods.method import Discretisation, OneStep
from solve.system import PeriodicSystem


@dataclass(frozen=True)
class Radau(OneStep):
    """Radau IIA of odd order 3 … 13: collocation at the right Radau points, the step's end included."""

    order: int = 9

    name = "radau"
    l_stable = True

    def __post_init__(self) -> None:
        if self.order not in range(3, 14, 2):
            raise ValueOutOfBoundsError(
                f"order of radau is {self.order}; allowed: 3, 5, 7, 9, 11, 13; try order 9"
            )

    @property
    def follows(self) -> float:
        """Up to here a mode without damping keeps about half its amplitude, or more, over 500 rad."""
        return self.order / 2 - 1

    @property
    def curve_order(self) -> int:
        return min(self.order, self.collocation.curve_order)

    @cached_property
    def collocation(self) -> Collocation:
        inner = (roots_jacobi((self.order - 1) // 2, 1.0, 0.0)[0] + 1.0) / 2.0
        return Collocation((*map(float, inner), 1.0))

    def bytes_a_step(self, n: int) -> int:
        return self.collocation.bytes_a_step(n)

    def discretise(self, system: PeriodicSystem, speed: float, grid: Grid) -> Discretisation:
        return discretise(self.collocation, system, speed, grid)
