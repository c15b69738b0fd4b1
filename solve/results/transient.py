"""The motion in time from a state, turn by turn, beside the orbit that it reaches."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from solve.arrays import Array
from solve.contracts import driven
from solve.results.contents import Column, Contents, plain, require_different_names
from solve.results.orbit import Orbit
from solve.results.plot import MOST_ROWS, axis_label, label_quantity, shown, title_of, titled
from solve.results.quantities import measured
from solve.results.report import Facts, RenderableType, digits, sized, speeds_of, table, table_of, text
from solve.results.result import Result
from solve.results.style import BLUE, VERMILION, Axes, Figure, page
from solve.statistics import Statistics
from solve.system import SPEED, PeriodicSystem

_AXIS = ("phase",)
_MOST_TURNS = 40
"""Rows of the table; of more turns every k-th is shown."""


@dataclass(frozen=True)
class Transient(Result):
    """Motions (turns, 3, n, k): q, dq/ds, d²q/ds² over the turns at nodes s (k,), time times the mean speed
    of the turn (the phase where the speed is constant), both ends included; ends: speeds (turns + 1,) in
    rad/s at the ends of the turns. orbit: what it is compared with, None where there is none; rtol: to
    which that counts as reached.
    """

    _calculated: ClassVar[tuple[str, ...]] = (*Result._calculated, "outputs")

    system: PeriodicSystem
    ends: Array
    nodes: Array
    motions: Array
    orbit: Orbit | None
    rtol: float
    nonlinear: bool

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
        drive, state = (self.phase, self.speed), (self.q, self.qd, self._joined(2))
        if not self.ramp:
            return dict(self.system.output_values(*drive, *state))
        return dict(self.system.output_values(self.phase, self.speeds, *state, self.acceleration))

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
    def peaks(self) -> Array:
        """max|q| of each turn (turns, n), at the nodes."""
        return np.abs(self.motions[:, 0]).max(axis=-1)

    @cached_property
    def distances(self) -> Array:
        """max|difference|/max|q| of each turn (turns, n) to the orbit; NaN without one."""
        if self.orbit is None:
            return np.full_like(self.peaks, np.nan)
        q = self.orbit.at(self.nodes)
        scale = np.abs(q).max(axis=1)
        scale = np.where(scale > 0, scale, scale.max() or 1.0)
        return np.abs(self.motions[:, 0] - q).max(axis=-1) / scale

    @property
    def reached(self) -> int | None:
        """Turns after which all that follow are within rtol of the orbit; None where the last is not."""
        beyond = [turn for turn, row in enumerate(self.distances, 1) if not row.max() <= self.rtol]
        last = beyond[-1] if beyond else 0
        return last if last < self.turns else None

    @cached_property
    def warnings(self) -> list[str]:
        """What is doubtful about this result, a sentence each."""
        figures = {name: _figures(self.values(name)) for name in self.system.judged_quantities}
        judged = self.system.judged(figures, linear=not self.nonlinear)
        if self.ramp:
            return judged
        if self.orbit is None:
            return [
                "no orbit lies near the last turn: more turns may reach one, or there is none of this period",
                *judged,
            ]
        if self.reached is None:
            last = float(np.nanmax(self.distances[-1]))
            left = f"the orbit is not reached: the last turn is off by {last:.1e} of it; give more turns"
            return [left, *judged]
        return judged

    def record(self) -> dict[str, Any]:
        """Of `solve transient --json`: figures of every coordinate and output over all turns, of a coordinate
        also its largest modulus in each of them, and its distance to the orbit."""
        coordinates = {
            name: {**self._record(name, values), "peaks": peaks, "distances": distances}
            for name, values, peaks, distances in zip(
                self.system.coordinates, self.q, self.peaks.T, self.distances.T, strict=True
            )
        }
        outputs = {name: self._record(name, values) for name, values in self.outputs.items()}
        return {**super().record(), "coordinates": plain(coordinates), "outputs": plain(outputs)}

    def _record(self, name: str, values: Array) -> dict[str, Any]:
        found = _figures(values)
        extremes = {"max": found.max, "min": found.min, "max_abs": found.max_abs}
        return {"unit": self.system.units.get(name, ""), **extremes, "end": values[-1]}

    @property
    def whole(self) -> dict[str, Any]:
        drive: dict[str, Any]
        if self.ramp:
            drive = {"speed": None, "period": None, "speeds": self.ends[[0, -1]], "time": self.time[-1]}
        else:
            drive = {"speed": self.speed, "period": self.system.period / self.speed}
        solved = {**drive, "nonlinear": self.nonlinear}
        return {**solved, "turns": self.turns, "reached": self.reached, "rtol": self.rtol}

    def facts(self) -> Facts:
        drive = f"{self._ramp_in_words}, {self.turns} turns in {self.time[-1]:.6g} s"
        return [("speed", drive)] if self.ramp else []

    def tables(self) -> Sequence[RenderableType]:
        """A row a turn: the largest modulus of each coordinate, and the distance to the orbit. A row an
        output: its extrema."""
        columns = {"": Column(range(1, self.turns + 1), heading="turn")}
        for name, peaks in zip(self.system.coordinates[:MOST_ROWS], self.peaks.T, strict=False):
            columns[name] = sized(peaks, self.system.units.get(name, ""), "", name, 6)
        distances = Column(self.distances.max(axis=1), heading="from orbit", text=digits(".1e"))
        speeds = speeds_of(self.system, self.ends[1:], heading="to {}")
        columns["end"] = speeds if self.ramp else distances
        made = [table_of("Largest moduli, turn by turn", columns, most=_MOST_TURNS), *self._output_tables]
        if self.ramp:
            return made
        words = f"the orbit is not reached to {self.rtol:g} within {self.turns} turns"
        if self.reached is not None:
            words = f"the orbit is reached to {self.rtol:g} after {self.reached} of {self.turns} turns"
        return [*made, text("\n" + words)]

    @property
    def _output_tables(self) -> list[RenderableType]:
        if not self.outputs:
            return []
        made = table("Outputs over all turns", "output", "max", "min")
        for name, values in self.outputs.items():
            unit = self.system.units.get(name, "")
            made.add_row(name, measured(values.max(), unit), measured(values.min(), unit))
        return [made]

    @property
    def _ramp_in_words(self) -> str:
        return self.system.speed_unit.span(self.ends[0], self.ends[-1])

    def plot(self, names: Sequence[str] | None = None) -> Figure:
        """Each name, by default the coordinates, over the turns, the orbit beside; over time and speed where
        that varies (matplotlib Figure). Raises UnknownNameError."""
        names = shown(self.system, names)
        turns = self.time if self.ramp else self.phase / self.system.period
        kind = "nonlinear" if self.nonlinear else "linear"
        title = f"{titled(self.system, self.speed)}: {kind} transient"
        if self.ramp:
            title = f"{title_of(self.system)}, {self._ramp_in_words}: {kind} transient"
        with page(1.1 + 1.5 * len(names) + 0.5 * self.ramp, title) as figure:
            axes = figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
            for place, name in zip(axes, names, strict=True):
                values = self.values(name)
                factor = label_quantity(place, self.system, name, values)
                place.plot(turns, factor * values, color=BLUE, linewidth=0.8)
                if self.orbit is not None:
                    found = self.orbit.statistics(name)
                    for level in (found.max, found.min):
                        place.axhline(factor * level, color=VERMILION, linewidth=0.8, linestyle="--")
            axes[-1].set_xlim(0, turns[-1])
            dashed = " (dashed: extrema of the orbit)" if self.orbit is not None else ""
            axes[-1].set_xlabel("time (s)" if self.ramp else "turns" + dashed)
            if self.ramp:
                self._add_speeds(axes[0])
            figure.align_ylabels(axes)
        return figure

    def _add_speeds(self, axes: Axes) -> None:
        """The speed, which is linear in time, along the upper edge."""
        first, last = self.system.speed_unit.of(self.ends[[0, -1]])
        slope = (last - first) / self.time[-1]
        above = axes.secondary_xaxis(
            "top", functions=(lambda t: first + slope * t, lambda speed: (speed - first) / slope)
        )
        above.set_xlabel(axis_label(self.system, SPEED))

    def contents(self) -> Contents:
        """Time, phase, coordinates and outputs, for a file; in .npz and .mat also q, qd (n, j), from
        whose end another transient can go on."""
        system, q = self.system, self.q
        columns = [
            ("time", Column(self.time, "s", "time", axes=_AXIS)),
            ("phase", Column(self.phase, "rad", "phase of the drive", axes=_AXIS)),
        ]
        if self.ramp:
            columns.append(("speed", speeds_of(system, self.speeds, axes=_AXIS)))
        for name, values in (*zip(system.coordinates, q, strict=True), *self.outputs.items()):
            unit, meaning = system.units.get(name, ""), system.meanings.get(name, "")
            columns.append((name, Column(values, unit, meaning, axes=_AXIS)))
        require_different_names(columns)
        arrays = {"phase": self.phase, "time": self.time, "q": q, "qd": self.qd}
        arrays["coordinates"] = np.array(system.coordinates)
        return Contents(dict(columns), {}, self.metadata, arrays)


def _figures(values: Array) -> Statistics:
    """Of values (j,) at the nodes, whose phases mean nothing over many turns."""
    size = np.abs(values)
    mean, rms = float(values.mean()), float(np.sqrt(np.square(values).mean()))
    return Statistics(float(values.max()), float(values.min()), float(size.max()), mean, np.nan, np.nan, rms)
