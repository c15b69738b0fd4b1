"""Derivatives of Floquet multipliers by quantities θ, from left and right eigenvectors along the turn.

Φ is the product of the maps A_k of the steps, so that d log ρ = Σ_k yᴴ_{k+1} dA_k x_k / (yᴴ_{k+1} A_k x_k)
with the right vectors x_k at the starts of the steps and the left ones y_{k+1} at their ends: the sum over
steps of what is for the differential equation an integral over the turn. Every step may scale its vectors.
"""

from functools import cached_property
from typing import NamedTuple

import numpy as np

from solve.arrays import Array
from solve.certify.all_multipliers import Spectrum, matched_logarithms
from solve.derivatives.turn import TurnOnGrid
from solve.errors import MissingLibraryError, NoDerivativeError
from solve.kernel import slicot
from solve.period.blocks import Blocks, balanced_blocks, carried
from solve.period.product_eigenvalues import ProductEigenvalues, product_eigenvalues

MEET = 1e-6
"""Relative distance of two multipliers up to which neither has a derivative."""

_LEADS = 0.1
"""Part of the spectral radius above which Φ itself gives a multiplier's vectors."""

_RETURNS, _NEARLY = 1e-11, 1e-6
"""Relative difference up to which a vector is the same after a period; the second where the product of the
steps does not separate it from another, as near the double +1 of a rigid-body mode: derivatives then have
about six digits."""

_SMALLEST = 1e-100
"""Modulus below which numbers may underflow within the turn."""


class Vectors(NamedTuple):
    """Of a multiplier, right (m, N) at the starts of the steps and left (m, N) at their ends, of any size."""

    right: Array
    left: Array


class MultipliersOnGrid:
    """The multipliers of a system on a grid, and their vectors. known: those of a finer one."""

    def __init__(self, turn: TurnOnGrid, known: Spectrum):
        self._turn, self._spectrum = turn, known

    def vectors(self, at: int) -> Vectors:
        """Of one of the known multipliers. Raises NoDerivativeError where it is too close to another."""
        rho = self._spectrum.multiplier(at)
        found = self._leading(rho, _RETURNS)
        if found is not None:
            return found
        try:
            return self._of_product(at)
        except np.linalg.LinAlgError:
            found = self._leading(rho, _NEARLY)
        if found is None:
            raise NoDerivativeError(f"multiplier {at + 1} has no derivative: it is too close to another")
        return found

    def weights(self, vectors: Vectors, modulus: bool) -> list[tuple[complex, Array]]:
        """Weights (m, s, 3, n, n) of the entries of M, C and K at the stages in the derivative of log |ρ|, or
        in those of real and imaginary part of log ρ, with the unit of each."""
        turn, n, right, left = self._turn, self._turn.point.n, vectors.right, vectors.left.conj()
        left = left / ((left[:, None] @ turn.A)[:, 0] * right).sum(axis=1, keepdims=True)
        X = turn.stage_states(_parts(right))
        y = turn.pulled_ends(_parts(left)).reshape(*X.shape[:2], 1, n, 1, 2)
        (a, b), (v, w) = np.moveaxis(y, -1, 0), np.moveaxis(X[:, :, :, None], -1, 0)
        real = (1.0, b * w - a * v)
        return [real] if modulus else [real, (1j, -(a * w + b * v))]

    def by_node(self, vectors: Vectors, node: int) -> complex:
        """The derivative of log ρ by the phase of the start of a step."""
        y, x = vectors.left[node - 1].conj(), vectors.right[node]
        return -complex(y @ self._turn.rate_jump(node) @ x) / complex(y @ x)

    def _leading(self, rho: complex, accuracy: float) -> Vectors | None:
        """Vectors of a multiplier from Φ; None if they are not the same after a period to this accuracy."""
        values, right, left = self._of_turn
        at = int(np.abs(values - rho).argmin())
        value, found = values[at], []
        if not abs(value) > max(_LEADS * np.abs(values).max(), _SMALLEST):
            return None
        ways = (False, right[:, at], value), (True, left[:, at], value.conj())
        for backwards, start, factor in ways:
            states = self._turn.followed(start[:, None], backwards)[..., 0]
            apart = np.abs(states[-1] - factor * start) / np.abs(factor)
            if not (apart <= accuracy * np.abs(start).max()).all():
                return None
            found.append(states[:-1])
        return Vectors(found[0], found[1][::-1])

    @cached_property
    def _of_turn(self) -> tuple[Array, Array, Array]:
        """Multipliers (N,) of Φ with right and left vectors (N, N), a column each."""
        Phi = self._turn.followed(np.eye(self._turn.A.shape[-1]))[-1]
        values, right = np.linalg.eig(Phi)
        # The inverse of right vectors loses digits of all left ones where two others are nearly parallel.
        own, left = np.linalg.eig(Phi.conj().T)
        places = np.abs(own.conj() - values[:, None]).argmin(axis=1)
        return values.astype(complex), right, left[:, places]

    def _of_product(self, at: int) -> Vectors:
        if not slicot.available():
            raise MissingLibraryError(
                f"the derivative of multiplier {at + 1} requires SLICOT, because it is below the round-off "
                "of Φ; install ctrlsys, or choose a larger multiplier"
            )
        right, left = self._every
        place = int(self._places[at])
        return Vectors(right[..., place], left[..., place])

    @property
    def _known(self) -> Array:
        """log ρ (N,)."""
        return np.nan_to_num(self._spectrum.logarithms, nan=-np.inf)

    @cached_property
    def _blocks(self) -> Blocks:
        return balanced_blocks(self._turn.A[None])

    @cached_property
    def _found(self) -> ProductEigenvalues:
        return product_eigenvalues(self._blocks.factors, self._blocks.rounding, vectors=True)

    @cached_property
    def _places(self) -> Array:
        """Those of the known multipliers among the ones of this grid."""
        return matched_logarithms(self._known, self._found.logarithms[0])

    @cached_property
    def _every(self) -> tuple[Array, Array]:
        """Right vectors at the starts of the steps and left ones at their ends, (m, N, N), a column each."""
        blocks, found, A = self._blocks, self._found, self._turn.A
        assert found.right is not None
        assert found.left is not None
        units = blocks.units[0][:, None]
        right, _ = carried(A, blocks.starts, units * found.right[0])
        # Backwards, a block ends where the one before it begins.
        ends = len(A) - np.append(blocks.starts[1:], len(A))[::-1]
        at_ends = np.roll(found.left[0], -1, axis=0)[::-1] / units
        left, _ = carried(np.swapaxes(A, 1, 2)[::-1], ends, at_ends)
        return right, left[::-1]


def _parts(values: Array) -> Array:
    """Real and imaginary parts (…, 2) of complex numbers (…)."""
    return np.stack((np.real(values), np.imag(values)), axis=-1)
