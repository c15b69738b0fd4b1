"""Floquet multipliers, exponents and the stability verdict (section 2 of the chapter)."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple

import numpy as np

from solve.arrays import ROUND_OFF, Array
from solve.certify.all_multipliers import Spectrum
from solve.certify.certified import Certified, InterpolationError, ReductionError
from solve.certify.correction import liouville_defect
from solve.equations import warnings_of
from solve.errors import counted
from solve.methods.method import Method
from solve.period.floquet_modes import FloquetMode
from solve.period.multipliers import VERDICTS, Multipliers
from solve.results.contents import Column, Columns, FileContents, HeaderRows, to_json
from solve.results.result import Result
from solve.results.rigid_body import RigidBodyMode, rigid_body_modes_of
from solve.results.serialization import NOT_STORED, serializable, stored_property
from solve.system import PeriodicSystem

_CONSEQUENCES = (
    "perturbations decay by a factor {radius:.3g} per period",
    "perturbations neither decay nor grow",
    "perturbations grow by a factor {radius:.4g} per period, so that the periodic vibration does not persist",
    "the accuracy is insufficient to decide whether perturbations decay or grow",
)
"""Texts that state the consequence of each verdict."""


def short_verdict(verdict: str) -> str:
    """Return a short text for a verdict, for narrow columns.

    >>> short_verdict("asymptotically stable")
    'asympt. stable'
    """
    return verdict.replace("asymptotically", "asympt.")


def method_text(method: Method) -> str:
    """Return a string with the name and the settings of a method.

    >>> from solve.methods.newmark import Newmark
    >>> method_text(Newmark())
    'newmark (gamma 0.5, beta 0.25)'
    """
    numbers = [f"{name} {value}" for name, value in method.settings.items() if isinstance(value, int | float)]
    return f"{method.name} ({', '.join(numbers)})" if numbers else method.name


@serializable
class ErrorEstimate(NamedTuple):
    """Estimated relative errors of orbit and multipliers.

    Parameters
    ----------
    orbit : float
        Largest value of max|error| / max|q| of any coordinate; NaN without an orbit.
    multipliers : float
        Largest |error| of any multiplier, divided by the spectral radius.
    """

    orbit: float
    multipliers: float


serializable(ReductionError)
serializable(InterpolationError)


@dataclass(frozen=True)
class Solution(Result):
    """Solution of a system at one speed, with method, grid and checks.

    Attributes
    ----------
    system : PeriodicSystem
        System that was solved.
    speed : float
        Speed in rad/s.
    certified : Certified
        Numerical solution with its error estimates.
    spectrum : Spectrum
        Multipliers and modes.
    engine_notes : sequence of str
        Notes on the selection of the engine.
    """

    system: PeriodicSystem
    speed: float
    certified: Certified = field(metadata=NOT_STORED)
    spectrum: Spectrum = field(metadata=NOT_STORED)
    engine_notes: Sequence[str] = ()

    @property
    def period(self) -> float:
        """Period T in s."""
        return self.system.period / self.speed

    @stored_property
    def method(self) -> str:
        """Name of the method."""
        return self.certified.method.name

    @stored_property
    def described(self) -> str:
        """Name and settings of the method."""
        return method_text(self.certified.method)

    @stored_property
    def steps(self) -> int:
        """Number of steps per period."""
        return self.certified.steps

    @stored_property
    def condition(self) -> float:
        """Condition number of the linear system for the initial state of the orbit; NaN without an orbit."""
        return float(self.certified.solutions.condition[0])

    @stored_property
    def liouville(self) -> float:
        """Difference between log|det Φ| by the method and by Liouville's formula; the difference is caused by
        modes that the steps do not resolve. NaN for a method without steps."""
        known = np.where(np.isfinite(self.multiplier_errors), self.spectrum.logarithms, np.nan)
        return liouville_defect(self.system, self.speed, self.certified.solutions, known)

    @stored_property
    def reduction_error(self) -> ReductionError | None:
        """Estimated error of the reduction of the system; None for a full system."""
        if not self.system.labels.solvable or not self.certified.reduction:
            return None
        return self.certified.reduction[0]

    @stored_property
    def interpolation_error(self) -> InterpolationError | None:
        """Estimated error of the interpolation of sampled matrices; None for systems that are not sampled.
        `error_estimate` includes this error."""
        if not self.system.labels.solvable or not self.certified.interpolation:
            return None
        return self.certified.interpolation[0]


@dataclass(frozen=True)
class Stability(Solution):
    """Stability of the periodic motion of a system at one speed, from `solve.floquet`.

    `multipliers` and `exponents` contain all N values: two per coordinate, or one per first-order state. The
    spectral radius and the verdict exclude rigid-body modes.

    Attributes
    ----------
    multipliers : (N,) complex array
        Floquet multipliers ρ in order of decreasing modulus.
    exponents : (N,) complex array
        Floquet exponents λ = ln(ρ)/T in 1/s.
    spectral_radius : float
        Largest |ρ|.
    verdict : str
        "asymptotically stable", "stable", "unstable" or "undetermined".
    stable : bool or None
        Whether the motion is stable; None if the verdict is undetermined.
    error_estimate : ErrorEstimate
        Estimated relative errors.
    warnings : list of str
        Sentences on what is doubtful.
    """

    _recorded: ClassVar[str] = (
        "speed period method steps multipliers multiplier_errors unresolved exponents modes spectral_radius "
        "verdict stable error_estimate distance_from_one liouville condition rigid_body_modes notes"
    )
    _subject: ClassVar[str] = "motion"
    """Subject of sentences about the verdict. Without an orbit, the verdict applies to every motion of the
    linear equations."""

    @stored_property
    def multipliers(self) -> Array:
        """Complex multipliers ρ (N,) in descending order of modulus. In conjugate pairs, the multiplier with
        positive imaginary part comes first. A multiplier is 0 if it underflows, and NaN if it is unknown."""
        return self.spectrum.values

    @stored_property
    def exponents(self) -> Array:
        """Exponents λ = ln(ρ)/T (N,) in 1/s, on the principal branch (Eq. (11) of the chapter). An exponent
        is finite even if ρ underflows; it is -inf if ρ is exactly 0, and NaN if ρ is unknown."""
        return self.spectrum.logarithms / self.period

    @stored_property
    def multiplier_errors(self) -> Array:
        """Estimated relative errors (N,) of the individual multipliers; NaN if a multiplier is not accurate
        to one digit."""
        return self.spectrum.errors

    @property
    def unresolved(self) -> int:
        """Number of multipliers that are not accurate to one digit; their error is NaN."""
        return int(np.isnan(self.multiplier_errors).sum())

    @stored_property
    def modes(self) -> Sequence[FloquetMode]:
        """Mode of each multiplier, with its frequency in rad/s, and with the same frequency folded modulo
        2π/T."""
        return self.spectrum.modes

    @stored_property
    def spectral_radius(self) -> float:
        """Largest |ρ| without rigid-body modes; 0 if the largest multiplier is unresolved, or if all
        multipliers belong to rigid-body modes."""
        if (
            self._rho.resolved[0]
            or not len(self._others)
            or math.isnan(self.multiplier_errors[self._others[0]])
        ):
            return float(self._rho.spectral_radius[0])
        return float(np.abs(self.multipliers[self._others[0]]))

    @property
    def _others(self) -> Array:
        """Indices of the multipliers that do not belong to rigid-body modes."""
        return np.flatnonzero(~self.spectrum.rigid)

    @stored_property
    def rigid_body_modes(self) -> Sequence[RigidBodyMode]:
        """Rigid-body modes; undamped modes come first."""
        solutions = self.certified.solutions
        if solutions.free is None:
            return []
        return rigid_body_modes_of(solutions.free.modes, solutions.secular, self.speed)

    @stored_property
    def distance_from_one(self) -> float:
        """Smallest |ρ - 1| of any multiplier ρ; 0 at resonance, and on a stability boundary of kind +1."""
        return float(self._rho.distance_from_one[0])

    @property
    def _rho(self) -> Multipliers:
        return self.certified.solutions.multipliers

    @stored_property
    def error_estimate(self) -> ErrorEstimate:
        """Errors of the orbit and of the multipliers. The error of the multipliers is infinite if the
        spectral radius is not accurate to one digit."""
        orbit, multipliers = map(float, self.certified.errors[0])
        if not self._rho.resolved[0]:
            largest = float(self.multiplier_errors[self._others[0]]) if len(self._others) else 0.0
            multipliers = math.inf if math.isnan(largest) else max(multipliers, largest)
        return ErrorEstimate(math.nan if self.certified.solutions.curve is None else orbit, multipliers)

    @stored_property
    def verdict(self) -> str:
        """Text "asymptotically stable", "stable", "unstable" or "undetermined"."""
        return VERDICTS[self.certified.verdicts[0]]

    @property
    def stable(self) -> bool | None:
        """Whether the motion is stable; None if the verdict is undetermined."""
        return None if self.verdict == "undetermined" else self.verdict != "unstable"

    @stored_property
    def notes(self) -> list[str]:
        """Notes on the engine, the method, and rigid-body modes."""
        modes = (self._rigid_body_note(mode) for mode in self.rigid_body_modes)
        method = filter(None, self.certified.solutions.notes)
        error = self.interpolation_error
        sampled = [] if error is None or error.is_doubtful(self.certified.request.rtol) else [error.sentence]
        return [*self.engine_notes, *method, *modes, *self.spectrum.notes, *sampled]

    def _rigid_body_note(self, mode: RigidBodyMode) -> str:
        """Note that describes a rigid-body mode and its effect on the result."""
        names, units = self.system.coordinates, self.system.labels.units
        count = "its multiplier +1" if mode.damped else "its two multipliers +1"
        text = f"rigid-body mode {mode.ratio(names)}: spectral radius and verdict exclude {count}"
        if self.certified.solutions.curve is None:
            return text
        if not mode.damped:
            return f"{text}; the inertia-weighted mean of the vibration along this mode is zero"
        drift, size = mode.drift or 0.0, np.abs(self.certified.solutions.curve[0].sampled(1)).max()
        if abs(drift) * self.period <= max(self.error_estimate.orbit, ROUND_OFF) * size:
            return f"{text}; the motion has no steady velocity along this mode"
        largest = max(range(len(names)), key=lambda k: abs(mode.vector[k]))
        unit = units.get(names[largest], "")
        velocity = f"{drift * mode.vector[largest]:.6g} {unit}/s".replace(" /s", " per second")
        return (
            f"{text}; load and drag balance at a steady velocity along this mode ({names[largest]}: "
            f"{velocity}); the velocities of the result include this velocity, the coordinates exclude it"
        )

    @stored_property
    def warnings(self) -> list[str]:
        """Warnings about the result, one sentence each."""
        reduction = [] if self.reduction_error is None else self.reduction_error.warnings
        numerical = [*reduction, *self.certified.warnings(0), *self.spectrum.warnings]
        return [*numerical, *warnings_of(self.system, self.speed)]

    @property
    def summary(self) -> str:
        """Sentence on the verdict and its consequence."""
        consequence = _CONSEQUENCES[VERDICTS.index(self.verdict)].format(radius=self.spectral_radius)
        speed = self.system.labels.speed_unit.text(self.speed)
        subject = self._subject
        if self.rigid_body_modes and self.certified.solutions.curve is None:
            subject += " relative to rigid-body modes"
        return f"At {speed} the {subject} is {self.verdict}: {consequence}."

    @property
    def summary_values(self) -> dict[str, Any]:
        reduction = {} if self.reduction_error is None else {"reduction_error": self.reduction_error}
        sampled = (
            {} if self.interpolation_error is None else {"interpolation_error": self.interpolation_error}
        )
        return {"residual": None, **super().summary_values, **reduction, **sampled}

    def header_rows(self) -> HeaderRows:
        """Rows of the heading: method, errors, checks and notes."""
        errors, checks = self._accuracy()
        return [
            ("method", f"{self.described}, {counted(self.steps, 'step')} per period"),
            ("errors", f"{', '.join(errors)} (relative)"),
            *(("reduced", text) for text in self._reduced()),
            ("checks", ", ".join(checks)),
            *(("note", note) for note in self.notes),
        ]

    def _reduced(self) -> list[str]:
        """Text on the error of the system's reduction; empty for a full system."""
        error = self.reduction_error
        if error is None:
            return []
        return [f"{error.coordinates} of {error.full} coordinates: {', '.join(error.parts)} (relative)"]

    def _accuracy(self) -> tuple[list[str], list[str]]:
        """Texts that state the errors, and texts that state the checks."""
        liouville = f"Liouville {self.liouville:.1e}"
        if self.unresolved:
            liouville += f" owing to {counted(self.unresolved, 'unresolved multiplier')}"
        checks = [liouville, f"nearest ρ to +1 at {self.distance_from_one:.2g}"]
        return [f"multipliers {self.error_estimate.multipliers:.1e}"], checks

    @property
    def metadata(self) -> dict[str, Any]:
        labels = {"units": self.system.labels.units, "meanings": self.system.labels.meanings}
        return {**super().metadata, **to_json(labels)}

    @property
    def columns(self) -> Columns:
        """Columns of the table, with one row per multiplier."""
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
                "frequency of the mode's strongest harmonic",
            ),
            "mode_order": (self._of_modes("order"), "1", "order of that harmonic, per period"),
            "participation": (
                self._of_modes("participation"),
                "1",
                "fraction of the mode in that harmonic",
            ),
        }
        return {name: Column(*column, axes=("multiplier",)) for name, column in columns.items()}

    def file_contents(self) -> FileContents:
        """Columns of the table, with one row per multiplier. Files .npz and .mat contain complex multipliers
        and exponents."""
        arrays = {"multipliers": self.multipliers, "exponents": self.exponents}
        return FileContents(self.columns, {}, self.metadata, arrays)

    def _of_modes(self, name: str) -> Array:
        return np.array([getattr(mode, name) for mode in self.modes], dtype=float)
