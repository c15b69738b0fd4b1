"""Floquet multipliers from monodromy matrices (…, N, N), their rounding, and the verdict of stability.

Every array may have a leading axis of points, here `…`.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from solve.arrays import Array

NEGLIGIBLE = 1e-100
"""Modulus below which multipliers count as unresolved: products of so different factors keep no digit."""

UNIT_CIRCLE = 1e-9
"""Distance from 1 within which a modulus counts as 1, unless its error estimate is larger."""

_SWEEPS, _GAIN = 8, 0.95
"""Of balancing a pair: at most so often, and only where norms fall to this part of themselves."""

VERDICTS = ("asymptotically stable", "stable", "unstable")

EPS = float(np.finfo(float).eps)
_TINY = float(np.finfo(float).tiny)


@dataclass(frozen=True)
class Multipliers:
    """values (…, N): complex, falling in modulus, + imaginary part first, zero where unresolved: below
    eps‖Φ‖ or 1e-100 and so lost in rounding. resolved (…): how many of them are not."""

    values: Array
    resolved: Array

    @classmethod
    def of(cls, Phi: Array) -> "Multipliers":
        """Eigenvalues of finite monodromy matrices (…, N, N)."""
        values = _pair(Phi) if Phi.shape[-1] == 2 else np.linalg.eigvals(Phi).astype(complex)
        values = np.take_along_axis(values, np.argsort(-np.abs(values), axis=-1, kind="stable"), axis=-1)
        _put_positive_first(values)
        modulus, norm = np.abs(values), frobenius(Phi)
        # Frobenius' norm bounds the spectral one from both sides; between them only it decides.
        least = EPS * norm[..., None]
        unsure = ((modulus <= least) & (modulus > least / math.sqrt(Phi.shape[-1]))).any(axis=-1)
        if unsure.any():
            norm = np.where(unsure, np.linalg.norm(Phi, 2, axis=(-2, -1)), norm)
        kept = modulus > np.maximum(EPS * norm, NEGLIGIBLE)[..., None]
        return cls(np.where(kept, values, 0.0), kept.sum(axis=-1))

    def __getitem__(self, points: Any) -> "Multipliers":
        return Multipliers(self.values[points], self.resolved[points])

    @property
    def spectral_radius(self) -> Array:
        """Largest modulus (…)."""
        return np.abs(self.values[..., 0])

    @property
    def nearest_one(self) -> Array:
        """The multiplier nearest to +1 (…), with its imaginary part's modulus; 0 where none is resolved."""
        nearest = np.abs(self.values - 1.0).argmin(axis=-1)[..., None]
        value = np.take_along_axis(self.values, nearest, axis=-1)[..., 0]
        return np.real(value) + 1j * np.abs(np.imag(value))

    @property
    def distance_from_one(self) -> Array:
        """Smallest |ρ - 1| of a resolved multiplier (…): 0 at resonance and on a stability boundary of
        kind +1."""
        known = np.arange(self.values.shape[-1]) < self.resolved[..., None]
        return np.where(known, np.abs(self.values - 1.0), np.inf).min(axis=-1)

    def difference(self, other: "Multipliers") -> Array:
        """Largest distance (…) to the matched multipliers of `other`, the better ones, relative to their
        spectral radius; infinite where that is 0 and ours is not."""
        distance = np.abs(self.values[..., :, None] - other.values[..., None, :])
        nearest = distance.argmin(axis=-1)
        largest = np.asarray(distance.min(axis=-1).max(axis=-1))
        # Where two have the same nearest neighbour, the assignment takes more than that.
        shared = (np.sort(nearest, axis=-1) != np.arange(nearest.shape[-1])).any(axis=-1)
        for point in zip(*np.nonzero(np.atleast_1d(shared)), strict=True) if shared.any() else ():
            at = point if largest.ndim else ()
            largest[at] = _assigned(distance[at])
        scale = other.spectral_radius
        nothing = np.where(largest == 0, 0.0, np.inf)
        return np.where(scale > 0, largest / np.where(scale > 0, scale, 1.0), nothing)

    def with_digits(self, error: Array) -> "Multipliers":
        """Those alone of which the error (…), relative to the spectral radius, leaves a digit."""
        kept = np.abs(self.values) > (error * self.spectral_radius)[..., None]
        return Multipliers(np.where(kept, self.values, 0.0), kept.sum(axis=-1))


