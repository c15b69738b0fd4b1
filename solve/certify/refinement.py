"""Two grids that agree: finer and finer steps for many points at once, orbit and multipliers judged
separately."""

import math
from collections.abc import Generator, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from solve.arrays import Array, across, different, most, whole
from solve.certify.certified import Certified, Failed, Request
from solve.certify.estimates import (
    Burdens,
    at_one,
    differences,
    monodromy_differences,
    nearly_decided,
    not_followed,
    radius_changes,
    raised,
    rounding,
    within_reach,
)
from solve.certify.first_grid import first_steps
from solve.certify.hidden import hidden
from solve.certify.inertia import singular
from solve.certify.orders import ALIAS, aliasing, unresolved
from solve.certify.pace import (
    FARTHEST,
    SECOND,
    SECOND_FAR,
    Pace,
    estimated,
    fallen,
    finished,
    judged,
    needed_steps,
    onward,
    rung,
    rungs_above,
    seen_by_both,
    sure_powers,
    times_more,
)
from solve.errors import StepsError
from solve.methods.method import Method, Solutions, no_orbit
from solve.period.frozen import Frozen, balanced, frozen
from solve.period.grid import Grid
from solve.period.multipliers import EPS, Multipliers, decided
from solve.period.points import Points
from solve.progress import foreseen, stage

STEPS = "steps"
"""How the stage of a single solution names what is refined."""

_FEW_STEPS = 360
WITNESS_RTOL = 1e-10
"""Accuracy of multipliers by which others are judged, at most."""

_WITNESS_PART, _WITNESS_LEAST = 0.01, 1e-3
"""Part of the errors of others that those of multipliers by which they are judged may have, and at least so
much accuracy."""

UNDERFLOW = 1e-30
"""Spectral radius below which multipliers are refined only as long as grids agree better and better."""

_MEMORY = 2**25
"""Bytes that the points solved at once may take."""


def certified(points: Points, method: Method, request: Request) -> Iterator[Certified | Failed]:
    """Each of the points once, in groups as they come.

    With `steps`: that grid, judged by one twice as fine. Without: refined until both errors of the finer
    of two grids are estimated at `rtol` or less, or the precision in reach is achieved. A point fails with
    ResonanceError where an orbit is asked for and a multiplier is at +1 for all that the method can tell.
    Raises StepsError for `steps` that the method cannot use at any point.
    """
    refinement = Refinement(points, method, request)
    every, failures = np.arange(len(points)), dict(singular(points, refinement.modes))
    if request.steps is not None:
        refused = refinement.unusable(request.steps, np.delete(every, list(failures)))
        failures |= {failure.position: failure.reason for failure in refused}
    if failures:
        yield from (Failed(*failure) for failure in failures.items())
        every = np.delete(every, list(failures))
    if not method.converges:
        yield from refinement.approximated(every)
    elif request.steps is None:
        yield from refinement.refined(every)
    else:
        yield from refinement.judged(every)


def on_one_grid(
    points: Points, method: Method, request: Request, steps: int
) -> Iterator[tuple[Array, Solutions]]:
    """The points on that many steps, not judged, in parts with their positions (k,); failures left out."""
    refinement = Refinement(points, method, request)
    for part in refinement.parts(steps, np.arange(len(points))):
        solutions = refinement.solved(steps, part)
        yield part[solutions.known], solutions[solutions.known]


@dataclass(frozen=True)
class _Trail:
    """Points with the solutions of the last grid that they had, of so many steps, the ratio (k, 1) of these
    to the steps of the grid before, infinite where there was none, and the differences (k, 2) that it made.
    Without solutions: points that begin."""

    positions: Array
    steps: int
    ratio: Array
    differences: Array
    solutions: Solutions | None

    @classmethod
    def begun(cls, positions: Array) -> "_Trail":
        none = np.full((len(positions), 2), np.inf)
        return cls(positions, 0, none[:, :1], none, None)

    def __len__(self) -> int:
        return len(self.positions)

    def __getitem__(self, some: Array) -> "_Trail":
        if whole(some, len(self)):
            return self
        solutions = None if self.solutions is None else self.solutions[some]
        return _Trail(self.positions[some], self.steps, self.ratio[some], self.differences[some], solutions)


