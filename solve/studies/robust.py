"""Robust objectives: mean plus a multiple of the standard deviation of a quantity over machines with
deviating parameters, with exact derivatives.

The deviations are the same for every design, so that the objective is a smooth function of the design.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from solve.arrays import Array
from solve.model.spread import Spread
from solve.period.named import Named
from solve.studies.design_points import Design
from solve.studies.probability import normal_variables
from solve.studies.tracked import leading

_MACHINES = 16
"""Number of machines, a power of two for a Sobol sequence. A choice: the objective of an oscillator then
agrees with integrals to 2 %."""


@dataclass(frozen=True)
class Robust:
    """Robust objective of a quantity at one speed: mean plus a multiple of the standard deviation over
    sampled machines."""

    machines: Sequence[Design]
    at: int
    quantity: Named
    multiple: float

    def values(self, x: Array) -> Array:
        values, _ = self._each(x)
        return np.array([values.mean() + self.multiple * values.std()])

    def slopes(self, x: Array) -> Array:
        values, slopes = self._each(x)
        deviation = values.std()
        weights = np.full(len(values), 1 / len(values))
        if deviation > 0:
            weights += self.multiple * (values - values.mean()) / (len(values) * deviation)
        return (weights @ slopes)[None]

    def _each(self, x: Array) -> tuple[Array, Array]:
        """Values (s,) and derivatives (s, r) for the s machines."""
        found = [leading(machine, x, self.at, self.quantity) for machine in self.machines]
        return np.array([value for value, _ in found]), np.array([slopes for _, slopes in found])


def deviating(design: Design, spreads: Mapping[str, Spread]) -> list[Design]:
    """Sampled machines whose parameters deviate from those of the design by the given spreads."""
    from scipy.stats.qmc import Sobol

    cube = Sobol(len(spreads), rng=np.random.default_rng(0)).random(_MACHINES)
    machines = []
    for row in normal_variables(cube):
        values = {
            name: float(spread.values(at)) for (name, spread), at in zip(spreads.items(), row, strict=True)
        }
        others = {name: value for name, value in values.items() if name not in design.names}
        shift = np.array(
            [
                values.get(name, design.model.parameters[name]) - design.model.parameters[name]
                for name in design.names
            ]
        )
        model = design.model.varied(others) if others else design.model
        ends = design.low + shift, design.high + shift
        # The list of speeds is shared.
        rest = design.speeds, design.method, design.rtol, design.orbits
        machines.append(Design(model, design.names, *ends, *rest))
    return machines