def frobenius(Phi: Array) -> Array:
    """Frobenius' norm (…) of matrices (…, N, N), without overflow."""
    largest = np.maximum(np.abs(Phi).max(axis=(-2, -1)), _TINY)
    return largest * np.sqrt(((Phi / largest[..., None, None]) ** 2).sum(axis=(-2, -1)))


def accumulated(steps: int) -> float:
    """Units of rounding that so many steps leave in what they make together, as measured."""
    return max(8.0, steps / 16)


def most_rounding(Phi: Array, radius: Array) -> Array:
    """What `rounding_errors` cannot exceed (…), from the spectral radius (…)."""
    known = radius > NEGLIGIBLE
    return np.where(known, np.sqrt(8 * EPS * frobenius(Phi) / np.where(known, radius, 1.0)), 0.0)


def rounding_errors(Phi: Array) -> Array:
    """Errors of the multipliers (…), relative to the spectral radius, that an error of 8 eps‖Φ‖ in Φ makes:
    as many times larger as the eigenvalue is ill-conditioned, and its square root in a defective pair."""
    if Phi.shape[-1] == 2:
        values, norm, conditions = _balanced_pair(Phi)
    else:
        balanced = scaled_alike(Phi)[0]
        values, right = np.linalg.eig(balanced)
        # Complex for every point alike, whatever its neighbours are.
        right = right.astype(complex)
        norm = np.linalg.norm(balanced, 2, axis=(-2, -1))
        defective = np.linalg.slogdet(right)[0] == 0
        right = np.where(defective[..., None, None], np.eye(Phi.shape[-1]), right)
        with np.errstate(over="ignore"):
            conditions = np.linalg.norm(np.linalg.inv(right), axis=-1).max(axis=-1)
        conditions = np.where(defective, np.inf, conditions)
    radius = np.abs(values).max(axis=-1)
    known = radius > NEGLIGIBLE
    perturbation = 8 * EPS * norm / np.where(known, radius, 1.0)
    return np.where(known, np.minimum(perturbation * conditions, np.sqrt(perturbation)), 0.0)


def _balanced_pair(Phi: Array) -> tuple[Array, Array, Array]:
    """Of 2 × 2 matrices (…, 2, 2), balanced: eigenvalues (…, 2), spectral norm, condition of both values."""
    balanced = Phi.copy()
    for _ in range(_SWEEPS):
        column, row = (np.sqrt((balanced**2).sum(axis=axis)) for axis in (-2, -1))
        known = (row > 0) & (column > 0)
        factor = np.sqrt(np.where(known, row, 1.0) / np.where(known, column, 1.0))
        # Where little is gained a small entry may be all that keeps a defective pair together.
        gains = column * factor + row / factor < _GAIN * (column + row)
        factor = np.where(gains, factor, 1.0)[..., 0]
        balanced[..., 1, 0] *= factor
        balanced[..., 0, 1] /= factor
    values = _pair(balanced)
    # Schur's form [[ρ1, t], [0, ρ2]] gives both eigenvalues the condition sqrt(1 + t²/|ρ1 - ρ2|²).
    square = (balanced**2).sum(axis=(-2, -1))
    excess = square - (np.abs(values) ** 2).sum(axis=-1)
    excess = np.where(excess < 8 * EPS * square, 0.0, excess)
    gap = np.abs(values[..., 0] - values[..., 1]) ** 2
    half, product = square / 2, np.abs(np.prod(values, axis=-1))
    norm = np.sqrt(half + np.sqrt(np.maximum(half**2 - product**2, 0.0)))
    return values, norm, np.sqrt(1 + np.where(excess > 0, excess / np.where(gap > 0, gap, 1e-300), 0.0))


