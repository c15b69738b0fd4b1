"""Piecewise-constant transition matrices (L. A. Pipes, J. Appl. Phys. 24 (1953) 902-910; C. S. Hsu,
J. Math. Anal. Appl. 45 (1974) 234-251; section 7.2.2 of the thesis)."""

from dataclasses import dataclass

import numpy as np

from solve.methods.method import Discretisation, OneStep
from solve.period.grid import Grid
from solve.period.points import Points, state_rate, state_size


@dataclass(frozen=True)
class Hsu(OneStep):
    """Hsu's method. On each step, P and f of x′ = P x + f are frozen at the middle of the step, and the
    equations are solved exactly by matrix exponentials.

    The order is 2. For piecewise-constant coefficients, the method is exact."""

    name = "hsu"
    first_order = True
    order = 2
    curve_order = 2

    def discretise(self, points: Points, grid: Grid) -> Discretisation:
        from scipy.linalg import expm

        N = state_size(points)
        rate = state_rate(points, grid.stages(np.array([0.5]))[:, 0])
        augmented = np.zeros((*rate.shape[:2], N + 1, N + 1))
        augmented[..., :N, :] = grid.h[:, None, None] * rate
        finite = np.isfinite(augmented).all(axis=(-2, -1))
        maps = np.full(rate.shape, np.nan)
        maps[finite] = expm(augmented[finite])[:, :N]
        return Discretisation.of_rates(grid, maps, rate, rate, points.first_order)
