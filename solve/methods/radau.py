"""Radau IIA (B. L. Ehle, 1969; E. Hairer, G. Wanner, Solving ODEs II, IV.5): L-stable, order 2s - 1."""

from dataclasses import dataclass

import numpy as np
from numpy.polynomial.legendre import legder, legroots, legval

from solve.arrays import Array
from solve.methods.collocated import Collocated


@dataclass(frozen=True)
class Radau(Collocated):
    """Radau IIA: collocation at the right Radau points, which include the end of the step.

    Parameters
    ----------
    order : int
        Odd order from 3 to 13.
    """

    order: int = 9

    name = "radau"
    orders = range(3, 14, 2)
    l_stable = True

    @property
    def nodes(self) -> Array:
        stages = (self.order + 1) // 2
        difference = [0.0] * (stages - 1) + [-1.0, 1.0]
        # `legroots` of NumPy 2.5 returns complex numbers.
        zeros = np.real(legroots(difference))
        zeros -= legval(zeros, difference) / legval(zeros, legder(difference))
        return np.append((zeros[:-1] + 1.0) / 2.0, 1.0)
