"""Two grids that agree: finer and finer steps, orbit and multipliers judged separately."""

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from solve.arrays import Array
from solve.certify.pace import Pace, estimated, far, finished, first_steps, judged, rung, telling_steps
from solve.errors import StepsError
from solve.methods.auto import Auto
from solve.methods.method import Method, Solution, no_orbit
from solve.methods.radau import Radau
from solve.period.grid import Grid
from solve.period.multipliers import NEGLIGIBLE, Multipliers, accumulated, most_rounding, rounding_error
from solve.system import PeriodicSystem

_FEW_STEPS = 360
WITNESS_RTOL = 1e-10
"""Accuracy of multipliers by which others are judged."""

FADED = 1e-30
"""Spectral radius below which multipliers are refined only as long as grids agree better and better."""

_SHARP = 0.1
"""Part of a method's own error within which its extrapolated multiplier must meet +1 to be taken for it."""

_ASTRAY = 0.1
"""Angle (rad) that a mode may be misplaced by after a period for two grids to tell their error."""

_PHASES = 1021
"""Evenly spaced phases at which the orders of the matrices are looked for: no multiple of any grid's."""

_ALIAS = 0.01
"""Part of the tolerance that orders may have that samples do not tell: a resonance may enlarge them."""

_EPS = float(np.finfo(float).eps)


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
    """With `steps`: that grid, judged by one twice as fine. Without: refined until both errors of the
    finer of two grids are estimated at `rtol` or less, or the precision in reach is achieved.

    Raises ResonanceError where an orbit is asked for and a multiplier is at +1 for all that the method
    can tell.
    """
    refinement = Refinement(system, speed, method.settled(system, speed), orbit)
    if steps is not None:
        refinement.refuse(steps)
    if refinement.method.order == 0:
        return refinement.approximated(steps, rtol)
    return refinement.refined(rtol) if steps is None else refinement.judged(steps, rtol)


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

    @cached_property
    def reach(self) -> float:
        """ω_max T, the angle that the fastest frozen mode turns in one period."""
        return float(np.abs(self.frozen).max()) * self.system.period

    def resolved(self, steps: int) -> bool:
        """Whether the steps follow the fastest mode."""
        return self.reach <= steps * self.method.follows

    def unresolved_modes(self, steps: int) -> list[str]:
        """The quiet vice: a method that is not L-stable keeps what its steps do not resolve."""
        if self.method.l_stable or self.resolved(steps):
            return []
        enough = f", or at least {math.ceil(self.reach / self.method.follows)} steps"
        return [
            f"ω_max h = {self.reach / steps:.2g}: {steps} steps leave stiff modes unresolved, and "
            f"{self.method.name} neither follows nor damps them: the multipliers may be false though the "
            f"orbit is right; use radau{enough if self.method.order else ''}"
        ]

    def hidden_error(self, solution: Solution, steps: int) -> float:
        """Error of the multipliers that both of two grids may have, from modes that `steps` do not follow,
        or that they misplace by so much of a turn that the grids may meet by chance.

        An L-stable method loses such modes, which is wrong where they truly live on; any other may turn
        them into anything, and is judged by one that is L-stable.
        """
        if self.resolved(steps) and self.method.drift(self.reach, steps) < _ASTRAY:
            return 0.0
        if not self.method.l_stable:
            return solution.multipliers.difference(self.witness.solution.multipliers)
        lost = float(surviving(self.frozen, self.system.period, steps * self.method.follows))
        radius = max(solution.multipliers.spectral_radius, NEGLIGIBLE)
        return lost / radius if lost < radius else 1.0

    @cached_property
    def content(self) -> Array:
        """Parts of orders 0, 1, … in M, C, K or d, whichever is larger; the largest order of each has 1."""
        phases = np.arange(_PHASES) * (self.system.period / _PHASES)
        M, C, K, d = self.system.in_phase(phases, self.speed)
        unit = 1.0 / np.sqrt(np.maximum(np.abs(np.einsum("kii->ki", M)).mean(axis=0), np.finfo(float).tiny))
        scaled = (*(unit[:, None] * part * unit for part in (M, C, K)), d * unit)
        sizes = [np.abs(np.fft.rfft(part.reshape(_PHASES, -1), axis=0)).max(axis=1) for part in scaled]
        return np.max([size / max(size.max(), np.finfo(float).tiny) for size in sizes], axis=0)

    def alias_error(self, finest: int) -> float:
        """Error of orbit and multipliers that evenly spaced samples cannot tell: orders of the matrices above
        half the finest grid's steps, such as 48 teeth, may look like lower ones on every grid. A series
        needs the orders about them too."""
        if not self.method.samples_evenly or self.system.breaks:
            return 0.0
        seen = finest // 4 if math.isinf(self.method.order) else finest // 2
        return float(self.content[seen + 1 :].sum())

    @cached_property
    def witness(self) -> Certified:
        """The multipliers by a method that is L-stable."""
        return certified(self.system, self.speed, Radau(), None, WITNESS_RTOL, orbit=False)

    def refuse(self, steps: int) -> None:
        fewest = max(1, len(self.system.breaks))
        whole = isinstance(steps, int | np.integer) and not isinstance(steps, bool)
        if not whole or steps < fewest:
            raise StepsError(
                f"steps is {steps!r}; allowed: whole numbers of at least {fewest}; leave --steps out to have "
                "it chosen"
            )
        if steps < self.least:
            raise StepsError(
                f"{self.method.name} with {steps} steps a period is beyond its stability limit; use at "
                f"least {self.least} steps, or a method without limit (radau)"
            )
        most = self.most // 2 if self.method.order else self.most
        if steps > most:
            raise StepsError(
                f"{self.method.name} takes at most {most} steps a period for {self.system.n} "
                f"coordinates; given: {steps}; use fewer, or leave --steps out to have it chosen"
            )

    def solved(self, steps: int) -> Solution:
        grid = Grid.uniform(steps, self.system.period, self.system.breaks)
        return self.method.solution(self.system, self.speed, grid, self.orbit)

    def approximated(self, steps: int | None, rtol: float) -> Certified:
        """A method that does not converge to the truth, judged by one that does."""
        chosen = self.solved(min(_FEW_STEPS, self.most) if steps is None else steps)
        truth = certified(self.system, self.speed, Auto(), None, min(rtol, 1e-8), self.orbit)
        errors = np.maximum(differences(chosen, truth.solution), rounding(chosen))
        return self.result(chosen, errors, rtol, steps)

    def judged(self, steps: int, rtol: float) -> Certified:
        chosen, finer = self.solved(steps), self.solved(2 * steps)
        self.refuse_resonance(chosen, finer, 2.0)
        errors = judged(differences(chosen, finer), self.orders)
        hidden = self.hidden_error(chosen, steps)
        errors = _raised(errors, rounding(chosen), self.alias_error(2 * steps), hidden)
        return self.result(chosen, errors, rtol, steps)

    def refined(self, rtol: float) -> Certified:
        steps, coarse = self.first()
        pace, before = Pace(steps).onward(False, self.most), np.full(2, np.inf)
        while True:
            fine = self.solved(pace.steps)
            found = differences(coarse, fine)
            errors = estimated(found, before, pace, self.orders)
            wanted = within_reach(fine, errors, np.array([max(rtol, 2 * fine.defect), rtol]))
            faded = max(each.multipliers.spectral_radius for each in (coarse, fine)) < FADED
            told = fine.rounding < 1.0
            done = told and bool(finished(found, before, errors, wanted, pace, np.array([False, faded])))
            hidden = self.hidden_error(fine, telling_steps(pace, self.method)) if done else 0.0
            alias = self.alias_error(pace.steps) if done else 0.0
            onward = pace.onward(done or bool(far(pace, errors, wanted, self.orders)), self.most)
            if (done and max(hidden, alias / _ALIAS) <= rtol) or onward.steps > self.most:
                self.refuse_resonance(coarse, fine, pace.ratio)
                hidden = self.hidden_error(fine, telling_steps(pace, self.method))
                errors = _raised(errors, rounding(fine), self.alias_error(pace.steps), hidden)
                return self.result(with_digits(fine, errors[1]) if faded else fine, errors, rtol, None)
            coarse, before, pace = fine, found, onward

    def first(self) -> tuple[int, Solution]:
        """The first grid's steps and solution, or those of a finer one where that overflows."""
        steps = rung(max(first_steps(self.method), len(self.system.breaks), math.ceil(1.2 * self.least)))
        while True:
            try:
                return steps, self.solved(steps)
            except StepsError:
                steps *= 2
                if steps > self.most:
                    raise

    def refuse_resonance(self, coarse: Solution, fine: Solution, ratio: float) -> None:
        """Raise ResonanceError where the multiplier nearest to +1 goes there as the steps get finer."""
        if self.orbit and self.method.order:
            ours, theirs = (np.array(each.multipliers.nearest_one) for each in (coarse, fine))
            if at_one(ours, theirs, ratio, self.method.order, fine.grid.steps):
                raise no_orbit()

    @property
    def orders(self) -> Array:
        """Of the continuous curve and of the multipliers."""
        return np.array([self.method.curve_order, self.method.order])

    def result(self, solution: Solution, errors: Array, rtol: float, steps: int | None) -> Certified:
        """The solution with its errors (2,) and what is doubtful about it.

        Whoever chose the `steps` is told of modes that they do not follow; where refinement chose them,
        an L-stable method has confirmed the multipliers to within their error.
        """
        orbit, multipliers = float(errors[0]) + solution.defect, float(errors[1])
        found = [("orbit", orbit), ("multipliers", multipliers)]
        warnings = list(self.method.concerns)
        if not len(solution.multipliers.values):
            found.pop()
            warnings.append(
                "no multiplier keeps a digit: they are so small that nothing is left of a disturbance after "
                "one turn, and only that is certain"
            )
        missed = [f"{name} to {error:.1e}" for name, error in found if error > rtol]
        if steps is not None or multipliers > rtol:
            warnings += self.unresolved_modes(solution.grid.steps)
        if missed:
            where = "at the precision in reach" if steps is None else f"with {steps} steps"
            if self.method.order == 0:
                where = "is an approximation that"
            warnings.append(
                f"{self.method.name} {where} gives the {' and the '.join(missed)} only, not to rtol {rtol:g}"
            )
        return Certified(self.method, solution, orbit, multipliers, warnings)


