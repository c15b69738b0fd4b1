"""Floquet multipliers, exponents and the verdict of stability (chapter Section 2)."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

import numpy as np

from solve.arrays import Array
from solve.certify.all_multipliers import Spectrum
from solve.certify.certified import Certified, ReductionError
from solve.certify.correction import liouville_defect
from solve.methods.method import Method
from solve.period.floquet_modes import FloquetMode
from solve.period.multipliers import VERDICTS, Multipliers
from solve.results.contents import Column, Columns, Contents, Facts, plain
from solve.results.lasting import lasting
from solve.results.result import Result
from solve.results.rigid_body import RigidBodyMode, rigid_body_modes_of
from solve.system import PeriodicSystem

_STILL = 1e-12
"""Displacement by a steady velocity over a period, relative to the vibration, that is round-off of the load's
mean: some thousand terms, each to 1e-16, times a condition number up to 10."""

_RECORDED = (
    *("speed", "period", "method", "steps", "multipliers", "multiplier_errors", "unresolved", "exponents"),
    *("modes", "spectral_radius", "verdict", "stable", "error_estimate", "distance_from_one", "liouville"),
    *("condition", "rigid_body_modes", "notes"),
)
_MEANS = (
    "disturbances decay by a factor {radius:.3g} per period",
    "disturbances neither decay nor grow",
    "disturbances grow by a factor {radius:.4g} per period, and this vibration is not sustained",
    "the accuracy is insufficient to decide whether disturbances decay or grow",
)


def in_short(verdict: str) -> str:
    """A verdict in few characters."""
    return verdict.removesuffix("ally stable")


def described(method: Method) -> str:
    """A method's name and settings.

    >>> from solve.methods.newmark import Newmark
    >>> described(Newmark())
    'newmark (gamma 0.5, beta 0.25)'
    """
    numbers = [f"{name} {value}" for name, value in method.settings.items() if isinstance(value, int | float)]
    return f"{method.name} ({', '.join(numbers)})" if numbers else method.name


@lasting
class ErrorEstimate(NamedTuple):
    """orbit: per coordinate max|error|/max|q|, the largest (NaN without an orbit); multipliers:
    |error| divided by the spectral radius."""

    orbit: float
    multipliers: float


lasting(ReductionError)


@dataclass(frozen=True)
class Stability(Result):
    """Stability of the periodic motion and its certainty. Multipliers and exponents contain all 2n values;
    spectral radius and verdict exclude rigid-body modes."""

    system: PeriodicSystem
    speed: float
    certified: Certified
    spectrum: Spectrum
    engine_notes: Sequence[str] = ()

    _subject: ClassVar[str] = "motion"
    """What the verdict is about: without an orbit, any motion of the linear equations."""
    _of_solver: ClassVar[tuple[str, ...]] = ("certified", "spectrum")
    _calculated: ClassVar[tuple[str, ...]] = (
        *("method", "described", "steps", "multipliers", "exponents", "multiplier_errors", "modes"),
        *("spectral_radius", "distance_from_one", "condition", "liouville", "error_estimate", "verdict"),
        *("rigid_body_modes", "notes", "warnings", "reduction_error"),
    )

    @property
    def period(self) -> float:
        """T in seconds."""
        return self.system.period / self.speed

    @cached_property
    def method(self) -> str:
        return self.certified.method.name

    @cached_property
    def described(self) -> str:
        """The method's name and settings."""
        return described(self.certified.method)

    @cached_property
    def steps(self) -> int:
        """Steps per period."""
        return self.certified.steps

    @cached_property
    def multipliers(self) -> Array:
        """All 2n multipliers ρ (complex) in descending order of modulus, + imaginary part first; 0 if ρ
        underflows, NaN if it is unknown."""
        return self.spectrum.values

    @cached_property
    def exponents(self) -> Array:
        """λ = ln(ρ)/T in 1/s, principal branch (chapter Eq. (11)), also where ρ underflows; -inf for an exact
        zero, NaN where nothing is known."""
        return self.spectrum.logarithms / self.period

    @cached_property
    def multiplier_errors(self) -> Array:
        """Estimated error of each multiplier, relative to itself; NaN where the steps give it no digit."""
        return self.spectrum.errors

    @property
    def unresolved(self) -> int:
        """Number of multipliers without a digit, those whose error is NaN."""
        return int(np.isnan(self.multiplier_errors).sum())

    @cached_property
    def modes(self) -> Sequence[FloquetMode]:
        """Of each multiplier: its frequency modulo 2π/T (folded) and that of its mode, in rad/s."""
        return self.spectrum.modes

    @cached_property
    def spectral_radius(self) -> float:
        """Largest |ρ| without rigid-body modes; 0 if it is unresolved or there is no other multiplier."""
        if (
            self._rho.resolved[0]
            or not len(self._others)
            or math.isnan(self.multiplier_errors[self._others[0]])
        ):
            return float(self._rho.spectral_radius[0])
        return float(np.abs(self.multipliers[self._others[0]]))

    @property
    def _others(self) -> Array:
        """Positions of the multipliers that do not belong to rigid-body modes."""
        return np.flatnonzero(~self.spectrum.rigid)

    @cached_property
    def rigid_body_modes(self) -> Sequence[RigidBodyMode]:
        """Rigid-body modes, undamped ones first."""
        solutions = self.certified.solutions
        if solutions.free is None:
            return []
        return rigid_body_modes_of(solutions.free.modes, solutions.secular, self.speed)

    @cached_property
    def distance_from_one(self) -> float:
        """Smallest |ρ - 1|: 0 at resonance and on a stability boundary of kind +1."""
        return float(self._rho.distance_from_one[0])

    @cached_property
    def condition(self) -> float:
        """Condition number of the linear system that closed the orbit; NaN without an orbit."""
        return float(self.certified.solutions.condition[0])

    @property
    def _rho(self) -> Multipliers:
        return self.certified.solutions.multipliers

    @cached_property
    def liouville(self) -> float:
        """log|det Φ| of the method minus that by Liouville's formula: 0 except for modes that the steps do
        not resolve. NaN for a method without steps."""
        return liouville_defect(self.system, self.speed, self.certified.solutions)

    @cached_property
    def error_estimate(self) -> ErrorEstimate:
        """Of the orbit, and of the multipliers relative to the spectral radius; infinite where it has no
        digit."""
        orbit, multipliers = map(float, self.certified.errors[0])
        if not self._rho.resolved[0]:
            own = float(self.multiplier_errors[self._others[0]]) if len(self._others) else 0.0
            multipliers = math.inf if math.isnan(own) else max(multipliers, own)
        return ErrorEstimate(math.nan if self.certified.solutions.curve is None else orbit, multipliers)

    @cached_property
    def reduction_error(self) -> ReductionError | None:
        """Estimated error of the reduction of the system; None for a full system."""
        if not self.system.solvable or not self.certified.reduction:
            return None
        return self.certified.reduction[0]

    @cached_property
    def verdict(self) -> str:
        """ "asymptotically stable", "stable", "unstable" or "undetermined"."""
        return VERDICTS[self.certified.verdicts[0]]

    @property
    def stable(self) -> bool | None:
        """None where the verdict is undetermined."""
        return None if self.verdict == "undetermined" else self.verdict != "unstable"

    @cached_property
    def notes(self) -> list[str]:
        """How this result was made: what the method and the engine have to say."""
        of_modes = (self._turning(mode) for mode in self.rigid_body_modes)
        of_method = filter(None, self.certified.solutions.notes)
        return [*self.engine_notes, *of_method, *of_modes, *self.spectrum.notes]

    def _turning(self, mode: RigidBodyMode) -> str:
        """Note on a rigid-body mode."""
        names, units = self.system.coordinates, self.system.units
        count = "its multiplier +1" if mode.damped else "its two multipliers +1"
        text = f"rigid-body mode {mode.ratio(names)}: spectral radius and verdict exclude {count}"
        if self.certified.solutions.curve is None:
            return text
        if not mode.damped:
            return f"{text}; the vibration has zero mean along it, weighted by the inertia"
        drift, size = mode.drift or 0.0, np.abs(self.certified.solutions.curve[0].sampled(1)).max()
        if abs(drift) * self.period <= max(self.error_estimate.orbit, _STILL) * size:
            return f"{text}; it has no steady velocity along it"
        at = max(range(len(names)), key=lambda k: abs(mode.vector[k]))
        unit = units.get(names[at], "")
        shown = f"{drift * mode.vector[at]:.6g} {unit}/s".replace(" /s", " per second")
        return (
            f"{text}; load and drag balance at a steady velocity along it ({names[at]}: {shown}); velocities "
            "include it, coordinates do not"
        )

    @cached_property
    def warnings(self) -> list[str]:
        """What is doubtful about this result, a sentence each."""
        reduced = [] if self.reduction_error is None else self.reduction_error.warnings
        own = [*reduced, *self.certified.warnings(0), *self.spectrum.warnings]
        return [*own, *self.system.warnings(self.speed)]

    @property
    def summary(self) -> str:
        """The verdict in plain words."""
        means = _MEANS[VERDICTS.index(self.verdict)].format(radius=self.spectral_radius)
        at = self.system.speed_unit.text(self.speed)
        subject = self._subject
        if self.rigid_body_modes and self.certified.solutions.curve is None:
            subject += " relative to rigid-body modes"
        return f"At {at} the {subject} is {self.verdict}: {means}."

    @property
    def whole(self) -> dict[str, Any]:
        reduced = {} if self.reduction_error is None else {"reduction_error": self.reduction_error}
        return {"residual": None, **{name: getattr(self, name) for name in _RECORDED}, **reduced}

    def facts(self) -> Facts:
        """How it was solved, and how certain it is."""
        errors, checks = self._accuracy()
        return [
            ("method", f"{self.described}, {self.steps} steps a period"),
            ("errors", f"{', '.join(errors)} (relative)"),
            *(("reduced", text) for text in self._reduced()),
            ("checks", ", ".join(checks)),
            *(("note", note) for note in self.notes),
        ]

    def _reduced(self) -> list[str]:
        """Text on the error of the reduction."""
        error = self.reduction_error
        if error is None:
            return []
        return [f"{error.coordinates} of {error.full} coordinates: {', '.join(error.parts)} (relative)"]

    def _accuracy(self) -> tuple[list[str], list[str]]:
        """Errors, and what the result was checked by, in words."""
        checks = [f"Liouville {self.liouville:.1e}", f"nearest ρ to +1 at {self.distance_from_one:.2g}"]
        return [f"multipliers {self.error_estimate.multipliers:.1e}"], checks

    @property
    def metadata(self) -> dict[str, Any]:
        labels = {"units": self.system.units, "meanings": self.system.meanings}
        return {**super().metadata, **plain(labels)}

    @property
    def columns(self) -> Columns:
        """A row a multiplier."""
        rho, exponents = self.multipliers, self.exponents
        columns = {
            "multiplier_re": (np.real(rho), "1", "Floquet multiplier, real part"),
            "multiplier_im": (np.imag(rho), "1", "Floquet multiplier, imaginary part"),
            "exponent_re": (np.real(exponents), "1/s", "Floquet exponent, real part: growth"),
            "exponent_im": (np.imag(exponents), "rad/s", "Floquet exponent, imaginary part"),
            "multiplier_error": (self.multiplier_errors, "1", "estimated error relative to the multiplier"),
            "mode_frequency": (
                self._of_modes("unfolded"),
                "rad/s",
                "frequency of the mode's strongest order",
            ),
            "mode_order": (self._of_modes("order"), "1", "that order, in turns of a period"),
            "participation": (self._of_modes("participation"), "1", "part of the mode with that order"),
        }
        return {name: Column(*column, axes=("multiplier",)) for name, column in columns.items()}

    def contents(self) -> Contents:
        """In .npz and .mat complex multipliers and exponents."""
        arrays = {"multipliers": self.multipliers, "exponents": self.exponents}
        return Contents(self.columns, {}, self.metadata, arrays)

    def _of_modes(self, name: str) -> Array:
        return np.array([getattr(mode, name) for mode in self.modes], dtype=float)
