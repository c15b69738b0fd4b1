"""Derivatives of Floquet multipliers with respect to quantities θ, from left and right eigenvectors over the
period.

Φ is the product of the maps A_k of the steps, so that d log ρ = Σ_k yᴴ_{k+1} dA_k x_k / (yᴴ_{k+1} A_k x_k)
with the right vectors x_k at the starts of the steps and the left vectors y_{k+1} at their ends. The sum over
steps corresponds to an integral over the period. The vectors of each step may be scaled independently."""

from functools import cached_property
from typing import NamedTuple

import numpy as np

from solve.arrays import Array
from solve.certify.all_multipliers import Spectrum
from solve.derivatives.periodic_problem import PeriodicProblem
from solve.errors import MissingLibraryError, NoDerivativeError
from solve.kernel import slicot
from solve.period.blocks import Blocks, balanced_blocks, carried
from solve.period.logarithms import matched_logarithms
from solve.period.product_eigenvalues import ProductEigenvalues, product_eigenvalues

COALESCENCE = 1e-6
"""Relative distance between two multipliers up to which their derivatives are not computed. Chosen by
judgement: multipliers that coincide lose half of their digits."""

_LEADING = 0.1
"""Modulus of a multiplier, relative to the spectral radius, above which its eigenvectors are computed from Φ.
Chosen by judgement: at this modulus, the eigenvectors lose one digit."""

_PERIODIC, _NEARLY_PERIODIC = 1e-11, 1e-6
"""Relative difference up to which a vector counts as unchanged after a period. The second value is used if
the product of the steps does not separate the vector from another one, as near the double multiplier +1 of a
rigid-body mode. Derivatives are then accurate to about six digits."""

_MIN_MODULUS = 1e-100
"""Modulus of a multiplier below which values may underflow during the period."""


class Vectors(NamedTuple):
    """Eigenvectors of a multiplier in arbitrary norm: right vectors (m, N) at the starts of the steps, and
    left vectors (m, N) at their ends."""

    right: Array
    left: Array


