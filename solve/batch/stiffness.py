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

    def faster(self, rate: float) -> Array:
        """Whether sqrt(ρ(M⁻¹K)) or ρ(M⁻¹C) exceeds the rate at any of the phases (P,)."""
        M, C, K = np.moveaxis(self._fields, (1, 2), (3, 4))
        somewhere = self._fastest(*(part[:, self._likely(M, K)] for part in (M, C, K)))
        found = somewhere > rate
        open_ = np.flatnonzero(~found)
        if len(open_):
            open_ = open_[~self._slow(open_, rate)]
        if len(open_):
            found[open_] = self._fastest(*(part[open_] for part in (M, C, K))).max(axis=1) > rate
        return found

    def within(self, reach: Array) -> Array:
        """Whether all frozen eigenvalues are sure to have moduli of at most `reach` (P,): λ²M + λC + K
        is regular beyond where (|M⁻¹C|/r + |M⁻¹K|/r²) v ≤ v for some positive v (Perron, Collatz)."""
        every = np.arange(self._fields.shape[3])
        r = reach[:, None]
        C, K = self._ratios(every)
        return _contracts(np.abs(C) / r + np.abs(K) / r**2)

    def eigenvalues(self, every: int = 1) -> Array:
        """Frozen eigenvalues (P, k, 2n), at every so many-th of the phases."""
        n, (M, C, K) = self._n, np.moveaxis(self._fields[..., ::every], (1, 2), (3, 4))
        rate = np.zeros((*M.shape[:2], 2 * n, 2 * n))
        rate[..., range(n), range(n, 2 * n)] = 1.0
        rate[..., n:, :] = np.linalg.solve(M, np.concatenate((-K, -C), axis=-1))
        return np.linalg.eigvals(rate)

    def __getitem__(self, points: Array) -> "Stiffness":
        return Stiffness(
            self._fields[:, :, :, points].reshape(-1, len(points), self._fields.shape[4]), self._n
        )

    def _slow(self, points: Array, rate: float) -> Array:
        """Whether the points are sure not to be faster than the rate."""
        C, K = self._ratios(points)
        return _contracts(np.abs(K) / rate**2) & _contracts(np.abs(C) / rate)

    def _ratios(self, points: Array) -> tuple[Array, Array]:
        """M⁻¹C and M⁻¹K as fields (n, n, P, k), by elimination without exchange; NaN or a wrong
        bound's excess where that fails only sends a point to the exact way."""
        M, C, K = self._fields[:, :, :, points]
        n, rows = self._n, np.concatenate((M, C, K), axis=1)
        with np.errstate(all="ignore"):
            for k in range(n):
                rows[k, k + 1 :] /= rows[k, k]
                for i in range(n):
                    if i != k:
                        rows[i, k + 1 :] -= rows[i, k] * rows[k, k + 1 :]
        return rows[:, n : 2 * n], rows[:, 2 * n :]

    def _likely(self, M: Array, K: Array) -> int:
        """The phase at which the point in the middle is stiffest."""
        middle = len(M) // 2
        return int(np.abs(np.linalg.eigvals(np.linalg.solve(M[middle], K[middle]))).max(axis=1).argmax())

    def _fastest(self, M: Array, C: Array, K: Array) -> Array:
        stiffness, damping = (np.abs(np.linalg.eigvals(np.linalg.solve(M, A))).max(axis=-1) for A in (K, C))
        return np.maximum(np.sqrt(stiffness), damping)


def _contracts(B: Array) -> Array:
    """Whether non-negative fields B (n, n, P, k) are sure to have spectral radii of at most 1 (P,)."""
    v = np.ones(B.shape[1:])
    with np.errstate(all="ignore"):
        for _ in range(_ITERATIONS):
            v = np.einsum("ijpk,jpk->ipk", B, v)
            v = np.maximum(v / v.max(axis=0), 1e-3)
        return (np.einsum("ijpk,jpk->ipk", B, v) <= v).all(axis=(0, 2))