@dataclass(frozen=True)
class _Compared:
    """Points on one grid, and of the grids before, whichever these were: multipliers rho, monodromy matrices
    Phi, and the differences (k, 2) `found` on this grid and `before`."""

    pace: Pace
    positions: Array
    fine: Solutions
    rho: Multipliers
    Phi: Array
    found: Array
    before: Array

    def __getitem__(self, some: Array) -> "_Compared":
        if whole(some, len(self.positions)):
            return self
        return _Compared(
            self.pace[some],
            self.positions[some],
            self.fine[some],
            self.rho[some],
            self.Phi[some],
            self.found[some],
            self.before[some],
        )


class Refinement:
    """Points under one method."""

    def __init__(self, points: Points, method: Method, request: Request):
        self.points, self.method, self.request = points, method, request
        self.most = method.most_steps(points.n)
        self.orders = np.array([method.curve_order, method.order])
        self.sure = sure_powers(method)

    @cached_property
    def modes(self) -> Frozen:
        """Frozen ones of all points."""
        return frozen(self.points, engine=self.request.engine)

    @cached_property
    def _equations(self) -> Points:
        """The points as the method solves them: factors would change modal masses, and what an approximation
        makes of these."""
        return balanced(self.points, self.modes) if self.method.converges else self.points

    def burdens(self, positions: Array) -> Burdens:
        """What acts on the coordinates of points at the positions (k,)."""
        return lambda at, sizes: self.modes[positions[at]].burdens(sizes)

    def _stiff_rounding(self, positions: Array) -> Array:
        """What rounding of the stiffest mode's coefficients may make of the softest (k, 1), where a method
        damps the one, so that grids do not tell."""
        if not self.method.l_stable:
            return np.zeros((len(positions), 1))
        turns = self.modes[positions].few_reach / (2 * np.pi)
        return (EPS * turns**2)[:, None]

    def _differences(self, coarse: Solutions, fine: Solutions, positions: Array) -> Array:
        """Of solutions of points at the positions (k,) to better ones, (k, 2)."""
        return differences(coarse, fine, self.burdens(positions), self.request.engine)

    @cached_property
    def least(self) -> Array:
        """Steps (P,) below which the method cannot be stable."""
        if type(self.method).least_steps is Method.least_steps:
            return np.ones(len(self.points), dtype=int)
        return self.method.least_steps(self.modes)

    def unusable(self, steps: Any, positions: Array) -> Iterator[Failed]:
        """The points at which the method is unstable with so many steps. Raises StepsError for a number that
        it can use nowhere."""
        self.method.require_steps(steps, self.points)
        for position in positions[steps < self.least[positions]].tolist():
            reason = StepsError(
                f"{self.method.name} with {steps} steps a period is beyond its stability limit; use at "
                f"least {self.least[position]} steps, or a method without limit (radau)"
            )
            yield Failed(position, reason)

    def solved(self, steps: int, positions: Array) -> Solutions:
        """Those of the points at the positions (k,) on that many steps."""
        points = self._equations[positions]
        grid = Grid.uniform(steps, points.period, points.breaks)
        with stage(f"{self.method.name} on {steps} steps"):
            return self.method.solutions(points, grid, self.request.orbit, self.request.engine)

    def approximated(self, positions: Array) -> Iterator[Certified | Failed]:
        """A method that does not converge to the truth, judged by one that does."""
        steps = min(_FEW_STEPS, self.most) if self.request.steps is None else self.request.steps
        truth = replace(self.request, rtol=min(self.request.rtol, 1e-8), steps=None)
        for part in self.parts(steps, positions):
            chosen, part = yield from self._sound(self.solved(steps, part), part)
            if not len(part):
                continue
            points = self.points[part]
            for method, at in self.request.reference(points):
                for better in certified(points[at], method, truth):
                    if isinstance(better, Failed):
                        yield Failed(int(part[at[better.position]]), better.reason)
                        continue
                    own = chosen[at[better.positions]]
                    these = part[at[better.positions]]
                    found = self._differences(own, better.solutions, these)
                    errors = np.maximum(found, rounding(own))
                    radius = better.solutions.multipliers.spectral_radius
                    yield self._certified(these, own, errors, errors[:, 1] * radius)

    def judged(self, positions: Array) -> Iterator[Certified | Failed]:
        """On the steps given, by twice as many."""
        steps = self.request.steps
        assert steps is not None
        for part in self.parts(2 * steps, positions):
            coarse, part = yield from self._sound(self.solved(steps, part), part)
            if not len(part):
                continue
            fine = self.solved(2 * steps, part)
            known = fine.known
            fine, part = yield from self._sound(fine, part)
            coarse = coarse[known]
            if not len(part):
                continue
            resonant = self._resonant(coarse.multipliers, fine, 2.0)
            yield from self._no_orbits(part[resonant])
            coarse, fine, part = coarse[~resonant], fine[~resonant], part[~resonant]
            if not len(part):
                continue
            errors = judged(self._differences(coarse, fine, part), self.orders)
            unseen = self._hidden(np.full(len(part), steps), part, coarse, errors)
            alias = aliasing(self.points[part], self.method, 2 * steps, given=True)
            radii = radius_changes(coarse.multipliers, fine.multipliers)
            with np.errstate(over="ignore", invalid="ignore"):
                absolute = np.fmax(errors[:, 1] * fine.multipliers.spectral_radius, unseen[:, 2])
            errors = raised(errors, rounding(coarse), alias, unseen[:, :2], radii)
            yield self._certified(part, coarse, errors, absolute)

    def refined(self, positions: Array) -> Iterator[Certified | Failed]:
        """On as many steps as each point needs."""
        first = first_steps(self.method, self.modes[positions], self.request.orbit, self.request.rtol)
        first = np.maximum(np.minimum(first, self.most // 2), len(self.points.breaks))
        first = np.maximum(first, np.ceil(1.2 * self.least[positions])).astype(int)
        for position in positions[first > self.most].tolist():
            yield Failed(position, self._out_of_reach(int(self.least[position])))
        positions, first = positions[first <= self.most], rungs_above(first[first <= self.most])
        pending = {steps: [_Trail.begun(positions[first == steps])] for steps in different(first)}
        while pending:
            steps = min(pending)
            for part in self._fitting(steps, pending.pop(steps)):
                for onward_, trail in (yield from self._on(steps, part)):
                    pending.setdefault(onward_, []).append(trail)

    def _out_of_reach(self, least: int) -> StepsError:
        return StepsError(
            f"{self.method.name} is stable from {least} steps a period on and takes at most {self.most}; "
            "use a method without limit (radau)"
        )

    def _fitting(self, steps: int, trails: list[_Trail]) -> Iterator[list[_Trail]]:
        """The points in parts that fit into memory."""
        for part in self.parts(steps, np.arange(sum(len(trail) for trail in trails))):
            yield [trail for trail in _taken(trails, part) if len(trail)]

    def _on(self, steps: int, trails: list[_Trail]) -> Generator[Any, None, list[tuple[int, _Trail]]]:
        """Points side by side on a grid of so many steps, whichever they come from; returns those that are
        still open, with the steps of the grids to which they go on."""
        old = [trail for trail in trails if trail.solutions is not None]
        trails = old + [trail for trail in trails if trail.solutions is None]
        solutions = self.solved(steps, np.concatenate([trail.positions for trail in trails]))
        further: list[tuple[int, _Trail]] = []
        end = 0
        for trail in trails:
            first, end = end, end + len(trail)
            if trail.solutions is None:
                further += yield from self._begun(steps, trail, solutions.neighbours(first, end))
        fine = solutions.neighbours(0, sum(len(trail) for trail in old))
        if fine.failures:
            old = list(_taken(old, fine.known))
            fine, _ = yield from self._sound(fine, np.concatenate([trail.positions for trail in trails]))
        if len(fine):
            further += yield from self._judged(self._compared(steps, old, fine))
        return further

    def _compared(self, steps: int, trails: list[_Trail], fine: Solutions) -> _Compared:
        """Solutions on a grid of so many steps with those that the points had before."""
        found, rho, Phi, ratio, end = [], [], [], [], 0
        for trail in trails:
            first, end, coarse = end, end + len(trail), trail.solutions
            assert coarse is not None
            found.append(self._differences(coarse, fine.neighbours(first, end), trail.positions))
            rho.append(coarse.multipliers)
            Phi.append(coarse.Phi)
            ratio.append(np.full((len(trail), 1), steps / trail.steps))
        pace = Pace(steps, np.concatenate(ratio), np.concatenate([trail.ratio for trail in trails]))
        positions, before = (
            np.concatenate([getattr(trail, name) for trail in trails])
            for name in ("positions", "differences")
        )
        beside = Multipliers.beside(rho), np.concatenate(Phi), np.concatenate(found)
        return _Compared(pace, positions, fine, *beside, before)

    def _judged(self, these: _Compared) -> Generator[Any, None, list[tuple[int, _Trail]]]:
        """Ends the points that need no finer grid, and returns the others as `_on` does."""
        pace, fine, found, rtol = these.pace, these.fine, these.found, self.request.rtol
        wanted = np.column_stack((np.maximum(rtol, 2 * fine.defect), np.full(len(fine), rtol)))
        small = np.maximum(these.rho.spectral_radius, fine.multipliers.spectral_radius) < UNDERFLOW
        errors, tells = self._errors(these), pace.tells
        if tells.any():
            wanted = within_reach(fine, np.where(tells[:, None], errors, 0.0), wanted)
        done = self._finished(these, errors, wanted, small)
        foreseen(STEPS, pace.steps, lambda: min(needed_steps(pace, errors, wanted, self.orders), self.most))
        ended, last = np.zeros(len(fine), dtype=bool), rung(pace.steps + 1) > self.most
        at = np.flatnonzero(done | last)
        if len(at):
            ended[at] = yield from self._ended(these[at], errors[at], small[at], last)
        still_open = np.flatnonzero(~ended)
        if not len(still_open):
            return []
        times = times_more(found[still_open], wanted[still_open], pace[still_open], self.orders)
        times[(done & tells)[still_open]] = FARTHEST
        trail = _Trail(these.positions, pace.steps, pace.ratio, found, fine)[still_open]
        return _parted(trail, onward(pace.steps, times, self.most))

    def _errors(self, these: _Compared) -> Array:
        """Of the finer grids (k, 2): as three grids tell, or as they surely are."""
        tells = these.pace.tells
        if tells.all():
            return estimated(these.found, these.before, these.pace, self.orders)
        errors = np.maximum(fallen(these.found, these.pace, self.sure), self._stiff_rounding(these.positions))
        if tells.any():
            errors[tells] = estimated(these.found[tells], these.before[tells], these.pace[tells], self.orders)
        return errors

    def _finished(self, these: _Compared, errors: Array, wanted: Array, small: Array) -> Array:
        """Which points need no finer grid (k,). Their errors (k, 2) are raised in place by what their
        matrices, and orders that the steps do not follow, may leave. small (k,): whose multipliers are
        refined only as long as grids agree better and better."""
        pace, fine, found, before = these.pace, these.fine, these.found, these.before
        tiny = np.column_stack((np.zeros_like(small), small))
        done = finished(found, before, errors, wanted, pace, tiny) & (fine.rounding < 1.0)
        if self.method.spectral:
            done &= pace.tells
        by_two = done & ~pace.tells
        if by_two.any():
            at = most(by_two)
            apart = fallen(monodromy_differences(these.Phi[at], fine, at)[:, None], pace[at], self.sure[1])
            errors[at, 1] = np.where(by_two[at], np.maximum(errors[at, 1], apart[:, 0]), errors[at, 1])
            rho, e = fine.multipliers[at], errors[at, 1]
            done[at] &= ~by_two[at] | ((e <= wanted[at, 1]) & decided(rho, e * rho.spectral_radius))
        if done.any():
            at = most(done)
            points = self.points[these.positions[at]]
            left = unresolved(points, self.method, pace[at], found[at], before[at])
            errors[at] = np.where(done[at, None], np.maximum(errors[at], left), errors[at])
            done[at] &= across(np.logical_and, left <= wanted[at])
        if done.any():
            done &= ~nearly_decided(done & pace.tells, fine, errors, found, before, self.method.order)
        return done

    def _begun(
        self, steps: int, trail: _Trail, first: Solutions
    ) -> Generator[Failed, None, list[tuple[int, _Trail]]]:
        """The first grid; points that overflow begin with twice the steps, and those whose curves it does not
        follow go on to three times as many."""
        again = [at for at, reason in first.failures.items() if isinstance(reason, StepsError)]
        if 2 * steps > self.most:
            again = []
        known = first.known
        for at, reason in first.failures.items():
            if at not in again:
                yield Failed(int(trail.positions[at]), reason)
        times = np.where(not_followed(first)[known], SECOND_FAR, SECOND)
        begun = replace(trail, steps=steps, solutions=first)[known]
        further = _parted(begun, onward(steps, times, self.most))
        if again:
            further.append((2 * steps, trail[np.array(again)]))
        return further

    def _ended(
        self, these: _Compared, errors: Array, small: Array, last: bool
    ) -> Generator[Any, None, Array]:
        """Points whose grids agree, unless modes that these do not follow, or orders that they do not see,
        matter and the grids are not the `last`; returns which points have ended (k,)."""
        pace, positions, fine = these.pace, these.positions, these.fine
        unseen = self._hidden(seen_by_both(pace, self.method), positions, fine, errors)
        alias = aliasing(self.points[positions], self.method, pace.steps)
        doubt = across(np.maximum, np.maximum(unseen[:, :2], alias / ALIAS))
        ended = (doubt <= self.request.rtol) | last
        radii = radius_changes(these.rho, fine.multipliers)
        resonant = ended & self._resonant(these.rho, fine, pace.ratio[:, 0])
        yield from self._no_orbits(positions[resonant])
        for kind in (False, True):
            good = np.flatnonzero(ended & ~resonant & (small == kind))
            if len(good):
                chosen = fine[good]
                found = raised(errors[good], rounding(chosen), alias[good], unseen[good, :2], radii[good])
                if kind:
                    chosen = chosen.with_multipliers(chosen.multipliers.with_digits(found[:, 1], UNDERFLOW))
                yield self._certified(positions[good], chosen, found, unseen[good, 2])
        return ended

    def _hidden(self, steps: Array, positions: Array, solutions: Solutions, errors: Array) -> Array:
        """What two grids with the errors (k, 2) do not show, see `hidden`."""

        def witness(at: Array) -> tuple[Multipliers, Array]:
            return self._witnessed(positions[at], solutions[at], errors[at])

        modes, rho, rtol = self.modes[positions], solutions.multipliers, self.request.rtol
        return hidden(modes, self.method, steps, rho, rtol, witness)

    def _witnessed(self, positions: Array, solutions: Solutions, errors: Array) -> tuple[Multipliers, Array]:
        """Multipliers of the points by the witness, zero with an infinite bound where it cannot tell; and the
        errors of orbits that are series, which agree however long they lack a resonant harmonic."""
        values = np.zeros((len(positions), 2 * self.points.n), dtype=complex)
        resolved, bound = np.zeros(len(positions), dtype=int), np.full(len(positions), np.inf)
        orbits = np.zeros(len(positions))
        orbit = self.request.orbit and self.method.spectral
        least = np.fmin.reduce(errors if orbit else errors[:, 1:], axis=1)
        # Of a point's own, whatever its neighbours need, but few different ones.
        decades = np.floor(np.log10(np.clip(_WITNESS_PART * least, WITNESS_RTOL, _WITNESS_LEAST)) / 2) * 2
        accuracies = np.where(np.isnan(least), WITNESS_RTOL, np.maximum(10.0**decades, WITNESS_RTOL))
        with stage("multipliers by another method"):
            for rtol in np.unique(accuracies).tolist():
                some = np.flatnonzero(accuracies == rtol)
                request = replace(self.request, orbit=orbit, rtol=rtol, steps=None)
                for found in certified(self.points[positions[some]], self.request.witness, request):
                    if isinstance(found, Certified):
                        at, rho = some[found.positions], found.solutions.multipliers
                        values[at], resolved[at], bound[at] = rho.values, rho.resolved, rho.bound
                        if orbit:
                            apart = self._differences(solutions[at], found.solutions, positions[at])
                            orbits[at] = apart[:, 0]
        return Multipliers(values, resolved, bound), orbits

    def _resonant(self, coarse: Multipliers, fine: Solutions, ratio: Array | float) -> Array:
        """Points (k,) with a multiplier that goes to +1, where an orbit is asked for."""
        if not self.request.orbit:
            return np.zeros(len(fine), dtype=bool)
        return at_one(coarse, fine.multipliers, ratio, self.method.order, fine.grid.steps)

    def _certified(self, positions: Array, solutions: Solutions, errors: Array, absolute: Array) -> Certified:
        """absolute (k,): errors of the multipliers, beside what the relative ones leave of these."""
        errors[:, 0] += solutions.defect
        radius = solutions.multipliers.spectral_radius
        with np.errstate(over="ignore"):
            absolute = np.maximum(absolute, np.where(radius > 0, errors[:, 1], 0.0) * radius)
        modes = self.modes[positions]
        return Certified(positions, self.method, solutions, errors, absolute, self.request, modes)

    def _sound(self, solutions: Solutions, positions: Array) -> Iterator[Failed]:
        """Report failures; returns the other solutions and their positions."""
        if not solutions.failures:
            return solutions, positions
        for at, reason in solutions.failures.items():
            yield Failed(int(positions[at]), reason)
        return solutions[solutions.known], positions[solutions.known]

    @staticmethod
    def _no_orbits(positions: Array) -> Iterator[Failed]:
        return (Failed(position, no_orbit()) for position in positions.tolist())

    def parts(self, steps: int, positions: Array) -> list[Array]:
        """The positions, split so that each part fits into memory."""
        if len(positions) < 2:
            return [positions] if len(positions) else []
        size = self.method.bytes_a_step(self.points.n, self.request.orbit, self.request.engine)
        size = (size + 8 * self.points.bytes_a_phase) * steps
        return np.array_split(positions, min(len(positions), math.ceil(len(positions) * size / _MEMORY)))


def _taken(trails: list[_Trail], known: Array) -> Iterator[_Trail]:
    """Of points side by side those at the positions (k,)."""
    end = 0
    for trail in trails:
        first, end = end, end + len(trail)
        yield trail[known[(known >= first) & (known < end)] - first]


def _parted(trail: _Trail, steps: Array) -> list[tuple[int, _Trail]]:
    """The points by the steps (k,) of the grids to which they go on."""
    return [(to, trail[np.flatnonzero(steps == to)]) for to in different(steps)]
