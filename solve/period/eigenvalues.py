"""Eigenvalues of monodromy matrices (…, N, N), with balancing and round-off errors.

Eigenvalues of 2×2 matrices are computed in closed form. Their entries a, b, c, d in row order are arrays (…),
or one array (4, …). Other matrices are solved by LAPACK or by compiled code."""

import math

import numpy as np

from solve.arrays import EPS, Array, across, solved
from solve.kernel import multipliers as kernel
from solve.kernel.engines import COMPILED
from solve.kernel.multipliers import Conditioned

NEGLIGIBLE = 1e-100
"""Modulus below which multipliers are unresolved. Chosen by judgement; its square is far above underflow."""

LOST = 8 * EPS
"""Modulus of a multiplier, relative to the norm of the matrix, below which round-off leaves no accurate
digit. Chosen by judgement: the round-off of a few operations."""

_ILL_CONDITIONED = 0.1
"""Threshold for an ill-conditioned eigenvalue: condition number times the square root of the relative
perturbation. Chosen by judgement."""


def conditioned(Phi: Array, units: Array | None, engine: str) -> Conditioned | None:
    """Compute the eigenvalues of matrices (P, N, N) and their condition numbers with compiled code.

    Return None if `engine` is not COMPILED, if compiled code is not available, or if N is large. units (P,
    N): units of the states as returned by `balance_matrices`, if known."""
    found = kernel.conditioned(Phi, units) if engine == COMPILED else None
    if found is not None and (is_missing := np.isnan(found.values[:, 0])).any():
        matrices, known_units = Phi[is_missing], None if units is None else units[is_missing]
        values, unit, norms, conditions = _conditioned(matrices, known_units)
        order = np.lexsort((-np.imag(values), -np.abs(values)))
        found.values[is_missing] = np.take_along_axis(values * unit[:, None], order, axis=-1)
        found.conditions[is_missing] = np.take_along_axis(conditions, order, axis=-1)
        found.norms[is_missing] = norms * unit
        found.sizes[is_missing] = sorted_eigenvalues(matrices, known_units)[1]
    return found


def sorted_eigenvalues(Phi: Array, units: Array | None = None) -> tuple[Array, Array]:
    """Return the eigenvalues (…, N), in order of decreasing modulus, and Frobenius norms (…).

    Of a conjugate pair, the positive imaginary part is first. The norm of a 2×2 matrix is the smallest over
    all units of the states. For larger matrices, the norm is that of the balanced matrix if the smallest
    eigenvalue may be round-off. Otherwise, it is the norm of the matrix itself, which may be larger. units
    (…, N): units of the states as returned by `balance_matrices`, if known."""
    scaled, unit = _scaled_entries(Phi)
    if len(scaled) == 4:
        norm = np.asarray(unit * _least_pair_norm(*scaled))
        return _by_modulus(_pair_eigenvalues(*scaled) * unit[..., None]), norm
    values = _by_modulus(np.linalg.eigvals(Phi).astype(complex))
    _put_positive_first(values)
    norm = np.asarray(unit * _frobenius(scaled))
    is_unsure = np.asarray(np.abs(values[..., -1]) <= LOST * norm)
    if is_unsure.any():
        scaled, unit = _scaled_entries(Phi[is_unsure])
        known_units = None if units is None else units[is_unsure]
        norm[is_unsure] = unit * _frobenius(_by_entry(balanced(_matrices(scaled), known_units)))
    return values, norm


def multiplier_roundoff(
    Phi: Array, units: Array | None = None, steps: int = 1, known: Conditioned | None = None
) -> Array:
    """Estimate the errors (…) of the multipliers due to the round-off of Φ, relative to the spectral radius.

    The round-off accumulated in `steps` steps is multiplied by the condition number of the eigenvalue. For a
    defective block of k eigenvalues, the k-th root of the round-off is used instead if it is smaller. units
    (…, N): units of the states as returned by `balance_matrices`, if known. known: eigenvalues, if already
    computed."""
    if known is None:
        values, unit, norm, conditions = _conditioned(Phi, units)
    else:
        values, unit, norm, conditions = known.values, 1.0, known.norms, known.conditions
    radius = across(np.maximum, np.abs(values))
    is_resolved = unit * radius > NEGLIGIBLE
    scale = np.where(is_resolved, radius, 1.0)
    perturbation = EPS * roundoff_growth(steps) * norm / scale
    bound = perturbation ** (1 / _block_size(values / scale[..., None], conditions, perturbation))
    return np.where(is_resolved, np.minimum(perturbation * across(np.maximum, conditions), bound), 0.0)


