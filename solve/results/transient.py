"""The motion in time from a state, turn by turn, beside the orbit that it reaches."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from solve.arrays import Array
from solve.results.contents import Column, Contents, plain, require_different_names
from solve.results.orbit import Orbit
from solve.results.plot import MOST_ROWS, label_quantity, titled
from solve.results.quantities import fixed, prefixed
from solve.results.report import RenderableType, heading, stacked, table, text
from solve.results.result import Result
from solve.results.style import BLUE, VERMILION, Figure, page
from solve.system import PeriodicSystem

_AXIS = ("phase",)
_MOST_TURNS = 40
"""Rows of the table; of more turns every k-th is shown."""


@dataclass(frozen=True)
class Transient(Result):
    """Motions (turns, 3, n, k): q, dq/dφ, d²q/dφ² over the turns at nodes (k,), both ends included; speed in
    rad/s. orbit: what it is compared with, None where there is none; rtol: to which that counts as reached.
    """

    system: PeriodicSystem
    speed: float
    nodes: Array
    motions: Array
    orbit: Orbit | None
    rtol: float
    nonlinear: bool

    @property
    def turns(self) -> int:
        return len(self.motions)

    @property
    def phase(self) -> Array:
        """Phases (j,) of all turns, the end of one and the start of the next once."""
        turns = np.arange(self.turns)[:, None] * self.system.period
        return np.append((turns + self.nodes[:-1]).ravel(), self.turns * self.system.period)

    @property
    def time(self) -> Array:
        """Times (j,) in seconds."""
        return self.phase / self.speed

    @property
    def q(self) -> Array:
        """Coordinates (n, j)."""
        return self._joined(0)

    @property
    def qd(self) -> Array:
        """Velocities (n, j), by time."""
        return self.speed * self._joined(1)

    def _joined(self, derivative: int) -> Array:
        values = self.motions[:, derivative]
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
        if self.orbit is None:
            return [
                "no orbit lies near the last turn: more turns may reach one, or there is none of this period"
            ]
        if self.reached is None:
            last = float(np.nanmax(self.distances[-1]))
            return [f"the orbit is not reached: the last turn is off by {last:.1e} of it; give more turns"]
        return []

    def record(self) -> dict[str, Any]:
        """Of `solve transient --json`: figures of every coordinate over all turns, its largest modulus in
        each of them, and its distance to the orbit."""
        coordinates = {
            name: {
                "unit": self.system.units.get(name, ""),
                "max": values.max(),
                "min": values.min(),
                "max_abs": np.abs(values).max(),
                "end": values[-1],
                "peaks": peaks,
                "distances": distances,
            }
            for name, values, peaks, distances in zip(
                self.system.coordinates, self.q, self.peaks.T, self.distances.T, strict=True
            )
        }
        return {**super().record(), "coordinates": plain(coordinates)}

    @property
    def whole(self) -> dict[str, Any]:
        solved = {"speed": self.speed, "period": self.system.period / self.speed, "nonlinear": self.nonlinear}
        return {**solved, "turns": self.turns, "reached": self.reached, "rtol": self.rtol}

    def report(self, choices: Sequence[str] = ()) -> RenderableType:
        """A row a turn: the largest modulus of each coordinate, and the distance to the orbit."""
        names = self.system.coordinates[:MOST_ROWS]
        sizes = self.peaks.max(axis=0)
        scales = [
            prefixed(self.system.units.get(name, ""), size) for name, size in zip(names, sizes, strict=False)
        ]
        columns = [
            f"{name} ({unit})" if unit else name for name, (_, unit) in zip(names, scales, strict=True)
        ]
        made = table("Largest moduli, turn by turn", "turn", *columns, "from orbit", left=0)
        for turn in range(0, self.turns, -(-self.turns // _MOST_TURNS)):
            row = zip(self.peaks[turn], scales, sizes, strict=False)
            cells = [fixed(peak * factor, size * factor, 6) for peak, (factor, _), size in row]
            distance = self.distances[turn].max()
            made.add_row(str(turn + 1), *cells, f"{distance:.1e}" if np.isfinite(distance) else "–")
        words = f"the orbit is not reached to {self.rtol:g} within {self.turns} turns"
        if self.reached is not None:
            words = f"the orbit is reached to {self.rtol:g} after {self.reached} of {self.turns} turns"
        return stacked(heading(self.system, self.speed, choices), made, text("\n" + words))

    def plot(self) -> Figure:
        """The coordinates over the turns, the orbit beside (matplotlib Figure)."""
        names = self.system.coordinates[:MOST_ROWS]
        turns = self.phase / self.system.period
        kind = "nonlinear" if self.nonlinear else "linear"
        with page(1.1 + 1.5 * len(names), f"{titled(self.system, self.speed)}: {kind} transient") as figure:
            axes = figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
            for place, name, values in zip(axes, names, self.q, strict=False):
                factor = label_quantity(place, self.system, name, values)
                place.plot(turns, factor * values, color=BLUE, linewidth=0.8)
                if self.orbit is not None:
                    found = self.orbit.statistics(name)
                    for level in (found.max, found.min):
                        place.axhline(factor * level, color=VERMILION, linewidth=0.8, linestyle="--")
            axes[-1].set_xlim(0, self.turns)
            axes[-1].set_xlabel(
                "turns" + (" (dashed: extrema of the orbit)" if self.orbit is not None else "")
            )
            figure.align_ylabels(axes)
        return figure

    def contents(self) -> Contents:
        """Time, phase and coordinates, for a file; in .npz and .mat also q, qd (n, j), from whose end another
        transient can go on."""
        system, q = self.system, self.q
        columns = [
            ("time", Column(self.time, "s", "time", axes=_AXIS)),
            ("phase", Column(self.phase, "rad", "phase of the drive", axes=_AXIS)),
        ]
        for name, values in zip(system.coordinates, q, strict=True):
            unit, meaning = system.units.get(name, ""), system.meanings.get(name, "")
            columns.append((name, Column(values, unit, meaning, axes=_AXIS)))
        require_different_names(columns)
        arrays = {"phase": self.phase, "time": self.time, "q": q, "qd": self.qd}
        arrays["coordinates"] = np.array(system.coordinates)
        told = {**self.about, **self.whole, "warnings": self.warnings}
        return Contents(dict(columns), {}, plain(told), arrays)