class GridMultipliers:
    """Multipliers of a system on a grid, and their eigenvectors. known: multipliers from a finer grid."""

    def __init__(self, problem: PeriodicProblem, known: Spectrum):
        self._problem, self._spectrum = problem, known

    def vectors(self, at: int) -> Vectors:
        """Eigenvectors of the known multiplier with index `at`. Raises NoDerivativeError if this multiplier
        is too close to another one."""
        rho = self._spectrum.multiplier(at)
        vectors_of_multiplier = self._leading(rho, _PERIODIC)
        if vectors_of_multiplier is not None:
            return vectors_of_multiplier
        try:
            return self._of_product(at)
        except np.linalg.LinAlgError:
            vectors_of_multiplier = self._leading(rho, _NEARLY_PERIODIC)
        if vectors_of_multiplier is None:
            raise NoDerivativeError(f"multiplier {at + 1} has no derivative: it is too close to another")
        return vectors_of_multiplier

    def weights(self, vectors: Vectors, modulus: bool) -> list[tuple[complex, Array]]:
        """Return weights (m, s, 3, n, n) of the entries of M, C and K at the stages. If `modulus` is true,
        their weighted sum is the derivative of log |ρ|. Otherwise, there are two arrays of weights, for the
        real and the imaginary part of the derivative of log ρ.

        Each array is preceded by the factor of its sum, 1 or i."""
        problem, n, right, left = self._problem, self._problem.point.n, vectors.right, vectors.left.conj()
        left = left / ((left[:, None] @ problem.A)[:, 0] * right).sum(axis=1, keepdims=True)
        X = problem.stage_states(_parts(right))
        y = problem.end_state_gradient(_parts(left)).reshape(*X.shape[:2], 1, n, 1, 2)
        (a, b), (v, w) = np.moveaxis(y, -1, 0), np.moveaxis(X[:, :, :, None], -1, 0)
        real = (1.0, b * w - a * v)
        return [real] if modulus else [real, (1j, -(a * w + b * v))]

    def by_node(self, vectors: Vectors, node: int) -> complex:
        """Derivative of log ρ with respect to the phase at which the step with index `node` starts."""
        y, x = vectors.left[node - 1].conj(), vectors.right[node]
        return -complex(y @ self._problem.rate_jump(node) @ x) / complex(y @ x)

    def _leading(self, rho: complex, accuracy: float) -> Vectors | None:
        """Eigenvectors of a multiplier, computed from Φ. None if one period does not reproduce them to the
        relative accuracy `accuracy`."""
        values, right, left = self._eigenvectors
        at = int(np.abs(values - rho).argmin())
        value, vectors = values[at], []
        if not abs(value) > max(_LEADING * np.abs(values).max(), _MIN_MODULUS):
            return None
        problems = (False, right[:, at], value), (True, left[:, at], value.conj())
        for backwards, start, factor in problems:
            states = self._problem.propagate(start[:, None], backwards)[..., 0]
            change = np.abs(states[-1] - factor * start) / np.abs(factor)
            if not (change <= accuracy * np.abs(start).max()).all():
                return None
            vectors.append(states[:-1])
        return Vectors(vectors[0], vectors[1][::-1])

    @cached_property
    def _eigenvectors(self) -> tuple[Array, Array, Array]:
        """Return the multipliers (N,) of Φ, and its right and left eigenvectors as columns of matrices (N,
        N)."""
        Phi = self._problem.propagate(np.eye(self._problem.A.shape[-1]))[-1]
        values, right = np.linalg.eig(Phi)
        # If two right vectors are nearly parallel, left vectors from the inverse of the right vectors would
        # be inaccurate.
        adjoint_values, left = np.linalg.eig(Phi.conj().T)
        nearest = np.abs(adjoint_values.conj() - values[:, None]).argmin(axis=1)
        return values.astype(complex), right, left[:, nearest]

    def _of_product(self, at: int) -> Vectors:
        if not slicot.available():
            raise MissingLibraryError(
                f"multiplier {at + 1} is below the round-off of Φ, so that its derivative requires SLICOT; "
                "install ctrlsys, which contains SLICOT, or choose a larger multiplier"
            )
        right, left = self._product_vectors
        place = int(self._places[at])
        return Vectors(right[..., place], left[..., place])

    @property
    def _known(self) -> Array:
        """Logarithms (N,) of the known multipliers."""
        return np.nan_to_num(self._spectrum.logarithms, nan=-np.inf)

    @cached_property
    def _blocks(self) -> Blocks:
        return balanced_blocks(self._problem.A[None])

    @cached_property
    def _eigenvalues(self) -> ProductEigenvalues:
        return product_eigenvalues(self._blocks.factors, self._blocks.rounding, vectors=True)

    @cached_property
    def _places(self) -> Array:
        """For each known multiplier, its index among the multipliers of this grid."""
        return matched_logarithms(self._known, self._eigenvalues.logarithms[0])

    @cached_property
    def _product_vectors(self) -> tuple[Array, Array]:
        """Return right vectors at the starts of the steps and left vectors at their ends, as columns of
        arrays (m, N, N)."""
        blocks, product, A = self._blocks, self._eigenvalues, self._problem.A
        assert product.right is not None
        assert product.left is not None
        units = blocks.units[0][:, None]
        right, _ = carried(A, blocks.starts, units * product.right[0])
        # In the reversed chain, a block starts where it ends in the forward direction.
        ends = len(A) - np.append(blocks.starts[1:], len(A))[::-1]
        at_ends = np.roll(product.left[0], -1, axis=0)[::-1] / units
        left, _ = carried(np.swapaxes(A, 1, 2)[::-1], ends, at_ends)
        return right, left[::-1]


def _parts(values: Array) -> Array:
    """Real and imaginary parts (…, 2) of complex numbers (…)."""
    return np.stack((np.real(values), np.imag(values)), axis=-1)
