"""Radau IIA (B. L. Ehle, 1969; E. Hairer, G. Wanner, Solving ODEs II, IV.5): L-stable, order 2s - 1."""

from dataclasses import dataclass
from functools import cache

from solve.errors import ValueOutOfBoundsError
from solve.methods.collocated import Collocated
from solve.methods.collocation import Collocation


@dataclass(frozen=True)
class Radau(Collocated):
    """Radau IIA of odd order 3 … 13: collocation at the right Radau points, the step's end included."""

    order: int = 9

    name = "radau"
    l_stable = True

    def __post_init__(self) -> None:
        if self.order not in range(3, 14, 2):
            raise ValueOutOfBoundsError(
                f"order of radau is {self.order}; allowed: 3, 5, 7, 9, 11, 13; try order 9"
            )
        super().__post_init__()

    @property
    def collocation(self) -> Collocation:
        return _collocation(self.order)


@cache
def _collocation(order: int) -> Collocation:
    from scipy.special import roots_jacobi

    inner = (roots_jacobi((order - 1) // 2, 1.0, 0.0)[0] + 1.0) / 2.0
    return Collocation((*map(float, inner), 1.0))
