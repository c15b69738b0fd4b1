"""How fast the frozen modes of many points are: bounds first, eigenvalues where the bounds leave doubt.

Every question is one of `PeriodicSystem.fastest` and `frozen_eigenvalues`, at the same phases.
"""

import numpy as np

from solve.arrays import Array

_ITERATIONS = 6


class Stiffness:
    """Frozen modes from fields (3n² + n, P, k) of Ω²M, ΩC, K over points and phases."""

    def __init__(self, fields: Array, n: int):
        self._fields, self._n = fields[: 3 * n**2].reshape(3, n, n, *fields.shape[1:]), n

    def __getitem__(self, points: Array) -> "Stiffness":
        fields = self._fields[:, :, :, points]
        return Stiffness(fields.reshape(-1, *fields.shape[3:]), self._n)

    def faster(self, rate: float) -> Array:
        """Whether sqrt(ρ(M⁻¹K)) or ρ(M⁻¹C) exceeds the rate at any of the phases (P,)."""
        if self._n == 1:
            return np.any(self._fastest() > rate, axis=1)
        found = self._at(self._likely())._fastest()[:, 0] > rate
        open_ = np.flatnonzero(~found)
        if len(open_):
            open_ = open_[~self[open_]._slow(rate)]
        if len(open_):
            found[open_] = (self[open_]._fastest() > rate).any(axis=1)
        return found

    def within(self, reach: float) -> Array:
        """Whether all frozen eigenvalues are sure to have moduli of at most `reach` (P,): λ²M + λC + K
        is regular beyond where (|M⁻¹C|/r + |M⁻¹K|/r²) v ≤ v for some positive v (Perron, Collatz)."""
        C, K = self._ratios()
        if self._n == 1:
            # Schur and Cohn's criterion, sharp for a single mode.
            inside = (np.abs(K) <= reach**2) & (np.abs(C) <= reach + K / reach)
            return np.all(inside, axis=(0, 1, 3))
        return _contracts(np.abs(C) / reach + np.abs(K) / reach**2)

    def eigenvalues(self, phases: Array | slice = slice(None)) -> Array:
        """Frozen eigenvalues (P, k, 2n) at some of the phases, all by default."""
        n, (M, C, K) = self._n, np.moveaxis(self._fields[..., phases], (1, 2), (3, 4))
        if n == 1:
            return _quadratic(*(part[..., 0, 0] for part in (M, C, K)))
        rate = np.zeros((*M.shape[:2], 2 * n, 2 * n))
        rate[..., range(n), range(n, 2 * n)] = 1.0
        rate[..., n:, :] = np.linalg.solve(M, np.concatenate((-K, -C), axis=-1))
        return np.linalg.eigvals(rate)

    def _at(self, phase: int) -> "Stiffness":
        fields = self._fields[..., phase : phase + 1]
        return Stiffness(fields.reshape(-1, *fields.shape[3:]), self._n)

    def _likely(self) -> int:
        """The phase at which the point in the middle is stiffest."""
        middle = self[np.array([self._fields.shape[3] // 2])]
        return int(middle._fastest()[0].argmax())

    def _fastest(self) -> Array:
        """The larger of sqrt(ρ(M⁻¹K)) and ρ(M⁻¹C), (P, k)."""
        M, C, K = np.moveaxis(self._fields, (1, 2), (3, 4))
        if self._n == 1:
            stiffness, damping = (np.abs(part[..., 0, 0] / M[..., 0, 0]) for part in (K, C))
        else:
            stiffness, damping = (
                np.abs(np.linalg.eigvals(np.linalg.solve(M, part))).max(axis=-1) for part in (K, C)
            )
        return np.maximum(np.sqrt(stiffness), damping)

    def _slow(self, rate: float) -> Array:
        """Whether the points are sure not to be faster than the rate."""
        C, K = self._ratios()
        return _contracts(np.abs(K) / rate**2) & _contracts(np.abs(C) / rate)

    def _ratios(self) -> tuple[Array, Array]:
        """M⁻¹C and M⁻¹K as fields (n, n, P, k), by elimination without exchange, as inertia allows."""
        M, C, K = self._fields
        n, rows = self._n, np.concatenate((M, C, K), axis=1)
        with np.errstate(all="ignore"):
            for k in range(n):
                rows[k, k + 1 :] /= rows[k, k]
                for i in range(n):
                    if i != k:
                        rows[i, k + 1 :] -= rows[i, k] * rows[k, k + 1 :]
        return rows[:, n : 2 * n], rows[:, 2 * n :]


def _quadratic(M: Array, C: Array, K: Array) -> Array:
    """Roots (…, 2) of λ²M + λC + K."""
    half, product = C / (2 * M), K / M
    root = np.sqrt((half**2 - product).astype(complex))
    larger = -half - np.where(half < 0, -1.0, 1.0) * root
    return np.stack(
        (larger, np.where(larger != 0, product / np.where(larger != 0, larger, 1.0), 0.0)), axis=-1
    )


def _contracts(B: Array) -> Array:
    """Whether non-negative fields B (n, n, P, k) are sure to have spectral radii of at most 1 (P,)."""
    v = np.ones(B.shape[1:])
    with np.errstate(all="ignore"):
        for _ in range(_ITERATIONS):
            v = np.einsum("ijpk,jpk->ipk", B, v)
            v = np.maximum(v / v.max(axis=0), 1e-3)
        return (np.einsum("ijpk,jpk->ipk", B, v) <= v).all(axis=(0, 2))
