"""Time integration of nonlinear equations with feedback."""

from collections.abc import Callable
from typing import Any

import numpy as np

from solve.arrays import Array
from solve.contracts import Matrices, driven
from solve.errors import TransientError
from solve.studies.control.plant import state_equations

_LEAST_STEPS = 128
"""Smallest number of steps per period: with fewer, a step could skip a load that acts during a small part of
the period. Chosen by judgement."""

Equations = Callable[[Array, Array, float, Array, Array], Matrices]
"""Type of functions of phases (k,), speeds (k,), an acceleration, q (k, n) and q̇ (k, n). Such a function
returns M, C, K and d of the equations linearised about this state. At this state, the linearised equations
are exact."""


class FeedbackIntegrator:
    """Integration over periods by LSODA (A. C. Hindmarsh, L. R. Petzold) in SciPy, with `count` states per
    period; see `Integrator`. The tolerance `rtol` is relative to `sizes` (n,), the scales of the
    coordinates."""

    def __init__(
        self, equations: Equations, first_order: int, period: float, sizes: Array, count: int, rtol: float
    ):
        self._equations, self._first_order, self._rtol = equations, first_order, rtol
        self._n, self._period, self.nodes = len(sizes), period, np.linspace(0.0, period, count + 1)
        self._sizes = np.tile(sizes, 2)[: self._N]

    @property
    def _N(self) -> int:
        return 2 * self._n - self._first_order

    def __call__(self, state: Array, start: float, speed: float, last: float | None = None) -> Array:
        """Return the states over one period; see `Integrator`. Raises TransientError if the integration
        fails."""
        from scipy.integrate import solve_ivp

        ends = speed, speed if last is None else last
        mean, n, N = sum(ends) / 2, self._n, self._N

        def rates(s: Array, x: Array) -> tuple[Array, Array]:
            """Return A (k, N, N) and b (k, N) of ẋ = A x + b at states x (N, k)."""
            phase, omega, acceleration = driven(s, *ends, self._period)
            q, qd = x[:n].T, np.zeros((len(s), n))
            qd[:, : N - n] = x[n:].T
            matrices = self._equations(phase + start, omega, acceleration, q, qd)
            A, _, b = state_equations(matrices, np.zeros((len(s), n, 0)), self._first_order)
            return A, b

        def slope(s: float | Array, x: Array) -> Array:
            times, states = np.atleast_1d(s), x.reshape(N, -1)
            A, b = rates(times, states)
            return ((np.einsum("kij,jk->ik", A, states) + b.T) / mean).reshape(x.shape)

        scale = np.concatenate((np.ones(n), np.full(N - n, mean)))
        options: dict[str, Any] = {
            "rtol": self._rtol,
            "atol": self._rtol * self._sizes * scale,
            "jac": lambda s, x: rates(np.array([s]), x[:, None])[0][0] / mean,
            "max_step": self._period / _LEAST_STEPS,
        }
        solved = solve_ivp(slope, self.nodes[[0, -1]], state[:N] * scale, "LSODA", self.nodes, **options)
        if not solved.success:
            raise TransientError(
                f"the transient cannot be integrated beyond phase {start:.6g}: {solved.message}"
            )
        motion = np.zeros((3, n, len(self.nodes)))
        motion[0], motion[1, : N - n] = solved.y[:n], solved.y[n:] / mean
        slopes = slope(self.nodes, solved.y)
        motion[1, N - n :], motion[2, : N - n] = slopes[N - n : n], slopes[n:] / mean
        return motion
