"""Natural frequencies at positions of the drive and over a parameter: records, tables and files."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np

from solve.arrays import Array
from solve.contracts import ModeShape
from solve.errors import ValueOutOfBoundsError
from solve.results.contents import Column, Columns, Contents, model_record, plain
from solve.results.frequencies_plot import positions_figure, shapes_figure, variation_figure
from solve.results.quantities import fixed, headed
from solve.results.report import Facts, RenderableType, Table, digits, table_of
from solve.results.result import Result
from solve.results.style import Figure
from solve.system import PeriodicSystem

_MOST_MODES, _MOST_LINKS = 6, 3
"""Columns of a table."""

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
            return positions_figure(self.system, self.positions, self.values)
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
        degrees = [f"{each:.5g}°" for each in np.degrees(self.positions)]
        columns = {"position": Column(self.positions, "rad", "of the drive", "position", degrees)}
        for k, values in enumerate(self.values.T, start=1):
            heading = f"mode {k}" if k <= _MOST_MODES else ""
            meaning = f"natural frequency {k}"
            columns[f"frequency{k}"] = Column(values, "rad/s", meaning, heading, self._text)
        return columns

    def _text(self, omega: float) -> str:
        return fixed(omega, float(np.nanmax(self.values, initial=0.0)), 6)

    def tables(self) -> Sequence[Table]:
        """A row a position, and the figures below."""
        k = self.values.shape[1]
        shown = f": the lowest {_MOST_MODES} of {k}" if k > _MOST_MODES else ""
        made = table_of(f"Over the turn, rad/s{shown}", self.columns, most=_MOST_ROWS)
        made.add_section()
        for name, values in _figures(self.values, 0).items():
            made.add_row(name, *map(self._text, values[:_MOST_MODES]))
        return [made]


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
        return variation_figure(self.system, self.parameter, self.values, lowest, self.pinned, self._several)

    @property
    def whole(self) -> dict[str, Any]:
        """In rad/s and rad, the parameter in its own unit."""
        over = {"parameter": self.parameter, "values": self.values, "positions": self.positions}
        return {**over, **self.figures, "pinned": self.pinned, "errors": self.errors}

    @property
    def columns(self) -> Columns:
        """A row a value of the parameter."""
        unit, _ = self.system.parameter_labels[self.parameter]
        title = headed(self.parameter, self.system.unit_of(self.parameter).name)
        largest, tenths = float(np.abs(self.values).max()), partial(fixed, magnitude=100.0, digits=6)
        varied = partial(fixed, magnitude=largest, digits=5)
        columns = {self.parameter: Column(self.values, unit, "varied", title, varied)}
        headings = {"mean": "mean ω1", "min": "min", "max": "max"} if self._several else {"mean": "ω1"}
        for k, (name, values) in itertools.product(range(self.frequencies.shape[2]), self.figures.items()):
            about = "rad/s", f"{name} over the positions", headings.get(name, "") if k == 0 else ""
            columns[f"frequency{k + 1}_{name}"] = Column(values[:, k], *about, tenths)
        for number, (link, alone) in enumerate(self.pinned.items()):
            about = "rad/s", "the link alone, pinned at both ends", f"{link} alone" * (number < _MOST_LINKS)
            columns[f"{link}_pinned"] = Column(alone, *about, tenths)
        return columns

    @property
    def _several(self) -> bool:
        """Whether at several positions."""
        return len(self.positions) > 1

    def tables(self) -> Sequence[Table]:
        """A row a value of the parameter: the lowest frequency, and those of up to three links alone."""
        mean_of = f": the mean of {len(self.positions)} positions" if self._several else ""
        caption = "alone: the link's lowest frequency, pinned at both ends" if self.pinned else None
        title = f"Over {self.parameter}, rad/s{mean_of}"
        return [table_of(title, self.columns, most=_MOST_ROWS, caption=caption)]


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
        texts = self._reduction
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

    def facts(self) -> Facts:
        place = f"{math.degrees(self.here.positions[0]):.6g}°"
        return [("freedoms", str(self.here.freedoms)), *[("position", place)] * self.system.moves]

    def tables(self) -> Sequence[RenderableType]:
        """At the position, with mode shapes the largest bending of each link; over the turn; over a
        parameter."""
        omegas, caption = self.here.values[0], None
        columns = {
            "mode": Column(range(1, len(omegas) + 1), heading="mode"),
            "frequency": Column(omegas, heading="rad/s", text=digits(".7g")),
            "hertz": Column(omegas, heading="Hz", text=digits(".7g", 1 / (2 * math.pi))),
        }
        if self.shapes:
            masses = [shape.modal_mass for shape in self.shapes]
            columns["mass"] = Column(masses, heading="modal mass (kg)", text=digits(".4g"))
            caption = "of each link: its largest bending, that of the mode being 1"
            for number, link in enumerate(self.system.links):
                bending = [np.abs(shape.transverse[number]).max() for shape in self.shapes]
                columns[link.name] = Column(bending, heading=link.name, text=digits(".3f"))
        further = (part.tables() for part in (self.turn, self.variation) if part is not None)
        return [table_of("Natural frequencies", columns, caption=caption), *itertools.chain(*further)]

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
