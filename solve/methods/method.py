"""What every method of this package offers: one period of a system solved on one grid."""

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from solve.arrays import Array
from solve.errors import ResonanceError, StepsError
from solve.period.curve import Curve, PeriodicCurve
from solve.period.grid import Grid
from solve.period.multipliers import Multipliers
from solve.period.period_map import Steps, monodromy, periodic_states
from solve.system import PeriodicSystem

_MOST_MEMORY, _MEMORY_OF_LARGE_SYSTEMS = 2**29, 2**31
"""Bytes that the solution of one period may take at its peak; more where fewer steps would be too few."""
_ENOUGH_STEPS = 2**13


@dataclass(frozen=True)
class Solution:
    """One method on one grid.

    Phi: the monodromy matrix (N, N). curve: the periodic solution, if asked for. steps: the maps
    behind Φ, where the method has them. condition: of the linear system that gave the curve.
    defect: relative error of the curve that no finer grid would mend. rounding: relative error that the
    way to Φ leaves in the multipliers, beyond that of their condition; 1 where the grid does not tell Φ.
    notes: what the method has to say about this solution.
    """

    grid: Grid
    Phi: Array
    curve: PeriodicCurve | None = None
    steps: Steps | None = None
    condition: float = np.nan
    defect: float = 0.0
    rounding: float = 0.0
    notes: list[str] = field(default_factory=list)
    multipliers: Multipliers = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "multipliers", Multipliers.of(self.Phi))

    def with_multipliers(self, multipliers: Multipliers) -> "Solution":
        """The same with other multipliers than all of Φ."""
        changed = copy(self)
        object.__setattr__(changed, "multipliers", multipliers)
        return changed


class Method(Protocol):
    """A method in phase time: M q″ + C q′ + K q = d with derivatives by the phase."""

    @property
    def name(self) -> str: ...

    @property
    def order(self) -> float:
        """Order of convergence at the nodes, and of the multipliers; 0 for an approximation that does
        not converge to the truth, infinite where errors fall faster than any power of the steps."""
        ...

    @property
    def curve_order(self) -> float:
        """Order of convergence of the continuous curve."""
        ...

    @property
    def l_stable(self) -> bool:
        """Whether stiff modes that the steps do not resolve are damped out rather than kept."""
        ...

    @property
    def follows(self) -> float:
        """ω_max h up to which the steps follow the fastest mode."""
        ...

    @property
    def samples_evenly(self) -> bool:
        """Whether all samples of a grid are equally far apart, so that some orders of the matrices look like
        others to it."""
        ...

    def drift(self, angle: float, steps: int) -> float:
        """Angle by which so many steps misplace a mode that turns `angle` in a period, where that matters
        before the mode is lost."""
        ...

    @property
    def concerns(self) -> list[str]:
        """Warnings that the method's own settings deserve."""
        ...

    def settled(self, system: PeriodicSystem, speed: float) -> "Method":
        """The method itself, or the one that it chooses for this system."""
        ...

    def least_steps(self, frozen: Array, period: float) -> int:
        """Steps a period below which the method cannot be stable, from the frozen eigenvalues (k, 2n)
        of the system by phase; 1 where it has no limit."""
        ...

    def most_steps(self, n: int) -> int:
        """Steps a period beyond which n coordinates take too much memory or time."""
        ...

    def solution(self, system: PeriodicSystem, speed: float, grid: Grid, orbit: bool) -> Solution:
        """The monodromy matrix, and with `orbit` the periodic solution."""
        ...


@dataclass(frozen=True)
class Discretisation:
    """A one-step method on a grid.

    steps: the affine maps of its state. curve: from the states at the nodes (m+1, N) to the
    continuous curve of q in the phase.
    """

    steps: Steps
    curve: Callable[[Array], Curve]


class OneStep:
    """A method whose period is a chain of affine maps, given by `discretise`."""

    name: str

    @property
    def follows(self) -> float:
        return 1.0

    @property
    def samples_evenly(self) -> bool:
        return True

    def drift(self, angle: float, steps: int) -> float:
        return 0.0

    @property
    def concerns(self) -> list[str]:
        return []

    def settled(self, system: PeriodicSystem, speed: float) -> Method:
        return self  # type: ignore[return-value]

    def least_steps(self, frozen: Array, period: float) -> int:
        return 1

    def bytes_a_step(self, n: int) -> int:
        """Memory that a step of n coordinates takes at the peak, or somewhat less."""
        return 80 * (2 * n + 1) ** 2

    def most_steps(self, n: int) -> int:
        size = self.bytes_a_step(n)
        return max(_MOST_MEMORY // size, min(_MEMORY_OF_LARGE_SYSTEMS // size, _ENOUGH_STEPS))

    def discretise(self, system: PeriodicSystem, speed: float, grid: Grid) -> Discretisation:
        raise NotImplementedError

    def solution(self, system: PeriodicSystem, speed: float, grid: Grid, orbit: bool) -> Solution:
        discretisation = self.discretise(system, speed, grid)
        with np.errstate(over="ignore", invalid="ignore"):
            Phi = monodromy(discretisation.steps)
        if not np.isfinite(Phi).all():
            raise overflow(self.name, grid.steps)
        if not orbit:
            return Solution(grid, Phi, steps=discretisation.steps)
        states, condition = periodic_states(discretisation.steps)
        if not np.isfinite(condition):
            raise no_orbit()
        return Solution(grid, Phi, discretisation.curve(states), discretisation.steps, float(condition))


def overflow(method: str, steps: int) -> StepsError:
    return StepsError(
        f"{method} with {steps} steps overflows within one period; use more steps or the default method"
    )


def no_orbit() -> ResonanceError:
    return ResonanceError(
        "I - Φ is singular: a Floquet multiplier is at +1, so that the forced motion grows without bound or "
        "is not unique; change the speed or add damping"
    )
