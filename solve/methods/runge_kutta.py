"""Classical Runge–Kutta method of order 4 as a period map (chapter Eqs. (15)-(21)).

The affine maps follow from the stages, chapter Eq. (16), applied to unit states. Their closed forms in the
chapter, Eqs. (18) and (19), contain two wrong coefficients and are not used."""

from dataclasses import dataclass

import numpy as np

from solve.arrays import Array
from solve.methods.method import MOST_STEPS, Discretisation, OneStep
from solve.period.frozen import FrozenModes
from solve.period.grid import Grid
from solve.period.points import Points, state_rate, state_size


@dataclass(frozen=True)
class RungeKutta4(OneStep):
    """Explicit Runge–Kutta method, stable for hλ in the region |R(hλ)| ≤ 1, up to |hλ| of about 2.8."""

    name = "rk4"
    first_order = True
    order = 4
    curve_order = 4
    # This is far below the stability limit; near the limit, RK4 damps undamped modes.
    follows = 0.5

    def least_steps(self, modes: FrozenModes) -> Array:
        """Smallest number of steps (P,) for which |R(hλ)| ≤ 1 for every frozen eigenvalue λ of a mode that
        does not grow.

        R(z) = 1 + z + z²/2 + z³/6 + z⁴/24."""
        values = modes.eigenvalues()
        values = np.where(np.isfinite(values), values, 0.0)
        size = np.abs(values)
        decaying = (np.real(values) <= 1e-9 * size) & (size > 0)
        ray = values / np.where(size > 0, size, 1.0)
        low, high = np.zeros(values.shape), np.full(values.shape, 4.0)
        for _ in range(40):
            middle = (low + high) / 2
            z = middle * ray
            inside = np.abs(1 + z * (1 + z / 2 * (1 + z / 3 * (1 + z / 4)))) <= 1 + 1e-12
            low, high = np.where(inside, middle, low), np.where(inside, high, middle)
        needed = np.where(decaying, size * modes.period / np.where(low > 0, low, 1.0), 1.0)
        return np.ceil(np.minimum(needed.max(axis=(1, 2)), MOST_STEPS)).astype(int)

    def discretise(self, points: Points, grid: Grid) -> Discretisation:
        N = state_size(points)
        h = grid.h[:, None, None]
        phases = grid.stages(np.array([0.0, 0.5, 1.0]))
        start, middle = (state_rate(points, phases[:, k]) for k in (0, 1))
        end = np.roll(start, -1, axis=1) if grid.smooth else state_rate(points, phases[:, 2])
        x = np.zeros(start.shape)
        x[..., range(N), range(N)] = 1.0

        def rate(P: Array, x: Array) -> Array:
            k = P[..., :-1] @ x
            k[..., -1] += P[..., -1]
            return k

        k1 = rate(start, x)
        k2 = rate(middle, x + h / 2 * k1)
        k3 = rate(middle, x + h / 2 * k2)
        k4 = rate(end, x + h * k3)
        maps = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        return Discretisation.of_rates(grid, maps, start, end, points.first_order)
