"""Motion in time from an initial state, and the orbit on which it settles."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, ClassVar

import numpy as np

from solve.arguments import matches_annotations
from solve.arrays import Array
from solve.contracts import Statistics, driven
from solve.equations import exceeded_limits, output_values, warnings_of
from solve.errors import counted
from solve.labels import known_quantities
from solve.period.curve import curves_through, interpolation_tolerance, sufficient_strides
from solve.period.quantities import Quantities
from solve.results.contents import (
    FileContents,
    HeaderRows,
    columns_by_name,
    curves_of,
    speeds_of,
    to_json,
)
from solve.results.orbit import Orbit
from solve.results.result import Figure, Result
from solve.results.rigid_body import steady_part
from solve.results.serialization import stored_property
from solve.system import PeriodicSystem

_AT_ONCE = 2**19
"""Maximum number of values of states and outputs that are evaluated together. Chosen by judgement, to limit
the memory."""

_RESOLVED = 0.1
"""Relative interpolation error between the states up to which interpolated curves count as resolved: they are
accurate to at least one digit."""

_REMEDIES = {
    "stable": "differences from the orbit are not damped; start on the orbit",
    "unstable": "it is unstable",
}
"""Mapping from the verdict on an orbit to the reason why the orbit is not reached, or to a remedy."""


@dataclass(frozen=True)
class TransientMotion(Result):
    """Motion over a number of periods ("turns"), with the statistics of each period.

    Attributes
    ----------
    ends : (turns + 1,) array
        Speeds in rad/s at the ends of the periods.
    nodes : (k,) array
        Values of s over a period, including both ends, where s is the time since the start of the period,
        multiplied by the mean speed of the period. At constant speed, s is the phase.
    motions : (turns, 3, n, k) array
        q, dq/ds and d²q/ds² at the nodes.
    between : float
        Interpolation error between the nodes, relative to the largest value of each coordinate and of its
        rates.
    """

    system: PeriodicSystem
    ends: Array
    nodes: Array
    motions: Array
    between: float

    @property
    def turns(self) -> int:
        """Number of periods."""
        return len(self.motions)

    @property
    def speed(self) -> float:
        """Final speed in rad/s."""
        return float(self.ends[-1])

    @property
    def ramp(self) -> bool:
        """Whether the speed varies."""
        return bool(np.ptp(self.ends) > 0)

    @property
    def phase(self) -> Array:
        """Phases (j,) of all periods in rad. The common end of two periods appears once."""
        first, last = self.ends[:-1, None], self.ends[1:, None]
        within, *_ = driven(self.nodes[:-1], first, last, self.system.period)
        turns = np.arange(self.turns)[:, None] * self.system.period
        return np.append((turns + within).ravel(), self.turns * self.system.period)

    @property
    def time(self) -> Array:
        """Times (j,) in seconds."""
        starts = np.concatenate(([0.0], np.cumsum(self.system.period / self._mean_speeds)))
        within = self.nodes[:-1] / self._mean_speeds[:, None]
        return np.append((starts[:-1, None] + within).ravel(), starts[-1])

    @property
    def _mean_speeds(self) -> Array:
        """Mean speeds (turns,) of the periods."""
        return (self.ends[:-1] + self.ends[1:]) / 2

    @property
    def q(self) -> Array:
        """Coordinates (n, j)."""
        return self._joined(0)

    @property
    def qd(self) -> Array:
        """Velocities (n, j) (derivatives with respect to time)."""
        return self._joined(1)

    @property
    def speeds(self) -> Array:
        """Speeds (j,) in rad/s, linear in time."""
        return self.ends[0] + np.ptp(self.ends) * np.sign(self.acceleration) * self.time / self.time[-1]

    @property
    def acceleration(self) -> float:
        """Acceleration of the drive in rad/s²."""
        return float((self.ends[-1] ** 2 - self.ends[0] ** 2) / (2 * self.turns * self.system.period))

    @stored_property
    def outputs(self) -> Mapping[str, Array]:
        """Mapping from the names of outputs to values (j,)."""
        states = self.q, self.qd, self._joined(2)
        return dict(output_values(self.system, self.phase, self.speeds, *states, self.acceleration))

    @matches_annotations
    def values(self, name: str) -> Array:
        """Values (j,) of a coordinate or output. Raises UnknownNameError."""
        known_quantities(self.system, [name])
        if name in self.system.coordinates:
            return self.q[self.system.coordinates.index(name)]
        return self.outputs[name]

    def _joined(self, derivative: int) -> Array:
        values = self.motions[:, derivative] * (self._mean_speeds**derivative)[:, None, None]
        turns = np.concatenate(values[..., :-1], axis=-1)
        return np.concatenate((turns, values[-1][:, -1:]), axis=-1)

    @stored_property
    def _figures(self) -> Array:
        """Fields of `Statistics` (turns, n + o, 7) of coordinates and outputs over each period. They are
        computed from interpolated curves or, if these are not accurate, from the states alone."""
        if not self._curves_resolved:
            return self._figures_of_states
        system = self.system
        figures = np.empty((self.turns, system.n + len(system.outputs), 7))
        strides = sufficient_strides(self.nodes, self.motions, bool(system.breaks), self.between)
        for stride in np.unique(strides):
            turns = np.flatnonzero(strides == stride)
            numbers = len(turns) * len(self.nodes[::stride]) * figures.shape[1]
            for some in np.array_split(turns, min(len(turns), 1 + numbers // _AT_ONCE)):
                figures[some] = self._figures_of_curves(some, stride)
        return figures

    def _figures_of_curves(self, turns: Array, stride: int) -> Array:
        """Fields of `Statistics` (P, n + o, 7) for the periods with indices `turns` (P,), from curves through
        every `stride`-th state."""
        system = self.system
        groups = [[name] for name in system.outputs] if system.labels.outputs_apart else [[*system.outputs]]
        curve, figures = curves_through(self.nodes[::stride], self.motions[turns][..., ::stride]), []
        for names in groups:
            outputs = partial(self._outputs_within, turns, names) if names else None
            group = Quantities(curve, self._mean_speeds[turns], outputs).figures()
            figures.append(group[:, system.n :] if figures else group)
        return np.concatenate(figures, axis=1)

    @property
    def _curves_resolved(self) -> bool:
        """Whether interpolated curves are accurate to at least one digit."""
        return self.between <= _RESOLVED

    @property
    def _figures_of_states(self) -> Array:
        """Fields of `Statistics` from the states alone: maximum, minimum and largest absolute value; the
        other fields are NaN."""
        names, last = (*self.system.coordinates, *self.system.outputs), len(self.nodes) - 1
        columns = np.arange(self.turns)[:, None] * last + np.arange(last + 1)
        values = np.stack([self.values(name)[columns] for name in names], axis=1)
        figures = np.full((*values.shape[:2], len(Statistics._fields)), np.nan)
        figures[..., 0], figures[..., 1] = values.max(axis=-1), values.min(axis=-1)
        figures[..., 2] = np.abs(values).max(axis=-1)
        return figures

    def _outputs_within(
        self, turns: Array, names: Sequence[str], s: Array, q: Array, qd: Array, qdd: Array
    ) -> Array:
        """Outputs (P, o, k) in the periods with indices `turns` (P,), at `s` (P, k) as defined for `nodes`,
        for q, q̇ and q̈ (P, n, k). Derivatives are with respect to time."""
        first, last = self.ends[turns, None], self.ends[turns + 1, None]
        phase, speed, _ = driven(np.mod(s, self.system.period), first, last, self.system.period)
        states = (np.moveaxis(array, 1, 0).reshape(self.system.n, -1) for array in (q, qd, qdd))
        outputs = output_values(self.system, phase.ravel(), speed.ravel(), *states, self.acceleration)
        return np.stack([outputs[name].reshape(s.shape) for name in names], axis=1)

    @cached_property
    def extremes(self) -> Mapping[str, Statistics]:
        """Maximum, minimum and largest absolute value of each coordinate and output over all periods; other
        statistics are NaN."""
        figures = np.moveaxis(self._figures, -1, 0)
        unknown = [np.nan] * (len(Statistics._fields) - 3)
        names = *self.system.coordinates, *self.system.outputs
        return {
            name: Statistics(*map(float, row), *unknown)
            for name, *row in zip(names, figures[0].max(0), figures[1].min(0), figures[2].max(0), strict=True)
        }

    @property
    def peaks(self) -> Array:
        """Largest absolute value (turns, n) of each coordinate in each period."""
        return self._figures[:, : self.system.n, 2]


@dataclass(frozen=True)
class Transient(TransientMotion):
    """Motion over a number of periods, compared with an orbit, from `solve.transient`.

    Attributes
    ----------
    orbit : Orbit or None
        Orbit with which the motion is compared.
    rtol : float
        Relative distance at which the orbit counts as reached.
    nonlinear : bool
        Whether the equations are nonlinear.
    notes : sequence of str
        Sentences on what is doubtful about the integration.
    """

    _recorded: ClassVar[str] = "nonlinear turns reached rtol between"

    orbit: Orbit | None
    rtol: float
    nonlinear: bool
    notes: Sequence[str] = ()

    @cached_property
    def distances(self) -> Array:
        """Largest difference (turns, n) from the orbit at the nodes of each period, relative to max|q|; NaN
        without an orbit. Steady motion along rigid-body modes is subtracted first."""
        if self.orbit is None:
            return np.full_like(self.peaks, np.nan)
        q = self.orbit.at(self.nodes)
        scale = np.abs(q).max(axis=1)
        scale = np.where(scale > 0, scale, scale.max() or 1.0)
        difference = self.motions[:, 0] - q
        difference -= steady_part(difference, self.nodes, self.orbit.rigid_body_modes, self.speed)
        return np.abs(difference).max(axis=-1) / scale

    @property
    def reached(self) -> int | None:
        """Number of periods after which the motion stays within `rtol` of the orbit; None if the last period
        is not within `rtol`."""
        beyond = [turn for turn, row in enumerate(self.distances, 1) if not row.max() <= self.rtol]
        last = beyond[-1] if beyond else 0
        return last if last < self.turns else None

    @stored_property
    def warnings(self) -> list[str]:
        """Warnings about the result, one sentence each."""
        linear = not self.nonlinear
        sentences = [*self.notes, *exceeded_limits(self.system, self.extremes, linear)]
        sentences += warnings_of(self.system, self.speed, linear)
        if not self.between <= interpolation_tolerance(self.rtol):
            error = f"{self.between:.1e}" if self._curves_resolved else "unknown"
            sentences.append(
                f"the relative error of extrema is {error}: the vibration is too fast for the "
                f"{len(self.nodes) - 1} states that are stored per period; give fewer turns, which allows "
                "more states, or start on the orbit"
            )
        if self.ramp or self.reached is not None:
            return sentences
        if self.orbit is None:
            unreached = (
                "no orbit is near the motion of the last period: more turns may reach an orbit, or there is "
                "no orbit of this period"
            )
        else:
            last = float(np.nanmax(self.distances[-1]))
            remedy = _REMEDIES.get(self.orbit.verdict, "give more turns")
            unreached = f"the orbit is not reached: the last period differs from it by {last:.1e}; {remedy}"
        return [unreached, *sentences]

    def record(self) -> dict[str, Any]:
        """JSON object of `solve transient --json`. It contains the extrema of every coordinate and output
        and, for each period, the largest absolute value of each coordinate and its distance from the
        orbit."""
        coordinates = {
            name: {**self._record(name), "peaks": peaks, "distances": distances}
            for name, peaks, distances in zip(
                self.system.coordinates, self.peaks.T, self.distances.T, strict=True
            )
        }
        outputs = {name: self._record(name) for name in self.outputs}
        return {**super().record(), "coordinates": to_json(coordinates), "outputs": to_json(outputs)}

    def _record(self, name: str) -> dict[str, Any]:
        extremes = self.extremes[name]
        values = {"max": extremes.max, "min": extremes.min, "max_abs": extremes.max_abs}
        return {"unit": self.system.labels.units.get(name, ""), **values, "end": self.values(name)[-1]}

    @property
    def summary_values(self) -> dict[str, Any]:
        drive: dict[str, Any]
        if self.ramp:
            drive = {"speed": None, "period": None, "speeds": self.ends[[0, -1]], "time": self.time[-1]}
        else:
            drive = {"speed": self.speed, "period": self.system.period / self.speed}
        return {**drive, **super().summary_values}

    def header_rows(self) -> HeaderRows:
        drive = f"{self.ramp_in_words}, {counted(self.turns, 'turn')} in {self.time[-1]:.6g} s"
        return [("speed", drive)] if self.ramp else []

    @property
    def ramp_in_words(self) -> str:
        """Text that states the range of the speed."""
        return self.system.labels.speed_unit.span(self.ends[0], self.ends[-1])

    @matches_annotations
    def plot(self, names: Sequence[str] | None = None) -> Figure:
        """Figure of each quantity, by default the coordinates, versus periods or, for a run-up, versus time.
        Raises UnknownNameError."""
        return super().plot(names)

    def file_contents(self) -> FileContents:
        """Columns of time, phase, coordinates and outputs. Files .npz and .mat also contain q and qd (n, j);
        another transient can continue from their last values."""
        system, q = self.system, self.q
        columns = curves_of(system, self.time, self.phase, q, self.outputs)
        if self.ramp:
            columns.insert(2, ("speed", speeds_of(system, self.speeds, axes=("phase",))))
        arrays = {"phase": self.phase, "time": self.time, "q": q, "qd": self.qd}
        arrays["coordinates"] = np.array(system.coordinates)
        return FileContents(columns_by_name(columns), {}, self.metadata, arrays)
