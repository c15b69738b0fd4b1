"""Refinement of grids until the errors estimated from two solutions meet the tolerance."""

from collections.abc import Generator, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from solve.arrays import Array, across, unique_integers
from solve.certify.certified import Certified, Failed, Request, verdicts_of
from solve.certify.comparison import Comparison, compared
from solve.certify.estimates import NO_DIGIT, radius_changes, relative_to_size, rounding, within_reach
from solve.certify.first_grid import AIM, LEAST, UNDERFLOW, first_steps
from solve.certify.solving import Solving
from solve.certify.unfollowed_modes import unfollowed
from solve.errors import StepsError
from solve.methods.method import Method, Solutions
from solve.period.multipliers import EPS, KNOWN_ON_CIRCLE, NEGLIGIBLE, UNDETERMINED
from solve.period.points import Points
from solve.period.rigid_body import Free
from solve.terminal import progress

STEPS = "steps"
"""Name of the progress counter for the steps of a single solution."""

_FEW_STEPS = 360
"""Default steps of an approximation that does not converge: one per degree."""

_SAFETY = 2.0
"""Factor on the difference from a better solution: the difference equals the error to first order, and is at
least half of it in 99.8 % of the stored population."""

_GROWTH = 4 / 3, 2.0, 6.0
"""Least ratio of the steps of the first two grids, and of later ones, when errors have not fallen with the
order of the method; largest ratio."""

_FINE = 192
"""Steps above which sizes differ by a quarter of an octave: extra steps then cost more than an extra grid."""

_STALLED, _ROUND_OFFS, _TINY = 0.5, 1e3, 1e-12
"""An error of at most the second value times the estimated round-off is round-off if two successive grids
leave it above the first fraction of its previous value; below the third value, also if one finer grid raises
it. Larger errors of two successive grids may not fall for other reasons, such as kinks in the
coefficients."""

_STIFF_ROUNDING, _NOISE = EPS / 8, 10.0
"""Measured relative round-off of the softest mode per square of the number of periods of the stiffest one.
Both orders use the same coefficients, so that their difference shows at least a tenth of this round-off."""

_AT_ONE = 0.1
"""Distance from +1, as a fraction of the change between two solutions, within which a multiplier is +1."""


def certified(points: Points, method: Method, request: Request) -> Iterator[Certified | Failed]:
    """Solutions with error estimates, each point once, in groups as they are completed.

    The grid has the given number of `steps`, or is the first one with errors of at most `rtol` or of
    round-off. Errors are differences from a better solution, see `Comparison`. A point fails with
    ResonanceError if an orbit is requested and a multiplier equals +1 within the difference of both
    solutions. Raises StepsError for `steps` that the method cannot use at any point."""
    comparison = compared(points, method, request)
    solving, refinement = comparison.solving, _Refinement(comparison)
    if solving.free is not None and len(kinds := _kinds(solving.free)) > 1:
        yield from _by_kind(solving, kinds)
        return
    refused = solving.refused()
    yield from refused
    every = np.delete(np.arange(len(points)), [failure.position for failure in refused])
    if not method.converges:
        yield from _approximated(solving, every)
    elif request.steps is None:
        yield from refinement.refined(every)
    else:
        yield from refinement.on_given_steps(request.steps, every)


def on_one_grid(
    points: Points, method: Method, request: Request, steps: int
) -> Iterator[tuple[Array, Solutions]]:
    """Better solutions of the points on one grid, without error estimates, in parts with their positions
    (k,); failed points are omitted."""
    solving = Solving(points, method.with_another_stage or method, request)
    for part in solving.parts(steps, np.arange(len(points))):
        solutions = solving.solved(steps, part)
        yield part[solutions.known], solutions[solutions.known]


def grid_sizes(steps: Array) -> Array:
    """Steps (k,) rounded up to 8, 12, 16, 24, …, 128, 192, 224, 256, 320, 384, …: few different grids, which
    points share, so that tables are reused."""
    steps = np.maximum(steps, LEAST)
    octave = np.exp2(np.floor(np.log2(steps)))
    part = octave / np.where(steps > _FINE, 4, 2)
    return (part * np.ceil(steps / part)).astype(int)


