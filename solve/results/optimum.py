"""Optimum of a design: free parameters, objective before and after, requirements, and curves."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from solve.arrays import Array
from solve.model.cases import case_text
from solve.results.contents import Column, Columns, HeaderRows, speeds_of
from solve.results.formatting import measured
from solve.results.result import Result
from solve.results.serialization import serializable
from solve.system import PeriodicSystem

AT_BOUND = 1e-6
"""Distance from a bound, relative to the range of the parameter, within which the parameter counts as lying
on the bound. Chosen by judgement."""


@serializable
class Requirement(NamedTuple):
    """Requirement, with its worst value at any speed for the optimal parameters, and with its bound."""

    name: str
    value: float
    bound: float


@serializable
class Curves(NamedTuple):
    """Values (m,) of a coordinate or output at phases (m,) over a period, for the initial design and the
    optimum."""

    phase: Array
    before: Array
    after: Array


@serializable
class FreeParameter(NamedTuple):
    """Initial value, optimal value and bounds of a free parameter, in the model's unit."""

    before: float
    value: float
    low: float
    high: float

    @property
    def at_bound(self) -> str:
        """Bound on which the optimal value lies: "low", "high", or an empty string for neither."""
        margin = AT_BOUND * (self.high - self.low)
        if self.value - self.low <= margin:
            return "low"
        return "high" if self.high - self.value <= margin else ""


@dataclass(frozen=True)
class Optimum(Result):
    """Optimum of a model's parameters, from `solve.optimise`.

    Attributes
    ----------
    system : PeriodicSystem
        Model with the optimal parameters.
    minimised : str
        Quantity whose largest value at any of the speeds is minimised.
    unit : str
        Unit of this quantity.
    parameters : mapping of str to FreeParameter
        Free parameters.
    objective, before : float
        Largest value at any of the speeds, for the optimal and for the initial parameters.
    constraints : sequence of Requirement
        Requirements with their worst values.
    speeds : (k,) array
        Speeds in rad/s.
    values, values_before : (k,) array
        Minimised quantity at these speeds, for the optimal and for the initial parameters.
    curves : Curves or None
        Curves of the coordinate or output that is minimised, at the speed of its largest value; None for
        other quantities.
    confirmed : mapping of str to object
        Largest value and verdicts of the nonlinear orbits, and proofs; empty without these.
    doubts : sequence of str
        Reasons why the optimum is doubtful, one sentence each.
    """

    system: PeriodicSystem
    minimised: str
    unit: str
    parameters: Mapping[str, FreeParameter]
    objective: float
    before: float
    constraints: Sequence[Requirement]
    speeds: Array
    values: Array
    values_before: Array
    curves: Curves | None
    confirmed: Mapping[str, Any]
    doubts: Sequence[str] = ()

    @property
    def free(self) -> Mapping[str, float]:
        """Mapping from the names of the free parameters to their optimal values, in the model's units."""
        return {name: parameter.value for name, parameter in self.parameters.items()}

    @property
    def summary(self) -> str:
        """Sentence on the reduction of the objective."""
        before, after = measured(self.before, self.unit), measured(self.objective, self.unit)
        if not self.objective < self.before:
            comment = "falls no further" if self.objective == self.before else f"rises to {after}"
            return f"{self.minimised} is {before} and {comment}."
        reduction = 100 * (1 - self.objective / self.before) if self.before > 0 else math.inf
        change = f", by {reduction:.3g} %" if reduction <= 100 else ""
        return f"{self.minimised} falls from {before} to {after}{change}."

    @property
    def summary_values(self) -> dict[str, Any]:
        return {
            "free": self.free,
            "minimised": self.minimised,
            "objective": self.objective,
            "before": self.before,
            "start": {name: parameter.before for name, parameter in self.parameters.items()},
            "constraints": self.constraints,
            "confirmed": self.confirmed,
            "speeds": self.speeds,
        }

    @property
    def columns(self) -> Columns:
        """Columns of the table, with one row per speed."""
        meaning = self.minimised
        return {
            "speed": speeds_of(self.system, self.speeds, heading="speed ({})"),
            "before": Column(self.values_before, self.unit, f"{meaning} before", "before", "{:.6g}".format),
            "optimum": Column(
                self.values, self.unit, f"{meaning} at the optimum", "optimum", "{:.6g}".format
            ),
        }

    def header_rows(self) -> HeaderRows:
        rows = [("minimised", f"{self.minimised}, largest at any of {len(self.speeds)} speeds")]
        return rows if len(self.speeds) > 1 else [("minimised", self.minimised)]

    @property
    def toml(self) -> str:
        """Text of a case file for the optimal model. Every number has its unit and source."""
        sources = {
            name: f"optimum of {self.minimised}; bounds {parameter.low:.6g} to {parameter.high:.6g}"
            for name, parameter in self.parameters.items()
        }
        return case_text("optimum", f"least {self.minimised}", self.system.labels, sources)
