"""Orbits of nonlinear equations, and orbits of mechanisms with prescribed motion."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from solve.arguments import matches_annotations
from solve.arrays import Array
from solve.certify.correction import corrected
from solve.contracts import Statistics
from solve.equations import exceeded_limits, judged_quantities, output_values, warnings_of
from solve.errors import NoVibrationError, SolveError, ValueOutOfBoundsError, counted, listed
from solve.period.curve import Curve, PeriodicCurve
from solve.period.quantities import repeats_early
from solve.period.signals import LEAST_SAMPLES
from solve.results.contents import HeaderRows
from solve.results.orbit import Orbit
from solve.results.periodic_motion import PeriodicMotion, QuasiStatic, SolvedMotion
from solve.results.serialization import stored_property
from solve.results.stability import ErrorEstimate
from solve.system import PeriodicSystem, check

_STEPS = 256
"""Number of steps per period of prescribed motion in files. Chosen by judgement. It does not affect the
statistics, which are computed from the continuous curve."""

_MOST_EVENTS = 32
"""Number of events per period of the model above which a warning about chatter is issued. Chosen by
judgement."""

_ROUNDOFF = 1e-14
"""Relative error of an output of prescribed motion: an output takes about a hundred operations, each of which
is accurate to 1e-16."""


@dataclass(frozen=True)
class NonlinearOrbit(Orbit):
    """Solution of the nonlinear equations r(φ, Ω, q, q̇, q̈) = 0 that repeats after `periods` periods of the
    model, from `solve.nonlinear`. Its attribute `system` is the system linearised along the orbit.

    Attributes
    ----------
    iterations : int
        Number of corrections of Newton's method on the grid on which the orbit was found.
    found_by : str
        Strategy that succeeded: "start", "linear orbit", "load", "speed" or "transient".
    failed : tuple of str
        Sentences on the strategies that were tried before this one and failed.
    periods : int
        Number of periods of the model per period of the orbit.
    settled : bool
        False if a transient from rest does not settle on an orbit.
    events : tuple of float
        Ascending phases in rad at which the orbit crosses a stop, a clearance or a contact.
    grazing : tuple of float
        Phases in rad at which the orbit touches a stop, a clearance or a contact tangentially.
    """

    iterations: int = 0
    found_by: str = ""
    failed: tuple[str, ...] = ()
    periods: int = 1
    settled: bool = True
    events: tuple[float, ...] = ()
    grazing: tuple[float, ...] = ()

    @stored_property
    def linearisation_error(self) -> Mapping[str, float] | None:
        """None, because the equations are not linearised."""
        return

    @stored_property
    def notes(self) -> list[str]:
        """Notes on the engine, the method, rigid-body modes, and strategies that failed."""
        return [*super().notes, *self.failed]

    @property
    def quasi_static(self) -> QuasiStatic:
        """Raise ValueOutOfBoundsError, because a nonlinear orbit has no quasi-static solution."""
        raise ValueOutOfBoundsError(
            "the quasi-static solution belongs to the linear model; omit --quasi-static or --nonlinear"
        )

    @stored_property
    def linear(self) -> PeriodicCurve | None:
        """Orbit of the linear equations on the same grid; None if it does not exist."""
        grid, certified = self.certified.solutions.grid, self.certified
        rest = Curve(grid.nodes, np.zeros((self.system.n, grid.steps, 1)))
        engine = certified.request.engine
        try:
            curve = corrected(self.system, rest, self.speed, certified.method, grid, engine).curve
        except SolveError:
            return None
        return None if curve is None else curve[0]

    @stored_property
    def warnings(self) -> list[str]:
        """Warnings about the result, one sentence each."""
        return [*super().warnings, *self.doubts]

    @cached_property
    def doubts(self) -> list[str]:  # type: ignore[override]
        """Warnings that the requested orbit may not have been found, one sentence each."""
        sentences = []
        if self.periods > 1 and repeats_early(self.curve, self.periods):
            sentences.append(
                f"the orbit repeats after each of its {self.periods} periods: it has period T; use another "
                "start to find an orbit of longer period"
            )
        if self.grazing:
            phases = listed([f"{phase:.4g}" for phase in self.grazing])
            sentences.append(
                f"the orbit grazes a switch of the equations, such as a stop, at phase {phases} rad: its "
                "multipliers change abruptly nearby, and the verdict is undetermined"
            )
        if len(self.events) > _MOST_EVENTS * self.periods:
            sentences.append(
                f"the orbit crosses switches of the equations {len(self.events)} times: it may chatter, and "
                "events may be missing"
            )
        if not self.settled:
            sentences.append(
                "a transient from rest does not settle on an orbit of this period: there may be no stable "
                "orbit of this period"
            )
        return sentences

    @stored_property
    def verdict(self) -> str:
        """Verdict as for linear orbits; "undetermined" for an orbit that grazes a switch."""
        return "undetermined" if self.grazing else super().verdict

    @property
    def summary(self) -> str:
        return f"By the nonlinear equations: {super().summary.replace('At', 'at', 1)}"

    @property
    def summary_values(self) -> dict[str, Any]:
        search = {"iterations": self.iterations, "found_by": self.found_by, "periods": self.periods}
        search["events"] = list(self.events)
        return {**super().summary_values, **search}

    def header_rows(self) -> HeaderRows:
        search = f"by {self.found_by}, {counted(self.iterations, 'correction')} of Newton's method"
        return [*super().header_rows(), ("found", search)]

    def linear_values(self, name: str, phase: Array) -> Array | None:
        """Values (k,) of a coordinate or output at phases (k,) on the orbit of the linear equations; None if
        there is no such orbit."""
        if self.linear is None:
            return None
        q, v, a = (self.linear(phase, derivative) for derivative in range(3))
        if name in self.system.coordinates:
            return q[self.system.coordinates.index(name)]
        if not self.system.labels.solvable:
            return None
        return output_values(self.system, phase, self.speed, q, self.speed * v, self.speed**2 * a)[name]


class NoStability:
    """Mixin for a mechanism without coordinates, and thus without vibration. It replaces attributes of
    `Orbit`."""

    method = described = "prescribed motion"
    steps = _STEPS
    samples = LEAST_SAMPLES
    verdict = ""
    stable = None
    spectral_radius = distance_from_one = condition = liouville = np.nan
    error_estimate = ErrorEstimate(_ROUNDOFF, np.nan)
    residual = 0.0
    linearisation_error = reduction_error = interpolation_error = None
    rigid_body_modes = ()
    multipliers = exponents = np.zeros(0, dtype=complex)
    multiplier_errors = np.zeros(0)
    modes = ()
    _figures = np.zeros((0, 7))


@dataclass(frozen=True)
class RigidOrbit(NoStability, Orbit):  # type: ignore[misc]
    """Prescribed motion of a mechanism without coordinates. The result contains outputs over a period, but no
    multipliers, exponents or verdict."""

    @classmethod
    def at_speed(cls, system: PeriodicSystem, speed: float) -> "RigidOrbit":
        """Prescribed motion at a speed in rad/s. Raises DesiredMotionError if it does not exist."""
        check(system, speed)
        no_solution: Any = None
        return cls(system, speed, no_solution, no_solution)

    curve = None  # type: ignore[assignment]
    notes = ()  # type: ignore[assignment]

    @property
    def phase(self) -> Array:
        return np.linspace(0.0, self.system.period, _STEPS + 1)

    @matches_annotations
    def state(self, phase: Array) -> tuple[Array, Array, Array]:
        empty = np.zeros((0, len(phase)))
        return empty, empty, empty

    @matches_annotations
    def at(self, phase: float | Array) -> Array:
        return self.state(np.atleast_1d(phase))[0]

    @matches_annotations
    def statistics(self, name: str) -> Statistics:
        if self.system.labels.solvable:
            return PeriodicMotion.statistics(self, name)
        return self.output_statistics[name]

    @property
    def _output_figures(self) -> Array:
        return super(SolvedMotion, self)._output_figures

    @property
    def quasi_static(self) -> QuasiStatic:
        """Raise NoVibrationError, because a mechanism without coordinates has no quasi-static solution."""
        raise NoVibrationError(
            f"{self.system.labels.name} has no coordinates; omit the quasi-static solution"
        )

    @stored_property
    def warnings(self) -> list[str]:
        """Warnings about the result, one sentence each."""
        system = self.system
        names = sorted({*judged_quantities(system), *system.outputs})
        figures = {name: self.statistics(name) for name in names}
        return [
            *warnings_of(system, self.speed),
            *exceeded_limits(system, figures),
            *self._non_periodic_outputs,
        ]

    @property
    def summary(self) -> str:
        return (
            f"At {self.system.labels.speed_unit.text(self.speed)} the motion is prescribed: nothing vibrates."
        )

    @property
    def summary_values(self) -> dict[str, Any]:
        return {**super().summary_values, "verdict": None}

    def header_rows(self) -> HeaderRows:
        return [("motion", "prescribed: without coordinates nothing vibrates")]
