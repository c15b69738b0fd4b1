"""Time marching until the transient has died: what one does without a periodic procedure."""

import math
from dataclasses import dataclass, field

import numpy as np

from solve.arrays import Array
from solve.errors import StepsError, ValueOutOfBoundsError
from solve.methods.method import Discretisation, OneStep, Solution
from solve.methods.newmark import Newmark
from solve.period.grid import Grid
from solve.period.multipliers import Multipliers
from solve.period.period_map import Steps, affine_period, monodromy, periodic_states, states_from
from solve.system import PeriodicSystem


@dataclass(frozen=True)
class March(OneStep):
    """Newmark's method from rest, turn after turn, until no more is left of the transient than
    `tolerance`: ‖x - x_s‖ ≤ tolerance ‖x_s‖ at the start of a turn, x_s being that of the periodic
    solution (thesis 6.8: 10⁻⁴). The number of turns is noted.

    Turns are applied as the map of one turn, which gives what marching gives, without its cost. A mode
    with |ρ| takes about ln(tolerance)/ln|ρ| turns.
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

    @property
    def samples_evenly(self) -> bool:
        return self.base.samples_evenly

    def drift(self, angle: float, steps: int) -> float:
        return self.base.drift(angle, steps)

    def least_steps(self, frozen: Array, period: float) -> int:
        return self.base.least_steps(frozen, period)

    def discretise(self, system: PeriodicSystem, speed: float, grid: Grid) -> Discretisation:
        return self.base.discretise(system, speed, grid)

    def solution(self, system: PeriodicSystem, speed: float, grid: Grid, orbit: bool) -> Solution:
        discretisation = self.discretise(system, speed, grid)
        steps = discretisation.steps
        if not orbit:
            return Solution(grid, monodromy(steps), steps=steps)
        limit = periodic_states(steps)[0][0]
        Phi = monodromy(steps)
        start, turns = self.marched(steps, limit, Multipliers.of(Phi).spectral_radius)
        note = f"march: {turns} turns until {self.tolerance:g} of the transient was left"
        defect = float(np.linalg.norm(start - limit) / np.linalg.norm(limit)) if limit.any() else 0.0
        curve = discretisation.curve(states_from(steps, start))
        return Solution(grid, Phi, curve, steps, defect=defect, notes=[note])

    def marched(self, steps: Steps, limit: Array, radius: float) -> tuple[Array, int]:
        """The state at the start of the last turn, from rest towards the limit (N,), and the number of
        turns before it.

        Raises StepsError where the transient does not die, or not within `most_turns`.
        """
        if radius >= 1.0 or math.log(self.tolerance) < self.most_turns * math.log(max(radius, 1e-300)):
            raise StepsError(
                f"march: the transient does not die within {self.most_turns} turns (spectral radius "
                f"{radius:.9g}); use a periodic method such as radau"
            )
        period = affine_period(steps)
        x, enough = np.zeros_like(limit), self.tolerance * np.linalg.norm(limit)
        turns = 0
        while np.linalg.norm(x - limit) > enough and turns < self.most_turns:
            x = period.A[0] @ x + period.b[0]
            turns += 1
        return x, turns
