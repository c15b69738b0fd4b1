"""A model fitted to measurement: its parameters with intervals."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from solve.arrays import Array
from solve.results.contents import Column, Columns, HeaderRows
from solve.results.result import Result
from solve.results.serialization import serializable, stored_property
from solve.system import PeriodicSystem
from solve.units import ShownUnit


@serializable
class Channel(NamedTuple):
    """Measured and computed values (k,) of a coordinate or output at phases, or of orders, at a speed
    (rad/s); complex where orders have phase angles. position: the phase at which natural frequencies are
    those of the modes `at`, at rest."""

    speed: float
    orders: bool
    name: str
    at: Array
    measured: Array
    computed: Array
    position: float | None = None

    @property
    def record(self) -> dict[str, Any]:
        """For JSON."""
        return {"speed": self.speed, "name": self.name, "difference": self.relative}

    def where(self, unit: ShownUnit) -> str:
        """Speed in a unit, or position of what rests."""
        return unit.text(self.speed) if self.position is None else f"at {np.degrees(self.position):.6g}°"

    @property
    def axis(self) -> str:
        """What the values are functions of, as a label."""
        return "phase (°)" if self.by_phase else "order" if self.orders else "mode"

    @property
    def by_phase(self) -> bool:
        """Whether it is a curve over the phase."""
        return self.position is None and not self.orders

    @property
    def relative(self) -> float:
        """Root mean square of the difference, relative to that of what was measured."""
        size = math.sqrt(float(np.mean(np.abs(self.measured) ** 2)))
        off = math.sqrt(float(np.mean(np.abs(self.computed - self.measured) ** 2)))
        return off / size if size else math.nan


@serializable
class Interval(NamedTuple):
    """A fitted value, and the ends of the interval that holds the true one in 95 of 100 cases, in the model's
    unit; infinite where the data do not tell."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Fitted(Result):
    """system: the model with the fitted values. parameters: by name. correlations (r, r) between them.
    residual: root mean square of all differences, each channel by its own size. unidentifiable: in words,
    what the data cannot tell; doubts: why the data and the model may not belong together."""

    system: PeriodicSystem
    data: str
    parameters: Mapping[str, Interval]
    correlations: Array
    residual: float
    unidentifiable: Sequence[str]
    channels: Sequence[Channel]
    doubts: Sequence[str] = ()

    @stored_property
    def warnings(self) -> list[str]:
        """Why the model may not belong to the data, and what these cannot tell, a sentence each."""
        return [*self._reduction, *self.doubts, *self.unidentifiable]

    @property
    def summary_values(self) -> dict[str, Any]:
        return {
            "fitted": dict(self.system.parameters),
            "data": self.data,
            "intervals": self.parameters,
            "correlations": self.correlations,
            "residual": self.residual,
            "unidentifiable": self.unidentifiable,
            "channels": [each.record for each in self.channels],
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

    def header_rows(self) -> HeaderRows:
        return [("data", self.data)]

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
