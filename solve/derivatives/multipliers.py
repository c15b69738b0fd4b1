"""Derivatives of Floquet multipliers by quantities θ, from left and right eigenvectors along the turn.

Φ is the product of the maps A_k of the steps, so that d log ρ = Σ_k yᴴ_{k+1} dA_k x_k / (yᴴ_{k+1} A_k x_k)
with the right vectors x_k at the starts of the steps and the left ones y_{k+1} at their ends: the sum over
steps of what is for the differential equation an integral over the turn. Every step may scale its vectors.
"""

from functools import cached_property

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

    def weights(self, at: int) -> Array:
        """Weights (m, s, 3, n, n) of the entries of M, C and K at the stages in the derivative of log ρ of
        the multiplier at a place."""
        turn, n = self._turn, self._turn.point.n
        right, left = (part[..., at] for part in self._vectors)
        left = left.conj()
        gained = np.einsum("mi,mij,mj->m", left, turn.A, right)
        y = (left[:, None] @ turn.B)[:, 0] / gained[:, None]
        X = turn.stage_states(right[..., None])[..., 0]
        return -y.reshape(*X.shape[:2], 1, n, 1) * X[:, :, :, None]

    def by_node(self, at: int, node: int) -> complex:
        """The derivative of log ρ of the multiplier at a place by the phase of the start of a step."""
        right, left = (part[..., at] for part in self._vectors)
        y, x = left[node - 1].conj(), right[node]
        return -complex(y @ self._turn.rate_jump(node) @ x) / complex(y @ x)

    @cached_property
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
