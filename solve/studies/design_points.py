"""Solutions of a model with varied parameters at several speeds, with exact derivatives, for optimisation."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import cast

import numpy as np

from solve.arrays import ROUND_OFF, Array
from solve.derivatives.grid_derivatives import GridDerivatives, dependence_of
from solve.errors import NoDerivativeError
from solve.methods.choice import Rule
from solve.methods.collocated import Collocated
from solve.period.named import RADIUS, Named, Solved
from solve.results.orbit import Orbit
from solve.results.stability import Stability
from solve.single import floquet, periodic
from solve.system import PeriodicSystem


@dataclass(frozen=True, eq=False)
class DesignPoint:
    """Solution at one speed, with derivatives with respect to the r free parameters."""

    solved: Stability
    names: Sequence[str]

    @cached_property
    def _grid(self) -> GridDerivatives:
        rule = cast(Collocated, self.solved.certified.method)
        dependence = dependence_of(self.solved, self.names)
        return GridDerivatives(self.solved, rule, self.solved.steps, dependence, self.names)

    @property
    def orbit(self) -> Orbit:
        """Solution as an orbit. Only valid if the design requires orbits."""
        return cast(Orbit, self.solved)

    def signal(self, name: str, phase: Array) -> Array:
        """Values (k,) of a coordinate or output."""
        return self.orbit.signal(name)(phase)

    def signal_slopes(self, name: str, phase: Array) -> Array:
        """Derivatives (k, r) of a coordinate or output with respect to the free parameters, at fixed
        phases."""
        return self._grid.forward.signal(name, phase).T

    def value(self, quantity: Named) -> float:
        """Value of a real quantity."""
        return float(np.real(quantity.value(cast(Solved, self.solved))))

    def slopes(self, quantity: Named) -> Array:
        """Derivatives (r,) of a real quantity with respect to the free parameters. If several multipliers
        have the spectral radius as their modulus, the derivatives of the first one are returned. Raises
        NoDerivativeError."""
        (slopes,) = self._grid.slopes([quantity])
        if not isinstance(slopes, NoDerivativeError):
            return np.real(slopes)
        if quantity.subject != RADIUS:
            raise slopes
        radius = self.solved.spectral_radius
        return radius * np.real(self._grid.log_multiplier_derivatives(0, modulus=True))


@dataclass(eq=False)
class Design:
    """Model with free parameters between bounds. The optimisation variables x (r,) are the parameters, scaled
    so that they range from 0 to 1.

    `orbits` is True if orbits are required, and False if multipliers suffice.
    """

    model: PeriodicSystem
    names: Sequence[str]
    low: Array
    high: Array
    speeds: list[float]
    method: str | Rule
    rtol: float
    orbits: bool
    _last: tuple[bytes, list[DesignPoint]] = (b"", [])

    @property
    def start(self) -> Array:
        """Variables x (r,) that correspond to the parameters of the model."""
        values = np.array([self.model.labels.parameters[name] for name in self.names])
        return (values - self.low) / (self.high - self.low)

    def parameters(self, x: Array) -> Mapping[str, float]:
        """Mapping from the names of the free parameters to their values, in the model's units."""
        values = self.low + x * (self.high - self.low)
        # Round-off must lead neither beyond a bound nor to a tiny number instead of the bound 0.
        values = np.where(x < ROUND_OFF, self.low, np.where(x > 1 - ROUND_OFF, self.high, values))
        return dict(zip(self.names, values.tolist(), strict=True))

    def varied(self, x: Array) -> PeriodicSystem:
        """Model whose free parameters correspond to x."""
        return self.model.varied(self.parameters(x))

    def points(self, x: Array) -> list[DesignPoint]:
        """Solutions at the design speeds. The most recent solutions are cached."""
        key = x.tobytes() + np.array(self.speeds).tobytes()
        if key != self._last[0]:
            self._last = key, self.at(x, self.speeds)
        return self._last[1]

    def at(self, x: Array, speeds: Sequence[float]) -> list[DesignPoint]:
        """Solutions at other speeds, without caching."""
        model, solve = self.varied(x), periodic if self.orbits else floquet
        return [DesignPoint(solve(model, speed, self.method, rtol=self.rtol), self.names) for speed in speeds]

    def on_grids_of(self, points: Sequence[DesignPoint], x: Array) -> list[DesignPoint]:
        """Solutions for the variables x, computed with the methods and grids of `points`. Errors then cancel
        in finite differences."""
        model = self.varied(x)
        return [
            DesignPoint(
                periodic(model, speed, point.solved.certified.method, point.solved.steps, self.rtol),
                self.names,
            )
            for point, speed in zip(points, self.speeds, strict=True)
        ]

    def slopes(self, by_parameters: Array) -> Array:
        """Convert derivatives with respect to the parameters to derivatives (…, r) with respect to x."""
        return by_parameters * (self.high - self.low)
