"""Eigenvalues of a product A_{m-1} … A_0 from its factors, as logarithms: the product is never formed.

The periodic QR algorithm (A. Bojanczyk, G. Golub, P. Van Dooren, Proc. SPIE 1770 (1992) 31-42;
D. Kressner, BIT 46 (2006) 421-440) in complex arithmetic with one shift a sweep: unitary matrices Q_k
make every Q_{k+1}ᴴ A_k Q_k upper triangular, and an eigenvalue is a product of diagonal entries. Each
factor errs by some units of rounding of its own norm alone, so that an eigenvalue of 1e-400 keeps as
many digits as the factors tell.

A rotation at one node of the chain is carried through all factors. Its way depends on 2 × 2 diagonal
blocks alone, which a loop over numbers follows; then all factors are rotated at once. They are stored
with their number as the last axis, F (N, N, m).
"""

import cmath
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from solve.arrays import Array
from solve.period.multipliers import EPS

ROUNDING = 4.0
"""Units of rounding by which the algorithm errs in a factor, relative to its norm, as measured."""

_FEW = 32
"""Factors up to which systems along the chain are solved as full ones."""

_SWEEPS = 60
"""Sweeps for one eigenvalue after which the algorithm gives up; two to three are usual."""


@dataclass(frozen=True)
class ProductEigenvalues:
    """Eigenvalues ρ of each product, falling in modulus, + imaginary part first.

    logarithms (P, N): log ρ, the imaginary part in (-π, π]; real part -inf for an exact 0.
    errors (P, N): estimated relative error of ρ; infinite where ρ has no digit.
    right, left (P, m, N, N) or None: columns x_k, y_k at the start of each factor, with ‖x_k‖ = 1,
    y_kᴴ x_k = 1, A_k x_k ∝ x_{k+1} and y_{k+1}ᴴ A_k ∝ y_kᴴ.
    """

    logarithms: Array
    errors: Array
    right: Array | None
    left: Array | None


def product_eigenvalues(
    factors: Array, rounding: Array | None = None, vectors: bool = False
) -> ProductEigenvalues:
    """Eigenvalues of A_{m-1} … A_0 for real factors (P, m, N, N) in order of application.

    rounding (P, m): Frobenius norm of the error that each factor brings; half a unit of rounding of its
    norm by default. Raises LinAlgError where the iteration does not converge.
    """
    power = np.frexp(np.abs(factors).max(axis=(-2, -1)))[1]
    factors = np.ldexp(factors, -power[..., None, None])
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


def _point(A: Array, rounding: Array, vectors: bool) -> tuple[Array, Array, Array | None, Array | None]:
    """Logarithms, errors, right and left eigenvectors of the product of A (m, N, N)."""
    F, Q = _schur(A, vectors)
    diagonal = np.einsum("iik->ik", F)
    with np.errstate(divide="ignore"):
        logarithms = np.log(diagonal).sum(axis=1)
    logarithms -= 2j * math.pi * np.round(np.imag(logarithms) / (2 * math.pi))
    logarithms[np.isneginf(np.real(logarithms))] = -np.inf
    X = _triangular_eigenvectors(F, logarithms)
    Y = np.linalg.inv(X)
    size = rounding + ROUNDING * EPS * np.linalg.norm(A, axis=(1, 2))
    errors = _errors(diagonal, logarithms, size, X, Y)
    logarithms = _conjugate_pairs(logarithms, errors)
    angles = np.imag(logarithms)
    order = np.lexsort((-angles, -np.abs(angles), -np.real(logarithms)))
    if Q is None:
        return logarithms[order], errors[order], None, None
    length = np.linalg.norm(X, axis=1)
    right = Q @ (X / length[:, None, :])
    left = Q @ np.swapaxes(Y * length[:, :, None], 1, 2).conj()
    return logarithms[order], errors[order], right[..., order], left[..., order]


def _schur(A: Array, vectors: bool) -> tuple[Array, Array | None]:
    """Upper triangular F_k = Q_{k+1}ᴴ A_k Q_k as (N, N, m), and Q (m, N, N) if wanted."""
    m, N, _ = A.shape
    F, Q, q = np.empty((N, N, m)), np.empty((N, N, m)), np.eye(N)
    for k in range(m):
        Q[..., k] = q
        q, F[..., k] = np.linalg.qr(A[k] @ q)
    # The basis of the first node becomes the one found at the end: F_0 is full, the others triangular.
    F[..., 0], Q[..., 0] = F[..., 0] @ q, q
    basis = Q if vectors else None
    for column in range(N - 2):
        for row in range(N - 2, column, -1):
            _rotate(F, basis, row, (F[row, column, 0], F[row + 1, column, 0]), column, N)
            F[row + 1, column, 0] = 0.0
    F, basis = F.astype(complex), None if basis is None else basis.astype(complex)
    _iterate(F, basis)
    return F, None if basis is None else np.ascontiguousarray(np.moveaxis(basis, -1, 0))