def differences(coarse: Solution, fine: Solution) -> Array:
    """Of the orbit, per coordinate max|difference|/max|q|, and of the multipliers: (2,).

    A coordinate that rests but for rounding (the mass that a tuned absorber quiets) has no size of its
    own to compare with; it is measured by the largest.
    """
    multipliers = coarse.multipliers.difference(fine.multipliers)
    if coarse.curve is None or fine.curve is None:
        return np.array([0.0, multipliers])
    phase = coarse.grid.nodes[:-1, None] + coarse.grid.h[:, None] * np.array([0.0, 0.25, 0.5, 0.75])
    q, finer = (curve(phase.ravel()) for curve in (coarse.curve, fine.curve))
    scale = np.abs(finer).max(axis=1)
    scale = np.where(scale > rounding(fine)[0] * scale.max(), scale, scale.max())
    error = np.abs(q - finer).max(axis=1)
    return np.array([np.max(error / np.where(scale > 0, scale, 1.0)), multipliers])


def at_one(coarse: Array, fine: Array, ratio: float, order: float, steps: int) -> Array:
    """Whether multipliers (…) of two grids, the finer one of `steps`, go to +1 as the steps get finer."""
    change = (fine - coarse) / (ratio**order - 1)
    return np.abs(fine + change - 1) <= np.maximum(_SHARP * np.abs(change), _EPS * max(8, steps))


