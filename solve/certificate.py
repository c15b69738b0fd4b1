"""Two grids that agree: step doubling on the orbit and on the multipliers separately."""

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from solve.arrays import Array
from solve.curve import Curve
from solve.errors import StepsError
from solve.methods.grid import Grid
from solve.methods.method import Method
from solve.methods.period_map import monodromy, periodic_states
from solve.system import PeriodicSystem

_FIRST_STEPS = 32
_MOST_MEMORY = 2**28
"""Bytes that the maps of one period may take before refinement stops."""

_RESOLVED = 1.0
"""ω_max h up to which a step resolves the fastest mode."""

_ROUNDING = 64 * np.finfo(float).eps
"""Relative error below which two grids can no longer be told from rounding."""


@dataclass(frozen=True)
class Multipliers:
    """Floquet multipliers: resolved ones, falling in modulus, + imaginary part first; the rest counted."""

    values: Array
    unresolved: int

    @classmethod
    def of(cls, Phi: Array) -> "Multipliers":
        """Eigenvalues of the monodromy matrix; those below eps‖Φ‖ are rounding and not reported."""
        values = np.linalg.eigvals(Phi).astype(complex)
        values = values[np.argsort(-np.abs(values), kind="stable")]
        pairs = np.flatnonzero((values[1:] == values[:-1].conj()) & (np.imag(values[:-1]) < 0))
        values[pairs], values[pairs + 1] = values[pairs + 1].copy(), values[pairs].copy()
        kept = np.abs(values) > np.finfo(float).eps * np.linalg.norm(Phi, 2)
        return cls(values[kept], int((~kept).sum()))

    @property
    def spectral_radius(self) -> float:
        return float(np.abs(self.values[0])) if len(self.values) else 0.0

    def difference(self, other: "Multipliers") -> float:
        """Largest distance between matched multipliers, relative to the spectral radius."""
        from scipy.optimize import linear_sum_assignment

        ours, theirs = (np.pad(s.values, (0, s.unresolved)) for s in (self, other))
        scale = max(self.spectral_radius, other.spectral_radius)
        if scale == 0.0:
            return 0.0
        distance = np.abs(ours[:, None] - theirs)
        return float(distance[linear_sum_assignment(distance)].max() / scale)


@dataclass(frozen=True)
class Solution:
    """One method on one grid."""

    method: Method
    grid: Grid
    Phi: Array
    multipliers: Multipliers
    curve: Curve | None
    condition: float = math.nan


@dataclass(frozen=True)
class Certified:
    """A solution with the errors estimated from a second grid; relative, as `rtol` is."""

    solution: Solution
    orbit_error: float
    multiplier_error: float
    warnings: list[str] = field(default_factory=list)


def solved(system: PeriodicSystem, speed: float, method: Method, steps: int, orbit: bool = True) -> Solution:
    """The monodromy matrix, and with `orbit` the periodic solution, on one grid."""
    grid = Grid.uniform(steps, system.period, system.breaks)
    discretisation = method.discretise(system, speed, grid)
    Phi = monodromy(discretisation.steps)
    if not np.isfinite(Phi).all():
        raise StepsError(
            f"{method.name} with {grid.steps} steps overflows within one period; use more steps or "
            "the default method"
        )
    curve, condition = None, math.nan
    if orbit:
        states, condition = periodic_states(discretisation.steps)
        curve = discretisation.curve(states)
    return Solution(method, grid, Phi, Multipliers.of(Phi), curve, condition)


def certified(
    system: PeriodicSystem, speed: float, method: Method, steps: int | None, rtol: float, orbit: bool = True
) -> Certified:
    """With `steps`: that grid, judged by one twice as fine. Without: doubled until both errors of the
    finer grid are estimated at `rtol` or less, or the precision in reach is achieved."""
    refinement = _Refinement(system, speed, method, orbit)
    if steps is not None:
        refinement.refuse(steps)
        return refinement.judged(steps, rtol)
    return refinement.refined(rtol)


@dataclass
class _Refinement:
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
        return _MOST_MEMORY // (8 * (2 * self.system.n + 1) ** 2)

    def unresolved_modes(self, steps: int) -> list[str]:
        """The quiet vice: a method that is not L-stable keeps what its steps do not resolve."""
        if self.method.l_stable:
            return []
        reach = float(np.abs(self.frozen).max()) * self.system.period
        if reach <= steps * _RESOLVED:
            return []
        return [
            f"ω_max h = {reach / steps:.2g}: {steps} steps leave stiff modes unresolved, and "
            f"{self.method.name} neither follows nor damps them: the multipliers may be false though the "
            f"orbit is right; use radau, or at least {math.ceil(reach / _RESOLVED)} steps"
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
                f"{steps} steps a period do not fit in memory; allowed: up to {self.most}; use a method of "
                "higher order"
            )

    def solved(self, steps: int) -> Solution:
        return solved(self.system, self.speed, self.method, steps, self.orbit)

    def judged(self, steps: int, rtol: float) -> Certified:
        chosen = self.solved(steps)
        differences = self._differences(chosen, self.solved(2 * steps))
        factors = (2.0**order for order in self._orders)
        errors = [max(e * f / (f - 1), _ROUNDING) for e, f in zip(differences, factors, strict=True)]
        return self._result(chosen, errors, rtol, f"with {steps} steps")

    def refined(self, rtol: float) -> Certified:
        steps = max(_FIRST_STEPS, len(self.system.breaks), math.ceil(1.2 * self.least))
        coarse, before = self.solved(steps), (math.inf, math.inf)
        while True:
            steps *= 2
            fine = self.solved(steps)
            differences = self._differences(coarse, fine)
            factors = map(_observed, differences, before, self._orders)
            errors = [max(e / (f - 1), _ROUNDING) for e, f in zip(differences, factors, strict=True)]
            stalled = all(e <= rtol or e >= e0 < 1e-6 for e, e0 in zip(differences, before, strict=True))
            if max(errors) <= rtol or stalled or 2 * steps > self.most:
                return self._result(fine, errors, rtol, "at the precision in reach")
            coarse, before = fine, differences

    @property
    def _orders(self) -> tuple[int, int]:
        return self.method.curve_order, self.method.order

    def _result(self, solution: Solution, errors: list[float], rtol: float, where: str) -> Certified:
        missed = [
            f"{name} to {e:.1e}" for name, e in zip(("orbit", "multipliers"), errors, strict=True) if e > rtol
        ]
        warnings = [*self.method.concerns(), *self.unresolved_modes(solution.grid.steps)]
        if missed:
            warnings.append(
                f"{self.method.name} {where} gives the {' and the '.join(missed)} only, not to rtol {rtol:g}"
            )
        return Certified(solution, errors[0], errors[1], warnings)

    def _differences(self, coarse: Solution, fine: Solution) -> tuple[float, float]:
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
