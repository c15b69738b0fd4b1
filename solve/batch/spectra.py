"""Floquet multipliers of many points, their differences and verdicts."""

import math
from dataclasses import dataclass

import numpy as np

from solve.arrays import Array
from solve.floquet import UNIT_CIRCLE, verdict

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
        kept = modulus > least[:, None]
        # Frobenius' norm bounds the spectral one from both sides; between them only it decides.
        unsure = ((modulus <= least[:, None]) & (modulus > least[:, None] / math.sqrt(Phi.shape[-1]))).any(
            axis=1
        )
        if unsure.any():
            norm = np.linalg.norm(Phi[unsure], 2, axis=(1, 2))
            kept[unsure] = modulus[unsure] > np.finfo(float).eps * norm[:, None]
        return cls(np.where(kept, values, 0.0), kept.sum(axis=1))

    def __getitem__(self, points: Array) -> "Spectra":
        return Spectra(self.values[points], self.resolved[points])

    @property
    def radius(self) -> Array:
        """Largest modulus (P,)."""
        return np.abs(self.values[:, 0])

    @property
    def distance_from_one(self) -> Array:
        """Smallest |ρ - 1| of a resolved multiplier (P,)."""
        known = np.arange(self.values.shape[1]) < self.resolved[:, None]
        return np.where(known, np.abs(self.values - 1.0), np.inf).min(axis=1)

    def difference(self, other: "Spectra") -> Array:
        """Largest distance (P,) between matched multipliers, relative to the spectral radius."""
        distance = np.abs(self.values[:, :, None] - other.values[:, None, :])
        nearest = distance.argmin(axis=2)
        largest = distance.min(axis=2).max(axis=1)
        # Where two have the same nearest neighbour, the assignment takes more than that.
        shared = (np.sort(nearest, axis=1) != np.arange(nearest.shape[1])).any(axis=1)
        for point in np.flatnonzero(shared):
            largest[point] = _assigned(distance[point])
        scale = np.maximum(self.radius, other.radius)
        return np.where(scale > 0, largest / np.where(scale > 0, scale, 1.0), 0.0)


def verdicts(Phi: Array, spectra: Spectra, error: Array) -> Array:
    """Positions (P,) in VERDICTS, as `floquet.verdict` judges a single Φ."""
    tolerance = np.maximum(error, UNIT_CIRCLE)[:, None]
    modulus = np.abs(spectra.values)
    found = np.where((modulus < 1 - tolerance).all(axis=1), 0, 1)
    found[(modulus > 1 + tolerance).any(axis=1)] = 2
    on_circle = (np.abs(modulus - 1) <= tolerance)[:, :, None] & ~np.eye(modulus.shape[1], dtype=bool)
    distance = np.abs(spectra.values[:, :, None] - spectra.values[:, None, :])
    close = (on_circle & (distance <= np.sqrt(tolerance)[:, :, None])).any(axis=(1, 2))
    for point in np.flatnonzero((found == 1) & close):
        known = spectra.values[point, : spectra.resolved[point]]
        found[point] = VERDICTS.index(verdict(Phi[point], known, float(error[point])))
    return found


def _pair(Phi: Array) -> Array:
    """Eigenvalues (P, 2) of 2 × 2 matrices, without the cancellation of the textbook's formula."""
    half = (Phi[:, 0, 0] + Phi[:, 1, 1]) / 2
    discriminant = ((Phi[:, 0, 0] - Phi[:, 1, 1]) / 2) ** 2 + Phi[:, 0, 1] * Phi[:, 1, 0]
    root = np.sqrt(discriminant.astype(complex))
    larger = np.where(discriminant >= 0, half + np.copysign(root.real, half), half + root)
    determinant = Phi[:, 0, 0] * Phi[:, 1, 1] - Phi[:, 0, 1] * Phi[:, 1, 0]
    real = np.where(larger != 0, determinant / np.where(larger != 0, larger, 1.0), 0.0)
    return np.stack((larger, np.where(discriminant >= 0, real, larger.conj())), axis=1)


def _put_positive_first(values: Array) -> None:
    """Swap neighbours that are a conjugate pair with the - imaginary part first, in place."""
    for k in range(values.shape[1] - 1):
        swap = (values[:, k + 1] == values[:, k].conj()) & (values[:, k].imag < 0)
        values[swap, k : k + 2] = values[swap, k : k + 2][:, ::-1]


def _assigned(distance: Array) -> float:
    from scipy.optimize import linear_sum_assignment

    return float(distance[linear_sum_assignment(distance)].max())
