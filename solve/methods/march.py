"""Time marching until the transient has decayed, for comparison with periodic methods."""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from solve.arrays import Array
from solve.errors import StepsError, ValueOutOfBoundsError, counted
from solve.kernel.engines import NUMPY
from solve.methods.method import Discretisation, OneStep, Solutions, one_by_one
from solve.methods.newmark import Newmark
from solve.period.frozen import FrozenModes
from solve.period.grid import Grid
from solve.period.period_map import Steps, affine_period, monodromy, periodic_states, states_from
from solve.period.points import Points


@dataclass(frozen=True)
class March(OneStep):
    """Newmark's method from rest over successive periods, until the transient has decayed to `tolerance`.

    The criterion at the start of a period is ‖x - x_s‖ ≤ tolerance ‖x_s‖, where x_s is the state of the
    periodic solution (section 6.8 of the thesis: 10⁻⁴). A note states the number of periods. The map of one
    period is applied repeatedly, which has the same result as marching at a lower cost. A mode with |ρ| < 1
    takes about ln(tolerance)/ln|ρ| periods."""

    tolerance: float = 1e-4
    most_turns: int = 10**6
    base: Newmark = field(default_factory=Newmark)

    name = "march"

    def __post_init__(self) -> None:
        if not 0 < self.tolerance < 1:
            raise ValueOutOfBoundsError(
                f"tolerance of march is {self.tolerance}; allowed: between 0 and 1; try 1e-4"
            )
        base = self.base
        self._set(
            order=base.order,
            curve_order=base.curve_order,
            phase_constant=base.phase_constant,
            warnings=base.warnings,
        )

    def least_steps(self, modes: FrozenModes) -> Array:
        return self.base.least_steps(modes)

    def discretise(self, points: Points, grid: Grid) -> Discretisation:
        return self.base.discretise(points, grid)

    def solutions(self, points: Points, grid: Grid, orbit: bool, engine: str = NUMPY) -> Solutions:
        if not orbit:
            return super().solutions(points, grid, orbit)
        return one_by_one(points, lambda point: self._from_rest(point, grid))

    def _from_rest(self, point: Points, grid: Grid) -> Solutions:
        """Solution of one point by marching."""
        chain = self.discretise(point, grid)
        found = self.sound(point, grid, monodromy(chain.steps), steps=chain.steps)
        if found.failures:
            raise found.failures[0]
        limit = periodic_states(chain.steps)[0][0, 0]
        start, turns = self.marched(chain.steps, limit, float(found.multipliers.spectral_radius[0]))
        defect = float(np.linalg.norm(start - limit) / np.linalg.norm(limit)) if limit.any() else 0.0
        return replace(
            found,
            curve=chain.curve(states_from(chain.steps, start[None])),
            defect=np.array([defect]),
            notes=(
                (
                    f"march: {counted(turns, 'period')} until the transient decayed to {self.tolerance:g} "
                    "of its initial size"
                ),
            ),
        )

    def marched(self, steps: Steps, limit: Array, radius: float) -> tuple[Array, int]:
        """Return the state at the start of the last period of a motion from rest towards the limit (N,), and
        the number of preceding periods.

        Raises StepsError if the transient does not decay within `most_turns` periods."""
        if radius >= 1.0 or math.log(self.tolerance) < self.most_turns * math.log(max(radius, 1e-300)):
            raise StepsError(
                f"march: the transient does not decay within {self.most_turns} periods (spectral "
                f"radius {radius:.9g}); use a periodic method such as radau"
            )
        period = affine_period(steps)
        x, enough = np.zeros_like(limit), self.tolerance * np.linalg.norm(limit)
        turns = 0
        while np.linalg.norm(x - limit) > enough and turns < self.most_turns:
            x = period.A[0, 0] @ x + period.b[0, 0]
            turns += 1
        return x, turns
