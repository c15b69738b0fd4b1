"""Floquet multipliers, exponents and the verdict of stability (chapter Section 2)."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from solve.arrays import Array
from solve.certify.all_multipliers import AllMultipliers
from solve.certify.certified import Certified
from solve.period.multipliers import VERDICTS, Multipliers, verdicts
from solve.results.contents import Contents, Variable, model_record, plain
from solve.results.plot import StabilityPanel, stability_figure
from solve.results.report import RenderableType, Table, described, heading, stacked, table
from solve.results.style import Figure
from solve.system import PeriodicSystem

_MOST_MULTIPLIERS = 8
_RECORDED = (
    *("multipliers", "multiplier_errors", "unresolved", "exponents", "spectral_radius", "verdict", "stable"),
    *("error_estimate", "distance_from_one", "liouville", "condition", "notes"),
)
_VERDICT_STYLE = dict(zip(VERDICTS, ("bold green", "bold yellow", "bold red", "bold magenta"), strict=True))


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
    every: AllMultipliers | None = None
    """All multipliers with errors of their own, where they were asked for."""

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
        """Multipliers ρ (complex), falling in modulus, + imaginary part first: resolved ones, or all 2n where
        all were asked for, of which some may underflow to 0."""
        if self.every is not None:
            return np.exp(self.every.logarithms)
        return self._rho.values[0, : int(self._rho.resolved[0])]

    @property
    def unresolved(self) -> int:
        """Number of multipliers without a digit: further ones below eps‖Φ‖, or of all those whose error is
        NaN."""
        if self.every is not None:
            return self.every.unresolved
        return self._rho.values.shape[1] - int(self._rho.resolved[0])

    @property
    def exponents(self) -> Array:
        """λ = ln(ρ)/T in 1/s, principal branch (chapter Eq. (11)); aligned with the multipliers, also where
        these underflow."""
        if self.every is not None:
            return self.every.logarithms / self.period
        return np.log(self.multipliers) / self.period

    @property
    def multiplier_errors(self) -> Array:
        """Estimated error of each multiplier, relative to itself; NaN where it has no digit."""
        if self.every is not None:
            return self.every.errors
        return self.certified.absolute[0] / np.abs(self.multipliers)

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
        of_all = [] if self.every is None else self.every.warnings
        return [*self.certified.warnings(0), *of_all, *self.system.warnings(self.speed)]

    @property
    def problem(self) -> dict[str, Any]:
        """What was solved, and how, as plain data."""
        solved = {"speed": self.speed, "period": self.period, "method": self.method, "steps": self.steps}
        return {**model_record(self.system), **solved}

    def record(self) -> dict[str, Any]:
        """Of `solve floquet --json`."""
        return plain({**self.problem, **self._verdict_record, "residual": None, "warnings": self.warnings})

    @property
    def _verdict_record(self) -> dict[str, Any]:
        found = {name: getattr(self, name) for name in _RECORDED}
        return {**found, "error_estimate": self.error_estimate._asdict()}

    def report(self, choices: Sequence[str] = ()) -> RenderableType:
        """Everything that `solve floquet` has to say but its warnings."""
        return stacked(self._heading(choices), self._multiplier_table(), self._verdict_line())

    def _heading(self, choices: Sequence[str]) -> Table:
        grid = heading(self.system, self.speed, choices)
        grid.add_row("method", f"{described(self.certified.method)}, {self.steps} steps a period")
        errors, checks = self._accuracy()
        grid.add_row("errors", f"{', '.join(errors)} (relative)")
        grid.add_row("checks", ", ".join(checks))
        for note in self.notes:
            grid.add_row("note", note)
        return grid

    def _accuracy(self) -> tuple[list[str], list[str]]:
        """Errors, and what the result was checked by, in words."""
        checks = [f"Liouville {self.liouville:.1e}", f"nearest ρ to +1 at {self.distance_from_one:.2g}"]
        return [f"multipliers {self.error_estimate.multipliers:.1e}"], checks

    def _multiplier_table(self) -> Table:
        columns = "Re ρ", "Im ρ", "|ρ|", "growth (1/s)", "frequency (Hz)"
        made = table("Floquet multipliers ρ", *columns, left=0)
        every = zip(self.multipliers, self.exponents, strict=True)
        pairs = [(rho, exponent) for rho, exponent in every if rho.imag >= 0]
        for rho, exponent in pairs[:_MOST_MULTIPLIERS]:
            made.add_row(
                f"{rho.real:.7g}",
                f"± {rho.imag:.7g}" if rho.imag else "0",
                f"{abs(rho):.7g}",
                f"{exponent.real:.5g}",
                f"{exponent.imag / (2 * math.pi):.5g}",
            )
        smaller = len(pairs) - _MOST_MULTIPLIERS
        rest = [f"{smaller} smaller"] * (smaller > 0)
        lost = "without a digit" if self.every is not None else "lost in rounding: practically 0"
        rest += [f"{self.unresolved} {lost}"] * (self.unresolved > 0)
        if rest:
            made.caption = "and " + ", ".join(rest)
        return made

    def _verdict_line(self) -> RenderableType:
        from rich.text import Text

        radius, error = self.spectral_radius, self.error_estimate.multipliers
        line = Text("\n").append(self.verdict, _VERDICT_STYLE[self.verdict])
        return line.append(f": spectral radius {radius:.10g} ± {error * radius:.0e}")

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
        rho, exponents = self.multipliers, self.exponents
        columns = {
            "multiplier_re": (np.real(rho), "1", "Floquet multiplier, real part"),
            "multiplier_im": (np.imag(rho), "1", "Floquet multiplier, imaginary part"),
            "exponent_re": (np.real(exponents), "1/s", "Floquet exponent, real part: growth"),
            "exponent_im": (np.imag(exponents), "rad/s", "Floquet exponent, imaginary part"),
        }
        variables = {name: Variable("multiplier", *column) for name, column in columns.items()}
        return Contents(variables, {}, {"multipliers": rho, "exponents": exponents}, plain(metadata))

    def plot(self) -> Figure:
        """Multipliers on the unit circle, and a closer look at small ones."""
        return stability_figure(self.system, self.speed, self._panel)

    @property
    def _panel(self) -> StabilityPanel:
        orbit, multipliers = self.error_estimate
        lines = [
            f"|ρ| max = {self.spectral_radius:.6g}",
            f"{self.method}, {self.steps} steps",
            f"error of multipliers {multipliers:.0e}",
        ]
        if not math.isnan(orbit):
            lines.append(f"error of orbit {orbit:.0e}")
        return StabilityPanel(self.multipliers, self.verdict, lines)