@dataclass(frozen=True)
class _Compared:
    """Solutions and better solutions of points at positions (k,); errors (k, 2) of the first; remainder (k,)
    after a period of modes that the steps do not resolve."""

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
    """Refinement of the points of a comparison, on given steps or on as many as each point requires."""

    def __init__(self, comparison: Comparison):
        self.comparison, self.solving = comparison, comparison.solving
        self.request, self.method, self.most = self.solving.request, self.solving.method, comparison.most
        self.previous_errors = np.full((len(self.solving.points), 2), np.inf)
        self.least_radii = np.full(len(self.solving.points), np.inf)
        self.stalls = np.zeros((len(self.solving.points), 2), dtype=int)
        self.grids = np.zeros(len(self.solving.points), dtype=int)

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
        some, modes = self.solving.points[positions], self.solving.modes[positions]
        first = first_steps(self.method, some, modes, self.request.orbit, self.request.rtol)
        first = np.minimum(grid_sizes(np.maximum(first, 1.2 * least)), max(self.most, LEAST))
        pending = {steps: [positions[first == steps]] for steps in unique_integers(first)}
        while pending:
            steps = min(pending)
            for part in self.comparison.better.parts(
                steps * self.comparison.times, np.concatenate(pending.pop(steps))
            ):
                for finer, open_ in (yield from self._on(steps, part)):
                    pending.setdefault(finer, []).append(open_)

    def _on(self, steps: int, positions: Array) -> Generator[Any, None, list[tuple[int, Array]]]:
        """Solve points on one grid; points with small errors are completed, the others returned with their
        next steps."""
        found, overflowing = yield from self._compared(steps, positions, finer=2 * steps <= self.most)
        further = [(2 * steps, overflowing)] if len(overflowing) else []
        if found is None:
            return further
        wanted = np.full(found.errors.shape, self.request.rtol)
        wanted[:, 0] = np.maximum(wanted[:, 0], 2 * found.solutions.defect)
        wanted = within_reach(found.solutions, found.errors, wanted)
        times = self._growth(found, wanted)
        done = self._accepted(steps, found, wanted)
        progress.set_total(STEPS, steps, lambda: min(int(times.max() * steps), self.most))
        next_steps = np.minimum(grid_sizes(np.maximum(times * steps, steps + 1)), self.most)
        yield from self._ended(found[np.flatnonzero(done)])
        open_ = np.flatnonzero(~done)
        next_steps = next_steps[open_]
        return further + [
            (to, found.positions[open_[next_steps == to]]) for to in unique_integers(next_steps)
        ]

    def _compared(
        self, steps: int, positions: Array, finer: bool
    ) -> Generator[Failed, None, tuple[_Compared | None, Array]]:
        """Solutions with their errors, and the points that overflow if a `finer` grid may solve them."""
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
        finest = steps * self.comparison.times
        remainder = unfollowed(self.method, modes, finest, self.request.rtol * radius)
        errors[:, 1] = np.maximum(errors[:, 1], _relative(remainder, radius))
        errors[:, 1] = np.maximum(errors[:, 1], np.minimum(self._stiff_rounding(at), _NOISE * errors[:, 1]))
        # Two solutions that differ visibly may both be wrong about modes that they do not follow.
        errors[(remainder > 0) & (errors[:, 1] > NO_DIGIT), 1] = np.inf
        errors[~(errors < 1.0)] = np.inf
        found = _Compared(at, solutions, better, errors, remainder)
        return found, again

    def _stiff_rounding(self, positions: Array) -> Array:
        """Round-off (k,) of the softest mode due to the coefficients of the stiffest one, relative, for
        methods that damp the stiffest one."""
        if not self.method.l_stable:
            return np.zeros(len(positions))
        periods = self.solving.modes[positions].few_reach / (2 * np.pi)
        return np.asarray(_STIFF_ROUNDING * np.where(np.isfinite(periods), periods, 0.0) ** 2)

    def _accepted(self, steps: int, found: _Compared, wanted: Array) -> Array:
        """Whether points need no finer grid (k,), or none is possible: their errors, including those of
        coefficients between the samples, are the tolerances (k, 2) or round-off, and a finer grid would not
        decide an open verdict. Increases the errors in place by those of coefficients between the samples."""
        errors, small = found.errors, found.solutions.multipliers.spectral_radius < UNDERFLOW
        round_off = rounding(found.solutions)
        round_off[:, 1] = np.maximum(round_off[:, 1], self._stiff_rounding(found.positions))
        low = (errors < _ROUND_OFFS * round_off) | np.column_stack((np.zeros_like(small), small))
        at, previous = found.positions, self.previous_errors[found.positions]
        rises = (errors > previous) & (previous < _TINY)
        falls = errors < _STALLED * previous
        # Unknown multipliers below `UNDERFLOW` are refined as long as they fall.
        radii = found.solutions.multipliers.spectral_radius + found.better.multipliers.spectral_radius
        falls[:, 1] |= small & (radii > NEGLIGIBLE) & (radii < _STALLED * self.least_radii[at])
        self.stalls[at] = np.where(falls, 0, self.stalls[at] + 1 + rises)
        # With kinks in the coefficients errors fall irregularly: the least of all may be a coincidence.
        self.previous_errors[at], self.least_radii[at] = errors, np.fmin(self.least_radii[at], radii)
        last = steps >= self.most
        done = across(np.logical_and, (errors <= wanted) | (low & (self.stalls[at] > 1)) | last)
        at = np.flatnonzero(done)
        if len(at):
            unresolved = self.comparison.unresolved(steps, found.positions[at], found.solutions[at])
            errors[at] = np.maximum(errors[at], unresolved)
            done[at] = across(np.logical_and, unresolved <= wanted[at])
        return (done & ~self._decides(found)) | last

    def _decides(self, found: _Compared) -> Array:
        """Whether a grid of twice the steps would decide an open verdict (k,), if errors fall with the order
        of the method and are not round-off."""
        solutions, order = found.solutions, min(self.method.order, 20)
        with np.errstate(over="ignore", invalid="ignore"):
            e = found.errors[:, 1] * solutions.multipliers.spectral_radius
        decides = np.isfinite(e) & (e > KNOWN_ON_CIRCLE / 2)
        decides &= found.errors[:, 1] > 4 * rounding(solutions)[:, 1]
        for fraction, is_open in ((1.0, True), (0.5**order, False)):
            at = np.flatnonzero(decides)
            if len(at):
                modes = self.solving.modes[found.positions[at]]
                verdicts = verdicts_of(solutions[at], fraction * e[at], modes)
                decides[at] = (verdicts == UNDETERMINED) == is_open
        return decides

    def _growth(self, found: _Compared, wanted: Array) -> Array:
        """Ratio of the steps (k,) at which errors reach the aim with the order of the method; 2 if the errors
        are small enough, but another condition fails."""
        orders = np.minimum(self.solving.orders, 20)
        errors, grids = found.errors, self.grids[found.positions]
        self.grids[found.positions] = grids + 1
        with np.errstate(all="ignore"):
            times = np.where(errors <= wanted, 1.0, (errors / (AIM * wanted)) ** (1 / orders))
        times = np.where(np.isfinite(errors), times, 2.0).max(axis=1)
        first, later, most = _GROWTH
        return np.clip(np.where(times > 1, times, 2.0), np.where(grids, later, first), most)

    def _ended(self, found: _Compared) -> Iterator[Certified | Failed]:
        """Certify points; those with a multiplier +1 fail if an orbit is requested."""
        rho, better = found.solutions.multipliers, found.better.multipliers
        resonant = np.zeros(len(found), dtype=bool)
        if self.request.orbit:
            change = better.nearest_one - rho.nearest_one
            limit = better.nearest_one + self.comparison.remaining * change
            round_off = EPS * max(8, found.better.grid.steps)
            resonant = np.abs(limit - 1) <= _AT_ONE * np.abs(change)
            # Multipliers of modes that the steps do not resolve may be anywhere.
            resonant &= np.isfinite(found.errors[:, 1]) & (np.abs(change) < NO_DIGIT)
            resonant |= np.abs(limit - 1) <= round_off
        yield from self.solving.no_orbits(found.positions[resonant])
        with np.errstate(over="ignore", invalid="ignore"):
            absolute = np.fmax(found.errors[:, 1] * better.spectral_radius, found.remainder)
        # The difference of two multipliers is at most the sum of the radii.
        largest = np.maximum(_SAFETY * (rho.spectral_radius + better.spectral_radius), found.remainder)
        absolute = np.where(rho.spectral_radius < UNDERFLOW, largest, absolute)
        errors = relative_to_size(found.errors, radius_changes(rho, better))
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


