"""Gauss methods (J. C. Butcher, Math. Comp. 18 (1964) 50-64): order 2s, keep |ρ| = 1 where it is 1."""

from dataclasses import dataclass
from functools import cache

import numpy as np

from solve.errors import ValueOutOfBoundsError
from solve.methods.collocated import Collocated
from solve.methods.collocation import Collocation


@dataclass(frozen=True)
class Gauss(Collocated):
    """Collocation at the Gauss points of even order 4 … 16. A-stable, but not L-stable: |R(∞)| = 1."""

    order: int = 10

    name = "gauss"

    def __post_init__(self) -> None:
        if self.order not in range(4, 17, 2):
            raise ValueOutOfBoundsError(
                f"order of gauss is {self.order}; allowed: 4, 6, 8, 10, 12, 14, 16; try order 10"
            )
        super().__post_init__()

    @property
    def collocation(self) -> Collocation:
        return _collocation(self.order)


@cache
def _collocation(order: int) -> Collocation:
    nodes = np.polynomial.legendre.leggauss(order // 2)[0]
    return Collocation(tuple(map(float, (nodes + 1.0) / 2.0)))
