"""The motion in time from a state, turn by turn, beside the orbit that it reaches."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, ClassVar

import numpy as np

from solve.arrays import Array
from solve.contracts import driven
from solve.period.curve import curves_through, interpolation_tolerance, sufficient_strides
from solve.period.quantities import Quantities
from solve.results.contents import (
    Contents,
    Facts,
    curves_of,
    plain,
    require_different_names,
    speeds_of,
)
from solve.results.orbit import Orbit
from solve.results.result import Figure, Result
from solve.results.rigid_body import steady_part
from solve.statistics import Statistics
from solve.system import PeriodicSystem

_AT_ONCE = 2**19
"""States and outputs at them of turns whose figures are found at once."""

_TOLD = 0.1
"""Error between the states, relative, below which curves through them tell extrema."""

_REMEDIES = {
    "stable": "it attracts no motion, as nothing damps the difference: start on the orbit",
    "unstable": "it attracts no motion, as it is unstable",
}
"""What to do, by the verdict on an orbit that is not reached."""


@dataclass(frozen=True)
class Transient(Result):
    """A motion over turns, and the orbit that it may reach.

    ends (turns + 1,): speeds in rad/s at the ends of the turns. nodes (k,): s, time times the mean speed of
    the turn, which is the phase where the speed is constant; both ends included. motions (turns, 3, n, k): q,
    dq/ds, d²q/ds² there. between: how far a curve through the states may be off between them, relative to the
    largest of each coordinate and its rates. orbit: what the motion is compared with, None where there is
    none. rtol: to which that counts as reached. notes: what is doubtful about the way to the motion.
    """

    _calculated: ClassVar[tuple[str, ...]] = (*Result._calculated, "outputs", "_figures")

    system: PeriodicSystem
    ends: Array
    nodes: Array
    motions: Array
    between: float
    orbit: Orbit | None
    rtol: float
    nonlinear: bool
    notes: Sequence[str] = ()

    @property
    def turns(self) -> int:
        return len(self.motions)

    @property
    def speed(self) -> float:
        """The speed at the end, in rad/s."""
        return float(self.ends[-1])

    @property
    def ramp(self) -> bool:
        """Whether the speed varies."""
        return bool(np.ptp(self.ends) > 0)

    @property
    def phase(self) -> Array:
        """Phases (j,) of all turns, the end of one and the start of the next once."""
        first, last = self.ends[:-1, None], self.ends[1:, None]
        within, *_ = driven(self.nodes[:-1], first, last, self.system.period)
        turns = np.arange(self.turns)[:, None] * self.system.period
        return np.append((turns + within).ravel(), self.turns * self.system.period)

    @property
    def time(self) -> Array:
        """Times (j,) in seconds."""
        starts = np.concatenate(([0.0], np.cumsum(self.system.period / self._mean)))
        within = self.nodes[:-1] / self._mean[:, None]
        return np.append((starts[:-1, None] + within).ravel(), starts[-1])

    @property
    def _mean(self) -> Array:
        """Mean speeds (turns,) of the turns."""
        return (self.ends[:-1] + self.ends[1:]) / 2

    @property
    def q(self) -> Array:
        """Coordinates (n, j)."""
        return self._joined(0)

    @property
    def qd(self) -> Array:
        """Velocities (n, j), by time."""
        return self._joined(1)

    @property
    def speeds(self) -> Array:
        """Speeds (j,) in rad/s; they go linearly in time."""
        return self.ends[0] + np.ptp(self.ends) * np.sign(self.acceleration) * self.time / self.time[-1]

    @property
    def acceleration(self) -> float:
        """Of the drive, in rad/s²."""
        return float((self.ends[-1] ** 2 - self.ends[0] ** 2) / (2 * self.turns * self.system.period))

    @cached_property
    def outputs(self) -> Mapping[str, Array]:
        """Outputs (j,) by name."""
        states = self.q, self.qd, self._joined(2)
        return dict(self.system.output_values(self.phase, self.speeds, *states, self.acceleration))

    def values(self, name: str) -> Array:
        """A coordinate or output (j,). Raises UnknownNameError."""
        self.system.known_quantities([name])
        if name in self.system.coordinates:
            return self.q[self.system.coordinates.index(name)]
        return self.outputs[name]

    def _joined(self, derivative: int) -> Array:
        values = self.motions[:, derivative] * (self._mean**derivative)[:, None, None]
        turns = np.concatenate(values[..., :-1], axis=-1)
        return np.concatenate((turns, values[-1][:, -1:]), axis=-1)

    @cached_property
    def _figures(self) -> Array:
        """Of coordinates and, behind them, outputs over each turn (turns, n + o, 7), the fields of
        `Statistics`, of the curves through the states; of the states alone where these do not tell curves."""
        system, made = self.system, np.empty((self.turns, self.system.n + len(self.system.outputs), 7))
        apart = [[name] for name in system.outputs] if system.outputs_apart else [[*system.outputs]]
        if not self._curves_tell:
            return self._figures_of_states
        strides = sufficient_strides(self.nodes, self.motions, bool(system.breaks), self.between)
        for stride in np.unique(strides):
            nodes, chosen = self.nodes[::stride], np.flatnonzero(strides == stride)
            numbers = len(chosen) * len(nodes) * made.shape[1]
            for some in np.array_split(chosen, min(len(chosen), 1 + numbers // _AT_ONCE)):
                curve, found = curves_through(nodes, self.motions[some][..., ::stride]), []
                for names in apart:
                    outputs = partial(self._outputs_within, some, names) if names else None
                    figures = Quantities(curve, self._mean[some], outputs).figures()
                    found.append(figures[:, system.n :] if found else figures)
                made[some] = np.concatenate(found, axis=1)
        return made

    @property
    def _curves_tell(self) -> bool:
        """Whether curves through the states are known to any digit."""
        return self.between <= _TOLD

    @property
    def _figures_of_states(self) -> Array:
        """Largest, smallest value and largest modulus over each turn; the other figures are NaN."""
        names, last = (*self.system.coordinates, *self.system.outputs), len(self.nodes) - 1
        places = np.arange(self.turns)[:, None] * last + np.arange(last + 1)
        values = np.stack([self.values(name)[places] for name in names], axis=1)
        found = np.full((*values.shape[:2], len(Statistics._fields)), np.nan)
        found[..., 0], found[..., 1] = values.max(axis=-1), values.min(axis=-1)
        found[..., 2] = np.abs(values).max(axis=-1)
        return found

    def _outputs_within(
        self, turns: Array, names: Sequence[str], s: Array, q: Array, qd: Array, qdd: Array
    ) -> Array:
        """Outputs (P, o, k) within turns (P,), at s (P, k) and states (P, n, k), derivatives by time."""
        first, last = self.ends[turns, None], self.ends[turns + 1, None]
        phase, speed, _ = driven(np.mod(s, self.system.period), first, last, self.system.period)
        states = (np.moveaxis(part, 1, 0).reshape(self.system.n, -1) for part in (q, qd, qdd))
        found = self.system.output_values(
            phase.ravel(), speed.ravel(), *states, acceleration=self.acceleration
        )
        return np.stack([found[name].reshape(s.shape) for name in names], axis=1)

    @cached_property
    def extremes(self) -> Mapping[str, Statistics]:
        """Largest, smallest value and largest modulus of each coordinate and output over all turns; the other
        figures are NaN."""
        figures = np.moveaxis(self._figures, -1, 0)
        unknown = [np.nan] * (len(Statistics._fields) - 3)
        names = *self.system.coordinates, *self.system.outputs
        return {
            name: Statistics(*map(float, row), *unknown)
            for name, *row in zip(names, figures[0].max(0), figures[1].min(0), figures[2].max(0), strict=True)
        }

    @property
    def peaks(self) -> Array:
        """max|q| of each turn (turns, n)."""
        return self._figures[:, : self.system.n, 2]

    @cached_property
    def distances(self) -> Array:
        """max|difference|/max|q| between each revolution (turns, n) and the orbit, at the nodes, without
        steady motion along rigid-body modes; NaN without an orbit."""
        if self.orbit is None:
            return np.full_like(self.peaks, np.nan)
        q = self.orbit.at(self.nodes)
        scale = np.abs(q).max(axis=1)
        scale = np.where(scale > 0, scale, scale.max() or 1.0)
        apart = self.motions[:, 0] - q
        apart -= steady_part(apart, self.nodes, self.orbit.rigid_body_modes, self.speed)
        return np.abs(apart).max(axis=-1) / scale

    @property
    def reached(self) -> int | None:
        """Turns after which all that follow are within rtol of the orbit; None where the last is not."""
        beyond = [turn for turn, row in enumerate(self.distances, 1) if not row.max() <= self.rtol]
        last = beyond[-1] if beyond else 0
        return last if last < self.turns else None

    @cached_property
    def warnings(self) -> list[str]:
        """What is doubtful about this result, a sentence each."""
        linear = not self.nonlinear
        judged = [*self.notes, *self.system.judged(self.extremes, linear)]
        judged += self.system.warnings(self.speed, linear)
        if not self.between <= interpolation_tolerance(self.rtol):
            known = f"to {self.between:.1e} of their size only" if self._curves_tell else "not at all"
            judged.append(
                f"{len(self.nodes) - 1} states a turn tell what lies between them, and extrema, {known}: the "
                "vibrations are fast; give fewer turns, or start on the orbit"
            )
        if self.ramp or self.reached is not None:
            return judged
        if self.orbit is None:
            left = "no orbit lies near the last turn: more turns may reach one, or none has this period"
        else:
            last = float(np.nanmax(self.distances[-1]))
            remedy = _REMEDIES.get(self.orbit.verdict, "give more turns")
            left = f"the orbit is not reached: the last turn is off by {last:.1e} of it; {remedy}"
        return [left, *judged]

    def record(self) -> dict[str, Any]:
        """Of `solve transient --json`: figures of every coordinate and output over all turns, of a coordinate
        also its largest modulus in each of them, and its distance to the orbit."""
        coordinates = {
            name: {**self._record(name), "peaks": peaks, "distances": distances}
            for name, peaks, distances in zip(
                self.system.coordinates, self.peaks.T, self.distances.T, strict=True
            )
        }
        outputs = {name: self._record(name) for name in self.outputs}
        return {**super().record(), "coordinates": plain(coordinates), "outputs": plain(outputs)}

    def _record(self, name: str) -> dict[str, Any]:
        found = self.extremes[name]
        extremes = {"max": found.max, "min": found.min, "max_abs": found.max_abs}
        return {"unit": self.system.units.get(name, ""), **extremes, "end": self.values(name)[-1]}

    @property
    def whole(self) -> dict[str, Any]:
        drive: dict[str, Any]
        if self.ramp:
            drive = {"speed": None, "period": None, "speeds": self.ends[[0, -1]], "time": self.time[-1]}
        else:
            drive = {"speed": self.speed, "period": self.system.period / self.speed}
        names = "nonlinear", "turns", "reached", "rtol", "between"
        return {**drive, **{name: getattr(self, name) for name in names}}

    def facts(self) -> Facts:
        drive = f"{self.ramp_in_words}, {self.turns} turns in {self.time[-1]:.6g} s"
        return [("speed", drive)] if self.ramp else []

    @property
    def ramp_in_words(self) -> str:
        return self.system.speed_unit.span(self.ends[0], self.ends[-1])

    def plot(self, names: Sequence[str] | None = None) -> Figure:
        """Each name, by default the coordinates, over the turns, the orbit beside; over time and speed where
        that varies (matplotlib Figure). Raises UnknownNameError."""
        return super().plot(names)

    def contents(self) -> Contents:
        """Time, phase, coordinates and outputs, for a file; in .npz and .mat also q, qd (n, j), from
        whose end another transient can go on."""
        system, q = self.system, self.q
        columns = curves_of(system, self.time, self.phase, q, self.outputs)
        if self.ramp:
            columns.insert(2, ("speed", speeds_of(system, self.speeds, axes=("phase",))))
        require_different_names(columns)
        arrays = {"phase": self.phase, "time": self.time, "q": q, "qd": self.qd}
        arrays["coordinates"] = np.array(system.coordinates)
        return Contents(dict(columns), {}, self.metadata, arrays)
