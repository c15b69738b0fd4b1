"""Two grids that agree: step doubling on the orbit and on the multipliers separately."""

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from solve.arrays import Array
from solve.errors import StepsError
from solve.methods.auto import Auto
from solve.methods.grid import Grid
from solve.methods.method import Method, Solution
from solve.system import PeriodicSystem

_FIRST_STEPS = 32
_FEW_STEPS = 360

_ROUNDING = 64 * float(np.finfo(float).eps)
"""Relative error below which two grids can no longer be told from rounding."""


@dataclass(frozen=True)
class Certified:
    """A solution with the errors estimated from a second grid; relative, as `rtol` is."""

    method: Method
    solution: Solution
    orbit_error: float
    multiplier_error: float
    warnings: list[str] = field(default_factory=list)


def certified(
    system: PeriodicSystem, speed: float, method: Method, steps: int | None, rtol: float, orbit: bool = True
) -> Certified:
    """With `steps`: that grid, judged by one twice as fine. Without: doubled until both errors of the
    finer grid are estimated at `rtol` or less, or the precision in reach is achieved."""
    refinement = Refinement(system, speed, method.settled(system, speed), orbit)
    if refinement.method.order == 0:
        return refinement.approximated(steps, rtol)
    if steps is not None:
        refinement.refuse(steps)
        return refinement.judged(steps, rtol)
    return refinement.refined(rtol)


@dataclass
class Refinement:
    """What grids of a method can give for a system at a speed."""

    system: PeriodicSystem
    speed: float
    method: Method
    orbit: bool

    @cached_property
    def frozen(self) -> Array:
        return self.system.frozen_eigenvalues(self.speed)

    @cached_property
    def least(self) -> int:
        return 1 if self.method.l_stable else self.method.least_steps(self.frozen, self.system.period)

    @property
    def most(self) -> int:
        return self.method.most_steps(self.system.n)

    def unresolved_modes(self, steps: int) -> list[str]:
        """The quiet vice: a method that is not L-stable keeps what its steps do not resolve."""
        if self.method.l_stable:
            return []
        reach = float(np.abs(self.frozen).max()) * self.system.period
        if reach <= steps * self.method.follows:
            return []
        return [
            f"ω_max h = {reach / steps:.2g}: {steps} steps leave stiff modes unresolved, and "
            f"{self.method.name} neither follows nor damps them: the multipliers may be false though the "
            f"orbit is right; use radau, or at least {math.ceil(reach / self.method.follows)} steps"
        ]

    def refuse(self, steps: int) -> None:
        if steps < max(1, len(self.system.breaks)):
            raise StepsError(
                f"steps is {steps}; allowed: whole numbers of at least "
                f"{max(1, len(self.system.breaks))}; leave --steps out to have it chosen"
            )
        if steps < self.least:
            raise StepsError(
                f"{self.method.name} with {steps} steps a period is beyond its stability limit; use at "
                f"least {self.least} steps, or a method without limit (radau)"
            )
        if steps > self.most:
            raise StepsError(
                f"{self.method.name} takes at most {self.most} steps a period for {self.system.n} coordinates; "
                f"given: {steps}; use fewer, or a method of higher order such as radau"
            )

    def solved(self, steps: int) -> Solution:
        grid = Grid.uniform(steps, self.system.period, self.system.breaks)
        return self.method.solution(self.system, self.speed, grid, self.orbit)

    def approximated(self, steps: int | None, rtol: float) -> Certified:
        """A method that does not converge to the truth, judged by one that does."""
        chosen = self.solved(steps or _FEW_STEPS)
        truth = certified(self.system, self.speed, Auto(), None, min(rtol, 1e-8), self.orbit)
        errors = [max(e, _ROUNDING) for e in differences(chosen, truth.solution)]
        return self._result(chosen, errors, rtol, "is an approximation that")

    def judged(self, steps: int, rtol: float) -> Certified:
        chosen = self.solved(steps)
        found = differences(chosen, self.solved(2 * steps))
        factors = (2.0**order for order in self._orders)
        errors = [max(e * f / (f - 1), _ROUNDING) for e, f in zip(found, factors, strict=True)]
        return self._result(chosen, errors, rtol, f"with {steps} steps")

    def refined(self, rtol: float) -> Certified:
        steps = max(_FIRST_STEPS, len(self.system.breaks), math.ceil(1.2 * self.least))
        coarse, before = self.solved(steps), (math.inf, math.inf)
        while True:
            steps *= 2
            fine = self.solved(steps)
            found = differences(coarse, fine)
            factors = map(_observed, found, before, self._orders)
            errors = [max(float(e / (f - 1)), _ROUNDING) for e, f in zip(found, factors, strict=True)]
            stalled = all(e <= rtol or e >= e0 < 1e-6 for e, e0 in zip(found, before, strict=True))
            reached = errors[0] <= max(rtol, 2 * fine.defect) and errors[1] <= rtol
            if reached or stalled or 2 * steps > self.most:
                return self._result(fine, errors, rtol, "at the precision in reach")
            coarse, before = fine, found

    @property
    def _orders(self) -> tuple[int, int]:
        return self.method.curve_order, self.method.order

    def _result(self, solution: Solution, errors: list[float], rtol: float, where: str) -> Certified:
        errors = [errors[0] + solution.defect, errors[1]]
        missed = [
            f"{name} to {e:.1e}" for name, e in zip(("orbit", "multipliers"), errors, strict=True) if e > rtol
        ]
        warnings = [*self.method.concerns, *solution.notes, *self.unresolved_modes(solution.grid.steps)]
        if missed:
            warnings.append(
                f"{self.method.name} {where} gives the {' and the '.join(missed)} only, not to rtol {rtol:g}"
            )
        return Certified(self.method, solution, errors[0], errors[1], warnings)


def differences(coarse: Solution, fine: Solution) -> tuple[float, float]:
    """Of the orbit, per coordinate max|difference|/max|q|, and of the multipliers."""
    multipliers = coarse.multipliers.difference(fine.multipliers)
    if coarse.curve is None or fine.curve is None:
        return 0.0, multipliers
    phase = coarse.grid.nodes[:-1, None] + coarse.grid.h[:, None] * np.array([0.0, 0.25, 0.5, 0.75])
    q, finer = (curve(phase.ravel()) for curve in (coarse.curve, fine.curve))
    scale = np.abs(finer).max(axis=1)
    error = np.abs(q - finer).max(axis=1)
    return float(np.max(error / np.where(scale > 0, scale, 1.0))), multipliers


def _observed(difference: float, before: float, order: int) -> float:
    """Factor by which doubling reduces the error: as seen, between 2 and 2^order."""
    if difference == 0.0 or not math.isfinite(before):
        return 2.0
    return min(max(before / difference, 2.0), 2.0**order)
