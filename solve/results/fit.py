"""A model fitted to measurement: its parameters with intervals, and measured beside computed."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np

from solve.arrays import Array
from solve.results.contents import Column, Columns
from solve.results.lasting import lasting
from solve.results.plot import labelled, title_of
from solve.results.quantities import prefixed
from solve.results.report import RenderableType, model_heading, stacked, table, text
from solve.results.result import Result
from solve.results.save import checked, write_whole
from solve.results.style import BLUE, VERMILION, Figure, page
from solve.system import PeriodicSystem

_MOST_PANELS = 8
_CLOSE = 0.9
"""Correlation from which on two parameters are named."""


@lasting
class Interval(NamedTuple):
    """A fitted value, and the ends of the interval that holds the true one in 95 of 100 cases, in the model's
    unit; infinite where the data do not tell."""

    value: float
    low: float
    high: float


@lasting
class Channel(NamedTuple):
    """Measured and computed values (k,) of a coordinate or output at phases, or of orders, at a speed
    (rad/s); complex where orders have phase angles."""

    speed: float
    orders: bool
    name: str
    at: Array
    measured: Array
    computed: Array

    @property
    def relative(self) -> float:
        """Root mean square of the difference, relative to that of what was measured."""
        size = math.sqrt(float(np.mean(np.abs(self.measured) ** 2)))
        off = math.sqrt(float(np.mean(np.abs(self.computed - self.measured) ** 2)))
        return off / size if size else math.nan


@dataclass(frozen=True)
class Fitted(Result):
    """system: the model with the fitted values. parameters: by name. correlations (r, r) between them.
    residual: root mean square of all differences, each channel by its own size. unidentifiable: in words,
    what the data cannot tell."""

    system: PeriodicSystem
    data: str
    parameters: Mapping[str, Interval]
    correlations: Array
    residual: float
    unidentifiable: Sequence[str]
    channels: Sequence[Channel]

    @cached_property
    def warnings(self) -> list[str]:
        """What the data cannot tell, a sentence each."""
        return list(self.unidentifiable)

    @property
    def whole(self) -> dict[str, Any]:
        channels = [
            {"speed": each.speed, "name": each.name, "difference": each.relative} for each in self.channels
        ]
        return {
            "fitted": dict(self.system.parameters),
            "data": self.data,
            "intervals": {name: each._asdict() for name, each in self.parameters.items()},
            "correlations": self.correlations,
            "residual": self.residual,
            "unidentifiable": self.unidentifiable,
            "channels": channels,
        }

    @property
    def columns(self) -> Columns:
        """A row a parameter."""
        every = list(self.parameters.values())
        return {
            "parameter": Column(list(self.parameters), "", "what was fitted"),
            "value": Column([each.value for each in every], "", "in the model's units"),
            "low": Column([each.low for each in every], "", "lower end of the 95 % interval"),
            "high": Column([each.high for each in every], "", "upper end of the 95 % interval"),
        }

    def record(self) -> dict[str, Any]:
        """Of `solve fit --json`, whose `parameters` are those that were fitted."""
        found = super().record()
        return {**found, "parameters": found.pop("intervals")}

    def report(self, choices: Sequence[str] = ()) -> RenderableType:
        """The parameters, how they hang together, and how far computed is from measured."""
        head = model_heading(self.system, choices)
        head.add_row("data", self.data)
        made = table("Fitted, with 95 % intervals", "parameter", "unit", "value", "low", "high", left=2)
        for name, each in self.parameters.items():
            unit = self.system.unit_of(name).name
            cells = (f"{number:.6g}" if math.isfinite(number) else "–" for number in each)
            made.add_row(name, unit, *cells)
        names = list(self.parameters)
        pairs = [
            f"{names[i]} and {names[j]} {self.correlations[i, j]:+.3f}"
            for i in range(len(names))
            for j in range(i)
            if abs(self.correlations[i, j]) >= _CLOSE
        ]
        if pairs:
            made.caption = f"correlated: {', '.join(pairs)}"
        unit = self.system.speed_unit
        off = table("Computed against measured", "quantity", unit.name, "values", "difference, %", left=1)
        for each in self.channels:
            off.add_row(
                each.name, f"{unit.of(each.speed):.6g}", str(len(each.at)), f"{100 * each.relative:.3g}"
            )
        words = f"\nresidual {100 * self.residual:.3g} % of what was measured"
        return stacked(head, made, off, text(words))

    def plot(self) -> Figure:
        """Measured points and computed curves, a panel a channel and speed, up to 8."""
        shown = self.channels[:_MOST_PANELS]
        with page(0.7 + 1.9 * len(shown), f"{title_of(self.system)}: fitted to {self.data}") as figure:
            panels = figure.subplots(len(shown), 1, squeeze=False)[:, 0]
            for axes, each in zip(panels, shown, strict=True):
                measured, computed = (np.abs(part) if np.iscomplexobj(part) else part for part in each[-2:])
                factor, unit = prefixed(self.system.units.get(each.name, ""), float(np.abs(measured).max()))
                order = np.argsort(each.at)
                across = each.at[order] if each.orders else np.degrees(each.at[order])
                line = {"marker": "x", "linestyle": ""} if each.orders else {"linewidth": 1.2}
                axes.plot(
                    across, factor * measured[order], "o", markersize=3, color=VERMILION, label="measured"
                )
                axes.plot(across, factor * computed[order], color=BLUE, label="computed", **line)
                axes.set_ylabel(labelled(each.name, unit))
                axes.set_title(self.system.speed_unit.text(each.speed), loc="left")
                axes.set_xlabel("order" if each.orders else "phase (°)")
            panels[0].legend()
        return figure

    @property
    def toml(self) -> str:
        """The fitted model as a case file: every number with its unit and source."""
        before = f"as in case {self.system.case}" if self.system.case else "as given"
        lines = [
            "[case.fitted]",
            f"title = {json.dumps(f'fitted to {self.data}')}",
            "[case.fitted.parameters]",
        ]
        for name, value in self.system.parameters.items():
            source = before
            if name in self.parameters:
                _, low, high = self.parameters[name]
                source = f"fitted to {self.data}; 95 % interval {low:.6g} to {high:.6g}"
            unit = json.dumps(self.system.parameter_labels[name][0])
            lines.append(f"{name} = {{ value = {value!r}, unit = {unit}, source = {json.dumps(source)} }}")
        return "\n".join(lines) + "\n"

    def save_case(self, path: str | Path) -> None:
        """Write `toml` to a file. Raises FileError."""

        def write(stream: BinaryIO) -> None:
            stream.write(self.toml.encode())

        write_whole(checked_case(path), write)


def checked_case(path: str | Path) -> Path:
    """The path of a case file that can be written. Raises FileError."""
    return checked(path, (".toml",), "case")
