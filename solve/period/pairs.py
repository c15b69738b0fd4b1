"""Eigenvalues of 2 × 2 matrices, given by their entries a, b, c, d by rows, (…) each or as fields (4, …)."""

import numpy as np

from solve.arrays import Array, across

_SWEEPS, _GAIN = 8, 0.95
"""Of balancing: at most so often, and only where norms fall to this part of themselves."""


def eigenvalues(a: Array, b: Array, c: Array, d: Array) -> Array:
    """Eigenvalues (…, 2), of a conjugate pair the one with + imaginary part first, without the cancellation
    of the textbook's formula; squares of the entries must not overflow."""
    half, discriminant = (a + d) / 2, np.square((a - d) / 2) + b * c
    real, root = discriminant >= 0, np.sqrt(np.abs(discriminant))
    larger = half + np.copysign(root, half)
    smaller = np.where(larger != 0, (a * d - b * c) / np.where(larger != 0, larger, 1.0), 0.0)
    parts = np.empty((*half.shape, 2, 2))
    parts[..., 0, 0], parts[..., 1, 0] = np.where(real, (larger, smaller), half)
    parts[..., 0, 1] = np.where(real, 0.0, root)
    parts[..., 1, 1] = 0.0 - parts[..., 0, 1]
    return parts.view(complex)[..., 0]


def balanced(a: Array, b: Array, c: Array, d: Array) -> Array:
    """The entries (4, …) in units of the state in which rows and columns are alike."""
    for _ in range(_SWEEPS):
        column, row = np.sqrt(np.square(a) + np.square(c)), np.sqrt(np.square(a) + np.square(b))
        known = (row > 0) & (column > 0)
        factor = np.sqrt(np.where(known, row, 1.0) / np.where(known, column, 1.0))
        # Where little is gained a small entry may be all that keeps a defective pair together.
        gains = column * factor + row / factor < _GAIN * (column + row)
        if not gains.any():
            break
        factor = np.where(gains, factor, 1.0)
        b, c = b / factor, c * factor
    return np.stack((a, b, c, d))


def least_norm(a: Array, b: Array, c: Array, d: Array) -> Array:
    """The least of Frobenius' norms (…) in any units of the state."""
    return np.sqrt(np.square(a) + np.square(d) + 2 * np.abs(b * c))


def conditions(entries: Array, values: Array, rounding: float) -> tuple[Array, Array]:
    """Spectral norms (…) of matrices with entries (4, …), and the condition of both their eigenvalues
    (…, 2); rounding: part of a sum of squares that is none."""
    # Schur's form [[ρ1, t], [0, ρ2]] gives both eigenvalues the condition sqrt(1 + t²/|ρ1 - ρ2|²).
    square = np.square(entries).sum(axis=0)
    excess = square - across(np.add, np.square(np.abs(values)))
    excess = np.where(excess < rounding * square, 0.0, excess)
    gap = np.square(np.abs(values[..., 0] - values[..., 1]))
    half, product = square / 2, np.abs(values[..., 0] * values[..., 1])
    norm = np.sqrt(half + np.sqrt(np.maximum(np.square(half) - np.square(product), 0.0)))
    return norm, np.sqrt(1 + np.where(excess > 0, excess / np.where(gap > 0, gap, 1e-300), 0.0))


def apart(some: Array, others: Array) -> Array:
    """Larger distance (…) of two numbers (…, 2) to two others, matched so that it is least."""
    straight, crossed = (across(np.maximum, np.abs(some - each)) for each in (others, others[..., ::-1]))
    return np.minimum(straight, crossed)
