"""Logarithms of the eigenvalues of a product A_{m-1} … A_0, computed from the factors without multiplying
them.

SLICOT's periodic QZ algorithm (A. Bojanczyk, G. Golub, P. Van Dooren, Proc. SPIE 1770 (1992) 31-42; D.
Kressner, BIT 46 (2006) 421-440) finds unitary matrices Q_k for which every Q_{k+1}ᴴ A_k Q_k is upper
triangular. An eigenvalue is a product of diagonal entries. The backward error of a factor, relative to its
norm, is a few units of round-off. Even an eigenvalue of 1e-400 is therefore as accurate as the factors
permit."""

import math
from dataclasses import dataclass

import numpy as np

from solve.arrays import EPS, Array
from solve.kernel.cyclic import cyclic
from solve.kernel.slicot import periodic_schur, product_logarithms

ROUNDING = 4.0
"""Backward error of the periodic Schur form, relative to the Frobenius norm of a factor, in units of
round-off. It is the largest value measured for products of 1 to 768 random factors of order 2 to 54."""


@dataclass(frozen=True)
class ProductEigenvalues:
    """Eigenvalues ρ of P products, in order of decreasing modulus, positive imaginary part first.

    logarithms (P, N): log ρ with imaginary part in (-π, π]; the real part is -inf for an exact 0. errors (P,
    N): estimated relative error of ρ; infinite if ρ is not accurate to one digit. right, left (P, m, N, N) or
    None: eigenvectors x_k and y_k at the start of each factor, as columns, with ‖x_k‖ = 1, y_kᴴ x_k = 1, A_k
    x_k ∝ x_{k+1} and y_{k+1}ᴴ A_k ∝ y_kᴴ."""

    logarithms: Array
    errors: Array
    right: Array | None
    left: Array | None


def product_eigenvalues(
    factors: Array, rounding: Array | None = None, vectors: bool = False
) -> ProductEigenvalues:
    """Eigenvalues of A_{m-1} … A_0 for real factors (P, m, N, N) in order of application.

    rounding (P, m): Frobenius norm of the error of each factor; by default, half a unit of round-off times
    the norm of the factor. vectors: whether eigenvectors are also computed. Raises LinAlgError if the
    iteration does not converge, ImportError without SLICOT."""
    factors, power = _scaled(factors)
    if rounding is None:
        sizes = EPS / 2 * np.linalg.norm(factors, axis=(-2, -1))
    else:
        sizes = np.ldexp(rounding, -power)
    found = [_point(A, size, vectors) for A, size in zip(factors, sizes, strict=True)]
    logarithms, errors, *chains = (list(part) for part in zip(*found, strict=True))
    right, left = (np.stack(chain) if vectors else None for chain in chains)
    scale = math.log(2) * power.sum(axis=1)
    logarithms = np.stack(logarithms) + scale[:, None]
    errors = np.stack(errors) + EPS * np.abs(np.real(logarithms))
    return ProductEigenvalues(logarithms, errors, right, left)


def eigenvalue_logarithms(factors: Array) -> Array:
    """Logarithms (N,) of the eigenvalues of one product of real factors (m, N, N), in arbitrary order and
    without error estimates. Raises the exceptions of `product_eigenvalues`."""
    scaled, power = _scaled(factors)
    return _principal(product_logarithms(scaled)) + math.log(2) * power.sum()


def _scaled(factors: Array) -> tuple[Array, Array]:
    """Divide factors (…, N, N) by powers of 2 so that their entries are at most 1. Return the scaled factors
    and the exponents (…)."""
    power = np.frexp(np.abs(factors).max(axis=(-2, -1)))[1]
    return np.ldexp(factors, -power[..., None, None]), power


def _principal(logarithms: Array) -> Array:
    """Logarithms with imaginary parts in [-π, π]. The logarithm of an exact zero is -inf."""
    logarithms = logarithms - 2j * math.pi * np.round(np.imag(logarithms) / (2 * math.pi))
    logarithms[np.isneginf(np.real(logarithms))] = -np.inf
    return logarithms


def _point(A: Array, rounding: Array, vectors: bool) -> tuple[Array, Array, Array | None, Array | None]:
    """Return the logarithms, the errors, and the right and left eigenvectors of the product of the factors A
    (m, N, N)."""
    F, Q = periodic_schur(A)
    diagonal = np.ascontiguousarray(np.einsum("kii->ik", F))
    with np.errstate(divide="ignore"):
        logarithms = _principal(np.log(diagonal).sum(axis=1))
    X = _triangular_eigenvectors(F, diagonal, logarithms)
    Y = np.linalg.inv(X)
    size = rounding + ROUNDING * EPS * np.linalg.norm(A, axis=(1, 2))
    errors = _errors(diagonal, logarithms, size, X, Y)
    logarithms = _conjugate_pairs(logarithms, errors)
    angles = np.imag(logarithms)
    order = np.lexsort((-angles, -np.abs(angles), -np.real(logarithms)))
    if not vectors:
        return logarithms[order], errors[order], None, None
    length = np.linalg.norm(X, axis=1)
    right = Q @ (X / length[:, None, :])
    left = Q @ np.swapaxes(Y * length[:, :, None], 1, 2).conj()
    return logarithms[order], errors[order], right[..., order], left[..., order]


