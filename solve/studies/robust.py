"""Robust objectives: statistics of a quantity over a set of machines whose parameters deviate, with exact
derivatives.

The deviations are the same for every design. The objective is therefore a smooth function of the design. An
objective that is a quantile is continuous, but not smooth.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from solve.arguments import number_or_nan
from solve.arrays import Array
from solve.errors import ValueOutOfBoundsError
from solve.model.spread import Spread
from solve.period.named import Named
from solve.studies.design_points import Design
from solve.studies.probability import normal_variables
from solve.studies.tracked import leading, tracked

_MACHINES, _BEYOND = 16, 2
"""Smallest number of machines, and smallest number of machines beyond a quantile. The number of machines is a
power of two, as a Sobol sequence requires. Chosen by judgement. Measured for an oscillator with one to five
varied parameters: mean and standard deviation agree with integrals to 2 %; the 90, 95 and 99 % quantiles,
from 32, 64 and 256 machines, agree to between 1 and 4 %."""

_EXTREME = 0.01
"""Smallest permitted distance of a quantile from 0 and from 1. At this distance, 256 machines are required.
Chosen by judgement."""


class Statistic(NamedTuple):
    """Statistic of the values of several machines: the mean plus a multiple of the standard deviation, or a
    quantile. `amount` is the multiple or the quantile."""

    amount: float
    is_quantile: bool

    @classmethod
    def parse(cls, given: float | str) -> "Statistic":
        """Statistic from a multiple of the standard deviation such as 3, or from a quantile such as "95 %".
        Raises ValueOutOfBoundsError.

        >>> Statistic.parse("95 %").text, Statistic.parse(3).text
        ('95 % quantile', 'mean + 3 σ')
        """
        text = str(given).strip()
        is_quantile = text.endswith("%")
        amount = number_or_nan(text.removesuffix("%")) / (100 if is_quantile else 1)
        if not (_EXTREME <= amount <= 1 - _EXTREME if is_quantile else 0 <= amount < math.inf):
            raise ValueOutOfBoundsError(
                f"robust is {given}; allowed: a multiple >= 0 of the standard deviation, such as 3, or a "
                "quantile from 1 % to 99 %, such as '95 %'"
            )
        return cls(amount, is_quantile)

    @property
    def text(self) -> str:
        """Name of the statistic in tables."""
        return f"{100 * self.amount:g} % quantile" if self.is_quantile else f"mean + {self.amount:g} σ"

    @property
    def machines(self) -> int:
        """Number of machines that the statistic requires."""
        if not self.is_quantile:
            return _MACHINES
        needed = _BEYOND / min(self.amount, 1 - self.amount)
        return max(_MACHINES, 2 ** math.ceil(math.log2(needed)))

    def weights(self, values: Array) -> Array:
        """Derivatives (s,) of the statistic with respect to values (s,). The statistic is homogeneous of
        degree 1, so that it equals the scalar product of these derivatives and the values."""
        count = len(values)
        weights = np.zeros(count)
        if self.is_quantile:
            # Quantiles are interpolated linearly between the s sorted values; value i is the quantile (i -
            # 1/2) / s (Hazen).
            place = min(max(self.amount * count - 0.5, 0.0), count - 1.0)
            below, order = min(int(place), count - 2), np.argsort(values, kind="stable")
            weights[order[below : below + 2]] = below + 1 - place, place - below
            return weights
        weights += 1 / count
        if (deviation := values.std()) > 0:
            weights += self.amount * (values - values.mean()) / (count * deviation)
        return weights


@dataclass(frozen=True)
class Robust:
    """Statistic of a quantity at one speed, over machines whose parameters deviate from their nominal
    values."""

    machines: Sequence[Design]
    at: int
    quantity: Named
    statistic: Statistic

    def values(self, x: Array) -> Array:
        values = np.array(
            [tracked(machine, x, self.at, self.quantity).values(x).max() for machine in self.machines]
        )
        return np.array([self.statistic.weights(values) @ values])

    def slopes(self, x: Array) -> Array:
        found = [leading(machine, x, self.at, self.quantity) for machine in self.machines]
        weights = self.statistic.weights(np.array([value for value, _ in found]))
        return (weights @ np.array([slopes for _, slopes in found]))[None]


def deviating(design: Design, spreads: Mapping[str, Spread], count: int) -> list[Design]:
    """Return `count` machines, a power of two, whose parameters deviate from those of the design. The
    deviations follow from `spreads`, the spreads about the parameters of the model, and are the same for all
    designs."""
    from scipy.stats.qmc import Sobol

    cube = Sobol(len(spreads), rng=np.random.default_rng(0)).random(count)
    machines = []
    for row in normal_variables(cube):
        values = {
            name: float(spread.values(at)) for (name, spread), at in zip(spreads.items(), row, strict=True)
        }
        others = {name: value for name, value in values.items() if name not in design.names}
        shift = np.array(
            [
                values.get(name, design.model.labels.parameters[name]) - design.model.labels.parameters[name]
                for name in design.names
            ]
        )
        model = design.model.varied(others) if others else design.model
        ends = design.low + shift, design.high + shift
        # All machines share the list of speeds.
        rest = design.speeds, design.method, design.rtol, design.orbits
        machines.append(Design(model, design.names, *ends, *rest))
    return machines
