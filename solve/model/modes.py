"""Natural frequencies and modes of M q̈ + K q = 0 at many positions in one call, and modal damping."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from solve.arrays import ROUND_OFF, Array
from solve.errors import MatricesError
from solve.matrices import split_entries
from solve.model.sampling import MatrixSampler

if TYPE_CHECKING:
    import casadi

_SHIFT = 1e-6
"""Shift of ω² for singular K, relative to the mean ω². Chosen by judgement."""

_RIGID = 1e-13
"""Value of ω², relative to the largest K_ii/M_ii, below which ω² counts as the round-off of a rigid-body
mode. Chosen by judgement."""

_ASYMMETRY = 1e-10
"""Threshold for round-off in the scaled K, relative to the largest entry of K. It applies to the asymmetry of
K and to the moduli of the negative eigenvalues. Chosen by judgement."""


class Modes(NamedTuple):
    """Natural frequencies (m, k) in rad/s, ascending, and mode vectors (m, n, k) with ΦᵀMΦ = I."""

    frequencies: Array
    vectors: Array


def lowest_frequencies(M: Array, K: Array, count: int) -> Array:
    """Lowest natural frequencies (m, count) in rad/s, in ascending order; see `modes`."""
    shift, _, pencil = _pencil(M, K)
    return _frequencies(np.linalg.eigvalsh(pencil), shift, roundoff_frequency(M, K))[:, :count]


def modes(M: Array, K: Array) -> Modes:
    """All modes of M and K (m, n, n). M must be positive definite, K positive semidefinite.

    The eigenvalues 1/ω² of the pencil M − (1/ω²) K are computed. Low frequencies then remain accurate for any
    stiffness of the highest modes. The highest modes lose digits and are recomputed from the pencil K − ω² M
    in the space of the modes above the geometric mean of the lowest and the highest frequency."""
    shift, L, pencil = _pencil(M, K)
    values, vectors = np.linalg.eigh(pencil)
    vectors = np.linalg.solve(np.swapaxes(L, 1, 2), vectors / np.sqrt(values[:, None, :]))
    frequencies = _frequencies(values, shift, roundoff_frequency(M, K))
    high = int((values**2 < values[:, :1] * values[:, -1:]).sum(axis=1).min(initial=values.shape[1]))
    low = vectors[:, :, high:]
    basis = vectors[:, :, :high] - low @ (np.swapaxes(low, 1, 2) @ M @ vectors[:, :, :high])
    squares, vectors[:, :, :high] = _rayleigh_ritz(M, K, basis)
    frequencies[:, values.shape[1] - high :] = np.sqrt(squares[:, ::-1])
    return Modes(frequencies, vectors[:, :, ::-1])


def _rayleigh_ritz(M: Array, K: Array, basis: Array) -> tuple[Array, Array]:
    """Squared frequencies ω² (m, r), descending, and modes (m, n, r) of M and K, computed by the
    Rayleigh-Ritz method in the span of `basis` (m, n, r)."""
    mass, stiffness = (np.swapaxes(basis, 1, 2) @ matrix @ basis for matrix in (M, K))
    L = np.linalg.cholesky(mass)
    squares, vectors = np.linalg.eigh(_congruent(stiffness, L))
    shapes = basis @ np.linalg.solve(np.swapaxes(L, 1, 2), vectors)
    return squares[:, ::-1], shapes[:, :, ::-1]


def _pencil(M: Array, K: Array) -> tuple[Array, Array, Array]:
    """Return the shift (m,), the Cholesky factor L of K + shift M = LLᵀ, and L⁻¹ M L⁻ᵀ."""
    shift = _shifts(M, K)
    L = np.linalg.cholesky(K + shift[:, None, None] * M)
    return shift, L, _congruent(M, L)


def _congruent(matrix: Array, L: Array) -> Array:
    """Products L⁻¹ A L⁻ᵀ for symmetric matrices A (m, n, n) and triangular L."""
    return np.linalg.solve(L, np.swapaxes(np.linalg.solve(L, matrix), 1, 2))


def roundoff_frequency(M: Array, K: Array) -> Array:
    """Frequency (m,) below which computed frequencies are round-off, for M and K (m, n, n). It is 0 for
    regular K, because low frequencies are then accurate."""
    if M.shape[1] == 0:
        return np.zeros(len(M))
    rounding = np.sqrt(_RIGID * (np.einsum("mii->mi", K) / np.einsum("mii->mi", M)).max(axis=1))
    return np.where(_shifts(M, K) > 0, rounding, 0.0)


def _frequencies(values: Array, shift: Array, rest: Array) -> Array:
    squares = 1 / values[:, ::-1] - shift[:, None]
    return np.sqrt(np.where(squares > rest[:, None] ** 2, squares, 0.0))


def _shifts(M: Array, K: Array) -> Array:
    """Shift of ω² (m,). If the K of any position is singular within round-off, the shift is positive for all
    positions; otherwise, it is zero for all positions."""
    try:
        pivots = np.einsum("mii->mi", np.linalg.cholesky(K)) ** 2
        singular = (pivots < ROUND_OFF * np.einsum("mii->mi", K)).any()
    except np.linalg.LinAlgError:
        singular = True
    mean = np.trace(K, axis1=1, axis2=2) / np.trace(M, axis1=1, axis2=2)
    return _SHIFT * mean * singular


def modal_damping(M: Array, K: Array, ratio: Array | float) -> Array:
    """Damping matrix C = MΦ diag(2ζω) ΦᵀM (m, n, n) for damping ratios ζ of the modes of M and K (m, n, n).

    ratio: one value for all modes, or k values (…, k) in order of ascending frequency. The last value holds
    for all higher modes."""
    frequencies, vectors = modes(M, K)
    ratios = np.atleast_1d(ratio)
    by_mode = ratios[..., np.minimum(np.arange(M.shape[-1]), ratios.shape[-1] - 1)]
    shapes = M @ vectors
    return (shapes * (2 * by_mode * frequencies)[:, None, :]) @ np.swapaxes(shapes, 1, 2)


def has_modes(M: Array, K: Array) -> Array:
    """Return a mask (m,) of the positions at which M and K (m, n, n) have real modes: both are finite, and K
    is symmetric and positive semidefinite within round-off."""
    unit = 1 / np.sqrt(np.einsum("mii->mi", M))
    with np.errstate(invalid="ignore"):
        scaled = K * unit[:, :, None] * unit[:, None, :]
        allowed = _ASYMMETRY * np.abs(scaled).max(axis=(1, 2))
        fit = np.abs(scaled - np.swapaxes(scaled, 1, 2)).max(axis=(1, 2)) <= allowed
    fit[fit] = np.linalg.eigvalsh(scaled[fit]).min(axis=1) >= -allowed[fit]
    return fit


def beyond_critical(ratio: float) -> str:
    """Warning about a damping ratio above 1."""
    return f"damping ratio {ratio:g}: above 1, modes do not oscillate; write 2 % as 0.02, not as 2"


class DampedSampler(MatrixSampler):
    """Sampler of M, C, K, d of a generated `linearised` function, with modal damping.

    ratios (k,): damping ratios of the modes. The modes are computed from M and K at speed 0 and at the phase
    of the sample. Raises MatricesError if there are no modes."""

    def __init__(self, linearised: "casadi.Function", parameters: Array, ratios: Array):
        super().__init__(linearised, parameters)
        self._ratios = ratios

    def entries(self, phase: Array, speeds: Array) -> Array:
        entries = super().entries(phase, speeds)
        entries[:, :, self.n**2 : 2 * self.n**2] += self.damping(phase).reshape(len(phase), -1)
        return entries

    def terms(self, phase: Array) -> None:
        return None

    def damping(self, phase: Array) -> Array:
        """Modal damping matrices (m, n, n) at phases (m,)."""
        C = damped(super().entries(phase, np.zeros(1))[0], self.n, self._ratios)
        without = np.isnan(C).any(axis=(1, 2))
        if without.any():
            raise MatricesError(
                f"damping ratios: at phase {phase[np.argmax(without)]:.4g} and speed 0, K is not "
                "symmetric, or not positive semidefinite, so that there are no modes; state a dissipation "
                "function instead"
            )
        return C


def damped(entries: Array, n: int, ratios: Array) -> Array:
    """Modal damping matrices (m, n, n) for damping ratios (k,) or (m, k). `entries` (m, 3n² + n) contain M
    and K in row order. The result is NaN if there are no modes."""
    M, _, K, _ = split_entries(entries, n)
    C, valid = np.full(M.shape, np.nan), has_modes(M, K)
    if valid.any():
        by_phase = np.broadcast_to(ratios, (len(M), ratios.shape[-1]))
        C[valid] = modal_damping(M[valid], K[valid], by_phase[valid])
    return C
