"""Natural frequencies as plain data, tables and files."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from solve.arrays import Array
from solve.results.contents import Contents, table_contents
from solve.results.frequencies import Frequencies, Variation
from solve.results.quantities import fixed
from solve.results.record import model_record, plain
from solve.results.report import model_heading, table
from solve.system import ModeShape

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.table import Table

_MOST_ROWS = 40
"""Rows of a table; of more positions or values every k-th is shown."""


@dataclass(frozen=True)
class Findings:
    """Frequencies at a position; where asked for, over the turn and over a parameter, and mode shapes."""

    here: Frequencies
    turn: Frequencies | None = None
    variation: Variation | None = None
    shapes: Sequence[ModeShape] = ()

    @property
    def warnings(self) -> list[str]:
        """Positions without stiffness, and values of the parameter that the model refuses."""
        found = []
        if not np.isfinite((self.turn or self.here).values).all():
            found.append(
                "the static stiffness is not positive at some position: frequencies are missing there"
            )
        if self.variation is not None:
            failed = [error for error in self.variation.errors if error is not None]
            if failed:
                found.append(f"{len(failed)} of {len(self.variation.errors)} values give none: {failed[0]}")
        return found

    def record(self) -> dict[str, Any]:
        """Of `solve frequencies --json`; rad/s and rad, parameters in SI units."""
        here = {"position": self.here.positions[0], "frequencies": self.here.values[0]}
        record = {**model_record(self.here.system), "freedoms": self.here.freedoms, **here}
        if self.turn is not None:
            record["turn"] = {
                "positions": self.turn.positions,
                "frequencies": self.turn.values,
                "mean": self.turn.mean,
                "min": self.turn.values.min(axis=0),
                "max": self.turn.values.max(axis=0),
            }
        if self.variation is not None:
            record["over"] = _variation_record(self.variation)
        if self.shapes:
            links = _links(self.here)
            record["modes"] = [_shape_record(shape, links) for shape in self.shapes]
        return plain(record | {"warnings": self.warnings})

    def report(self, choices: Sequence[str]) -> RenderableType:
        """Tables for a terminal of 80 columns."""
        from rich.console import Group

        head = model_heading(self.here.system, choices)
        head.add_row("freedoms", str(self.here.freedoms))
        if self.here.system.moves:
            head.add_row("position", f"{math.degrees(self.here.positions[0]):.6g}°")
        parts: list[RenderableType] = [head, _here_table(self.here, self.shapes)]
        if self.turn is not None:
            parts.append(_turn_table(self.turn))
        if self.variation is not None:
            parts.append(_variation_table(self.variation))
        return Group(*parts)

    def contents(self) -> Contents:
        """For a file: over the parameter, else over the turn, else at the position."""
        if self.variation is not None:
            return _variation_contents(self.variation)
        found = self.turn or self.here
        columns: dict[str, tuple[Any, str, str]] = {"position": (found.positions, "rad", "of the drive")}
        for k, values in enumerate(found.values.T, start=1):
            columns[f"frequency{k}"] = (values, "rad/s", f"natural frequency {k}")
        return table_contents(columns, model_record(found.system))


def _links(found: Frequencies) -> list[str]:
    return [link.name for link in found.system.links]


def _here_table(found: Frequencies, shapes: Sequence[ModeShape]) -> Table:
    links = _links(found) if shapes else []
    columns = ["modal mass (kg)", *links] if shapes else []
    made = table("Natural frequencies", "mode", "rad/s", "Hz", *columns, left=0)
    for k, omega in enumerate(found.values[0]):
        row = [str(k + 1), f"{omega:.7g}", f"{omega / (2 * math.pi):.7g}"]
        if shapes:
            row.append(f"{shapes[k].modal_mass:.4g}")
            row += [f"{np.abs(each).max():.3f}" for each in shapes[k].transverse]
        made.add_row(*row)
    if shapes:
        made.caption = "of each link: its largest bending, that of the mode being 1"
    return made


def _every(rows: int) -> int:
    return math.ceil(rows / _MOST_ROWS)


def _turn_table(found: Frequencies) -> Table:
    k = found.values.shape[1]
    shown = min(k, 6)
    title = f"Over the turn, rad/s{f': the lowest {shown} of {k}' if shown < k else ''}"
    made = table(title, "position", *(f"mode {i + 1}" for i in range(shown)), left=0)
    largest = float(np.nanmax(found.values, initial=0.0))

    def cells(values: Array) -> list[str]:
        return [fixed(omega, largest, 6) for omega in values[:shown]]

    every = _every(len(found.positions))
    for position, values in list(zip(found.positions, found.values, strict=True))[::every]:
        made.add_row(f"{math.degrees(position):.5g}°", *cells(values))
    made.add_section()
    for name in ("mean", "min", "max"):
        made.add_row(name, *cells(getattr(found.values, name)(axis=0)))
    return made


def _variation_table(found: Variation) -> Table:
    unit, _ = found.system.parameter_labels[found.parameter]
    names = [f"{found.parameter} ({unit})" if unit != "1" else found.parameter]
    whole = len(found.positions) > 1
    names += ["mean ω1", "min", "max"] if whole else ["ω1"]
    pinned = list(found.pinned.items())[:3]
    title = f"Over {found.parameter}, rad/s" + (
        f": the mean of {len(found.positions)} positions" if whole else ""
    )
    made = table(title, *names, *(f"{link} alone" for link, _ in pinned), left=0)
    largest = float(np.abs(found.values).max())
    figures = (found.mean, found.least, found.greatest) if whole else (found.mean,)
    for number in range(0, len(found.values), _every(len(found.values))):
        row = [fixed(found.values[number], largest, 5)]
        row += [fixed(each[number, 0], 100.0, 6) for each in figures]
        row += [fixed(alone[number], 100.0, 6) for _, alone in pinned]
        made.add_row(*row)
    if pinned:
        made.caption = "alone: the link's lowest frequency, pinned at both ends"
    return made


def _variation_record(found: Variation) -> dict[str, Any]:
    return {
        "parameter": found.parameter,
        "values": found.values,
        "positions": found.positions,
        "mean": found.mean,
        "min": found.least,
        "max": found.greatest,
        "pinned": found.pinned,
        "errors": list(found.errors),
    }


def _variation_contents(found: Variation) -> Contents:
    unit, _ = found.system.parameter_labels[found.parameter]
    columns: dict[str, tuple[Any, str, str]] = {found.parameter: (found.values, unit, "varied")}
    figures = {"mean": found.mean, "min": found.least, "max": found.greatest}
    for k in range(found.mean.shape[1]):
        for name, values in figures.items():
            columns[f"frequency{k + 1}_{name}"] = (values[:, k], "rad/s", f"{name} over the positions")
    for link, alone in found.pinned.items():
        columns[f"{link}_pinned"] = (alone, "rad/s", "the link alone, pinned at both ends")
    return table_contents(columns, model_record(found.system))


def _shape_record(shape: ModeShape, links: Sequence[str]) -> dict[str, Any]:
    each = zip(links, shape.places, shape.displacements, shape.transverse, strict=True)
    return {
        "frequency": shape.frequency,
        "modal_mass": shape.modal_mass,
        "links": {
            link: {
                "x": place[:, 0],
                "y": place[:, 1],
                "dx": displacement[:, 0],
                "dy": displacement[:, 1],
                "transverse": transverse,
            }
            for link, place, displacement, transverse in each
        },
    }
