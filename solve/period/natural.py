"""Natural frequencies of M q̈ + K q = 0 at many positions. Rigid-body modes have frequency exactly 0. A
stiffness matrix that is not positive semidefinite results in growth rates."""

from typing import NamedTuple

import numpy as np

from solve.arrays import EPS, Array, solved
from solve.matrices import inertia_units
from solve.period.rigid_body import rigid_body_modes

_SYMMETRIC = 64 * EPS
"""Largest asymmetry that counts as round-off of the assembly of a matrix, relative to the largest entry in
coordinates of unit inertia."""

PERTURBATION = 16.0
"""Factor in the error bound of an eigenvalue λ computed by the QR algorithm: factor × n × eps × norm ×
condition number. Measured: below 2 for random matrices of 2 to 20 coordinates."""

_EQUAL = 1e-7
"""Difference of two λ, relative to the largest λ, below which they count as equal: round-off splits a
defective pair by the square root of eps, 1.5e-8."""


class NaturalFrequencies(NamedTuple):
    """Natural frequencies and growth rates at m positions.

    Modes are in ascending order of the real part of λ in K v = λ M v: growing modes, rigid-body modes, then
    vibrating modes. frequencies (m, k): imaginary part of √−λ in rad/s; NaN where λ < 0. growth_rates (m, k):
    real part of √−λ in 1/s; NaN where λ ≥ 0. A mode with complex λ, which is possible if K is not symmetric,
    has both."""

    frequencies: Array
    growth_rates: Array

    @property
    def signed(self) -> Array:
        """Values in ascending order of λ: frequencies, or for λ < 0 growth rates with negative sign."""
        return np.where(np.isnan(self.frequencies), -self.growth_rates, self.frequencies)

    @classmethod
    def from_eigenvalues(cls, eigenvalues: Array) -> "NaturalFrequencies":
        """Frequencies and growth rates from complex λ (m, k)."""
        roots = np.sqrt(-eigenvalues.astype(complex))
        real = np.imag(eigenvalues) == 0
        grows = ~real | (np.real(eigenvalues) < 0)
        return cls(
            np.where(real & grows, np.nan, np.abs(np.imag(roots))),
            np.where(grows, np.abs(np.real(roots)), np.nan),
        )


def natural_frequencies(M: Array, K: Array, count: int) -> NaturalFrequencies:
    """Frequencies and growth rates of the first `count` modes of M and K (m, n, n); M must be invertible."""
    return NaturalFrequencies.from_eigenvalues(eigenvalues(M, K)[:, :count])


def eigenvalues(M: Array, K: Array) -> Array:
    """Complex λ (m, n) of K v = λ M v in ascending order of the real part. λ is exactly 0 for rigid-body
    modes.

    >>> chain = np.array([[[2.0, -2.0], [-2.0, 2.0]]])
    >>> eigenvalues(np.eye(2)[None], chain).real.round(12).tolist()
    [[0.0, 4.0]]
    """
    modes = rigid_body_modes(K[:, None], np.zeros_like(K[:, None]))
    found = np.zeros(K.shape[:2], dtype=complex)
    alike: dict[tuple[int, ...], list[int]] = {}
    for at, (references, present) in enumerate(zip(modes.references, modes.present, strict=True)):
        alike.setdefault(tuple(references[present].tolist()), []).append(at)
    for references, positions in alike.items():
        rest = [k for k in range(K.shape[1]) if k not in references]
        if rest:
            vectors = modes.vectors[positions][:, :, : len(references)]
            found[positions, len(references) :] = _elastic(
                M[positions], K[positions], vectors, [*references], rest
            )
    return np.take_along_axis(found, np.argsort(np.real(found), axis=1, kind="stable"), axis=1)


def lowest_elastic(frequencies: Array) -> Array:
    """Lowest nonzero frequency (…) of the natural frequencies (…, n); 0 if all are zero.

    >>> lowest_elastic(np.array([[0.0, 3.0, 2.0], [0.0, 0.0, 0.0]])).tolist()
    [2.0, 0.0]
    """
    lowest = np.where(frequencies == 0, np.inf, frequencies).min(axis=-1)
    return np.where(np.isinf(lowest), 0.0, lowest)


