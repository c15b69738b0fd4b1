"""Points solved on finer and finer grids, until the errors estimated from two solutions are small enough."""

from collections.abc import Generator, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from solve.arrays import Array, across, different
from solve.certify.certified import Certified, Failed, Request
from solve.certify.estimates import radius_changes, raised, rounding, within_reach
from solve.certify.ladder import STEPS, UNDERFLOW
from solve.certify.two_orders.comparison import Comparison, compared
from solve.certify.two_orders.first_grid import AIM, LEAST, first_steps
from solve.certify.two_orders.unfollowed_modes import unfollowed
from solve.errors import StepsError
from solve.methods.method import Method, Solutions
from solve.period.multipliers import EPS, KNOWN_ON_CIRCLE, UNDETERMINED, roughly
from solve.period.points import Points
from solve.progress import foreseen

_SAFETY = 2.0
"""Factor on the difference to a better solution: the difference is the error to first order, and at least
half of it in 99.8 % of the stored population."""

_GROWTH = 6.0
"""Largest ratio of the steps of two grids in succession."""

_STALLED, _SMALL = 0.5, 1e-6
"""An error below the second is round-off if two finer grids in succession leave it above the first
fraction."""

_AT_ONE = 0.1
"""Fraction of its change between two solutions within which a multiplier is taken for +1."""


def certified(points: Points, method: Method, request: Request) -> Iterator[Certified | Failed]:
    """Each of the points once, in groups as they come.

    On the `steps` given, or on the first grid with errors of at most `rtol`, or of round-off. Errors are
    differences to a better solution, see `Comparison`. A point fails with ResonanceError where an orbit is
    requested and a multiplier is at +1 as far as both solutions can distinguish. Raises StepsError for
    `steps` that the method cannot use at any point.
    """
    comparison = compared(points, method, request)
    solving, refinement = comparison.solving, _Refinement(comparison)
    refused = solving.refused()
    yield from refused
    every = np.delete(np.arange(len(points)), [failure.position for failure in refused])
    if request.steps is None:
        yield from refinement.refined(every)
    else:
        yield from refinement.on_given_steps(request.steps, every)


def grid_sizes(steps: Array) -> Array:
    """The least of 8, 12, 16, 24, 32, … that are not below the steps (k,): few different grids, so that
    points share them and tables are kept."""
    power = np.exp2(np.ceil(np.log2(np.maximum(steps, LEAST))))
    return np.where(0.75 * power >= np.maximum(steps, LEAST), 0.75 * power, power).astype(int)


@dataclass(frozen=True)
class _Compared:
    """Points at positions (k,) with their solutions, better ones, the errors (k, 2) of the first and what a
    period leaves (k,) of modes that it does not follow."""

    positions: Array
    solutions: Solutions
    better: Solutions
    errors: Array
    remainder: Array

    def __len__(self) -> int:
        return len(self.positions)

    def __getitem__(self, some: Array) -> "_Compared":
        return _Compared(
            self.positions[some],
            self.solutions[some],
            self.better[some],
            self.errors[some],
            self.remainder[some],
        )


