"""Controllers: gain versus phase, solution of the Riccati equation, and stability of the closed loop."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from solve.arguments import matches_annotations
from solve.arrays import Array, symmetric_of, uniform_phases
from solve.first_order import FirstOrderSystem
from solve.matrices import finite_phases
from solve.period.curve import Curve
from solve.results.contents import DEGREES, Column, Columns, FileContents, HeaderRows, to_json
from solve.results.result import Result
from solve.results.serialization import serializable, stored_property
from solve.results.stability import Stability
from solve.system import PeriodicSystem

_HARMONICS = 12
"""Number of harmonics of the gain in the record. Chosen by judgement."""

_TITLES = {"lqr": "regulator", "kalman": "Kalman filter", "lqg": "regulator with a Kalman filter"}


@serializable
class Vibration(NamedTuple):
    """Vibration of a quantity in SI units. `without` and `controlled` are the largest absolute values over a
    period without and with feedback; `rms` is the root mean square with feedback."""

    without: float
    controlled: float
    rms: float


@serializable
class StabilityMargin(NamedTuple):
    """Smallest relative change of parameters that makes a system unstable.

    Attributes
    ----------
    distance : float
        Norm of the change; infinite if no change of norm up to 1 makes the system unstable.
    changes : mapping
        Relative changes of the parameters.
    verdicts : tuple of str
        Verdicts just inside and just outside the boundary.
    """

    distance: float
    changes: Mapping[str, float]
    verdicts: tuple[str, ...]


@serializable
class Norms(NamedTuple):
    """Norms of the transfer from disturbances at the inputs to a state or output, in SI units.

    Attributes
    ----------
    h2, hinf : float
        H2 norm and H∞ norm of the closed loop.
    h2_without, hinf_without : float or None
        The same norms without feedback; None if the system without feedback is not asymptotically stable.
    frequency : float or None
        Frequency in rad/s, at most π/T, at which the closed loop has its largest gain.
    error : float
        Largest relative error of these norms.
    warnings : tuple of str
        Reasons to doubt the norms.
    """

    h2: float
    hinf: float
    h2_without: float | None
    hinf_without: float | None
    frequency: float | None
    error: float
    warnings: tuple[str, ...] = ()


@serializable
class SampledLoop(NamedTuple):
    """Closed loop whose feedback is sampled and held.

    Attributes
    ----------
    samples, delay : int
        Number of samples per period, and number of samples after which inputs act.
    spectral_radius, error : float
        Largest modulus of the multipliers, and its absolute error.
    verdict : str
        "asymptotically stable", "unstable" or "undetermined".
    largest : mapping of str to float
        Largest absolute values of coordinates and inputs on the periodic orbit, at the nodes of the grid, in
        SI units.
    """

    samples: int
    delay: int
    spectral_radius: float
    error: float
    verdict: str
    largest: Mapping[str, float]

    @property
    def rate(self) -> str:
        """Text that states the number of samples per period."""
        return f"{self.samples} sample{'s' * (self.samples != 1)} per period"


@dataclass(frozen=True)
class Controller(Result):
    """Periodic feedback, from `solve.lqr`, `solve.kalman`, `solve.lqg` or `solve.control`.

    Attributes
    ----------
    system : PeriodicSystem
        System without feedback.
    speed : float
        Ω in rad/s.
    kind : str
        "lqr", "kalman" or "lqg".
    states : tuple of str
        Names of the N states.
    signals : tuple of str
        Names of the r inputs or, for a filter without a regulator, of the measured quantities.
    solution, gains : Curve
        Curve of the upper triangle of the solution, and curve of the entries of the gain, row by row.
    closed : PeriodicSystem
        Closed loop; for a filter alone, the equations of the estimation error.
    stability : Stability
        Certified multipliers of the closed loop at the speed.
    error_estimate : float
        Largest error of the solution X over the period, relative to √(max X_ii max X_jj).
    residual : float
        Largest residual of the Riccati equation, relative to its largest term; entries are scaled by √(X_ii
        X_jj).
    rtol : float
        Requested relative tolerance.
    observer : Controller or None
        Filter, for results of `solve.lqg`.
    vibration : mapping of str to Vibration
        Periodic vibration of coordinates and inputs, without and with feedback, if it was requested.
    ahead : Curve or None
        Curve of the feedforward.
    margin : StabilityMargin or None
        Smallest relative change of parameters that makes the closed loop unstable, if it was requested.
    norms : mapping of str to Norms
        For states and outputs: norms of the transfer from disturbances at the inputs, if they were requested.
    sampled : SampledLoop or None
        Closed loop with inputs that are sampled and held, if it was requested.
    compensator : FirstOrderSystem or None
        Regulator with its observer, as a system from measured quantities to inputs, for results of
        `solve.lqg`.
    """

    system: PeriodicSystem
    speed: float
    kind: str
    states: tuple[str, ...]
    signals: tuple[str, ...]
    solution: Curve
    gains: Curve
    closed: PeriodicSystem
    stability: Stability
    error_estimate: float
    residual: float
    rtol: float
    observer: "Controller | None" = None
    vibration: Mapping[str, Vibration] = field(default_factory=dict)
    ahead: Curve | None = None
    margin: StabilityMargin | None = None
    norms: Mapping[str, Norms] = field(default_factory=dict)
    sampled: SampledLoop | None = None
    compensator: FirstOrderSystem | None = None

    @matches_annotations
    def riccati(self, phase: Array | float) -> Array:
        """Solution of the Riccati equation.

        Parameters
        ----------
        phase : float or (k,) array
            Phases in rad, in any period.

        Returns
        -------
        (k, N, N) array
            X of a regulator, or the covariance P of a filter, in SI units of the states.
        """
        return symmetric_of(self.solution(finite_phases(phase)))

    @matches_annotations
    def gain(self, phase: Array | float) -> Array:
        """Feedback gain.

        Parameters
        ----------
        phase : float or (k,) array
            Phases in rad, in any period.

        Returns
        -------
        (k, r, N) array
            K in u = −K x for a regulator; for a filter without a regulator, its gain L (k, N, y).
        """
        values = self.gains(finite_phases(phase)).T
        N, r = len(self.states), len(self.signals)
        return values.reshape(len(values), *((N, r) if self.kind == "kalman" else (r, N)))

    @matches_annotations
    def feedforward(self, phase: Array | float) -> Array:
        """Feedforward of the inputs, u = −K x + f.

        Parameters
        ----------
        phase : float or (k,) array
            Phases in rad, in any period.

        Returns
        -------
        (k, r) array
            Feedforward f; zero if there is none.
        """
        phases = finite_phases(phase)
        return np.zeros((len(phases), len(self.signals))) if self.ahead is None else self.ahead(phases).T

    @cached_property
    def harmonics(self) -> Array:
        """Complex harmonics K_k of the gain K = Re Σ_k K_k e^{ikφ}, where φ has the period 2π: (13, r, N) for
        a regulator, (13, N, y) for a filter with y measured quantities."""
        return self._harmonics_of(self.gain)

    def _harmonics_of(self, function: Callable[[Array], Array]) -> Array:
        """Complex harmonics (13, …) of a function of the phase."""
        count = 16 * DEGREES
        values = function(uniform_phases(count, self.system.period))
        transform = np.fft.rfft(values, axis=0)[: _HARMONICS + 1] * (2 / count)
        transform[0] /= 2
        return transform

    @property
    def multipliers(self) -> Array:
        """Floquet multipliers of the closed loop in order of decreasing modulus."""
        return self.stability.multipliers

    @property
    def verdict(self) -> str:
        """Stability verdict on the closed loop."""
        return self.stability.verdict

    @property
    def stable(self) -> bool | None:
        """Whether the closed loop is stable; None if undetermined."""
        return self.stability.stable

    @stored_property
    def warnings(self) -> list[str]:
        """Warnings about the result, one sentence each."""
        observer = [] if self.observer is None else self.observer.warnings
        missed = []
        if not self.error_estimate <= self.rtol:
            missed.append(
                f"the solution of the Riccati equation of the {_TITLES[self.kind]} is accurate to "
                f"{self.error_estimate:.1e} only, not to rtol {self.rtol:g}"
            )
        if self.stable is not True:
            missed.append(f"the closed loop is {self.verdict}")
        if self.sampled is not None and self.sampled.verdict != "asymptotically stable":
            missed.append(f"the closed loop with {self.sampled.rate} is {self.sampled.verdict}")
        doubts = [f"norms to {name}: {text}" for name, each in self.norms.items() for text in each.warnings]
        return list(dict.fromkeys([*missed, *observer, *self.stability.warnings, *doubts]))

    @property
    def summary(self) -> str:
        """Sentence on the stability of the closed loop."""
        what = "error of the estimates" if self.kind == "kalman" else "closed loop"
        return (
            f"At {self.system.labels.speed_unit.text(self.speed)} the {what} is {self.verdict}: "
            f"spectral radius {self.stability.spectral_radius:.6g}."
        )

    @property
    def summary_values(self) -> dict[str, Any]:
        stability, gains = self.stability, np.moveaxis(self.harmonics, 0, -1)
        ahead = () if self.ahead is None else self._harmonics_of(self.feedforward).T
        observer = None if self.observer is None else self.observer.record()
        rows = map(_amplitudes, gains.reshape(-1, gains.shape[-1]))
        return {
            "speed": self.speed,
            "period": self.system.period / self.speed,
            "kind": self.kind,
            "states": self.states,
            "signals": self.signals,
            "gain": dict(zip(self.gain_names, rows, strict=True)),
            "feedforward": dict(zip(self.signals, map(_amplitudes, ahead), strict=False)),
            "multipliers": self.multipliers,
            "exponents": stability.exponents,
            "spectral_radius": stability.spectral_radius,
            "verdict": self.verdict,
            "stable": self.stable,
            "error_estimate": {"riccati": self.error_estimate, "multipliers": stability.error_estimate[1]},
            "residual": self.residual,
            "observer": observer,
            "vibration": self.vibration,
            "margin": self.margin,
            "sampled": self.sampled,
            "norms": self.norms,
        }

    @property
    def gain_names(self) -> list[str]:
        """Names of the entries of the gain, row by row."""
        if self.kind == "kalman":
            return [f"{state}_by_{signal}" for state in self.states for signal in self.signals]
        return [f"{signal}_by_{state}" for signal in self.signals for state in self.states]

    def header_rows(self) -> HeaderRows:
        errors = f"Riccati equation {self.error_estimate:.1e}"
        return [
            ("controller", _TITLES[self.kind]),
            ("errors", f"{errors}, multipliers {self.stability.error_estimate[1]:.1e} (relative)"),
            ("checks", f"residual {self.residual:.1e}"),
        ]

    @property
    def columns(self) -> Columns:
        """Columns of the table: entries of the gain, with one row per phase."""
        phase = np.linspace(0.0, self.system.period, DEGREES)
        gains = self.gain(phase).reshape(DEGREES, -1).T
        columns = {"phase": Column(phase, "rad", "phase of the drive", axes=("phase",))}
        for name, values in zip(self.gain_names, gains, strict=True):
            first, _, second = name.partition("_by_")
            columns[name] = Column(values, "", f"gain of {first} by {second}", axes=("phase",))
        return columns

    def file_contents(self) -> FileContents:
        """Columns of the table. Files .npz and .mat also contain the gain and the solution as matrices."""
        phase = np.linspace(0.0, self.system.period, DEGREES)
        arrays = {"phase": phase, "gain": self.gain(phase), "riccati": self.riccati(phase)}
        return FileContents(self.columns, {}, self.metadata, {**arrays, "multipliers": self.multipliers})

    def record(self) -> dict[str, Any]:
        """JSON object of `solve control --json`."""
        return to_json({**self.model_info, **self.summary_values, "warnings": self.warnings})


def _amplitudes(harmonics: Array) -> dict[str, Array]:
    """Return moduli and phase angles of complex harmonics."""
    # For a strided array, round-off in NumPy 2.0 depends on memory addresses.
    harmonics = np.ascontiguousarray(harmonics)
    return {"harmonics": np.abs(harmonics), "phases": np.angle(harmonics)}
