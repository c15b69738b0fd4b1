"""One grid for many points: collocation with the points beside the steps, in NumPy."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from solve.arrays import Array
from solve.batch.curves import Curves
from solve.batch.tables import Tables
from solve.methods.collocation import Collocation
from solve.methods.period_map import Steps, monodromy, periodic_states


@dataclass(frozen=True)
class GridTables:
    """Tables at what a collocation method samples on m uniform steps: the stages (m · s phases, step by
    step) and, for the curve of a method whose step does not end at a stage, the nodes (m phases)."""

    method: Collocation
    steps: int
    period: float
    stages: Tables
    nodes: Tables | None


@dataclass(frozen=True)
class Level:
    """Monodromy matrices Phi (P, N, N) and, if asked for, periodic solutions on one grid. sound (P,):
    where the result is finite and the closed system regular."""

    Phi: Array
    curves: Curves | None
    sound: Array


class Engine(Protocol):
    """Something that solves many points on one grid."""

    def bytes_a_step(self, method: Collocation, n: int) -> int:
        """Memory that a step of a point takes."""
        ...

    def level(self, tables: GridTables, coefficients: Array, orbit: bool) -> Level:
        """For coefficients (P, R)."""
        ...


class NumpyEngine:
    """The kernels of a single solve with another leading axis."""

    name = "numpy"

    def bytes_a_step(self, method: Collocation, n: int) -> int:
        s = len(method.c)
        return 8 * (3 * (s * n) ** 2 + 4 * s * n * (2 * n + 1) + 8 * n**2)

    def level(self, tables: GridTables, coefficients: Array, orbit: bool) -> Level:
        method, m, n = tables.method, tables.steps, tables.stages.n
        P, s = len(coefficients), len(method.c)
        h = np.full(P * m, tables.period / m)
        with np.errstate(all="ignore"):
            M, C, K, d = _matrices(tables.stages.entries(coefficients).reshape(P * m, s, -1), n)
            a = method.stage_accelerations(h, M, C, K, d)
            steps = method.steps(h, a)
            steps = Steps(steps.A.reshape(P, m, 2 * n, 2 * n), steps.b.reshape(P, m, 2 * n))
            Phi = monodromy(steps)
            sound = np.isfinite(Phi).all(axis=(1, 2))
            if not orbit:
                return Level(Phi, None, sound)
            x, condition = periodic_states(Steps(steps.A[sound], steps.b[sound]))
            curves = Curves(np.full((P, n, m, len(method.curve_powers)), np.nan), tables.period)
            curves.coefficients[sound] = _powers(
                tables, coefficients[sound], x, a.reshape(P, m, s, n, -1)[sound]
            )
        sound[sound] = np.isfinite(condition)
        return Level(Phi, curves, sound)


def _matrices(entries: Array, n: int) -> tuple[Array, Array, Array, Array]:
    """Ω²M, ΩC, K (…, n, n) and d (…, n) of entries (…, 3n² + n)."""
    M, C, K = (
        entries[..., part * n**2 : (part + 1) * n**2].reshape(*entries.shape[:-1], n, n) for part in range(3)
    )
    return M, C, K, entries[..., 3 * n**2 :]


def _powers(tables: GridTables, coefficients: Array, x: Array, a: Array) -> Array:
    """Coefficients (P, n, m, D) of the curves through states x (P, m+1, 2n), from the accelerations
    a (P, m, s, n, 2n+1) as affine functions of them."""
    method, h, n = tables.method, tables.period / tables.steps, a.shape[3]
    stages = np.squeeze(a[..., :-1] @ x[:, :-1, None, :, None], -1) + a[..., -1]
    if tables.nodes is None:
        starts = np.roll(stages[:, :, -1], 1, axis=1)
    else:
        M, C, K, d = _matrices(tables.nodes.entries(coefficients), n)
        q, v = x[:, :-1, :n, None], x[:, :-1, n:, None]
        starts = np.squeeze(np.linalg.solve(M, d[..., None] - K @ q - C @ v), -1)
    accelerations = [starts, *np.moveaxis(stages, 2, 0), np.roll(starts, -1, axis=1)]
    data = [x[:, :-1, :n], h * x[:, :-1, n:], *(h**2 * part for part in accelerations)]
    data = np.stack(data[: method.curve_powers.shape[1]], axis=-1)
    return np.swapaxes(data, 1, 2) @ method.curve_powers.T
