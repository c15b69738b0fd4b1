"""A model fitted to measurement: its parameters with intervals."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

from solve.arrays import Array
from solve.results.channels import Channel
from solve.results.contents import Column, Columns, Facts
from solve.results.lasting import lasting
from solve.results.result import Result
from solve.system import PeriodicSystem


@lasting
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

    @cached_property
    def warnings(self) -> list[str]:
        """Why the model may not belong to the data, and what these cannot tell, a sentence each."""
        return [*self._reduction, *self.doubts, *self.unidentifiable]

    @property
    def whole(self) -> dict[str, Any]:
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

    def facts(self) -> Facts:
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
