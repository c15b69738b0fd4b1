"""Newmark's method (N. M. Newmark, ASCE J. Eng. Mech. Div. 85 (1959)) as a period map.

Chapter Eqs. (23)-(40) carry x = (q, q′, q″). The predictor z = (q*, q′*) of chapter Eq. (27) is a
state of order 2n that does the same: z_{k+1} = B z_k + …, with the spectrum of the 3n map but for n
zeros, and without an inverse of M.
"""

from dataclasses import dataclass

import numpy as np

from solve.arrays import Array
from solve.errors import ValueOutOfBoundsError
from solve.methods.method import Discretisation, OneStep
from solve.methods.newmark_stability import stability_limit
from solve.period.curve import Curve
from solve.period.grid import Grid
from solve.period.period_map import Steps
from solve.system import PeriodicSystem


@dataclass(frozen=True)
class Newmark(OneStep):
    """γ = 1/2, β = 1/4: average acceleration; γ = 1/2, β = 1/6: linear acceleration."""

    gamma: float = 0.5
    beta: float = 0.25

    name = "newmark"
    l_stable = False

    def __post_init__(self) -> None:
        for symbol, value in (("gamma", self.gamma), ("beta", self.beta)):
            if not 0.0 <= value <= 1.0:
                raise ValueOutOfBoundsError(
                    f"{symbol} of newmark is {value}; allowed: 0 … 1; try gamma 0.5 and beta 0.25"
                )

    @property
    def order(self) -> int:
        return 2 if self.gamma == 0.5 else 1

    @property
    def curve_order(self) -> int:
        return self.order

    def least_steps(self, frozen: Array, period: float) -> int:
        """From the limit of the undamped oscillator.

        For γ < 1/2 it is unstable at any step, so that no number of steps is refused here and `concerns`
        warns.
        """
        if self.gamma < 0.5:
            return 1
        angle = np.abs(frozen).max() * period
        return max(1, int(np.ceil(angle / stability_limit(self.gamma, self.beta))))

    def drift(self, angle: float, steps: int) -> float:
        """With γ = 1/2 a mode's period is longer by (β - 1/12) (ωh)²/2 of itself; otherwise modes grow or
        decay."""
        return abs(self.beta - 1 / 12) / 2 * angle**3 / steps**2 if self.gamma == 0.5 else 0.0

    @property
    def concerns(self) -> list[str]:
        if self.gamma >= 0.5:
            return []
        return [
            f"newmark with gamma = {self.gamma:g} < 1/2 is first order and adds energy: a mode grows by "
            f"about {(0.5 - self.gamma) / 2:.3g} ω² h per unit time; use gamma = 1/2"
        ]

    def discretise(self, system: PeriodicSystem, speed: float, grid: Grid) -> Discretisation:
        n = system.n
        h = grid.h[:, None, None]
        after = np.roll(h, -1, axis=0)
        M, C, K, d = system.in_phase(grid.stages(np.ones(1))[:, 0], speed)
        S = M + self.gamma * h * C + self.beta * h**2 * K
        a = np.linalg.solve(S, np.concatenate((-K, -C, d[..., None]), axis=-1))
        q, v = self.beta * h**2 * a, self.gamma * h * a
        q[:, :, :n] += np.eye(n)
        v[:, :, n : 2 * n] += np.eye(n)
        a_after = a
        if not grid.smooth:
            a_after = a.copy()
            self._restart(system, speed, grid, q, v, a_after)
        z = np.concatenate(
            (q + after * v + (0.5 - self.beta) * after**2 * a_after, v + (1 - self.gamma) * after * a_after),
            axis=1,
        )

        def curve(z: Array) -> Curve:
            q_end, v_end, a_end, a_next = (
                np.squeeze(part[..., :-1] @ z[:-1, :, None], -1) + part[..., -1]
                for part in (q, v, a, a_after)
            )
            q_nodes, v_nodes = (np.concatenate((part[-1:], part)) for part in (q_end, v_end))
            return Curve.quintic(grid.nodes, q_nodes, v_nodes, np.roll(a_next, 1, axis=0), a_end)

        return Discretisation(Steps(z[..., :-1], z[..., -1]), curve)

    @staticmethod
    def _restart(system: PeriodicSystem, speed: float, grid: Grid, q: Array, v: Array, a: Array) -> None:
        """Take the acceleration anew behind a jump of the matrices; the one before it says nothing there."""
        into = np.flatnonzero(np.roll(grid.at_break, -1))
        behind = np.roll(grid.stages(np.zeros(1))[:, 0], -1)[into]
        M, C, K, d = system.in_phase(behind, speed)
        force = -K @ q[into] - C @ v[into]
        force[..., -1] += d
        a[into] = np.linalg.solve(M, force)
