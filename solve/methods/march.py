"""Time marching until the transient has died: what one does without a periodic procedure."""

import math
from dataclasses import dataclass, field

import numpy as np

from solve.arrays import Array
from solve.errors import StepsError, ValueOutOfBoundsError
from solve.methods.grid import Grid
from solve.methods.method import Discretisation, OneStep, Solution
from solve.methods.newmark import Newmark
from solve.methods.period_map import Steps, affine_period, monodromy, periodic_states, states_from
from solve.system import PeriodicSystem


@dataclass(frozen=True)
class March(OneStep):
    """Newmark's method from rest, turn after turn, until the state at the start of a turn changes by
    no more than `tolerance` of its norm (thesis 6.8: 10⁻⁴); the number of turns is noted.

    Turns are applied as the map of one turn, which gives what marching gives, without its cost.
    """

    tolerance: float = 1e-4
    most_turns: int = 10**6
    base: Newmark = field(default_factory=Newmark)

    name = "march"
    l_stable = False

    def __post_init__(self) -> None:
        if not 0 < self.tolerance < 1:
            raise ValueOutOfBoundsError(
                f"tolerance of march is {self.tolerance}; allowed: between 0 and 1; try 1e-4"
            )

    @property
    def order(self) -> int:
        return self.base.order

    @property
    def curve_order(self) -> int:
        return self.base.curve_order

    @property
    def concerns(self) -> list[str]:
        return self.base.concerns

    def least_steps(self, frozen: Array, period: float) -> int:
        return self.base.least_steps(frozen, period)

    def discretise(self, system: PeriodicSystem, speed: float, grid: Grid) -> Discretisation:
        return self.base.discretise(system, speed, grid)

    def solution(self, system: PeriodicSystem, speed: float, grid: Grid, orbit: bool) -> Solution:
        discretisation = self.discretise(system, speed, grid)
        steps = discretisation.steps
        if not orbit:
            return Solution(grid, monodromy(steps), steps=steps)
        start, turns = self.marched(steps)
        note = f"march: {turns} turns until the state changed by no more than {self.tolerance:g} of its norm"
        limit = periodic_states(steps)[0][0]
        defect = float(np.linalg.norm(start - limit) / np.linalg.norm(limit)) if limit.any() else 0.0
        curve = discretisation.curve(states_from(steps, start))
        return Solution(grid, monodromy(steps), curve, steps, defect=defect, notes=[note])

    def marched(self, steps: Steps) -> tuple[Array, int]:
        """The state at the start of the last turn from rest, and the number of turns.

        Raises StepsError where the transient does not die.
        """
        period = affine_period(steps)
        x = np.zeros(steps.b.shape[1])
        for turn in range(1, self.most_turns + 1):
            following = period.A[0] @ x + period.b[0]
            change, size = np.linalg.norm(following - x), np.linalg.norm(following)
            x = following
            if not math.isfinite(size):
                break
            if change <= self.tolerance * size:
                return x, turn
        raise StepsError(
            "march: the transient does not die (a multiplier on or outside the unit circle); "
            "use a periodic method such as radau"
        )
