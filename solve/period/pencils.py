"""Quadratic pencils λ²M + λC + K: eigenvalues, bounds on spectral radii, and free drifts."""

import numpy as np

from solve.arrays import EPS, Array, solved
from solve.matrices import by_rates
from solve.period.points import rate_of

LOOPED = 9
"""Number of coordinates up to which elimination by loops over rows is as fast as LAPACK. The loops treat all
points and phases in one operation. Measured for one point: elimination takes 1.6 times as long as LAPACK with
27 coordinates, and 3.4 times as long with 72. With a hundred coordinates, determinants also underflow."""

_ITERATIONS = 6
"""Number of power iterations for the vector v of a bound. Chosen by judgement: the bound is valid for any
positive v."""


def pencil_eigenvalues(pencils: Array, first_order: int = 0) -> Array:
    """Finite eigenvalues (…, 2n - first_order) of λ²M + λC + K. `pencils` (3, n, n, …) contains M, C and
    K."""
    M, C, K = np.moveaxis(pencils, (1, 2), (-2, -1))
    return eigenvalues(rate_of(M, C, K, np.zeros(M.shape[:-1]), first_order)[..., :-1])


def eigenvalues(matrices: Array) -> Array:
    """Eigenvalues (…, N) of matrices; infinite if any entry of the matrix is not finite."""
    if np.isfinite(matrices).all():
        return np.linalg.eigvals(matrices)
    is_finite = np.asarray(np.isfinite(matrices).all(axis=(-2, -1)))
    values = np.linalg.eigvals(np.where(is_finite[..., None, None], matrices, 0.0))
    return np.where(is_finite[..., None], values, np.inf)


def quadratic_roots(M: Array, C: Array, K: Array) -> Array:
    """Roots (…, 2) of λ²M + λC + K; the root of larger modulus is first."""
    half, product = C / (2 * M), K / M
    root = np.sqrt((half**2 - product).astype(complex))
    larger = -half - np.where(half < 0, -1.0, 1.0) * root
    with np.errstate(invalid="ignore"):  # Infinite entries result in NaN.
        smaller = np.where(larger != 0, product / np.where(larger != 0, larger, 1.0), 0.0)
    return np.stack((larger, smaller), axis=-1)


def quadratic_moduli(M: Array, C: Array, K: Array) -> tuple[Array, Array]:
    """Moduli (…, 2) and real parts (…, 2) of the roots of λ²M + λC + K, computed in real arithmetic. The root
    of smaller modulus is first."""
    with np.errstate(all="ignore"):
        half, product = C / (2 * M), K / M
        is_real = half**2 > product
        root = np.sqrt(np.abs(half**2 - product))
        larger = np.where(is_real, -half - np.copysign(root, half), -half)
        smaller = np.where(is_real, product / larger, -half)
        modulus = np.sqrt(np.abs(product))
    moduli = (np.where(is_real, np.abs(real_part), modulus) for real_part in (smaller, larger))
    return np.stack(tuple(moduli), axis=-1), np.stack((smaller, larger), axis=-1)


def spectral_radius_within_one(B: Array) -> Array:
    """Return a mask (P,) of the points for which bounds prove that the spectral radii of nonnegative matrices
    B (n, n, P, k) are at most 1.

    The spectral radius is at most 1 if B v ≤ v for some positive v (Perron, Collatz).
    """
    v = np.ones(B.shape[1:])
    with np.errstate(all="ignore"):
        for _ in range(_ITERATIONS):
            v = np.einsum("ijpk,jpk->ipk", B, v)
            v = np.maximum(v / v.max(axis=0), 1e-3)
        return (np.einsum("ijpk,jpk->ipk", B, v) <= v).all(axis=(0, 2))


def fields_by_rates(pencils: Array, first_order: int) -> Array:
    """Return M, C and K (3, n, n, …) of equations in which the unknowns of first-order coordinates are their
    rates; see `by_rates`."""
    if not first_order:
        return pencils
    if first_order == pencils.shape[1]:
        return np.stack((pencils[1], pencils[2], np.zeros_like(pencils[0])))
    M, C, K = np.moveaxis(pencils, 2, -1)
    return np.moveaxis(np.stack(by_rates(M, C, K, first_order)), -1, 2)