def roundoff_growth(steps: int) -> float:
    """Round-off error of a product of `steps` matrices, in units of the unit round-off: 1/16 per matrix
    (measured), but at least 8."""
    return max(8.0, steps / 16)


def balanced(Phi: Array, units: Array | None = None) -> Array:
    """Scale matrices (…, N, N) by the units of the states, if given; otherwise balance them. Matrices with N
    = 2 are always balanced."""
    if Phi.shape[-1] == 2:
        return _matrices(_balanced_pair(*_by_entry(Phi)))
    return balance_matrices(Phi)[0] if units is None else _in_units(Phi, units)


def balance_matrices(matrices: Array) -> tuple[Array, Array]:
    """Balance matrices (…, N, N): scale them so that each row and its column have similar norms. Return the
    scaled matrices and the units (…, N), powers of two.

    Scaled entries are A_ij unit_j / unit_i (E. E. Osborne, J. ACM 7 (1960) 338-345, but with all rows scaled
    at once). Rows and columns of zeros are unchanged. Iteration stops if the squared norms of each row and
    its column differ by less than a factor of 4, or after 50 sweeps. Both limits are chosen by judgement."""
    scaled, powers = matrices, np.zeros(matrices.shape[:-1])
    with np.errstate(all="ignore"):
        for _ in range(50):
            squares = np.square(scaled / np.abs(scaled).max(axis=(-2, -1), keepdims=True))
            ratio = np.log2(squares.sum(axis=-1)) - np.log2(squares.sum(axis=-2))
            ratio = np.where(np.isfinite(ratio), ratio, 0.0)
            is_unbalanced = np.abs(ratio).max(axis=-1, keepdims=True) > 2.0
            if not is_unbalanced.any():
                break
            powers += np.where(is_unbalanced, ratio / 8, 0.0)
            scaled = _in_units(matrices, np.exp2(powers))
    units = np.exp2(np.round(powers))
    return _in_units(matrices, units), units


def pair_distance(some: Array, others: Array) -> Array:
    """Distance (…) between two pairs of numbers (…, 2): the larger distance of the matched numbers, for the
    better of the two matchings."""
    straight, crossed = (across(np.maximum, np.abs(some - pair)) for pair in (others, others[..., ::-1]))
    return np.minimum(straight, crossed)


def _in_units(matrices: Array, units: Array) -> Array:
    return matrices * units[..., None, :] / units[..., :, None]


def _by_modulus(values: Array) -> Array:
    """Sort eigenvalues (…, N) by decreasing modulus."""
    modulus = np.abs(values)
    if (modulus[..., 1:] > modulus[..., :-1]).any():
        return np.take_along_axis(values, np.argsort(-modulus, axis=-1, kind="stable"), axis=-1)
    return values


def _put_positive_first(values: Array) -> None:
    """Order each conjugate pair in place, so that the positive imaginary part is first."""
    wrong = (values[..., 1:] == values[..., :-1].conj()) & (np.imag(values[..., :-1]) < 0)
    for k in range(values.shape[-1] - 1) if wrong.any() else ():
        swap = (values[..., k + 1] == values[..., k].conj()) & (np.imag(values[..., k]) < 0)
        values[swap, k : k + 2] = values[swap, k : k + 2][..., ::-1]


def _conditioned(Phi: Array, units: Array | None) -> tuple[Array, Array, Array, Array]:
    """Return the eigenvalues (…, N) of balanced, scaled matrices, the scales (…), spectral norms (…) and
    condition numbers (…, N).

    The scales are powers of two, by which the matrices were divided."""
    scaled, unit = _scaled_entries(Phi)
    if len(scaled) == 4:
        entries = _balanced_pair(*scaled)
        values = _pair_eigenvalues(*entries)
        norm, condition = _pair_conditions(entries, values)
        return values, unit, norm, np.stack((condition, condition), axis=-1)
    matrices = balanced(_matrices(scaled), units)
    values, right = np.linalg.eig(matrices)
    # All points use complex arithmetic, so that the result of a point does not depend on the others.
    right = right.astype(complex)
    with np.errstate(over="ignore"):
        left = np.linalg.norm(solved(right, np.eye(Phi.shape[-1])), axis=-1)
    norm = np.linalg.svd(matrices, compute_uv=False)[..., 0]
    # The matrix of right eigenvectors of a defective matrix has no inverse.
    return values, unit, norm, np.where(np.isnan(left), np.inf, left)


