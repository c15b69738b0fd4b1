"""Floquet multipliers, exponents and the three verdicts of stability (chapter Section 2)."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from solve.arrays import Array
from solve.certify.certificate import Certified
from solve.system import PeriodicSystem

UNIT_CIRCLE = 1e-9
"""Distance from 1 within which a modulus counts as 1, unless its error estimate is larger."""

NEAR_ONE = 1e-3
"""Distance of a multiplier from +1 below which the height of a response deserves a warning."""


class ErrorEstimate(NamedTuple):
    """orbit: per coordinate max|error|/max|q|, the largest (NaN without an orbit); multipliers:
    |error| divided by the spectral radius."""

    orbit: float
    multipliers: float


@dataclass(frozen=True)
class Stability:
    """Whether disturbances of the periodic motion die out, and how certain that is."""

    system: PeriodicSystem
    speed: float
    certified: Certified

    @property
    def period(self) -> float:
        """T in seconds."""
        return self.system.period / self.speed

    @property
    def method(self) -> str:
        return self.certified.method.name

    @property
    def steps(self) -> int:
        """Steps per period."""
        return self.certified.solution.grid.steps

    @property
    def multipliers(self) -> Array:
        """Resolved multipliers ρ (complex), falling in modulus, + imaginary part first."""
        return self.certified.solution.multipliers.values

    @property
    def unresolved(self) -> int:
        """Number of further multipliers, all below eps‖Φ‖."""
        return self.certified.solution.multipliers.unresolved

    @property
    def exponents(self) -> Array:
        """λ = ln(ρ)/T in 1/s, principal branch (chapter Eq. (11))."""
        return np.log(self.multipliers) / self.period

    @property
    def spectral_radius(self) -> float:
        """Largest |ρ|."""
        return self.certified.solution.multipliers.spectral_radius

    @property
    def distance_from_one(self) -> float:
        """Smallest |ρ - 1|: 0 at resonance and on a stability boundary of kind +1."""
        return self.certified.solution.multipliers.distance_from_one

    @property
    def condition(self) -> float:
        """Condition number of the linear system that closed the orbit; NaN without an orbit."""
        return self.certified.solution.condition

    @cached_property
    def liouville(self) -> float:
        """log|det Φ| of the method less -∫ tr(M⁻¹C) dt of the system, which Liouville's formula makes
        equal: 0 but for the modes that the steps do not follow. NaN for a method without steps."""
        solution = self.certified.solution
        if solution.steps is None:
            return math.nan
        nodes, weights = np.polynomial.legendre.leggauss(3)
        phases = solution.grid.stages((nodes + 1) / 2)
        M, C, _, _ = self.system.in_phase(phases.ravel(), self.speed)
        rates = np.einsum("kii->k", np.linalg.solve(M, C)).reshape(phases.shape)
        volume = -float(solution.grid.h @ rates @ weights) / 2
        return float(np.linalg.slogdet(solution.steps.A)[1].sum()) - volume

    @property
    def error_estimate(self) -> ErrorEstimate:
        orbit = self.certified.orbit_error if self.certified.solution.curve is not None else math.nan
        return ErrorEstimate(orbit, self.certified.multiplier_error)

    @cached_property
    def verdict(self) -> str:
        """ "asymptotically stable", "stable" or "unstable"."""
        return verdict(self.certified.solution.Phi, self.multipliers, self.error_estimate.multipliers)

    @property
    def stable(self) -> bool:
        return self.verdict != "unstable"

    @property
    def notes(self) -> list[str]:
        """What the method has to say about how it found this result."""
        return self.certified.solution.notes

    @cached_property
    def warnings(self) -> list[str]:
        """What is doubtful about this result, a sentence each."""
        near = self.distance_from_one
        warnings = [*self.certified.warnings, *self.system.doubts(self.speed)]
        if near < NEAR_ONE:
            warnings.append(
                f"a multiplier is only {near:.1e} from +1 (resonance or a stability boundary): "
                "the height of the response means little here"
            )
        return warnings


def verdict(Phi: Array, multipliers: Array, error: float) -> str:
    """ "asymptotically stable", "stable" or "unstable".

    error: of the multipliers, relative to the spectral radius. A modulus counts as 1 within that error
    (absolute, where the radius is below 1) or 1e-9, whichever is larger. Multipliers on the unit circle
    leave the system stable only where their algebraic equals their geometric multiplicity (chapter
    Section 2).
    """
    modulus = np.abs(multipliers)
    radius = float(modulus.max(initial=0.0))
    tolerance = max(error * min(radius, 1.0), UNIT_CIRCLE) if radius else UNIT_CIRCLE
    if np.all(modulus < 1 - tolerance):
        return "asymptotically stable"
    if np.any(modulus > 1 + tolerance):
        return "unstable"
    # A double multiplier of a defective block splits by the square root of a perturbation.
    cluster = math.sqrt(tolerance)
    for value in multipliers[np.abs(modulus - 1) <= tolerance]:
        algebraic = int(np.sum(np.abs(multipliers - value) <= cluster))
        if algebraic > 1:
            singular = np.linalg.svd(Phi - value * np.eye(len(Phi)), compute_uv=False)
            if np.sum(singular <= 10 * cluster * max(singular[0], 1.0)) < algebraic:
                return "unstable"
    return "stable"
