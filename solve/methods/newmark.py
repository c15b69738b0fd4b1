"""Newmark's method (N. M. Newmark, ASCE J. Eng. Mech. Div. 85 (1959)) as a period map, and its stability
limits for the undamped oscillator η″ + ω²η = 0 (section 6.2.3 of the thesis, Fig. 6.1).

Chapter Eqs. (23)-(40) use the state x = (q, q′, q″). The predictor z = (q*, q′*) of chapter Eq. (27) is an
equivalent state with 2n components: z_{k+1} = B z_k + …. The map of z has the eigenvalues of the map of x,
except for n zeros. It does not require the inverse of M."""

import math
from dataclasses import dataclass

import numpy as np

from solve.arguments import conforms
from solve.arrays import Array, solved
from solve.errors import ValueOutOfBoundsError
from solve.methods.method import MOST_STEPS, Discretisation, OneStep
from solve.period.curve import Curve
from solve.period.frozen import FrozenModes
from solve.period.grid import Grid
from solve.period.period_map import Steps
from solve.period.points import Points, affine, matrices


@dataclass(frozen=True)
class Newmark(OneStep):
    """Newmark's method.

    Parameters
    ----------
    gamma, beta : float
        Parameters γ and β. With γ = 1/2, β = 1/4, the acceleration is averaged over a step; with γ = 1/2, β =
        1/6, it varies linearly.
    """

    gamma: float = 0.5
    beta: float = 0.25

    name = "newmark"

    def __post_init__(self) -> None:
        for symbol, value in (("gamma", self.gamma), ("beta", self.beta)):
            if not (conforms(value, float) and 0.0 <= value <= 1.0):
                raise ValueOutOfBoundsError(
                    f"{symbol} of newmark is {value}; allowed: 0 … 1; try gamma 0.5 and beta 0.25"
                )
        order = 2 if self.gamma == 0.5 else 1
        self._set(order=order, curve_order=order)
        if order == 2:
            # The relative increase of the period of a mode is (β - 1/12) (ωh)²/2.
            self._set(phase_constant=abs(self.beta - 1 / 12) / 2)
        if self.gamma < 0.5:
            self._set(
                warnings=(
                    f"newmark with gamma = {self.gamma:g} < 1/2 is first order and adds energy: a mode grows "
                    f"by about {(0.5 - self.gamma) / 2:.3g} ω² h per unit time; use gamma = 1/2",
                )
            )

    def least_steps(self, modes: FrozenModes) -> Array:
        """Smallest number of steps per period (P,), from the stability limit for the undamped oscillator.

        For γ < 1/2, every step is unstable. The number of steps is then not limited, but a warning is issued.
        """
        limit = stability_limit(self.gamma, self.beta)
        if self.gamma < 0.5 or np.isinf(limit):
            return super().least_steps(modes)
        phase_advance = np.where(np.isfinite(modes.phase_advance), modes.phase_advance, 0.0)
        return np.ceil(np.clip(phase_advance / limit, 1, MOST_STEPS)).astype(int)

    def discretise(self, points: Points, grid: Grid) -> Discretisation:
        n = points.n
        h = grid.h[:, None, None]
        after = np.roll(h, -1, axis=0)
        M, C, K, d = matrices(points, grid.stages(np.ones(1))[:, 0])
        S = M + self.gamma * h * C + self.beta * h**2 * K
        a = solved(S, np.concatenate((-K, -C, d[..., None]), axis=-1))
        q, v = self.beta * h**2 * a, self.gamma * h * a
        q[..., :n] += np.eye(n)
        v[..., n : 2 * n] += np.eye(n)
        a_after = a
        if not grid.smooth:
            a_after = a.copy()
            self._restart(points, grid, q, v, a_after)
        z = np.concatenate(
            (q + after * v + (0.5 - self.beta) * after**2 * a_after, v + (1 - self.gamma) * after * a_after),
            axis=-2,
        )

        def curve(z: Array) -> Curve:
            q_end, v_end, a_end, a_next = (affine(part, z[:, :-1]) for part in (q, v, a, a_after))
            q_nodes, v_nodes = (np.concatenate((part[:, -1:], part), axis=1) for part in (q_end, v_end))
            return Curve.quintic(grid.nodes, q_nodes, v_nodes, np.roll(a_next, 1, axis=1), a_end)

        return Discretisation(Steps(z[..., :-1], z[..., -1]), curve)

    @staticmethod
    def _restart(points: Points, grid: Grid, q: Array, v: Array, a: Array) -> None:
        """Recompute the acceleration after each jump of the matrices, because it is discontinuous there."""
        into = np.flatnonzero(np.roll(grid.at_break, -1))
        behind = np.roll(grid.stages(np.zeros(1))[:, 0], -1)[into]
        M, C, K, d = matrices(points, behind)
        force = -K @ q[:, into] - C @ v[:, into]
        force[..., -1] += d
        a[:, into] = solved(M, force)


def spectral_radius(gamma: float, beta: float, angle: Array | float) -> Array:
    """Largest |λ| of a step with phase advance ω h of the undamped oscillator, from the characteristic
    equation (thesis, Eq. (6.10))."""
    mu2 = np.square(angle) / (1 + beta * np.square(angle))
    half_sum, product = 1 - (gamma + 0.5) * mu2 / 2, 1 - (gamma - 0.5) * mu2
    root = np.sqrt(np.asarray(half_sum**2 - product, dtype=complex))
    return np.maximum(np.abs(half_sum + root), np.abs(half_sum - root))


def stability_limit(gamma: float, beta: float) -> float:
    """Largest ω h for which a step is stable: 1/sqrt(γ/2 - β). At this value, an eigenvalue passes through
    -1.

    It is infinite for 2β ≥ γ ≥ 1/2. It is 0 for γ < 1/2, because every step is unstable. The condition β ≥ (γ
    + 1/2)²/4 of the thesis, Eq. (6.11), is stronger: it requires the eigenvalues to remain complex."""
    if gamma < 0.5:
        return 0.0
    return math.inf if 2 * beta >= gamma else 1 / math.sqrt(gamma / 2 - beta)
