"""Effects of parameter tolerances: probability of instability, probabilities that limits are violated, Sobol
indices, and worst cases."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from solve.arrays import Array
from solve.errors import counted
from solve.results.contents import Column, Columns, HeaderRows
from solve.results.result import Result
from solve.results.serialization import serializable
from solve.system import PeriodicSystem

UNSTABLE = "unstable"
"""Name of the probability of instability."""


@serializable
class ParameterSpread(NamedTuple):
    """Spread of a parameter as a string, its nominal value, and the range in which the worst case is searched
    for, in the model's unit."""

    text: str
    nominal: float
    low: float
    high: float


@serializable
class Probability(NamedTuple):
    """Probability of an event, with the ends of its 95 % interval.

    `events` is the number of samples at which the event occurs, `undetermined` is the number of samples at
    which the error is too large to decide whether the event occurs, and `failed` is the number of samples
    without a result. In the upper end of the interval, undetermined and failed samples count as events.
    """

    value: float
    low: float
    high: float
    events: int
    undetermined: int
    failed: int


@serializable
class SobolIndices(NamedTuple):
    """First-order and total Sobol index of a parameter, with 95 % error margins."""

    first: float
    total: float
    first_error: float
    total_error: float


@serializable
class WorstPoint(NamedTuple):
    """Worst value of a quantity within the ranges of the parameters, its value for the nominal parameters,
    the speed (rad/s) of the worst value, and the parameters of the worst value."""

    value: float
    nominal: float
    speed: float
    parameters: Mapping[str, float]


@dataclass(frozen=True)
class Tolerances(Result):
    """Effects of the tolerances of a model's parameters, from `solve.tolerances`.

    Attributes
    ----------
    system : PeriodicSystem
        Model with the nominal parameters.
    speeds : (k,) array
        Speeds in rad/s.
    spreads : mapping of str to ParameterSpread
        Parameters that vary, with their spreads.
    samples, solves : int
        Number of samples for the probabilities, and number of all solutions per speed.
    probability : mapping of str to Probability
        Probabilities of instability, under the name "unstable", and of exceeding each limit.
    sobol : mapping of str to mapping of str to SobolIndices
        Sobol indices for each quantity and parameter.
    worst : mapping of str to WorstPoint
        Worst point for each quantity.
    bounds : mapping of str to tuple of float
        Limits of each quantity, in SI units. The worst value is the one farthest beyond a limit.
    units : mapping of str to str
        Units of quantities.
    points : (P, r) array
        Parameters of the samples, in the model's units.
    values : (P, q) array
        Worst value, at any of the speeds, of each quantity for each sample.
    weights : (P,) array
        Importance weights of the samples in means over the distribution.
    doubts : sequence of str
        Sentences on what is doubtful.
    """

    system: PeriodicSystem
    speeds: Array
    spreads: Mapping[str, ParameterSpread]
    samples: int
    solves: int
    probability: Mapping[str, Probability]
    sobol: Mapping[str, Mapping[str, SobolIndices]]
    worst: Mapping[str, WorstPoint]
    bounds: Mapping[str, Sequence[float]]
    units: Mapping[str, str]
    points: Array
    values: Array
    weights: Array
    doubts: Sequence[str] = ()

    @property
    def summary(self) -> str:
        """Sentence on the probability of instability."""
        found = self.probability[UNSTABLE]
        ends = f"{found.low:.3g} to {found.high:.3g}"
        return f"Probability of instability: {found.value:.3g}, 95 % interval {ends}."

    @property
    def summary_values(self) -> dict[str, Any]:
        return {
            "speeds": self.speeds,
            "tolerances": {name: spread.text for name, spread in self.spreads.items()},
            "samples": self.samples,
            "solves": self.solves,
            "probability": self.probability,
            "sobol": self.sobol,
            "worst": self.worst,
        }

    @property
    def columns(self) -> Columns:
        """Columns of the table, with one row per sample."""
        parameters = {
            name: Column(
                column,
                self.system.labels.parameter_labels[name][0],
                self.system.labels.parameter_labels[name][1],
            )
            for name, column in zip(self.spreads, self.points.T, strict=True)
        }
        quantities = {
            name: Column(column, unit, f"{name}, worst at any of the speeds")
            for (name, unit), column in zip(self.units.items(), self.values.T, strict=True)
        }
        return {**parameters, **quantities, "weight": Column(self.weights, "1", "weight of the sample")}

    def header_rows(self) -> HeaderRows:
        unit = self.system.labels.speed_unit
        texts = [unit.text(float(speed)) for speed in self.speeds]
        shown = texts[0] if len(texts) == 1 else f"{len(texts)} speeds, {texts[0]} to {texts[-1]}"
        return [
            ("speed", shown),
            ("samples", f"{self.samples}, {counted(self.solves, 'solution')} per speed"),
        ]
