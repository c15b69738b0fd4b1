"""Frequencies and modes of M q̈ + K q = 0 for symmetric matrices at many positions (thesis (4.40))."""

from typing import NamedTuple

import numpy as np

from solve.arrays import Array

_SHIFT = 1e-6
"""Shift of ω² where K is singular, relative to the mean ω²."""

_REST = 1e-13
"""Part of the largest K_ii/M_ii below which ω² is rounding: the structure moves freely."""


class Modes(NamedTuple):
    """frequencies (m, k) in rad/s, rising; vectors (m, n, k) with ΦᵀMΦ = I."""

    frequencies: Array
    vectors: Array


def lowest_frequencies(M: Array, K: Array, count: int) -> Array:
    """The lowest `count` frequencies (m, count) in rad/s, rising; see `lowest_modes`."""
    factor, shift = _factor(M, K)
    return _frequencies(np.linalg.eigvalsh(_congruent(factor, M)), shift, at_rest(M, K))[:, :count]


def lowest_modes(M: Array, K: Array, count: int) -> Modes:
    """The lowest modes for M, K (m, n, n); M positive definite, K semidefinite at least.

    1/ω² are eigenvalues of L⁻¹ M L⁻ᵀ with K = L Lᵀ, so that low frequencies keep their digits however
    stiff the highest modes are.
    """
    factor, shift = _factor(M, K)
    values, vectors = np.linalg.eigh(_congruent(factor, M))
    chosen = values[:, ::-1][:, :count]
    shapes = np.linalg.solve(np.swapaxes(factor, 1, 2), vectors[:, :, ::-1][:, :, :count])
    return Modes(_frequencies(values, shift, at_rest(M, K))[:, :count], shapes / np.sqrt(chosen)[:, None, :])


def at_rest(M: Array, K: Array) -> Array:
    """Frequency (m,) below which there is only rounding, for M, K (m, n, n)."""
    if M.shape[1] == 0:
        return np.zeros(len(M))
    return np.sqrt(_REST * (np.einsum("mii->mi", K) / np.einsum("mii->mi", M)).max(axis=1))


def _frequencies(values: Array, shift: Array, rest: Array) -> Array:
    squares = 1 / np.maximum(values[:, ::-1], np.finfo(float).tiny) - shift[:, None]
    return np.sqrt(np.where(squares > rest[:, None] ** 2, squares, 0.0))


def _factor(M: Array, K: Array) -> tuple[Array, Array]:
    """Cholesky factor of K, or of K + shift M where some K is singular, and the shift (m,)."""
    shift = np.zeros(len(K))
    try:
        return np.linalg.cholesky(K), shift
    except np.linalg.LinAlgError:
        shift = _SHIFT * np.trace(K, axis1=1, axis2=2) / np.trace(M, axis1=1, axis2=2)
        return np.linalg.cholesky(K + shift[:, None, None] * M), shift


def _congruent(factor: Array, A: Array) -> Array:
    """L⁻¹ A L⁻ᵀ."""
    half = np.linalg.solve(factor, A)
    return np.linalg.solve(factor, np.swapaxes(half, 1, 2))
