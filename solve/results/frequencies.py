"""Natural frequencies at positions of the drive and over a parameter: records, tables and files."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from solve.arrays import Array
from solve.contracts import ModeShape
from solve.errors import ValueOutOfBoundsError
from solve.results.contents import Column, Columns, Contents, model_record, plain
from solve.results.frequencies_plot import shapes_figure, turn_figure, variation_figure
from solve.results.quantities import fixed, headed
from solve.results.report import RenderableType, Table, model_heading, stacked, table
from solve.results.result import Result
from solve.results.style import Figure
from solve.system import PeriodicSystem

_MOST_ROWS = 40
"""Rows of a table; of more positions or values every k-th is shown."""


@dataclass(frozen=True)
class Frequencies(Result):
    """values (m, k): the lowest k frequencies in rad/s, rising, at positions (m,) in rad.

    A frequency is NaN where the static stiffness is not positive: there the position is unstable.
    """

    system: PeriodicSystem
    positions: Array
    values: Array

    @property
    def mean(self) -> Array:
        """Mean over the positions (k,): for a whole turn the cycle's mean."""
        return self.values.mean(axis=0)

    @property
    def freedoms(self) -> int:
        """How many; of a structure those that no inextensible link takes away."""
        return self.system.freedoms

    def shapes(self, number: int = 0) -> list[ModeShape]:
        """How the links move in each mode at the position of that number. Raises ValueOutOfBoundsError
        for a system that is no structure of beams."""
        return self.system.mode_shapes(float(self.positions[number]), self.values[number])

    def plot(self) -> Figure:
        """Mode shapes at one position; frequencies over several. Raises ValueOutOfBoundsError where there
        are no links to draw."""
        if len(self.positions) > 1:
            return turn_figure(self.system, self.positions, self.values)
        if not self.system.links:
            raise ValueOutOfBoundsError(
                f"{self.system.name} at one position has nothing to draw; draw the whole turn: --turn 36"
            )
        return shapes_figure(self.system, float(self.positions[0]), self.shapes())

    @property
    def whole(self) -> dict[str, Any]:
        """Positions (rad), frequencies (rad/s), and figures of these over the positions."""
        return {"positions": self.positions, "frequencies": self.values, **_figures(self.values, 0)}

    @property
    def columns(self) -> Columns:
        """A row a position."""
        columns = {"position": Column(self.positions, "rad", "of the drive")}
        for k, values in enumerate(self.values.T, start=1):
            columns[f"frequency{k}"] = Column(values, "rad/s", f"natural frequency {k}")
        return columns

    def report(self, choices: Sequence[str] = ()) -> RenderableType:
        return stacked(model_heading(self.system, choices), self.table())

    def table(self) -> Table:
        """A row a position, and the figures below."""
        k = self.values.shape[1]
        shown = min(k, 6)
        title = f"Over the turn, rad/s{f': the lowest {shown} of {k}' if shown < k else ''}"
        made = table(title, "position", *(f"mode {i + 1}" for i in range(shown)), left=0)
        largest = float(np.nanmax(self.values, initial=0.0))
        some = range(0, len(self.positions), _every(len(self.positions)))
        rows = {f"{math.degrees(self.positions[at]):.5g}°": self.values[at] for at in some}
        for part in (rows, _figures(self.values, 0)):
            for name, values in part.items():
                made.add_row(name, *(fixed(omega, largest, 6) for omega in values[:shown]))
            made.add_section()
        return made


@dataclass(frozen=True)
class Variation(Result):
    """Frequencies (v, m, k) in rad/s over a parameter, values (v,) in its own unit, at positions (m,) in rad.

    NaN where errors (v,) says why there are none. pinned: the lowest frequency of each link by itself,
    pinned at both ends, (v,) by name.
    """

    system: PeriodicSystem
    parameter: str
    values: Array
    positions: Array
    frequencies: Array
    pinned: dict[str, Array]
    errors: tuple[str | None, ...]

    @property
    def figures(self) -> dict[str, Array]:
        """mean, min and max over the positions (v, k), by name."""
        return _figures(self.frequencies, 1)

    @property
    def mean(self) -> Array:
        """Over the positions (v, k)."""
        return self.figures["mean"]

    def plot(self) -> Figure:
        """The lowest frequency over the parameter beside those of the links alone (thesis Fig. 9.1)."""
        lowest = {name: values[:, 0] for name, values in self.figures.items()}
        whole = len(self.positions) > 1
        return variation_figure(self.system, self.parameter, self.values, lowest, self.pinned, whole)

    @property
    def whole(self) -> dict[str, Any]:
        """In rad/s and rad, the parameter in its own unit."""
        over = {"parameter": self.parameter, "values": self.values, "positions": self.positions}
        return {**over, **self.figures, "pinned": self.pinned, "errors": self.errors}

    @property
    def columns(self) -> Columns:
        """A row a value of the parameter."""
        unit, _ = self.system.parameter_labels[self.parameter]
        columns = {self.parameter: Column(self.values, unit, "varied")}
        for k, (name, values) in itertools.product(range(self.frequencies.shape[2]), self.figures.items()):
            columns[f"frequency{k + 1}_{name}"] = Column(values[:, k], "rad/s", f"{name} over the positions")
        for link, alone in self.pinned.items():
            columns[f"{link}_pinned"] = Column(alone, "rad/s", "the link alone, pinned at both ends")
        return columns

    def report(self, choices: Sequence[str] = ()) -> RenderableType:
        return stacked(model_heading(self.system, choices), self.table())

    def table(self) -> Table:
        """A row a value of the parameter: the lowest frequency, and those of up to three links alone."""
        whole, pinned = len(self.positions) > 1, dict(itertools.islice(self.pinned.items(), 3))
        names = ["mean ω1", "min", "max"] if whole else ["ω1"]
        names += [f"{link} alone" for link in pinned]
        mean_of = f": the mean of {len(self.positions)} positions" if whole else ""
        parameter = headed(self.parameter, self.system.unit_of(self.parameter).name)
        made = table(f"Over {self.parameter}, rad/s{mean_of}", parameter, *names, left=0)
        largest = float(np.abs(self.values).max())
        lowest = [each[:, 0] for each in self.figures.values()][: 3 if whole else 1]
        for number in range(0, len(self.values), _every(len(self.values))):
            cells = (fixed(each[number], 100.0, 6) for each in (*lowest, *pinned.values()))
            made.add_row(fixed(self.values[number], largest, 5), *cells)
        if pinned:
            made.caption = "alone: the link's lowest frequency, pinned at both ends"
        return made