class _Refinement:
    """Points of a comparison, on given steps or each on as many as it needs."""

    def __init__(self, comparison: Comparison):
        self.comparison, self.solving = comparison, comparison.solving
        self.request, self.method, self.most = self.solving.request, self.solving.method, comparison.most
        self.least_error = np.full((len(self.solving.points), 2), np.inf)
        self.stalls = np.zeros((len(self.solving.points), 2), dtype=int)

    def on_given_steps(self, steps: int, positions: Array) -> Iterator[Certified | Failed]:
        for part in self.comparison.better.parts(steps * self.comparison.times, positions):
            found, _ = yield from self._compared(steps, part, finer=False)
            if found is not None:
                unresolved = self.comparison.unresolved(steps, found.positions, found.solutions)
                np.maximum(found.errors, unresolved, out=found.errors)
                yield from self._ended(found)

    def refined(self, positions: Array) -> Iterator[Certified | Failed]:
        least = np.maximum(self.solving.least[positions], len(self.solving.points.breaks))
        for position in positions[least > self.most].tolist():
            yield Failed(position, self._out_of_reach(int(self.solving.least[position])))
        positions, least = positions[least <= self.most], least[least <= self.most]
        modes = self.solving.modes[positions]
        first = first_steps(self.method, self.solving.points, modes, self.request.rtol)
        first = np.minimum(grid_sizes(np.maximum(first, 1.2 * least)), max(self.most, LEAST))
        pending = {steps: [positions[first == steps]] for steps in different(first)}
        while pending:
            steps = min(pending)
            for part in self.comparison.better.parts(
                steps * self.comparison.times, np.concatenate(pending.pop(steps))
            ):
                for finer, open_ in (yield from self._on(steps, part)):
                    pending.setdefault(finer, []).append(open_)

    def _on(self, steps: int, positions: Array) -> Generator[Any, None, list[tuple[int, Array]]]:
        """Points on one grid: ends those with small errors, returns the others with their next steps."""
        found, overflowing = yield from self._compared(steps, positions, finer=2 * steps <= self.most)
        further = [(2 * steps, overflowing)] if len(overflowing) else []
        if found is None:
            return further
        wanted = within_reach(found.solutions, found.errors, np.full(found.errors.shape, self.request.rtol))
        times = self._growth(found.errors, wanted)
        done = self._accepted(steps, found, wanted)
        foreseen(STEPS, steps, lambda: min(int(times.max() * steps), self.most))
        next_steps = np.minimum(grid_sizes(np.maximum(times * steps, steps + 1)), self.most)
        done |= next_steps <= steps
        yield from self._ended(found[np.flatnonzero(done)])
        open_ = np.flatnonzero(~done)
        next_steps = next_steps[open_]
        return further + [(to, found.positions[open_[next_steps == to]]) for to in different(next_steps)]

    def _compared(
        self, steps: int, positions: Array, finer: bool
    ) -> Generator[Failed, None, tuple[_Compared | None, Array]]:
        """Solutions with their errors; and the points that overflow, if a `finer` grid may solve them."""
        solutions, better = self.comparison.solved(steps, positions)
        failures = {**better.failures, **solutions.failures}
        overflowing = [at for at, why in failures.items() if finer and isinstance(why, StepsError)]
        for at in failures.keys() - set(overflowing):
            yield Failed(int(positions[at]), failures[at])
        known = np.setdiff1d(np.arange(len(positions)), np.array(list(failures), dtype=int))
        again = positions[np.array(overflowing, dtype=int)]
        if not len(known):
            return None, again
        solutions, better, at = solutions[known], better[known], positions[known]
        errors = _SAFETY * self.solving.differences(solutions, better, at)
        errors = np.maximum(errors, rounding(solutions))
        radius, modes = better.multipliers.spectral_radius, self.solving.modes[at]
        remainder = unfollowed(self.method, modes, steps, self.request.rtol * radius)
        errors[:, 1] = np.maximum(errors[:, 1], _relative(remainder, radius))
        errors[~(errors < 1.0)] = np.inf
        found = _Compared(at, solutions, better, errors, remainder)
        return found, again

    def _accepted(self, steps: int, found: _Compared, wanted: Array) -> Array:
        """Whether the errors of points are the wanted ones (k, 2) or round-off (k,), and a finer grid would
        not decide an open verdict. Raises them in place by what no sample of the grid resolves."""
        errors, small = found.errors, found.solutions.multipliers.spectral_radius < UNDERFLOW
        low = (errors < _SMALL) | np.column_stack((np.zeros_like(small), small))
        at, least = found.positions, self.least_error[found.positions]
        self.stalls[at] = np.where(errors < _STALLED * least, 0, self.stalls[at] + 1)
        self.least_error[at] = np.fmin(least, errors)
        done = across(np.logical_and, (errors <= wanted) | (low & (self.stalls[at] > 1)))
        at = np.flatnonzero(done)
        if len(at):
            unresolved = self.comparison.unresolved(steps, found.positions[at], found.solutions[at])
            errors[at] = np.maximum(errors[at], unresolved)
            done[at] = across(np.logical_and, unresolved <= wanted[at])
        return done & ~self._decides(found.solutions, errors)

    def _decides(self, solutions: Solutions, errors: Array) -> Array:
        """Whether a grid of twice the steps would decide the verdict (k,): multipliers are as near to the
        unit circle as their error, which is not round-off."""
        with np.errstate(over="ignore", invalid="ignore"):
            e = np.where(np.isfinite(errors[:, 1]), errors[:, 1], 0.0) * solutions.multipliers.spectral_radius
        near = (e > KNOWN_ON_CIRCLE / 2) & (e < KNOWN_ON_CIRCLE * 2 ** min(self.method.order, 20))
        near &= errors[:, 1] > 4 * rounding(solutions)[:, 1]
        at = np.flatnonzero(near)
        if len(at):
            near[at] = roughly(solutions.multipliers[at], e[at]) == UNDETERMINED
        return near

    def _growth(self, errors: Array, wanted: Array) -> Array:
        """Ratio of the steps (k,) by which errors (k, 2) fall to the aim with the order of the method; 2
        where they are small enough, but something else is not."""
        orders = np.minimum(self.solving.orders, 20)
        with np.errstate(all="ignore"):
            times = np.where(errors <= wanted, 1.0, (errors / (AIM * wanted)) ** (1 / orders))
        times = np.where(np.isfinite(errors), times, 2.0).max(axis=1)
        return np.clip(np.where(times > 1, times, 2.0), 1.0, _GROWTH)

    def _ended(self, found: _Compared) -> Iterator[Certified | Failed]:
        """Points with a multiplier at +1 fail where an orbit is wanted; the others are certified."""
        rho, better = found.solutions.multipliers, found.better.multipliers
        resonant = np.zeros(len(found), dtype=bool)
        if self.request.orbit:
            nearest, change = better.nearest_one, np.abs(better.nearest_one - rho.nearest_one)
            resonant = np.abs(nearest - 1) <= np.maximum(
                _AT_ONE * change, EPS * max(8, found.better.grid.steps)
            )
        yield from self.solving.no_orbits(found.positions[resonant])
        with np.errstate(over="ignore", invalid="ignore"):
            absolute = np.fmax(found.errors[:, 1] * better.spectral_radius, found.remainder)
        none = np.zeros_like(found.errors)
        errors = raised(found.errors, none, none, none, radius_changes(rho, better))
        small = rho.spectral_radius < UNDERFLOW
        for kind in (False, True):
            good = np.flatnonzero(~resonant & (small == kind))
            if len(good):
                chosen = found.solutions[good]
                if kind:
                    chosen = chosen.with_multipliers(
                        chosen.multipliers.with_digits(errors[good, 1], UNDERFLOW)
                    )
                yield from self.solving.certified(found.positions[good], chosen, errors[good], absolute[good])

    def _out_of_reach(self, least: int) -> StepsError:
        return StepsError(
            f"{self.method.name} is stable from {least} steps a period on and takes at most {self.most}; "
            "use a method without limit (radau)"
        )


def _relative(remainder: Array, radius: Array) -> Array:
    """A remainder (k,) relative to the spectral radius (k,), at most 1 where it is finite."""
    with np.errstate(over="ignore"):
        share = np.minimum(remainder / np.maximum(radius, np.finfo(float).tiny), 1.0)
    return np.where(np.isfinite(remainder), share, np.inf)
