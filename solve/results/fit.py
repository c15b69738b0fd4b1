"""Fit of a model to measurements: parameters with intervals, and differences for each channel."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from solve.arrays import Array
from solve.model.cases import case_text
from solve.results.contents import Column, Columns, HeaderRows
from solve.results.result import Result
from solve.results.serialization import serializable, stored_property
from solve.system import PeriodicSystem
from solve.units import ShownUnit


@serializable
class Channel(NamedTuple):
    """Measured and computed values (k,) of a coordinate or output at a speed (rad/s). `at` (k,) contains
    phases or, if `orders` is True, orders.

    If `orders` is True and phase angles were measured, the values are complex amplitudes. `position` is the
    phase at which natural frequencies at rest were measured; `at` then contains mode numbers.
    """

    speed: float
    orders: bool
    name: str
    at: Array
    measured: Array
    computed: Array
    position: float | None = None

    @property
    def record(self) -> dict[str, Any]:
        """JSON object of the channel."""
        return {"speed": self.speed, "name": self.name, "difference": self.relative}

    def where(self, unit: ShownUnit) -> str:
        """Text that states the speed or, for natural frequencies, the position of the drive."""
        return unit.text(self.speed) if self.position is None else f"at {np.degrees(self.position):.6g}°"

    @property
    def axis(self) -> str:
        """Label of the horizontal axis in figures."""
        return "phase (°)" if self.by_phase else "order" if self.orders else "mode"

    @property
    def by_phase(self) -> bool:
        """Whether the values are a curve versus phase."""
        return self.position is None and not self.orders

    @property
    def relative(self) -> float:
        """Root mean square of the differences, divided by the root mean square of the measured values."""
        size = math.sqrt(float(np.mean(np.abs(self.measured) ** 2)))
        difference = math.sqrt(float(np.mean(np.abs(self.computed - self.measured) ** 2)))
        return difference / size if size else math.nan


@serializable
class Interval(NamedTuple):
    """Fitted value and the ends of its 95 % confidence interval, in the model's unit. The ends are infinite
    if the data do not determine the value."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Fitted(Result):
    """Fit of a model's parameters to measured data, from `solve.fit`.

    Attributes
    ----------
    system : PeriodicSystem
        Model with the fitted values.
    data : str
        Name of the file of measured data.
    parameters : mapping of str to Interval
        Fitted values and confidence intervals.
    correlations : (r, r) array
        Correlation matrix of the parameters.
    residual : float
        Root mean square of all differences, each divided by the root mean square of its channel.
    unidentifiable : sequence of str
        Sentences on parameters that the data do not determine.
    channels : sequence of Channel
        Measured and computed values.
    doubts : sequence of str
        Sentences on disagreement between data and model.
    """

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
        """Warnings about differences between data and model, and about parameters that the data do not
        determine, one sentence each."""
        return [*super().warnings, *self.unidentifiable]

    @property
    def summary_values(self) -> dict[str, Any]:
        return {
            "fitted": dict(self.system.labels.parameters),
            "data": self.data,
            "intervals": self.parameters,
            "correlations": self.correlations,
            "residual": self.residual,
            "unidentifiable": self.unidentifiable,
            "channels": [channel.record for channel in self.channels],
        }

    @property
    def columns(self) -> Columns:
        """Columns of the table, with one row per parameter."""
        intervals = list(self.parameters.values())
        return {
            "parameter": Column(list(self.parameters), "", "name"),
            "value": Column([interval.value for interval in intervals], "", "in the model's units"),
            "low": Column([interval.low for interval in intervals], "", "lower end of the 95 % interval"),
            "high": Column([interval.high for interval in intervals], "", "upper end of the 95 % interval"),
        }

    def record(self) -> dict[str, Any]:
        """JSON object of `solve fit --json`, with the fitted values as `parameters`."""
        record = super().record()
        intervals = record.pop("intervals")
        return {**record, "parameters": intervals}

    def header_rows(self) -> HeaderRows:
        return [("data", self.data)]

    @property
    def toml(self) -> str:
        """Text of a case file for the fitted model. Every number has its unit and source."""
        sources = {
            name: f"fitted to {self.data}; 95 % interval {interval.low:.6g} to {interval.high:.6g}"
            for name, interval in self.parameters.items()
        }
        return case_text("fitted", f"fitted to {self.data}", self.system.labels, sources)
