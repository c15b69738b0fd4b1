"""Gauss methods (J. C. Butcher, Math. Comp. 18 (1964) 50-64) of order 2s, which preserve |ρ| = 1."""

from dataclasses import dataclass
from math import factorial

import numpy as np

from solve.arrays import Array
from solve.methods.collocated import Collocated


@dataclass(frozen=True)
class Gauss(Collocated):
    """Gauss methods: collocation at the Gauss points. They are A-stable, but not L-stable: |R(∞)| = 1.

    Parameters
    ----------
    order : int
        Even order from 4 to 16.
    """

    order: int = 10

    name = "gauss"
    orders = range(4, 17, 2)

    def _state_facts(self) -> None:
        super()._state_facts()
        # The stability function is the diagonal Padé approximant of exp (Hairer, Wanner, IV.3).
        s = self.order // 2
        self._set(phase_constant=factorial(s) ** 2 / (factorial(2 * s) * factorial(2 * s + 1)))

    @property
    def nodes(self) -> Array:
        return (np.polynomial.legendre.leggauss(self.order // 2)[0] + 1.0) / 2.0
