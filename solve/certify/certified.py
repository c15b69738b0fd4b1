"""Requests for solutions, and solutions with error estimates and warnings."""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from solve.arrays import Array
from solve.errors import SolveError, counted
from solve.methods.method import Method, Solutions
from solve.period.frozen import FrozenModes
from solve.period.multipliers import KNOWN_ON_CIRCLE, STABLE, UNDETERMINED, verdicts
from solve.period.points import Points

NEAR_ONE = 1e-3
"""Distance of a multiplier from +1 below which a warning is issued. Chosen by judgement: the amplitude of the
response is roughly proportional to 1/distance, and thus sensitive to small changes of the parameters."""


@dataclass(frozen=True)
class SolveRequest:
    """Requested accuracy or number of steps for the solutions of points.

    Parameters
    ----------
    orbit : bool
        Whether periodic solutions are required; otherwise, only multipliers are computed.
    rtol : float
        Tolerance of the relative errors of the orbit and of the multipliers.
    steps : int, optional
        Number of steps per period. By default, it is the number that `rtol` requires.
    engine : str
        COMPILED or NUMPY.
    reduction_method : Method
        Method for the error estimate of a reduction. It must be applicable to every system.
    reference_methods : callable
        Function that yields convergent methods for given points, each with the indices of its points. Results
        of methods that do not converge are compared with results of these methods.
    """

    orbit: bool
    rtol: float
    steps: int | None
    engine: str
    reduction_method: Method
    reference_methods: Callable[[Points], Iterator[tuple[Method, Array]]]


class ReductionError(NamedTuple):
    """Estimated errors that a reduction causes in the results; NaN if there is no estimate.

    Attributes
    ----------
    modes : int
        Number of retained modes per link.
    coordinates, full : int
        Number of coordinates of the reduced system and of the full system.
    discarded : float
        Lowest frequency, in rad/s, of the discarded modes.
    orbit : float
        Maximum of max|error|/max|q| over all coordinates of the full system; NaN without an orbit.
    multipliers : float
        Largest |error| of a multiplier, divided by the spectral radius.
    spectral_radius : float
        Error of the dominant multiplier, divided by the spectral radius.
    outputs : mapping
        max|error|/max|output| of each output.
    """

    modes: int
    coordinates: int
    full: int
    discarded: float
    orbit: float
    multipliers: float
    spectral_radius: float
    outputs: Mapping[str, float]

    @property
    def parts(self) -> list[str]:
        """Phrases that state the errors of the orbit, the multipliers and the least accurate output."""
        phrases = [] if math.isnan(self.orbit) else [f"orbit {self.orbit:.1e}"]
        phrases.append(f"multipliers {self.multipliers:.1e}")
        if self.outputs:
            worst = max(self.outputs, key=lambda name: self.outputs[name])
            phrases.append(f"outputs up to {self.outputs[worst]:.1e} ({worst})")
        return phrases

    @property
    def warnings(self) -> list[str]:
        """Warning about the reduction; empty if the reduction does not discard coordinates."""
        count = f"reduce={self.modes} keeps {self.coordinates} of {self.full} coordinates"
        if self.coordinates == self.full:
            return []
        if math.isnan(self.multipliers):
            return [f"{count}: the error cannot be estimated at this speed; increase 'reduce'"]
        return [f"{count}; estimated relative errors: {', '.join(self.parts)}"]


