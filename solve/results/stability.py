"""Floquet multipliers, exponents and the verdict of stability (chapter Section 2)."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from solve.arrays import Array
from solve.certify.certified import Certified
from solve.period.multipliers import VERDICTS, Multipliers, verdicts
from solve.results.contents import Contents, stability_contents
from solve.results.plot import StabilityPanel, stability_figure
from solve.results.record import problem_record
from solve.results.style import Figure
from solve.system import PeriodicSystem


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
    engine_notes: Sequence[str] = ()

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
        return self.certified.steps

    @property
    def multipliers(self) -> Array:
        """Resolved multipliers ρ (complex), falling in modulus, + imaginary part first."""
        return self._rho.values[0, : int(self._rho.resolved[0])]

    @property
    def unresolved(self) -> int:
        """Number of further multipliers, all below eps‖Φ‖."""
        return self._rho.values.shape[1] - int(self._rho.resolved[0])

    @property
    def exponents(self) -> Array:
        """λ = ln(ρ)/T in 1/s, principal branch (chapter Eq. (11))."""
        return np.log(self.multipliers) / self.period

    @property
    def spectral_radius(self) -> float:
        """Largest |ρ|."""
        return float(self._rho.spectral_radius[0])

    @property
    def distance_from_one(self) -> float:
        """Smallest |ρ - 1|: 0 at resonance and on a stability boundary of kind +1."""
        return float(self._rho.distance_from_one[0])

    @property
    def condition(self) -> float:
        """Condition number of the linear system that closed the orbit; NaN without an orbit."""
        return float(self.certified.solutions.condition[0])

    @property
    def _rho(self) -> Multipliers:
        return self.certified.solutions.multipliers

    @cached_property
    def liouville(self) -> float:
        """log|det Φ| of the method less -∫ tr(M⁻¹C) dt of the system, which Liouville's formula makes
        equal: 0 but for the modes that the steps do not follow. NaN for a method without steps."""
        solution = self.certified.solutions
        if solution.steps is None:
            return math.nan
        nodes, weights = np.polynomial.legendre.leggauss(3)
        phases = solution.grid.stages((nodes + 1) / 2)
        M, C, _, _ = self.system.in_phase(phases.ravel(), self.speed)
        rates = np.einsum("kii->k", np.linalg.solve(M, C)).reshape(phases.shape)
        volume = -float(solution.grid.h @ rates @ weights) / 2
        return float(np.linalg.slogdet(solution.steps.A[0])[1].sum()) - volume

    @property
    def error_estimate(self) -> ErrorEstimate:
        orbit, multipliers = map(float, self.certified.errors[0])
        return ErrorEstimate(math.nan if self.certified.solutions.curve is None else orbit, multipliers)

    @cached_property
    def verdict(self) -> str:
        """ "asymptotically stable", "stable", "unstable" or "undetermined"."""
        return VERDICTS[verdicts(self.certified.solutions.Phi, self._rho, self.certified.absolute)[0]]

    @property
    def stable(self) -> bool | None:
        """None where the verdict is undetermined."""
        return None if self.verdict == "undetermined" else self.verdict != "unstable"

    @property
    def notes(self) -> list[str]:
        """How this result was made: what the method and the engine have to say."""
        return [*self.engine_notes, *filter(None, self.certified.solutions.notes)]

    @cached_property
    def warnings(self) -> list[str]:
        """What is doubtful about this result, a sentence each."""
        return [*self.certified.warnings(0), *self.system.warnings(self.speed)]

    @property
    def problem(self) -> dict[str, Any]:
        """What was solved, and how, as plain data."""
        return problem_record(self.system, self.speed, self.method, self.steps)

    def contents(self) -> Contents:
        """Multipliers and exponents, for a file."""
        metadata = {
            **self.problem,
            "spectral_radius": self.spectral_radius,
            "verdict": self.verdict,
            "error_estimate": self.error_estimate._asdict(),
            "warnings": self.warnings,
            "units": dict(self.system.units),
            "meanings": dict(self.system.meanings),
        }
        return stability_contents(self.multipliers, self.exponents, metadata)

    def plot(self) -> Figure:
        """Multipliers on the unit circle, and a closer look at small ones."""
        return stability_figure(self.system, self.speed, self._drawn)

    @property
    def _drawn(self) -> StabilityPanel:
        orbit, multipliers = self.error_estimate
        lines = [
            f"|ρ| max = {self.spectral_radius:.6g}",
            f"{self.method}, {self.steps} steps",
            f"error of multipliers {multipliers:.0e}",
        ]
        if not math.isnan(orbit):
            lines.append(f"error of orbit {orbit:.0e}")
        return StabilityPanel(self.multipliers, self.verdict, lines)