def _kinds(free: Free) -> list[Array]:
    """Positions of points with rigid-body modes, of those that also conserve a momentum, and of the
    others."""
    found, conserving = free.modes.any, free.modes.conserving
    kinds = (np.flatnonzero(each) for each in (found & ~conserving, conserving, ~found))
    return [each for each in kinds if len(each)]


def _by_kind(solving: Solving, kinds: list[Array]) -> Iterator[Certified | Failed]:
    """Certify points of different kinds one after another."""
    for at in kinds:
        for found in certified(solving.points[at], solving.method, solving.request):
            if isinstance(found, Failed):
                yield Failed(int(at[found.position]), found.reason)
            else:
                yield replace(found, positions=at[found.positions])


def _approximated(solving: Solving, positions: Array) -> Iterator[Certified | Failed]:
    """Certify points under a method that does not converge, by comparison with one that does."""
    steps = min(_FEW_STEPS, solving.most) if solving.request.steps is None else solving.request.steps
    truth = replace(solving.request, rtol=min(solving.request.rtol, 1e-8), steps=None)
    for part in solving.parts(steps, positions):
        own, part = yield from solving.sound(solving.solved(steps, part), part)
        for method, at in solving.request.reference(solving.points[part]) if len(part) else ():
            for better in certified(solving.points[part[at]], method, truth):
                if isinstance(better, Failed):
                    yield Failed(int(part[at[better.position]]), better.reason)
                    continue
                some = at[better.positions]
                errors = solving.differences(own[some], better.solutions, part[some])
                errors = np.maximum(errors, rounding(own[some]))
                radius = better.solutions.multipliers.spectral_radius
                yield from solving.certified(part[some], own[some], errors, errors[:, 1] * radius)


def _relative(remainder: Array, radius: Array) -> Array:
    """A remainder (k,) relative to the spectral radius (k,), at most 1 where it is finite."""
    with np.errstate(over="ignore"):
        share = np.minimum(remainder / np.maximum(radius, NEGLIGIBLE), 1.0)
    return np.where(np.isfinite(remainder), share, np.inf)
