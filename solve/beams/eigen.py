"""Frequencies and modes of M q̈ + K q = 0 for symmetric matrices at many positions (thesis (4.40))."""

from typing import NamedTuple

import numpy as np

from solve.arrays import Array

_SHIFT = 1e-6
"""Shift of ω² where K is singular, relative to the mean ω²."""

_PIVOT = 1e-11
"""Part of K's diagonal below which a pivot of its factorisation is rounding."""

_REST = 1e-13
"""Part of the largest K_ii/M_ii below which ω² is rounding: the structure moves freely."""


class Modes(NamedTuple):
    """frequencies (m, k) in rad/s, rising; vectors (m, n, k) with ΦᵀMΦ = I."""

    frequencies: Array
    vectors: Array


def lowest_frequencies(M: Array, K: Array, count: int) -> Array:
    """The lowest `count` frequencies (m, count) in rad/s, rising; see `modes`."""
    import scipy.linalg

    n, rest, shift = M.shape[1], at_rest(M, K), _shifts(M, K)
    subset = (n - count, n - 1)
    found = [
        scipy.linalg.eigh(m, k + s * m, eigvals_only=True, subset_by_index=subset)
        for m, k, s in zip(M, K, shift, strict=True)
    ]
    return _frequencies(np.array(found), shift, rest)


def modes(M: Array, K: Array) -> Modes:
    """All modes for M, K (m, n, n); M positive definite, K semidefinite at least.

    1/ω² are eigenvalues of the pencil M − (1/ω²) K, so that low frequencies keep their digits however
    stiff the highest modes are.
    """
    rest, shift = at_rest(M, K), _shifts(M, K)
    L = np.linalg.cholesky(K + shift[:, None, None] * M)
    half = np.swapaxes(np.linalg.solve(L, M), 1, 2)
    values, vectors = np.linalg.eigh(np.linalg.solve(L, half))
    vectors = np.linalg.solve(np.swapaxes(L, 1, 2), vectors / np.sqrt(values[:, None, :]))
    return Modes(_frequencies(values, shift, rest), vectors[:, :, ::-1])


def at_rest(M: Array, K: Array) -> Array:
    """Frequency (m,) below which there is only rounding, for M, K (m, n, n): 0 where K is regular, as
    low frequencies then keep their digits however high the highest are."""
    if M.shape[1] == 0:
        return np.zeros(len(M))
    rounding = np.sqrt(_REST * (np.einsum("mii->mi", K) / np.einsum("mii->mi", M)).max(axis=1))
    return np.where(_shifts(M, K) > 0, rounding, 0.0)


def _frequencies(values: Array, shift: Array, rest: Array) -> Array:
    squares = 1 / values[:, ::-1] - shift[:, None]
    return np.sqrt(np.where(squares > rest[:, None] ** 2, squares, 0.0))


def _shifts(M: Array, K: Array) -> Array:
    """What to add to every ω² (m,): nothing, unless some K is singular but for rounding."""
    try:
        pivots = np.einsum("mii->mi", np.linalg.cholesky(K)) ** 2
        singular = (pivots < _PIVOT * np.einsum("mii->mi", K)).any()
    except np.linalg.LinAlgError:
        singular = True
    mean = np.trace(K, axis1=1, axis2=2) / np.trace(M, axis1=1, axis2=2)
    return _SHIFT * mean * singular
