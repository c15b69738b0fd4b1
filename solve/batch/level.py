"""One grid for many points: collocation with the points beside the steps, in NumPy."""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from solve.arrays import Array
from solve.batch.curves import Curves
from solve.batch.spectra import Spectra, rounding_errors
from solve.batch.tables import Tables
from solve.methods.collocation import Collocation
from solve.period.multipliers import accumulated
from solve.period.period_map import Steps, closed_condition, monodromy, periodic_states

_EPS = float(np.finfo(float).eps)


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
    """Monodromy matrices Phi (P, N, N) and, if asked for, periodic solutions on one grid of so many steps.

    sound (P,): where the result is finite and the closed system regular. condition (P,): of the closed
    system (G + H) x = r, or a bound of it where closed (P, 2, N, N), G and H, allows to say more; NaN
    without an orbit.
    """

    steps: int
    Phi: Array
    curves: Curves | None
    sound: Array
    condition: Array
    closed: Array | None = None

    def __getitem__(self, points: Array) -> "Level":
        return Level(
            self.steps,
            self.Phi[points],
            None if self.curves is None else self.curves[points],
            self.sound[points],
            self.condition[points],
            None if self.closed is None else self.closed[points],
        )

    @cached_property
    def spectra(self) -> Spectra:
        """Multipliers; zero where the result is not sound."""
        return Spectra.of(np.where(self.sound[:, None, None], self.Phi, 0.0))

    @property
    def closing_rounding(self) -> Array:
        """Error of the orbit (P,) that rounding leaves, or a bound of it."""
        return np.maximum(self._unit * np.nan_to_num(self.condition), 64 * _EPS)

    @property
    def _unit(self) -> float:
        return _EPS * accumulated(self.steps)

    def rounding(self, wanted: Array) -> Array:
        """Errors (P, 2) of orbit and multipliers that rounding leaves, as `certificate.rounding` says of
        one solution; that of the orbit may be bounded where it is below the `wanted` errors (P, 2)."""
        found = np.column_stack((self.closing_rounding, rounding_errors(self.Phi)))
        open_ = found[:, 0] > np.maximum(wanted[:, 0], 64 * _EPS)
        if self.closed is not None and open_.any():
            found[open_, 0] = self._unit * closed_condition(*np.moveaxis(self.closed[open_], 1, 0))
        return np.maximum(found, 64 * _EPS)

    @property
    def most_rounding(self) -> Array:
        """What `rounding` cannot exceed, (P, 2)."""
        radius = self.spectra.radius
        norm = np.sqrt((self.Phi**2).sum(axis=(1, 2)))
        multipliers = np.sqrt(8 * _EPS * norm / np.where(radius > 0, radius, np.inf))
        return np.column_stack((self.closing_rounding, np.maximum(multipliers, 64 * _EPS)))


class Engine(Protocol):
    """Something that solves many points on one grid."""

    name: str

    def bytes_a_step(self, method: Collocation, n: int, orbit: bool) -> int:
        """Memory that a step of a point takes."""
        ...

    def level(self, tables: GridTables, coefficients: Array, orbit: bool) -> Level:
        """For coefficients (P, R)."""
        ...


class NumpyEngine:
    """The kernels of a single solve with another leading axis."""

    name = "numpy"

    def bytes_a_step(self, method: Collocation, n: int, orbit: bool) -> int:
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
            sound = finite(Phi)
            if not orbit:
                return Level(m, Phi, None, sound, np.full(P, np.nan))
            x, condition = periodic_states(Steps(steps.A[sound], steps.b[sound]))
            curves = Curves(np.full((P, n, m, len(method.curve_powers)), np.nan), tables.period)
            curves.coefficients[sound] = _powers(
                tables, coefficients[sound], x, a.reshape(P, m, s, n, -1)[sound]
            )
        every = np.full(P, np.inf)
        every[sound] = condition
        return Level(m, Phi, curves, np.isfinite(every), every)


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


def finite(Phi: Array) -> Array:
    """Which matrices (P, N, N) are finite throughout (P,)."""
    return np.asarray(np.isfinite(Phi).all(axis=(1, 2)))