def _iterate(F: Array, Q: Array | None) -> None:
    """Sweeps until the Hessenberg factor F_0 is triangular too."""
    last, sweeps, H = len(F) - 1, 0, F[..., 0]
    scale = float(np.linalg.norm(H))
    while last > 0:
        first = last
        while first > 0:
            near = abs(H[first, first]) + abs(H[first - 1, first - 1])
            if abs(H[first, first - 1]) <= EPS * (near if near and sweeps < _SWEEPS // 2 else scale):
                H[first, first - 1] = 0.0
                break
            first -= 1
        if first == last:
            last, sweeps = last - 1, 0
            continue
        if sweeps == _SWEEPS:
            raise np.linalg.LinAlgError("the periodic QR algorithm did not converge")
        _sweep(F, Q, first, last, sweeps)
        sweeps += 1


def _sweep(F: Array, Q: Array | None, first: int, last: int, sweeps: int) -> None:
    """One implicitly shifted QR step on the rows and columns first … last."""
    H = F[..., 0]
    shift, exponent = _shift(F, last - 1)
    lead, _, _, lead_exponent = _diagonal_product(F, first)
    # First column of H T - shift, with T = F_{m-1} … F_1; a shift far above it would leave no rotation.
    y = complex(H[first, first]), complex(H[first + 1, first])
    size = abs(lead) * math.hypot(abs(y[0]), abs(y[1]))
    more = exponent - lead_exponent
    if sweeps % 10 == 9:
        y = y[0] - cmath.rect(math.hypot(abs(y[0]), abs(y[1])), sweeps), y[1]
    elif size and shift and more < 1000 and -100 < more + math.log2(abs(shift) / size) < 20:
        y = lead * y[0] - shift * 2.0**more, lead * y[1]
    for j in range(first, last):
        if j > first:
            y = complex(H[j, j - 1]), complex(H[j + 1, j - 1])
        _rotate(F, Q, j, y, max(j - 1, 0), j + 3)
        if j > first:
            H[j + 1, j - 1] = 0.0


def _shift(F: Array, j: int) -> tuple[complex, int]:
    """Wilkinson's shift: the eigenvalue of the last 2 × 2 block of T H nearest to its last entry, as a
    number and the exponent of a power of 2."""
    t, u, v, exponent = _diagonal_product(F, j)
    (a, b), (c, d) = F[j : j + 2, j : j + 2, 0].tolist()
    a, b, c, d = t * a + u * c, t * b + u * d, v * c, v * d
    half = (a - d) / 2
    root = cmath.sqrt(half * half + b * c)
    larger = half + root if abs(half + root) >= abs(half - root) else half - root
    return d - (b * c / larger if larger else 0.0), exponent


def _diagonal_product(F: Array, j: int) -> tuple[complex, complex, complex, int]:
    """Entries (j, j), (j, j+1), (j+1, j+1) of T, but for a power of 2, and its exponent."""
    t, u, v, exponent = 1.0 + 0j, 0j, 1.0 + 0j, 0
    for a, b, d in _diagonal_blocks(F, j):
        t, u, v = a * t, a * u + b * v, d * v
        size = abs(t) + abs(u) + abs(v)
        if not 1e-100 < size < 1e100 and size > 0:
            power = max(math.frexp(size)[1], -1000)
            t, u, v, exponent = t * 2.0**-power, u * 2.0**-power, v * 2.0**-power, exponent + power
    return t, u, v, exponent


def _rotate(F: Array, Q: Array | None, j: int, way: tuple[complex, complex], left: int, end: int) -> None:
    """Turns the states j, j+1 at the start of F_1 so that `way` becomes the first of them, and those at the
    other nodes so that F_1 … F_{m-1} stay triangular. Left of column `left` and from row `end` on the
    columns and rows that turn are 0."""
    ways = [_unit(*way)]
    for a, b, d in _diagonal_blocks(F, j):
        y, z = ways[-1]
        ways.append(_unit(a * y + b * z, d * z))
    after = np.array(ways).T
    y, z = np.roll(after, 1, axis=1)
    for matrix in (F[:end],) if Q is None else (F[:end], Q):
        a, b = matrix[:, j], matrix[:, j + 1]
        matrix[:, j], matrix[:, j + 1] = a * y + b * z, b * y.conj() - a * z.conj()
    y, z = after
    a, b = F[j, left:], F[j + 1, left:]
    F[j, left:], F[j + 1, left:] = a * y.conj() + b * z.conj(), b * y - a * z
    F[j + 1, j, 1:] = 0.0


def _diagonal_blocks(F: Array, j: int) -> Iterator[tuple[complex, complex, complex]]:
    """Entries (j, j), (j, j+1), (j+1, j+1) of F_1 … F_{m-1}."""
    return zip(F[j, j, 1:].tolist(), F[j, j + 1, 1:].tolist(), F[j + 1, j + 1, 1:].tolist(), strict=True)


def _unit(y: complex, z: complex) -> tuple[complex, complex]:
    size = math.hypot(abs(y), abs(z))
    return (y / size, z / size) if size else (1.0, 0.0)


def _triangular_eigenvectors(F: Array, logarithms: Array) -> Array:
    """Right eigenvectors of the triangular chain as columns of X (m, N, N), unit upper triangular:
    F_k X_k = X_{k+1} diag F_k.

    Each entry along the chain solves a cyclic bidiagonal system; elimination with pivots is stable
    wherever the entry grows or decays. Equal eigenvalues count as apart by one unit of rounding.
    """
    N, _, m = F.shape
    X = np.zeros((N, N, m), dtype=complex)
    for i in range(N):
        X[i, i] = 1.0
        for j in range(i - 1, -1, -1):
            own = F[j, j].copy()
            if logarithms[j] == logarithms[i] or abs(logarithms[j] - logarithms[i]) < EPS:
                own[0] *= 1 + 2 * EPS
            X[j, i] = _cyclic(own, -F[i, i], -(F[j, j + 1 : i + 1] * X[j + 1 : i + 1, i]).sum(axis=0))
    return np.ascontiguousarray(np.moveaxis(X, -1, 0))


def _cyclic(own: Array, following: Array, right: Array) -> Array:
    """x of own_k x_k + following_k x_{k+1} = right_k, closed after m; 0 where that is singular.

    In the order 0, m-1, 1, m-2, … the cyclic matrix has two bands on each side of its diagonal, which save
    work where m is large.
    """
    m, k = len(own), np.arange(len(own))
    if m <= _FEW:
        matrix = np.diag(own)
        matrix[k, (k + 1) % m] += following
        try:
            return np.linalg.solve(matrix, right)
        except np.linalg.LinAlgError:
            return np.zeros(m)
    place = np.where(2 * k < m, 2 * k, 2 * (m - k) - 1)
    bands = np.zeros((7, m), dtype=complex)
    after = np.roll(place, -1)
    bands[4, place] = own
    bands[4 + place - after, after] += following
    permuted = np.empty_like(right)
    permuted[place] = right
    # The package alone takes longer to be read than many a command.
    from scipy.linalg.lapack import zgbsv  # pyright: ignore[reportAttributeAccessIssue]

    solution, failed = zgbsv(2, 2, bands, permuted[:, None])[2:]
    return np.zeros(m) if failed else solution[place, 0]


def _errors(theta: Array, logarithms: Array, size: Array, X: Array, Y: Array) -> Array:
    """Relative error of each eigenvalue that errors of norm `size` (m,) in the triangular factors make.

    To first order by its left and right eigenvectors, to second order by way of every other eigenvector:
    what grows along a part of the chain only does not show in the first.
    """
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
            # Two eigenvalues that an error brings together part with its square root.
            errors[i] = math.sqrt(error * nearest) if error > nearest else error
    return np.where((errors < 1) & np.isfinite(logarithms), errors, np.inf)


def _longest_way(out: Array, back: Array, growth: Array) -> Array:
    """Largest out_k + growth_{k+1} + … + growth_{l-1} + back_l, for k < l ≤ k + m around the chain; all
    (N, m)."""
    until = np.cumsum(growth, axis=1)
    start, end, turn = out - until, back + until - growth, until[:, -1:]
    longest = np.maximum.accumulate(start[:, ::-1], axis=1)[:, ::-1] + turn
    longest[:, 1:] = np.maximum(longest[:, 1:], np.maximum.accumulate(start, axis=1)[:, :-1])
    return (longest + end).max(axis=1)


def _log_distance(apart: Array) -> Array:
    """log |exp(apart) - 1|."""
    near = np.minimum(np.real(apart), 40.0) + 1j * np.imag(apart)
    with np.errstate(divide="ignore"):
        return np.where(np.real(apart) > 40, np.real(apart), np.log(np.abs(np.expm1(near))))


def _conjugate_pairs(logarithms: Array, errors: Array) -> Array:
    """The same with exact conjugate pairs, and real where the imaginary part lies within the error."""
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
