"""Floquet multipliers of many points, their differences and verdicts."""

import math
from dataclasses import dataclass

import numpy as np

from solve.arrays import Array
from solve.period.multipliers import NEGLIGIBLE
from solve.results.stability import UNIT_CIRCLE, verdict

_SWEEPS = 3
"""Of balancing."""

VERDICTS = ("asymptotically stable", "stable", "unstable")


@dataclass(frozen=True)
class Spectra:
    """values (P, N): complex, falling in modulus, + imaginary part first, zero where unresolved;
    resolved (P,): how many of them stand above eps‖Φ‖."""

    values: Array
    resolved: Array

    @classmethod
    def of(cls, Phi: Array) -> "Spectra":
        """Of monodromy matrices (P, N, N), finite ones."""
        values = _pair(Phi) if Phi.shape[-1] == 2 else np.linalg.eigvals(Phi).astype(complex)
        values = np.take_along_axis(values, np.argsort(-np.abs(values), axis=1, kind="stable"), axis=1)
        _put_positive_first(values)
        modulus = np.abs(values)
        least = np.finfo(float).eps * np.sqrt((Phi**2).sum(axis=(1, 2)))
        kept = modulus > np.maximum(least, NEGLIGIBLE)[:, None]
        # Frobenius' norm bounds the spectral one from both sides; between them only it decides.
        unsure = ((modulus <= least[:, None]) & (modulus > least[:, None] / math.sqrt(Phi.shape[-1]))).any(
            axis=1
        )
        if unsure.any():
            norm = np.linalg.norm(Phi[unsure], 2, axis=(1, 2))
            kept[unsure] = modulus[unsure] > np.maximum(np.finfo(float).eps * norm, NEGLIGIBLE)[:, None]
        return cls(np.where(kept, values, 0.0), kept.sum(axis=1))

    def __getitem__(self, points: Array) -> "Spectra":
        return Spectra(self.values[points], self.resolved[points])

    @property
    def radius(self) -> Array:
        """Largest modulus (P,)."""
        return np.abs(self.values[:, 0])

    @property
    def nearest_one(self) -> Array:
        """The multiplier nearest to +1 (P,), with its imaginary part's modulus; 0 where none is resolved."""
        nearest = np.abs(self.values - 1.0).argmin(axis=1)[:, None]
        found = np.take_along_axis(self.values, nearest, axis=1)[:, 0]
        return np.real(found) + 1j * np.abs(np.imag(found))

    @property
    def distance_from_one(self) -> Array:
        """Smallest |ρ - 1| of a resolved multiplier (P,)."""
        known = np.arange(self.values.shape[1]) < self.resolved[:, None]
        return np.where(known, np.abs(self.values - 1.0), np.inf).min(axis=1)

    def difference(self, other: "Spectra") -> Array:
        """Largest distance (P,) to the matched multipliers of `other`, the better ones, relative to their
        spectral radius; infinite where that is 0 and ours is not."""
        distance = np.abs(self.values[:, :, None] - other.values[:, None, :])
        nearest = distance.argmin(axis=2)
        largest = distance.min(axis=2).max(axis=1)
        # Where two have the same nearest neighbour, the assignment takes more than that.
        shared = (np.sort(nearest, axis=1) != np.arange(nearest.shape[1])).any(axis=1)
        for point in np.flatnonzero(shared):
            largest[point] = _assigned(distance[point])
        scale = other.radius
        nothing = np.where(largest == 0, 0.0, np.inf)
        return np.where(scale > 0, largest / np.where(scale > 0, scale, 1.0), nothing)


def verdicts(Phi: Array, spectra: Spectra, error: Array, meetings: bool = True) -> Array:
    """Positions (P,) in VERDICTS, as `floquet.verdict` judges a single Φ; without `meetings`, by the moduli
    alone."""
    modulus = np.abs(spectra.values)
    radius = spectra.radius
    absolute = np.where(radius > 0, error, 0.0) * np.minimum(radius, 1.0)
    tolerance = np.maximum(absolute, UNIT_CIRCLE)[:, None]
    found = np.where((modulus < 1 - tolerance).all(axis=1), 0, 1)
    found[(modulus > 1 + tolerance).any(axis=1)] = 2
    if not meetings:
        return found
    on_circle = (np.abs(modulus - 1) <= tolerance)[:, :, None] & ~np.eye(modulus.shape[1], dtype=bool)
    distance = np.abs(spectra.values[:, :, None] - spectra.values[:, None, :])
    close = (on_circle & (distance <= np.sqrt(tolerance)[:, :, None])).any(axis=(1, 2))
    for point in np.flatnonzero((found == 1) & close):
        known = spectra.values[point, : spectra.resolved[point]]
        found[point] = VERDICTS.index(verdict(Phi[point], known, float(error[point])))
    return found


