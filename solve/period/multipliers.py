"""Floquet multipliers from the monodromy matrix."""

import math
from dataclasses import dataclass

import numpy as np

from solve.arrays import Array

NEGLIGIBLE = 1e-100
"""Modulus below which multipliers count as unresolved: products of so different factors keep no digit."""


@dataclass(frozen=True)
class Multipliers:
    """values: resolved multipliers (complex), falling in modulus, + imaginary part first; unresolved:
    how many more there are, all of them below eps‖Φ‖ or 1e-100 and so lost in rounding."""

    values: Array
    unresolved: int

    @classmethod
    def of(cls, Phi: Array) -> "Multipliers":
        """Eigenvalues of the monodromy matrix Φ (N, N)."""
        values = np.linalg.eigvals(Phi).astype(complex)
        values = values[np.argsort(-np.abs(values), kind="stable")]
        pairs = np.flatnonzero((values[1:] == values[:-1].conj()) & (np.imag(values[:-1]) < 0))
        values[pairs], values[pairs + 1] = values[pairs + 1].copy(), values[pairs].copy()
        modulus, eps = np.abs(values), np.finfo(float).eps
        largest = np.abs(Phi).max(initial=np.finfo(float).tiny)
        norm = largest * np.linalg.norm(Phi / largest)
        if ((modulus <= eps * norm) & (modulus > eps * norm / math.sqrt(len(Phi)))).any():
            # Frobenius' norm bounds the spectral one from both sides; between them only it decides.
            norm = np.linalg.norm(Phi, 2)
        kept = modulus > max(eps * norm, NEGLIGIBLE)
        return cls(values[kept], int((~kept).sum()))

    @property
    def spectral_radius(self) -> float:
        return float(np.abs(self.values[0])) if len(self.values) else 0.0

    @property
    def nearest_one(self) -> complex:
        """The multiplier nearest to +1, with its imaginary part's modulus; 0 where none is resolved."""
        if not len(self.values):
            return 0j
        nearest = self.values[np.abs(self.values - 1.0).argmin()]
        return complex(nearest.real, abs(nearest.imag))

    @property
    def distance_from_one(self) -> float:
        """Smallest |ρ - 1|: 0 at resonance and on a stability boundary of kind +1."""
        return float(np.abs(self.values - 1.0).min(initial=np.inf))

    def difference(self, other: "Multipliers") -> float:
        """Largest distance to the matched multipliers of `other`, the better ones, relative to their
        spectral radius; infinite where that is 0 and ours is not."""
        from scipy.optimize import linear_sum_assignment

        ours, theirs = (np.append(s.values, np.zeros(s.unresolved)) for s in (self, other))
        distance = np.abs(ours[:, None] - theirs)
        nearest = distance.argmin(axis=1)
        if len(set(nearest.tolist())) < len(nearest):
            # Two have the same nearest neighbour.
            nearest = linear_sum_assignment(distance)[1]
        largest = float(distance[np.arange(len(nearest)), nearest].max(initial=0.0))
        if other.spectral_radius == 0.0:
            return 0.0 if largest == 0.0 else np.inf
        return largest / other.spectral_radius


def most_rounding(Phi: Array, radius: float) -> float:
    """What `rounding_error` cannot exceed, from the spectral radius."""
    if radius <= NEGLIGIBLE:
        return 0.0
    return math.sqrt(8 * float(np.finfo(float).eps * np.linalg.norm(Phi)) / radius)


def accumulated(steps: int) -> float:
    """Units of rounding that so many steps leave in what they make together, as measured."""
    return max(8.0, steps / 16)


def rounding_error(Phi: Array) -> float:
    """Error of the multipliers, relative to the spectral radius, that an error of 8 eps‖Φ‖ in Φ makes: as
    many times larger as the eigenvalue is ill-conditioned, and its square root in a defective pair."""
    from scipy.linalg import matrix_balance

    balanced, _ = matrix_balance(Phi)
    values, right = np.linalg.eig(balanced)
    radius = np.abs(values).max()
    if radius <= NEGLIGIBLE:
        return 0.0
    perturbation = 8 * np.finfo(float).eps * np.linalg.norm(balanced, 2) / radius
    try:
        with np.errstate(over="ignore"):
            conditions = np.linalg.norm(np.linalg.inv(right), axis=1)
    except np.linalg.LinAlgError:
        conditions = np.array([np.inf])
    return float(min(perturbation * conditions.max(), np.sqrt(perturbation)))
