"""Overlaps of the Floquet modes of two neighbouring points, and exceptional points between them.

A mode is the sum of its harmonics, p(φ) exp(λt) = Σ_k p_k exp((λ + ikω)t) with ω = 2π/T. The same mode is
p(φ) exp(-isφ) with the exponent λ + isω. Overlaps are therefore computed for every shift s."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from solve.arrays import Array
from solve.studies.mode_vectors import ModeVectors

_MAX_SHIFT = 64
"""Largest difference between the harmonic numbers of a mode at two neighbouring points. Chosen by judgement.
If speeds are 1 % apart, this limit suffices for frequencies up to the 6400th harmonic."""


@dataclass(frozen=True)
class Overlaps:
    """Overlaps of j modes of a first point with k modes of a second point.

    forward (j, k, S), backward (k, j, S): mode p_b of the second point is the sum of forward[a, b, s] p_a
    exp(isφ) over the modes p_a of the first point and the shifts s from -S//2 to S//2. `backward` is the same
    with the points exchanged."""

    forward: Array
    backward: Array

    @classmethod
    def between(cls, first: ModeVectors, second: ModeVectors) -> "Overlaps":
        """Overlaps between two points on the same grid, computed with left inverses of the matrices of mode
        vectors."""
        largest = min(_MAX_SHIFT, (len(first.nodes) - 1) // 2)
        shifts = np.arange(-largest, largest + 1)
        waves = first.weights[:, None] * np.exp(-1j * np.outer(first.nodes, shifts))
        products = first.inverse @ second.parts, second.inverse @ first.parts
        return cls(*(np.tensordot(product, waves, axes=(0, 0)) for product in products))

    @property
    def largest(self) -> int:
        """Largest shift."""
        return self.forward.shape[-1] // 2

    @cached_property
    def products(self) -> Array:
        """Moduli (j, k, S) of forward[a, b, s] backward[b, a, -s].

        The products do not depend on the lengths of the vectors. Before moduli are taken, their sum over b
        and s is 1. As the points approach each other, a product tends to 1 for the same mode and to 0 for
        different modes, even if the modes are not orthogonal."""
        return np.abs(self.forward * np.swapaxes(self.backward, 0, 1)[..., ::-1])

    def coefficient(self, row: Array, column: Array, shift: Array) -> Array:
        """Entry of `forward` for modes `row` and `column` and a shift; zero for shifts beyond the largest
        one."""
        is_inside = np.abs(shift) <= self.largest
        values = self.forward[row, column, np.where(is_inside, shift + self.largest, 0)]
        return np.where(is_inside, values, 0.0)


@dataclass(frozen=True)
class CoupledPairs:
    """Coupling of r pairs of modes between two points, in the linear model of `exceptional_points`.

    Arrays (r, S) have one entry per pair and shift of the second mode of the pair.

    Attributes
    ----------
    first, second : (r,)
        Indices of the two modes of each pair.
    roots : (2, r, S)
        Exceptional points t±, complex; t is 0 at the first point and 1 at the second.
    coupling : (r, S)
        2√|h₁₂ h₂₁| of the matrix H(1) in `exceptional_points`: the smallest distance in rad/s between the
        exponents of two modes with this coupling.
    noise : (r,)
        Size below which the coupling may be a numerical error.
    gap : (r, S)
        Distance between the exponents halfway between the two exceptional points or, if this is outside 0 ≤ t
        ≤ 1, at the nearer end.
    """

    first: Array
    second: Array
    roots: Array
    coupling: Array
    noise: Array
    gap: Array

    @property
    def coupled(self) -> Array:
        """Mask (r, S) of the pairs and shifts whose coupling exceeds the noise."""
        return self.coupling > self.noise[:, None]

    @property
    def distance(self) -> Array:
        """Distance (r, S) from the segment 0 ≤ t ≤ 1 to the nearest exceptional point."""
        nearest = np.clip(np.real(self.roots), 0.0, 1.0)
        return np.abs(self.roots - nearest).min(axis=0)


def exceptional_points(
    overlaps: Overlaps,
    points: tuple[ModeVectors, ModeVectors],
    pairs: tuple[Array, Array],
    shifts: Array,
    noise: Array,
) -> CoupledPairs:
    """Compute the exceptional points between two neighbouring points, for every pair of modes.

    pairs (2, T): indices of each mode at the first and at the second point. shifts (T,): harmonic shifts of
    the modes of the second point. noise (T,): bound on the errors of the exponents.

    In the basis of the first point, the equations of two modes are a matrix H(t) of order 2 with H(0) =
    diag(α, β) and H(1) = W diag(α', β') W⁻¹; H is assumed to be linear in t. Its eigenvalues coincide where
    (h₁₁ - h₂₂)² + 4 h₁₂ h₂₁ = 0, at two exceptional points (T. Kato, Perturbation Theory for Linear
    Operators, II.1.1). If these are complex conjugates with a small imaginary part, the modes veer; if they
    coincide, the modes cross."""
    (now, then), (a, b) = points, pairs
    first, second = np.triu_indices(len(a), 1)
    reach = 2 + int(np.abs(shifts).max(initial=0))
    q = np.arange(-reach, reach + 1)
    at_start, at_end = now.exponents[a], then.exponents[b] + 1j * shifts * then.rotation
    delta = [
        (values[first] - values[second])[:, None] - 1j * q * rotation
        for values, rotation in ((at_start, now.rotation), (at_end, then.rotation))
    ]
    diagonal = overlaps.coefficient(a, b, shifts)
    i, j = first[:, None], second[:, None]
    # The diagonal is zero for a shift beyond the largest one.
    with np.errstate(all="ignore"):
        w = overlaps.coefficient(a[i], b[j], shifts[j] + q) / diagonal[j]
        v = overlaps.coefficient(a[j], b[i], shifts[i] - q) / diagonal[i]
        product = w * v
        end = delta[1] * (1 + product) / (1 - product)
        root_of_coupling = np.sqrt(-product + 0j) * delta[1] / (1 - product)
        roots = np.stack([delta[0] / (delta[0] - end + sign * 2j * root_of_coupling) for sign in (1, -1)])
        t = np.clip(np.real(roots).mean(axis=0), 0.0, 1.0)
        gap = np.abs(np.sqrt((delta[0] + t * (end - delta[0])) ** 2 + 4 * (t * root_of_coupling) ** 2))
    coupling = 2 * np.abs(root_of_coupling)
    limits = noise[first] + noise[second]
    return CoupledPairs(first, second, np.where(np.isfinite(roots), roots, 1e300), coupling, limits, gap)
