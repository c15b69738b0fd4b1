"""The classical Runge–Kutta method of order 4 as a period map (chapter Eqs. (15)-(21)).

The affine maps follow from the stages, chapter Eq. (16), applied to the unit states; the closed forms
that the chapter prints for them, Eqs. (18) and (19), carry two wrong coefficients and are not used.
"""

from dataclasses import dataclass

import numpy as np

from solve.arrays import Array
from solve.methods.method import Discretisation, OneStep
from solve.period.curve import Curve
from solve.period.grid import Grid
from solve.period.period_map import Steps
from solve.system import PeriodicSystem


@dataclass(frozen=True)
class RungeKutta4(OneStep):
    """Explicit: stable only while h |λ| stays inside the region |R(hλ)| ≤ 1, about 2.8."""

    name = "rk4"
    order = 4
    curve_order = 4
    l_stable = False

    @property
    def follows(self) -> float:
        """Well inside the stability limit, where RK4 damps a mode that has no damping."""
        return 0.5

    def least_steps(self, frozen: Array, period: float) -> int:
        """Least steps with |R(hλ)| ≤ 1 for every frozen eigenvalue λ that decays or stays.

        R(z) = 1 + z + z²/2 + z³/6 + z⁴/24.
        """
        decaying = frozen[(np.real(frozen) <= 1e-9 * np.abs(frozen)) & (np.abs(frozen) > 0)]
        if len(decaying) == 0:
            return 1
        low, high = np.zeros(len(decaying)), np.full(len(decaying), 4.0)
        ray = decaying / np.abs(decaying)
        for _ in range(40):
            middle = (low + high) / 2
            z = middle * ray
            inside = np.abs(1 + z * (1 + z / 2 * (1 + z / 3 * (1 + z / 4)))) <= 1 + 1e-12
            low, high = np.where(inside, middle, low), np.where(inside, high, middle)
        return int(np.ceil((np.abs(decaying) * period / low).max()))

    def discretise(self, system: PeriodicSystem, speed: float, grid: Grid) -> Discretisation:
        n = system.n
        h = grid.h[:, None, None]
        start, middle, end = self._rates(system, speed, grid)
        x = np.zeros((grid.steps, 2 * n, 2 * n + 1))
        x[:, range(2 * n), range(2 * n)] = 1.0

        def rate(P: Array, x: Array) -> Array:
            k = P[..., :-1] @ x
            k[..., -1] += P[..., -1]
            return k

        k1 = rate(start, x)
        k2 = rate(middle, x + h / 2 * k1)
        k3 = rate(middle, x + h / 2 * k2)
        k4 = rate(end, x + h * k3)
        maps = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)

        def curve(x: Array) -> Curve:
            a_start, a_end = (
                np.squeeze(P[:, n:, :-1] @ at[:, :, None], -1) + P[:, n:, -1]
                for P, at in ((start, x[:-1]), (end, x[1:]))
            )
            return Curve.quintic(grid.nodes, x[:, :n], x[:, n:], a_start, a_end)

        return Discretisation(Steps(maps[..., :-1], maps[..., -1]), curve)

    @staticmethod
    def _rates(system: PeriodicSystem, speed: float, grid: Grid) -> tuple[Array, Array, Array]:
        """(P | f) of chapter Eq. (5) at the start, middle and end of every step, (m, 2n, 2n+1) each."""
        phases = grid.stages(np.array([0.0, 0.5, 1.0]))
        if grid.smooth:
            start, middle = (system.state_rate(phases[:, i], speed) for i in (0, 1))
            return start, middle, np.roll(start, -1, axis=0)
        start, middle, end = (system.state_rate(phases[:, i], speed) for i in range(3))
        return start, middle, end