def slopes(M: Array, K: Array, by_M: Array, by_K: Array) -> Array:
    """Derivatives (r, n) of λ with respect to r quantities: yᵀ(∂K − λ ∂M)v with yᵀMv = 1.

    M and K (n, n) are the matrices at one position, by_M and by_K (r, n, n) their derivatives with respect to
    the quantities. For equal λ, the mean of their derivatives is returned.

    >>> slopes(np.eye(1), np.eye(1) * 4, np.ones((1, 1, 1)), np.zeros((1, 1, 1)))
    array([[-4.]])
    """
    values, right = np.linalg.eig(np.linalg.solve(M, K))
    order = np.argsort(np.real(values), kind="stable")
    values, right = values[order], right[:, order]
    left = np.linalg.inv(M @ right)
    each = np.einsum("ni,rij,jn->rn", left, by_K, right) - values * np.einsum(
        "ni,rij,jn->rn", left, by_M, right
    )
    alike = np.abs(values[:, None] - values) <= _EQUAL * np.abs(values).max()
    return np.real(each @ (alike / alike.sum(axis=0)))


def _elastic(M: Array, K: Array, vectors: Array, references: list[int], rest: list[int]) -> Array:
    """Eigenvalues λ (m, n - r) of the modes that are not rigid-body modes.

    `vectors` (m, n, r) are the rigid-body modes; their rows `references` are the identity. With q = E a + x,
    where E contains the modes and x is zero at the references, K acts on x alone, and M is reduced to a Schur
    complement."""
    stiffness, moved = K[:, rest][:, :, rest], M @ vectors
    if _symmetric(M, M).all() and _symmetric(K, M).all() and _is_positive(M):
        overlap_inverse = np.linalg.inv(np.swapaxes(vectors, 1, 2) @ moved)
        mass = M[:, rest][:, :, rest] - moved[:, rest] @ overlap_inverse @ np.swapaxes(moved[:, rest], 1, 2)
        return _of_symmetric(mass, stiffness).astype(complex)
    rate = np.linalg.solve(M, K)[:, :, rest]
    return np.array([_of_general(one) for one in rate[:, rest] - vectors[:, rest] @ rate[:, references]])


def _symmetric(A: Array, M: Array) -> Array:
    """Return a mask (m,) of the matrices (m, n, n) that are symmetric in coordinates of unit inertia."""
    unit = inertia_units(M)
    scaled = A * unit[:, :, None] * unit[:, None, :]
    asymmetry = np.abs(scaled - np.swapaxes(scaled, 1, 2)).max(axis=(1, 2))
    return np.asarray(asymmetry <= _SYMMETRIC * np.abs(scaled).max(axis=(1, 2)))


def _is_positive(A: Array) -> bool:
    """Whether symmetric matrices (m, n, n) are all positive definite."""
    try:
        np.linalg.cholesky(A)
    except np.linalg.LinAlgError:
        return False
    return True


def _of_symmetric(M: Array, K: Array) -> Array:
    """Eigenvalues λ (m, n) in ascending order, for positive definite M.

    If λ is computed, small λ are inaccurate if there are large λ; if 1/λ is computed, large λ are inaccurate.
    If K is positive definite, each λ is taken from the computation with the smaller relative error: eps
    λmax/λ for λ, or eps λ/λmin for 1/λ."""
    found = _reduced(M, K)
    if not _is_positive(K):
        return found
    inverse = 1 / _reduced(K, M)[:, ::-1]
    middle = np.sqrt(inverse[:, :1] * np.abs(found[:, -1:]))
    return np.sort(np.where(inverse < middle, inverse, found), axis=1)


def _reduced(A: Array, B: Array) -> Array:
    """Eigenvalues (m, n) of L⁻¹ B L⁻ᵀ, where A = L Lᵀ."""
    L = np.linalg.cholesky(A)
    congruent = np.linalg.solve(L, np.swapaxes(np.linalg.solve(L, B), 1, 2))
    return np.linalg.eigvalsh((congruent + np.swapaxes(congruent, 1, 2)) / 2)


def _of_general(rate: Array) -> Array:
    """Complex eigenvalues (n,) of a matrix. Imaginary parts within round-off are set to zero."""
    from scipy.linalg import matrix_balance

    balanced = np.asarray(matrix_balance(rate)[0])
    values, right = np.linalg.eig(balanced)
    left = np.nan_to_num(solved(right, np.eye(len(rate))), nan=np.inf)
    condition = np.linalg.norm(left, axis=1)
    error = PERTURBATION * len(rate) * EPS * np.linalg.norm(balanced) * condition
    return np.where(np.abs(np.imag(values)) <= error, np.real(values), values)