def _block_size(values: Array, conditions: Array, perturbation: Array) -> Array:
    """Return the largest number (…) of the ill-conditioned eigenvalues among `values` (…, N) that a
    perturbation may have split from one multiple eigenvalue. The number is at least 2."""
    size = np.full(perturbation.shape, 2)
    is_ill = conditions * np.sqrt(perturbation)[..., None] > _ILL_CONDITIONED
    if values.shape[-1] == 2 or not (is_ill.sum(axis=-1) > 2).any():
        return size
    distance = np.where(is_ill[..., None, :], np.abs(values[..., :, None] - values[..., None, :]), np.inf)
    for k in range(3, values.shape[-1] + 1):
        is_near = distance <= 4 * perturbation[..., None, None] ** (1 / k)
        size = np.where((is_near.sum(axis=-1) >= k).any(axis=-1), k, size)
    return size


def _by_entry(matrices: Array) -> Array:
    """Rearrange matrices (…, N, N) as entries (N², …); the values of each entry are contiguous in memory."""
    *points, rows, columns = matrices.shape
    fields = matrices.reshape(-1, rows * columns).T
    return np.ascontiguousarray(fields).reshape(-1, *points)


def _matrices(entries: Array) -> Array:
    """Rearrange entries (N², …) as matrices (…, N, N)."""
    size = math.isqrt(len(entries))
    return np.moveaxis(entries, 0, -1).reshape(*entries.shape[1:], size, size)


def _scaled_entries(Phi: Array) -> tuple[Array, Array]:
    """Return entries (N², …) of scaled matrices and the scales (…), powers of two by which the matrices were
    divided. Squares of the scaled entries neither overflow nor underflow."""
    entries = _by_entry(Phi)
    unit = np.exp2(np.frexp(np.abs(entries).max(axis=0))[1] - 1)
    return entries / unit, unit


def _frobenius(entries: Array) -> Array:
    return np.sqrt(np.square(entries).sum(axis=0))


def _pair_eigenvalues(a: Array, b: Array, c: Array, d: Array) -> Array:
    """Eigenvalues (…, 2) of 2×2 matrices, positive imaginary part first. The formula avoids the cancellation
    of the textbook formula. Squares of the entries must not overflow."""
    half, discriminant = (a + d) / 2, np.square((a - d) / 2) + b * c
    is_real, root = discriminant >= 0, np.sqrt(np.abs(discriminant))
    larger = half + np.copysign(root, half)
    smaller = np.where(larger != 0, (a * d - b * c) / np.where(larger != 0, larger, 1.0), 0.0)
    parts = np.empty((*half.shape, 2, 2))
    parts[..., 0, 0], parts[..., 1, 0] = np.where(is_real, (larger, smaller), half)
    parts[..., 0, 1] = np.where(is_real, 0.0, root)
    parts[..., 1, 1] = 0.0 - parts[..., 0, 1]
    return parts.view(complex)[..., 0]


def _balanced_pair(a: Array, b: Array, c: Array, d: Array) -> Array:
    """Entries (4, …) of balanced 2×2 matrices.

    At most 8 sweeps are made; they end if norms decrease by less than 5 %. Further scaling could reduce to
    round-off a small entry without which the matrix would be defective."""
    for _ in range(8):
        column, row = np.sqrt(np.square(a) + np.square(c)), np.sqrt(np.square(a) + np.square(b))
        is_positive = (row > 0) & (column > 0)
        factor = np.sqrt(np.where(is_positive, row, 1.0) / np.where(is_positive, column, 1.0))
        gains = column * factor + row / factor < 0.95 * (column + row)
        if not gains.any():
            break
        factor = np.where(gains, factor, 1.0)
        b, c = b / factor, c * factor
    return np.stack((a, b, c, d))


def _least_pair_norm(a: Array, b: Array, c: Array, d: Array) -> Array:
    """Smallest Frobenius norm (…) of a 2×2 matrix over all units of the state."""
    return np.sqrt(np.square(a) + np.square(d) + 2 * np.abs(b * c))


def _pair_conditions(entries: Array, values: Array) -> tuple[Array, Array]:
    """Return the spectral norms (…) of 2×2 matrices with entries (4, …), and the condition number (…), which
    is common to both eigenvalues."""
    # The Schur form [[ρ1, t], [0, ρ2]] gives both eigenvalues the condition number sqrt(1 + t²/|ρ1 - ρ2|²).
    square = np.square(entries).sum(axis=0)
    excess = square - across(np.add, np.square(np.abs(values)))
    excess = np.where(excess < LOST * square, 0.0, excess)
    gap = np.square(np.abs(values[..., 0] - values[..., 1]))
    half, product = square / 2, np.abs(values[..., 0] * values[..., 1])
    norm = np.sqrt(half + np.sqrt(np.maximum(np.square(half) - np.square(product), 0.0)))
    return norm, np.sqrt(1 + np.where(excess > 0, excess / np.where(gap > 0, gap, 1e-300), 0.0))
