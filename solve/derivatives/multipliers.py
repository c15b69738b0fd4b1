"""Derivatives of Floquet multipliers by quantities θ, from left and right eigenvectors along the turn.

Φ is the product of the maps A_k of the steps, so that d log ρ = Σ_k yᴴ_{k+1} dA_k x_k / (yᴴ_{k+1} A_k x_k)
with the right vectors x_k at the starts of the steps and the left ones y_{k+1} at their ends: the sum over
steps of what is for the differential equation an integral over the turn. Every step may scale its vectors.
"""

import numpy as np

from solve.arrays import Array
from solve.derivatives.turn import TurnOnGrid
from solve.period.product_eigenvalues import (
    ProductEigenvalues,
    balanced_blocks,
    carried,
    product_eigenvalues,
)

MEET = 1e-6
"""Relative distance of two multipliers up to which neither has a derivative."""


class MultipliersOnGrid:
    """The multipliers of a system on a grid, and their vectors."""

    def __init__(self, turn: TurnOnGrid):
        self._turn = turn
        self._blocks = balanced_blocks(turn.A[None])
        self.found: ProductEigenvalues = product_eigenvalues(
            self._blocks.factors, self._blocks.rounding, vectors=True
        )

    @property
    def logarithms(self) -> Array:
        """log ρ (N,), falling in modulus."""
        return self.found.logarithms[0]

    def slopes(self, slopes: Array) -> Array:
        """d log ρ / dθ (N, r), from derivatives of the entries (m k, 3n² + n, r) at the turn's phases."""
        turn = self._turn
        m, k = turn.phases.shape
        n, right, left = turn.point.n, *self._vectors()
        left = left.conj().swapaxes(1, 2)
        gained = np.einsum("mei,mie->me", left @ turn.A, right)
        y = (left @ turn.B) / gained[..., None]
        X = turn.stage_states(right)
        weights = y.reshape(m, 2 * n, -1, 1, n, 1).swapaxes(0, 1) * np.moveaxis(X, -1, 0)[:, :, :, :, None]
        of_stages = slopes.reshape(m, k, *slopes.shape[1:])[:, turn.stages, : 3 * n**2]
        of_stages, weights = of_stages.reshape(-1, slopes.shape[-1]), weights.reshape(2 * n, -1)
        return -(weights.real @ of_stages) - 1j * (weights.imag @ of_stages)

    def _vectors(self) -> tuple[Array, Array]:
        """Right vectors at the starts of the steps and left ones at their ends, (m, N, N), a column each."""
        blocks, found, A = self._blocks, self.found, self._turn.A
        assert found.right is not None
        assert found.left is not None
        units = blocks.units[0][:, None]
        right, _ = carried(A, blocks.starts, units * found.right[0])
        # Backwards, a block ends where the one before it begins.
        ends = len(A) - np.append(blocks.starts[1:], len(A))[::-1]
        at_ends = np.roll(found.left[0], -1, axis=0)[::-1] / units
        left, _ = carried(np.swapaxes(A, 1, 2)[::-1], ends, at_ends)
        return right, left[::-1]