def scaled_alike(matrices: Array) -> tuple[Array, Array]:
    """Matrices (…, N, N) with rows and columns scaled by powers of two so that their norms are alike, and
    the units (…, N) in which they then are: A_ij unit_j / unit_i."""
    from scipy.linalg import matrix_balance

    flat = matrices.reshape(-1, *matrices.shape[-2:])
    units = np.array([matrix_balance(each, permute=False, separate=True)[1][0] for each in flat])
    units = units.reshape(matrices.shape[:-1])
    return matrices * units[..., None, :] / units[..., :, None], units


def verdicts(Phi: Array, multipliers: Multipliers, error: Array, meetings: bool = True) -> Array:
    """Positions (…) in VERDICTS.

    error (…): of the multipliers, relative to the spectral radius. A modulus counts as 1 within that error
    (absolute, where the radius is below 1) or 1e-9, whichever is larger. Multipliers on the unit circle
    leave the system stable only where their algebraic equals their geometric multiplicity (chapter
    Section 2); without `meetings` that is not looked at, and the moduli alone decide.
    """
    values, radius = multipliers.values, multipliers.spectral_radius
    modulus = np.abs(values)
    absolute = np.where(radius > 0, error, 0.0) * np.minimum(radius, 1.0)
    tolerance = np.maximum(absolute, UNIT_CIRCLE)[..., None]
    judged = np.where((modulus < 1 - tolerance).all(axis=-1), 0, 1)
    judged = np.where((modulus > 1 + tolerance).any(axis=-1), 2, judged)
    if not meetings:
        return judged
    on_circle = (np.abs(modulus - 1) <= tolerance)[..., :, None] & ~np.eye(modulus.shape[-1], dtype=bool)
    distance = np.abs(values[..., :, None] - values[..., None, :])
    close = (on_circle & (distance <= np.sqrt(tolerance)[..., None])).any(axis=(-2, -1))
    for point in map(tuple, np.argwhere((judged == 1) & close)):
        if _defective(Phi[point], values[point], float(tolerance[point][0])):
            judged[point] = 2
    return judged


def _defective(Phi: Array, values: Array, tolerance: float) -> bool:
    """Whether one of the multipliers (N,) on the unit circle has fewer eigenvectors than it counts."""
    # A double multiplier of a defective block splits by the square root of a perturbation.
    cluster = math.sqrt(tolerance)
    for value in values[np.abs(np.abs(values) - 1) <= tolerance]:
        algebraic = int(np.sum(np.abs(values - value) <= cluster))
        if algebraic > 1:
            singular = np.linalg.svd(Phi - value * np.eye(len(Phi)), compute_uv=False)
            if np.sum(singular <= 10 * cluster * max(float(singular[0]), 1.0)) < algebraic:
                return True
    return False


def _pair(Phi: Array) -> Array:
    """Eigenvalues (…, 2) of 2 × 2 matrices, without the cancellation of the textbook's formula."""
    # By a power of two, which costs no digit, so that squares neither over- nor underflow.
    unit = np.exp2(np.frexp(np.abs(Phi).max(axis=(-2, -1)))[1])
    a, b, c, d = np.moveaxis((Phi / unit[..., None, None]).reshape(*Phi.shape[:-2], 4), -1, 0)
    half, discriminant = (a + d) / 2, ((a - d) / 2) ** 2 + b * c
    root = np.sqrt(discriminant.astype(complex))
    larger = np.where(discriminant >= 0, half + np.copysign(np.real(root), half), half + root)
    real = np.where(larger != 0, (a * d - b * c) / np.where(larger != 0, larger, 1.0), 0.0)
    values = np.stack((larger, np.where(discriminant >= 0, real, larger.conj())), axis=-1)
    return values * unit[..., None]


def _put_positive_first(values: Array) -> None:
    """Swap neighbours that are a conjugate pair with the - imaginary part first, in place."""
    for k in range(values.shape[-1] - 1):
        swap = (values[..., k + 1] == values[..., k].conj()) & (np.imag(values[..., k]) < 0)
        values[swap, k : k + 2] = values[swap, k : k + 2][..., ::-1]


def _assigned(distance: Array) -> float:
    from scipy.optimize import linear_sum_assignment

    return float(distance[linear_sum_assignment(distance)].max())