@dataclass(frozen=True)
class Findings(Result):
    """Frequencies at a position; where asked for, over the turn and over a parameter, and mode shapes."""

    here: Frequencies
    turn: Frequencies | None = None
    variation: Variation | None = None
    shapes: Sequence[ModeShape] = ()

    @cached_property
    def warnings(self) -> list[str]:
        """Positions without stiffness, and values of the parameter that the model refuses."""
        texts = []
        if not np.isfinite((self.turn or self.here).values).all():
            texts.append(
                "the static stiffness is not positive at some position: frequencies are missing there"
            )
        if self.variation is not None:
            failed = [error for error in self.variation.errors if error is not None]
            if failed:
                texts.append(f"{len(failed)} of {len(self.variation.errors)} values give none: {failed[0]}")
        return texts

    def record(self) -> dict[str, Any]:
        """Of `solve frequencies --json`; rad/s and rad, parameters in the model's own units."""
        here = {"position": self.here.positions[0], "frequencies": self.here.values[0]}
        further = {
            "turn": self.turn and self.turn.whole,
            "over": self.variation and self.variation.whole,
            "modes": [self._shape_record(shape) for shape in self.shapes],
        }
        head = {**model_record(self.here.system), "freedoms": self.here.freedoms, **here}
        asked = {name: part for name, part in further.items() if part}
        return plain({**head, **asked, "warnings": self.warnings})

    def _shape_record(self, shape: ModeShape) -> dict[str, Any]:
        links = {}
        each = zip(shape.places, shape.displacements, shape.transverse, strict=True)
        for link, (place, moved, transverse) in zip(self.here.system.links, each, strict=True):
            curves = dict(zip(("x", "y", "dx", "dy"), (*place.T, *moved.T), strict=True))
            links[link.name] = {**curves, "transverse": transverse}
        return {"frequency": shape.frequency, "modal_mass": shape.modal_mass, "links": links}

    @property
    def summary(self) -> str:
        """The lowest frequencies at the position."""
        where = f" at {math.degrees(self.here.positions[0]):.6g}°" if self.here.system.moves else ""
        hertz = ", ".join(f"{omega / (2 * math.pi):.4g}" for omega in self.here.values[0])
        return f"The lowest natural frequencies{where}, standing still: {hertz} Hz."

    def report(self, choices: Sequence[str] = ()) -> RenderableType:
        """Tables for a terminal of 80 columns."""
        head = model_heading(self.here.system, choices)
        head.add_row("freedoms", str(self.here.freedoms))
        if self.here.system.moves:
            head.add_row("position", f"{math.degrees(self.here.positions[0]):.6g}°")
        further = (part.table() for part in (self.turn, self.variation) if part is not None)
        return stacked(head, self._table(), *further)

    def _table(self) -> Table:
        """At the position; with mode shapes, the largest bending of each link."""
        links = [link.name for link in self.here.system.links] if self.shapes else []
        columns = ["modal mass (kg)", *links] if self.shapes else []
        made = table("Natural frequencies", "mode", "rad/s", "Hz", *columns, left=0)
        for k, omega in enumerate(self.here.values[0]):
            row = [str(k + 1), f"{omega:.7g}", f"{omega / (2 * math.pi):.7g}"]
            if self.shapes:
                row.append(f"{self.shapes[k].modal_mass:.4g}")
                row += [f"{np.abs(each).max():.3f}" for each in self.shapes[k].transverse]
            made.add_row(*row)
        if self.shapes:
            made.caption = "of each link: its largest bending, that of the mode being 1"
        return made

    @property
    def system(self) -> PeriodicSystem:  # type: ignore[override]
        return self.here.system

    @property
    def _widest(self) -> "Frequencies | Variation":
        """Over the parameter, else over the turn, else at the position: what a file holds, and a picture."""
        return self.variation or self.turn or self.here

    def contents(self) -> Contents:
        return self._widest.contents()

    def plot(self) -> Figure:
        """Raises ValueOutOfBoundsError where there is nothing to draw."""
        return self._widest.plot()


def _figures(frequencies: Array, axis: int) -> dict[str, Array]:
    return {name: getattr(frequencies, name)(axis=axis) for name in ("mean", "min", "max")}


def _every(rows: int) -> int:
    return math.ceil(rows / _MOST_ROWS)