def rounding_errors(Phi: Array) -> Array:
    """Errors of the multipliers (P,), relative to the spectral radius, that an error of 8 eps‖Φ‖ in Φ
    makes, as `methods.multipliers.rounding_error` says of a single Φ."""
    balanced = _balanced(Phi)
    if Phi.shape[-1] == 2:
        values = _pair(balanced)
        # Schur's form [[ρ1, t], [0, ρ2]] gives both eigenvalues the condition sqrt(1 + t²/|ρ1 - ρ2|²).
        square = (balanced**2).sum(axis=(1, 2))
        excess = square - (np.abs(values) ** 2).sum(axis=1)
        excess[excess < 8 * np.finfo(float).eps * square] = 0.0
        gap = np.abs(values[:, 0] - values[:, 1]) ** 2
        half, product = square / 2, np.abs(np.prod(values, axis=1))
        norm = np.sqrt(half + np.sqrt(np.maximum(half**2 - product**2, 0.0)))
        conditions = np.sqrt(1 + np.where(excess > 0, excess / np.where(gap > 0, gap, 1e-300), 0.0))
    else:
        values, right = np.linalg.eig(balanced)
        norm = np.linalg.norm(balanced, 2, axis=(1, 2))
        defective = np.linalg.det(right) == 0
        right[defective] = np.eye(Phi.shape[-1])
        conditions = np.linalg.norm(np.linalg.inv(right), axis=2).max(axis=1)
        conditions[defective] = np.inf
    radius = np.abs(values).max(axis=1)
    perturbation = 8 * np.finfo(float).eps * norm / np.where(radius > 0, radius, 1.0)
    return np.where(radius > 0, np.minimum(perturbation * conditions, np.sqrt(perturbation)), 0.0)


def _balanced(Phi: Array) -> Array:
    """The matrices with rows and columns scaled by powers of two, so that their norms are alike."""
    balanced, N = Phi.copy(), Phi.shape[-1]
    others = ~np.eye(N, dtype=bool)
    for _ in range(_SWEEPS):
        for i in range(N):
            column = np.sqrt((balanced[:, others[i], i] ** 2).sum(axis=1))
            row = np.sqrt((balanced[:, i, others[i]] ** 2).sum(axis=1))
            known = (column > 0) & (row > 0)
            ratio = np.where(known, row, 1.0) / np.where(known, column, 1.0)
            factor = 2.0 ** np.round(np.log2(ratio) / 2)
            balanced[:, :, i] *= factor[:, None]
            balanced[:, i, :] /= factor[:, None]
    return balanced


def _pair(Phi: Array) -> Array:
    """Eigenvalues (P, 2) of 2 × 2 matrices, without the cancellation of the textbook's formula."""
    half = (Phi[:, 0, 0] + Phi[:, 1, 1]) / 2
    discriminant = ((Phi[:, 0, 0] - Phi[:, 1, 1]) / 2) ** 2 + Phi[:, 0, 1] * Phi[:, 1, 0]
    root = np.sqrt(discriminant.astype(complex))
    larger = np.where(discriminant >= 0, half + np.copysign(np.real(root), half), half + root)
    determinant = Phi[:, 0, 0] * Phi[:, 1, 1] - Phi[:, 0, 1] * Phi[:, 1, 0]
    real = np.where(larger != 0, determinant / np.where(larger != 0, larger, 1.0), 0.0)
    return np.stack((larger, np.where(discriminant >= 0, real, larger.conj())), axis=1)


def _put_positive_first(values: Array) -> None:
    """Swap neighbours that are a conjugate pair with the - imaginary part first, in place."""
    for k in range(values.shape[1] - 1):
        swap = (values[:, k + 1] == values[:, k].conj()) & (np.imag(values[:, k]) < 0)
        values[swap, k : k + 2] = values[swap, k : k + 2][:, ::-1]


def _assigned(distance: Array) -> float:
    from scipy.optimize import linear_sum_assignment

    return float(distance[linear_sum_assignment(distance)].max())
