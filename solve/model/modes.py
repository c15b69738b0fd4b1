"""Natural frequencies and modes of M q̈ + K q = 0, for many positions at once, and damping by their ratios."""

from typing import NamedTuple

import numpy as np

from solve.arrays import Array

_SHIFT = 1e-6
"""Shift of ω² where K is singular, relative to the mean ω²."""

_PIVOT = 1e-11
"""Part of K's diagonal below which a pivot of its factorisation is rounding."""

_REST = 1e-13
"""Part of the largest K_ii/M_ii below which ω² is rounding: the structure moves freely."""


_ROUNDING = 1e-10
"""Part of the largest entry of K that counts as none."""


class Modes(NamedTuple):
    """frequencies (m, k) in rad/s, rising; vectors (m, n, k) with ΦᵀMΦ = I."""

    frequencies: Array
    vectors: Array


def lowest_frequencies(M: Array, K: Array, count: int) -> Array:
    """The lowest `count` frequencies (m, count) in rad/s, rising; see `modes`."""
    shift, _, pencil = _pencil(M, K)
    return _frequencies(np.linalg.eigvalsh(pencil), shift, at_rest(M, K))[:, :count]


def modes(M: Array, K: Array) -> Modes:
    """All modes for M, K (m, n, n); M positive definite, K semidefinite at least.

    1/ω² are eigenvalues of the pencil M − (1/ω²) K, so that low frequencies keep their digits however
    stiff the highest modes are. These lose digits there, and are found anew, by the pencil K − ω² M, in the
    space of the modes above the geometric mean of the lowest and the highest frequency.
    """
    shift, L, pencil = _pencil(M, K)
    values, vectors = np.linalg.eigh(pencil)
    vectors = np.linalg.solve(np.swapaxes(L, 1, 2), vectors / np.sqrt(values[:, None, :]))
    frequencies = _frequencies(values, shift, at_rest(M, K))
    high = int((values**2 < values[:, :1] * values[:, -1:]).sum(axis=1).min(initial=values.shape[1]))
    low = vectors[:, :, high:]
    basis = vectors[:, :, :high] - low @ (np.swapaxes(low, 1, 2) @ M @ vectors[:, :, :high])
    squares, vectors[:, :, :high] = _within(M, K, basis)
    frequencies[:, values.shape[1] - high :] = np.sqrt(squares[:, ::-1])
    return Modes(frequencies, vectors[:, :, ::-1])


def _within(M: Array, K: Array, basis: Array) -> tuple[Array, Array]:
    """ω² (m, r), falling, and modes (m, n, r) of M and K in the space of a basis (m, n, r), by Rayleigh and
    Ritz."""
    mass, stiffness = (np.swapaxes(basis, 1, 2) @ part @ basis for part in (M, K))
    L = np.linalg.cholesky(mass)
    squares, vectors = np.linalg.eigh(_congruent(stiffness, L))
    found = basis @ np.linalg.solve(np.swapaxes(L, 1, 2), vectors)
    return squares[:, ::-1], found[:, :, ::-1]


def _pencil(M: Array, K: Array) -> tuple[Array, Array, Array]:
    """The shift (m,), L with LLᵀ = K + shift M, and L⁻¹ M L⁻ᵀ."""
    shift = _shifts(M, K)
    L = np.linalg.cholesky(K + shift[:, None, None] * M)
    return shift, L, _congruent(M, L)


def _congruent(matrix: Array, L: Array) -> Array:
    """L⁻¹ A L⁻ᵀ of symmetric matrices A (m, n, n) and triangular L."""
    return np.linalg.solve(L, np.swapaxes(np.linalg.solve(L, matrix), 1, 2))


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


def modal_damping(M: Array, K: Array, ratio: Array | float) -> Array:
    """C = MΦ diag(2ζω) ΦᵀM (m, n, n) that gives the modes of M and K (m, n, n) their ratios ζ: one for all,
    or (..., k) in the order of rising frequencies, of which the last is that of all others."""
    frequencies, vectors = modes(M, K)
    given = np.atleast_1d(ratio)
    each = given[..., np.minimum(np.arange(M.shape[-1]), given.shape[-1] - 1)]
    shapes = M @ vectors
    return (shapes * (2 * each * frequencies)[:, None, :]) @ np.swapaxes(shapes, 1, 2)


def vibrates(M: Array, K: Array) -> Array:
    """Whether M and K (m, n, n) have modes (m,): finite, K symmetric and nowhere negative but for
    rounding."""
    unit = 1 / np.sqrt(np.einsum("mii->mi", M))
    with np.errstate(invalid="ignore"):
        scaled = K * unit[:, :, None] * unit[:, None, :]
        allowed = _ROUNDING * np.abs(scaled).max(axis=(1, 2))
        fit = np.abs(scaled - np.swapaxes(scaled, 1, 2)).max(axis=(1, 2)) <= allowed
    fit[fit] = np.linalg.eigvalsh(scaled[fit]).min(axis=1) >= -allowed[fit]
    return fit