class InterpolationError(NamedTuple):
    """Estimated errors due to harmonics that the samples of a system do not resolve.

    Attributes
    ----------
    azimuths : int
        Number of sampled azimuths.
    harmonic : int
        Highest harmonic of the samples with an amplitude above round-off.
    orbit, multipliers : float
        Relative errors, defined as in `ErrorEstimate`; 0 if all harmonics above the resolved harmonics are
        round-off.
    sufficient : int or None
        Estimated number of azimuths that meets the tolerance; None if the harmonics do not decay.
    """

    azimuths: int
    harmonic: int
    orbit: float
    multipliers: float
    sufficient: int | None

    def is_doubtful(self, rtol: float) -> bool:
        """Whether an error exceeds the tolerance."""
        return not max(self.orbit, self.multipliers) <= rtol

    @property
    def sentence(self) -> str:
        """Sentence that states the estimated errors, and the number of azimuths that suffices."""
        if self.orbit == 0 and self.multipliers == 0:
            return (
                f"interpolated from {self.azimuths} azimuths, which suffice: harmonics end at {self.harmonic}"
            )
        errors = f"orbit {self.orbit:.1e}, multipliers {self.multipliers:.1e}"
        text = f"interpolated from {self.azimuths} azimuths: estimated relative errors {errors}"
        if self.sufficient is None:
            return f"{text}; their harmonics do not decay; sample more azimuths, or declare jumps as breaks"
        if self.sufficient <= self.azimuths:
            return f"{text}; the azimuths suffice"
        return f"{text}; about {self.sufficient} azimuths suffice"


@dataclass(frozen=True)
class Failed:
    """Index `position` of a point without a solution, and the exception that states the reason."""

    position: int
    reason: SolveError


@dataclass(frozen=True)
class Certified:
    """Solutions of points by one method on one grid, with error estimates.

    Attributes
    ----------
    positions : (k,)
        Indices of the points among the requested points.
    errors : (k, 2)
        Relative errors of orbit and multipliers.
    absolute : (k,)
        Absolute errors of the multipliers.
    modes : FrozenModes
        Modes of the points, with coefficients frozen at fixed phases.
    reduction : tuple of ReductionError
        One entry per point; empty without a reduction.
    interpolation : tuple of InterpolationError
        One entry per point; empty without interpolation. `errors` and `absolute` include these errors.
    """

    positions: Array
    method: Method
    solutions: Solutions
    errors: Array
    absolute: Array
    request: SolveRequest
    modes: FrozenModes
    reduction: tuple[ReductionError, ...] = ()
    interpolation: tuple[InterpolationError, ...] = ()

    def __len__(self) -> int:
        return len(self.positions)

    @property
    def steps(self) -> int:
        """Number of steps per period."""
        return self.solutions.grid.steps

    @cached_property
    def verdicts(self) -> Array:
        """Verdicts (k,) as indices in `VERDICTS`; see `solve.period.multipliers.verdicts`."""
        return verdicts_of(self.solutions, self.absolute, self.modes)

    @cached_property
    def _is_on_circle(self) -> Array:
        """Mask (k,) of the points whose verdict is undetermined although their multipliers are accurate."""
        return (self.absolute <= KNOWN_ON_CIRCLE) & (self.verdicts == UNDETERMINED)

    @property
    def doubtful(self) -> Array:
        """Mask (k,) of the points about which there are warnings."""
        multipliers = self.solutions.multipliers
        doubtful = (self.errors > self.request.rtol).any(axis=1) | (multipliers.distance_from_one < NEAR_ONE)
        doubtful |= (multipliers.resolved == 0) & ~_rigid_body_only(self.solutions)
        doubtful |= self._is_on_circle | bool(self.method.warnings)
        if self.request.steps is not None and not self.method.l_stable:
            doubtful |= ~self.modes.is_within(self.steps * self.method.follows / self.modes.period)
        return doubtful

    def warnings(self, at: int) -> list[str]:
        """Return the warnings about the point with index `at`, one sentence each."""
        method, request, rho = self.method, self.request, self.solutions.multipliers
        orbit, multipliers = map(float, self.errors[at])
        is_below_round_off = not rho.resolved[at] and not _rigid_body_only(self.solutions)[at]
        warnings = list(method.warnings)
        if self.interpolation:
            error = self.interpolation[at]
            orbit, multipliers = orbit - error.orbit, multipliers - error.multipliers
            if error.is_doubtful(request.rtol):
                warnings.append(error.sentence)
        if is_below_round_off:
            warnings.append(
                "all multipliers are below the round-off of the monodromy matrix; perturbations vanish "
                "within one period"
            )
        if request.steps is not None or multipliers > request.rtol:
            phase_advance = float(self.modes[np.array([at])].phase_advance[0])
            is_accurate = request.orbit and orbit <= request.rtol
            orbit_error = orbit if is_accurate else None
            warnings += unresolved_modes_warning(method, phase_advance, self.steps, orbit_error)
        warnings += self._missed_tolerances(orbit, None if is_below_round_off else multipliers)
        distance = float(rho.distance_from_one[at])
        if distance < NEAR_ONE:
            # A distance below its error is round-off, which depends on the engine.
            is_round_off = distance <= self.absolute[at]
            lies = "equals +1 within its error" if is_round_off else f"is only {distance:.1e} from +1"
            warnings.append(
                f"a multiplier {lies} (resonance or a stability boundary): "
                "the amplitude of the response is unreliable here"
            )
        if self._is_on_circle[at]:
            has_unresolved = rho.values.shape[-1] > rho.resolved[at]
            error = max(float(self.absolute[at]), float(rho.bound[at]) if has_unresolved else 0.0)
            warnings.append(
                f"within their error ({error:.1e}), some multipliers lie on the unit circle or "
                "coincide on it: the accuracy is not sufficient to decide whether the motion remains bounded"
            )
        return warnings

    def _missed_tolerances(self, orbit: float, multipliers: float | None) -> list[str]:
        """Return a warning if an error exceeds the tolerance; otherwise an empty list."""
        errors = {"orbit": orbit} if multipliers is None else {"orbit": orbit, "multipliers": multipliers}
        rtol, steps = self.request.rtol, self.request.steps
        missed = [f"{name} to {error:.1e}" for name, error in errors.items() if error > rtol]
        if not missed:
            return []
        where = "at the attainable accuracy" if steps is None else f"with {counted(steps, 'step')}"
        where = where if self.method.converges else "is an approximation that"
        return [f"{self.method.name} {where} gives the {' and the '.join(missed)} only, not to rtol {rtol:g}"]


