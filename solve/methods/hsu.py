"""Piecewise-constant transition matrices (L. A. Pipes, J. Appl. Phys. 24 (1953) 902-910; C. S. Hsu,
J. Math. Anal. Appl. 45 (1974) 234-251; thesis 7.2.2)."""

from dataclasses import dataclass

import numpy as np

from solve.arrays import Array
from solve.methods.method import Discretisation, OneStep
from solve.period.curve import Curve
from solve.period.grid import Grid
from solve.period.period_map import Steps
from solve.system import PeriodicSystem


@dataclass(frozen=True)
class Hsu(OneStep):
    """x′ = P x + f with P and f frozen at the middle of each step and solved exactly there, by matrix
    exponentials: order 2, exact for piecewise-constant coefficients."""

    name = "hsu"
    order = 2
    curve_order = 2
    l_stable = False

    def discretise(self, system: PeriodicSystem, speed: float, grid: Grid) -> Discretisation:
        from scipy.linalg import expm

        N = 2 * system.n
        rate = system.state_rate(grid.stages(np.array([0.5]))[:, 0], speed)
        augmented = np.zeros((grid.steps, N + 1, N + 1))
        augmented[:, :N] = grid.h[:, None, None] * rate
        maps = expm(augmented)[:, :N]

        def curve(x: Array) -> Curve:
            n = system.n
            start, end = (
                np.squeeze(rate[:, n:, :-1] @ at[:, :, None], -1) + rate[:, n:, -1] for at in (x[:-1], x[1:])
            )
            return Curve.quintic(grid.nodes, x[:, :n], x[:, n:], start, end)

        return Discretisation(Steps(maps[..., :-1], maps[..., -1]), curve)