def mass_normalised(M: Array, C: Array, K: Array, first_order: int = 0) -> tuple[Array, Array]:
    """Return M⁻¹C and M⁻¹K (n, n, P, k). For the last `first_order` coordinates, the unknowns of M, C and K
    are the rates; see `by_rates`.

    For few coordinates they are computed by elimination without pivoting, which is accurate for inertia
    matrices."""
    if first_order == len(M):
        ratio, _ = mass_normalised(M, C, K[:, :0])
        return ratio, np.zeros_like(ratio)
    n, rows = len(M), np.concatenate((M, C, K), axis=1)
    if n > LOOPED:
        M, CK = np.split(np.moveaxis(rows, (0, 1), (2, 3)), [n], axis=-1)
        C, K = np.split(np.moveaxis(solved(M, CK), (2, 3), (0, 1)), [n], axis=1)
        return C, K
    with np.errstate(all="ignore"):
        for k in range(n):
            rows[k, k + 1 :] /= rows[k, k]
            for i in range(n):
                if i != k:
                    rows[i, k + 1 :] -= rows[i, k] * rows[k, k + 1 :]
    return rows[:, n : 2 * n], rows[:, 2 * n :]


def is_periodic_drift(rows: Array, Phi: Array, units: Array, error: float) -> bool:
    """Whether the equations `rows` (k, n) have a nonzero solution v for which the monodromy matrix Φ (2n, 2n)
    maps (v, 0) to itself.

    Equations and unknowns are scaled by their largest coefficients. error: error of the states, relative to
    `units` (2n,). Residuals of 12 eps and relative differences of 1e-6 after a period count as zero. Both
    limits are chosen by judgement."""
    for axis in (1, 0):
        largest = np.abs(rows).max(axis=axis, keepdims=True)
        largest = np.where(largest > 0, largest, 1.0)
        rows = rows / largest
    smallest = np.linalg.svd(rows, full_matrices=False)[2][-1]
    if (np.abs(rows @ smallest) > 12 * EPS).any():
        return False
    state = np.concatenate((smallest / largest[0], np.zeros(len(smallest))))
    change, size = np.abs(Phi @ state - state), np.abs(Phi) @ np.abs(state) + np.abs(state)
    allowed = 1e-6 * size + 10 * error * (units * np.abs(state)).max() / units
    return bool((change <= allowed).all())


def residual_amplitude(eigenvalues: Array, period: float, limit: Array | float) -> Array:
    """Return the amplitude (…) of the least damped fast mode after one period, relative to its initial
    amplitude. The returned value is at most 1. A mode is fast if its phase advance per period exceeds `limit`
    (…); the fastest mode always counts as fast.

    eigenvalues (…, k, 2n): eigenvalues of the system frozen at k phases."""
    moduli = np.abs(eigenvalues)
    is_fast = (moduli * period > limit) | (moduli == moduli.max(axis=-1, keepdims=True))
    rates = np.where(is_fast, np.real(eigenvalues), -np.inf).max(axis=-1)
    return np.exp(np.minimum(rates.mean(axis=-1) * period, 0.0))


def has_steady_determinant(M: Array, fraction: float) -> Array:
    """Return a mask (P,) of the points at which, at all k phases, the determinants of the matrices M (n, n,
    P, k) have the same sign and moduli above `fraction` times the median modulus."""
    n = len(M)
    if n > LOOPED:
        sign, logarithm = np.linalg.slogdet(np.moveaxis(M, (0, 1), (2, 3)))
        middle = np.argsort(logarithm, axis=1)[:, [logarithm.shape[1] // 2]]
        median = np.take_along_axis(logarithm, middle, 1)
        same_sign = sign == np.take_along_axis(sign, middle, 1)
        # The difference is NaN for two singular matrices; NaN does not count as steady.
        with np.errstate(invalid="ignore"):
            return np.asarray((same_sign & (logarithm - median > np.log(fraction))).all(axis=1))
    M = M.copy()
    determinant: Array = np.ones(M.shape[2:])
    with np.errstate(all="ignore"):
        for k in range(n):
            determinant *= M[k, k]
            for i in range(k + 1, n):
                M[i, k + 1 :] -= M[i, k] / M[k, k] * M[k, k + 1 :]
        middle = determinant.shape[1] // 2
        median = np.partition(determinant, middle, axis=1)[:, [middle]]
        return np.asarray((determinant * np.sign(median) > fraction * np.abs(median)).all(axis=1))