def verdicts_of(solutions: Solutions, errors: Array, modes: FrozenModes) -> Array:
    """Return the verdicts (P,), as indices in `VERDICTS`, on the motion without the rigid-body modes. If only
    rigid-body motion exists, the verdict is "stable"."""
    of_vibration = verdicts(solutions.Phi, solutions.multipliers, errors, modes)
    return np.where(_rigid_body_only(solutions), STABLE, of_vibration)


def _rigid_body_only(solutions: Solutions) -> Array:
    """Return a mask (P,) of the points all of whose multipliers belong to rigid-body modes."""
    if solutions.free is None:
        return np.zeros(len(solutions), dtype=bool)
    return np.asarray(solutions.free.modes.multiplicity == solutions.Phi.shape[-1])


def unresolved_modes_warning(
    method: Method, phase_advance: float, steps: int, orbit_error: float | None = None
) -> list[str]:
    """Return a warning if the method does not damp modes that its steps do not resolve; otherwise an empty
    list.

    phase_advance: ω_max T in rad. orbit_error: error of the orbit, if this error is small.
    """
    if method.l_stable or phase_advance <= steps * method.follows:
        return []
    enough = f", or at least {math.ceil(phase_advance / method.follows)} steps" if method.converges else ""
    right = "" if orbit_error is None else f", although the error of the orbit is {orbit_error:.1e}"
    return [
        f"ω_max h = {phase_advance / steps:.2g}: {counted(steps, 'step leaves', 'steps leave')} stiff modes "
        f"unresolved, and {method.name} neither resolves nor damps them: the multipliers may be "
        f"wrong{right}; use radau{enough}"
    ]