def with_digits(solution: Solution, error: float) -> Solution:
    """The solution with those multipliers alone of which the error (relative to the spectral radius)
    leaves a digit; the others count as unresolved."""
    values = solution.multipliers.values
    kept = np.abs(values) > error * solution.multipliers.spectral_radius
    unresolved = solution.multipliers.unresolved + int((~kept).sum())
    return solution.with_multipliers(Multipliers(values[kept], unresolved))


def within_reach(solution: Solution, errors: Array, wanted: Array) -> Array:
    """Errors (2,) to ask for: the wanted ones, or what rounding leaves where that is more and errors are
    low enough for it to matter."""
    most = max(most_rounding(solution.Phi, solution.multipliers.spectral_radius), 8 * solution.rounding)
    if (errors <= wanted).all() or errors[1] > max(most, wanted[1], 64 * _EPS):
        return wanted
    return np.maximum(rounding(solution), wanted)


def rounding(solution: Solution) -> Array:
    """Errors (2,), of orbit and multipliers, that rounding leaves in a problem of this condition."""
    closing = 0.0
    if not math.isnan(solution.condition):
        closing = _EPS * accumulated(solution.grid.steps) * solution.condition
    floors = closing, max(rounding_error(solution.Phi), 8 * solution.rounding)
    return np.maximum(floors, 64 * _EPS)


def _raised(errors: Array, floors: Array, alias: float, hidden: float) -> Array:
    """Errors (2,) estimated from two grids, raised by what no two grids show: rounding, orders of the
    matrices that they see alike, and modes that neither follows."""
    return np.maximum(np.maximum(errors, floors), [alias, max(alias, hidden)])


def surviving(frozen: Array, period: float, limit: float) -> Array:
    """What a period leaves, at most 1, of the least damped mode with ω T above the limit (…), from frozen
    eigenvalues (…, k, 2n) at k phases."""
    size = np.abs(frozen)
    fast = (size * period > limit) | (size == size.max(axis=-1, keepdims=True))
    rates = np.where(fast, np.real(frozen), -np.inf).max(axis=-1)
    return np.exp(np.minimum(rates.mean(axis=-1) * period, 0.0))