def _triangular_eigenvectors(F: Array, diagonal: Array, logarithms: Array) -> Array:
    """Right eigenvectors of a chain of triangular factors F (m, N, N), as columns of unit upper triangular
    matrices X (m, N, N): F_k X_k = X_{k+1} diag F_k.

    diagonal (N, m): diagonals of F. The values of one entry of X along the chain solve a cyclic bidiagonal
    system. Equal eigenvalues are treated as if they differed by one unit of round-off."""
    m, N, _ = F.shape
    X = np.zeros((m, N, N), dtype=complex)
    X[:, range(N), range(N)] = 1.0
    for j in range(N - 2, -1, -1):
        repeated = np.repeat(diagonal[j][None], N - 1 - j, axis=0)
        with np.errstate(invalid="ignore"):
            apart = np.abs(logarithms[j + 1 :] - logarithms[j])
        # Exact zeros count as equal; the difference of their logarithms is NaN.
        repeated[(logarithms[j + 1 :] == logarithms[j]) | (apart < EPS), 0] *= 1 + 2 * EPS
        right = np.squeeze(F[:, j, None, j + 1 :] @ X[:, j + 1 :, j + 1 :], 1)
        entries = cyclic(repeated[..., None, None], -diagonal[j + 1 :], -right.T[..., None])
        X[:, j, j + 1 :] = entries[..., 0].T
    return X


def _errors(theta: Array, logarithms: Array, size: Array, X: Array, Y: Array) -> Array:
    """Relative error of each eigenvalue due to errors of norm `size` (m,) of the triangular factors.

    The first-order term contains the left and right eigenvectors of the eigenvalue; the second-order term
    also contains the eigenvectors of all other eigenvalues. Only the second-order term includes errors that
    grow along a part of the chain."""
    errors = np.empty(len(theta))
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        log_theta = np.maximum(np.log(np.abs(theta)), -1e4)
        log_x = np.log(np.linalg.norm(X, axis=1)).T
        log_y = np.roll(np.log(np.linalg.norm(Y, axis=2)).T, -1, axis=1)
        for i in range(len(theta)):
            relative = np.log(size) - log_theta[i]
            out, back = relative + log_x[i] + log_y, relative + log_x + log_y[i]
            second = _longest_way(out, back, log_theta - log_theta[i])
            gap = _log_distance(logarithms - logarithms[i])
            gap[i] = np.inf
            error = np.linalg.norm(np.exp(out[i])) + np.exp(second - np.maximum(gap, second / 2)).sum()
            nearest = max(math.exp(min(gap.min(), 0.0)), EPS)
            # If the error exceeds the distance to the nearest eigenvalue, the two act as a double eigenvalue,
            # which changes by the square root of a perturbation.
            errors[i] = math.sqrt(error * nearest) if error > nearest else error
    return np.where((errors < 1) & np.isfinite(logarithms), errors, np.inf)


def _longest_way(out: Array, back: Array, growth: Array) -> Array:
    """Maximum (N,) of out_k + growth_{k+1} + … + growth_{l-1} + back_l over k < l ≤ k + m. Indices are
    cyclic; all arguments are (N, m)."""
    until = np.cumsum(growth, axis=1)
    start, end, turn = out - until, back + until - growth, until[:, -1:]
    longest = np.maximum.accumulate(start[:, ::-1], axis=1)[:, ::-1] + turn
    longest[:, 1:] = np.maximum(longest[:, 1:], np.maximum.accumulate(start, axis=1)[:, :-1])
    return (longest + end).max(axis=1)


def _log_distance(apart: Array) -> Array:
    """Logarithm of |exp(apart) - 1|."""
    near = np.minimum(np.real(apart), 40.0) + 1j * np.imag(apart)
    with np.errstate(divide="ignore"):
        return np.where(np.real(apart) > 40, np.real(apart), np.log(np.abs(np.expm1(near))))


def _conjugate_pairs(logarithms: Array, errors: Array) -> Array:
    """Make pairs of logarithms exactly conjugate. Make a logarithm exactly real if its imaginary part is
    within the error."""
    paired = np.real(logarithms) + np.where(np.cos(np.imag(logarithms)) < 0, math.pi, 0.0) * 1j
    left = list(np.flatnonzero(np.isfinite(logarithms)))
    while left:
        i = left.pop(0)
        distance = _log_distance(logarithms[[i, *left]] - logarithms[i].conj())
        nearest = int(distance.argmin())
        if nearest and math.exp(distance[0]) > 2 * errors[i]:
            j = left.pop(nearest - 1)
            mean = (logarithms[i] + logarithms[j].conj()) / 2
            paired[i], paired[j] = mean, mean.conjugate()
    return paired
