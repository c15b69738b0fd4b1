"""Finer and finer grids for many points at once, until two agree; orbit and multipliers are judged apart."""

from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from solve.arrays import Array, across, different, most, whole
from solve.certify.certified import Certified, Failed
from solve.certify.estimates import (
    monodromy_differences,
    nearly_decided,
    not_followed,
    radius_changes,
    raised,
    rounding,
    within_reach,
)
from solve.certify.first_grid import first_steps
from solve.certify.orders import ALIAS, aliasing, unresolved
from solve.certify.pace import (
    FARTHEST,
    SECOND,
    SECOND_FAR,
    Pace,
    estimated,
    fallen,
    finished,
    needed_steps,
    onward,
    rung,
    rungs_above,
    sure_powers,
    times_more,
)
from solve.certify.solving import Solving
from solve.errors import StepsError
from solve.methods.method import Solutions
from solve.period.multipliers import EPS, Multipliers, decided
from solve.progress import foreseen

STEPS = "steps"
"""How the stage of a single solution names what is refined."""

UNDERFLOW = 1e-30
"""Spectral radius below which multipliers are refined only as long as grids agree better and better."""

_STIFF_ROUNDING = EPS / 8
"""Times the square of the turns of the stiffest mode: what rounding of its coefficients makes of the softest,
as measured."""

Unseen = Callable[[Array, Array, Solutions, Array], Array]
"""From steps (k, 2) of two grids, positions (k,), solutions and their errors (k, 2) to what these grids do
not show, as `hidden` has it."""


@dataclass(frozen=True)
class _Trail:
    """Points with the solutions of the last grid that they had, of so many steps, the ratio (k, 1) of these
    to the steps of the grid before, and that in the piece between two jumps where it is least, infinite where
    there was none, and the differences (k, 2) that it made. Without solutions: points that begin."""

    positions: Array
    steps: int
    ratio: Array
    least: Array
    differences: Array
    solutions: Solutions | None

    @classmethod
    def begun(cls, positions: Array) -> "_Trail":
        none = np.full((len(positions), 2), np.inf)
        return cls(positions, 0, none[:, :1], none[:, :1], none, None)

    def __len__(self) -> int:
        return len(self.positions)

    def __getitem__(self, some: Array) -> "_Trail":
        if whole(some, len(self)):
            return self
        solutions = None if self.solutions is None else self.solutions[some]
        return _Trail(
            self.positions[some],
            self.steps,
            self.ratio[some],
            self.least[some],
            self.differences[some],
            solutions,
        )


@dataclass(frozen=True)
class _Compared:
    """Points on one grid, and of the grids before, whichever these were: multipliers rho, monodromy matrices
    Phi, and the differences (k, 2) `found` on this grid and `before`. least: the pace by the steps of
    the piece between two jumps where they rise least."""

    pace: Pace
    least: Pace
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
            self.least[some],
            self.positions[some],
            self.fine[some],
            self.rho[some],
            self.Phi[some],
            self.found[some],
            self.before[some],
        )


class Ladder:
    """Points under one method on as many steps as each needs."""

    def __init__(self, solving: Solving, unseen: Unseen):
        self.solving, self.unseen = solving, unseen
        self.method, self.request, self.most = solving.method, solving.request, solving.most
        self.orders, self.sure = solving.orders, sure_powers(solving.method)

    def refined(self, positions: Array) -> Iterator[Certified | Failed]:
        """On as many steps as each point needs."""
        first = first_steps(self.method, self.solving.modes[positions], self.request.orbit, self.request.rtol)
        first = np.maximum(np.minimum(first, self.most // 2), len(self.solving.points.breaks))
        first = np.maximum(first, np.ceil(1.2 * self.solving.least[positions])).astype(int)
        for position in positions[first > self.most].tolist():
            yield Failed(position, self._out_of_reach(int(self.solving.least[position])))
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
        for part in self.solving.parts(steps, np.arange(sum(len(trail) for trail in trails))):
            yield [trail for trail in _taken(trails, part) if len(trail)]

    def _on(self, steps: int, trails: list[_Trail]) -> Generator[Any, None, list[tuple[int, _Trail]]]:
        """Points side by side on a grid of so many steps, whichever they come from; returns those that are
        still open, with the steps of the grids to which they go on."""
        old = [trail for trail in trails if trail.solutions is not None]
        trails = old + [trail for trail in trails if trail.solutions is None]
        solutions = self.solving.solved(steps, np.concatenate([trail.positions for trail in trails]))
        further: list[tuple[int, _Trail]] = []
        end = 0
        for trail in trails:
            first, end = end, end + len(trail)
            if trail.solutions is None:
                further += yield from self._begun(steps, trail, solutions.neighbours(first, end))
        if not old:
            return further
        fine = solutions.neighbours(0, sum(len(trail) for trail in old))
        if fine.failures:
            positions, known = np.concatenate([trail.positions for trail in old]), fine.known
            fine, _ = yield from self.solving.sound(fine, positions)
            old = list(_taken(old, known))
        if len(fine):
            further += yield from self._judged(self._compared(steps, old, fine))
        return further

    def _compared(self, steps: int, trails: list[_Trail], fine: Solutions) -> _Compared:
        """Solutions on a grid of so many steps with those that the points had before."""
        found, rho, Phi, ratio, least, end = [], [], [], [], [], 0
        for trail in trails:
            first, end, coarse = end, end + len(trail), trail.solutions
            assert coarse is not None
            found.append(self.solving.differences(coarse, fine.neighbours(first, end), trail.positions))
            rho.append(coarse.multipliers)
            Phi.append(coarse.Phi)
            times = steps / trail.steps
            ratio.append(np.full((len(trail), 1), times))
            in_piece = times if fine.grid.smooth else fine.grid.least_ratio(coarse.grid)
            least.append(np.full((len(trail), 1), in_piece))
        return _Compared(
            Pace(steps, np.concatenate(ratio), np.concatenate([trail.ratio for trail in trails])),
            Pace(steps, np.concatenate(least), np.concatenate([trail.least for trail in trails])),
            np.concatenate([trail.positions for trail in trails]),
            fine,
            Multipliers.beside(rho),
            np.concatenate(Phi),
            np.concatenate(found),
            np.concatenate([trail.differences for trail in trails]),
        )

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
        trail = _Trail(these.positions, pace.steps, pace.ratio, these.least.ratio, found, fine)[still_open]
        return _parted(trail, onward(pace.steps, times, self.most))

    def _errors(self, these: _Compared) -> Array:
        """Of the finer grids (k, 2): as three grids tell, or as they surely are. What rounding may have made
        does not fall, and is known where three grids show it."""
        pace, found, tells = these.least, these.found, these.least.tells
        errors, rounding = fallen(found, pace, self.sure), self._stiff_rounding(these.positions)
        if tells.any():
            errors[tells] = estimated(found[tells], these.before[tells], pace[tells], self.orders)
        return np.maximum(errors, np.where(tells[:, None], np.minimum(found, rounding), rounding))

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
            known = self._known_by_two(these, errors, wanted, by_two, at)
            done[at] &= ~by_two[at] | known
        if done.any():
            at = most(done)
            points = self.solving.points[these.positions[at]]
            left = unresolved(points, self.method, pace[at], found[at], before[at], wanted[at])
            errors[at] = np.where(done[at, None], np.maximum(errors[at], left), errors[at])
            done[at] &= across(np.logical_and, left <= wanted[at])
        if done.any():
            done &= ~nearly_decided(done & pace.tells, fine, errors, found, before, self.method.order)
        return done

    def _known_by_two(
        self, these: _Compared, errors: Array, wanted: Array, by_two: Array, at: Array | slice
    ) -> Array:
        """Whether matrices of points at positions (k,) agree as their multipliers do, which may meet by
        chance, and leave a verdict; raises the errors of those of two grids in place."""
        apart = monodromy_differences(these.Phi[at], these.fine, at)[:, None]
        apart = fallen(apart, these.least[at], self.sure[1])[:, 0]
        errors[at, 1] = np.where(by_two[at], np.maximum(errors[at, 1], apart), errors[at, 1])
        rho, e = these.fine.multipliers[at], errors[at, 1]
        return (e <= wanted[at, 1]) & decided(rho, e * rho.spectral_radius)

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
        unseen = self.unseen(pace.both, positions, fine, errors)
        alias = aliasing(self.solving.points[positions], self.method, pace.steps)
        doubt = across(np.maximum, np.maximum(unseen[:, :2], alias / ALIAS))
        ended = (doubt <= self.request.rtol) | last
        radii = radius_changes(these.rho, fine.multipliers)
        resonant = ended & self.solving.resonant(these.rho, fine, pace.ratio[:, 0])
        yield from self.solving.no_orbits(positions[resonant])
        for kind in (False, True):
            good = np.flatnonzero(ended & ~resonant & (small == kind))
            if len(good):
                chosen = fine[good]
                found = raised(errors[good], rounding(chosen), alias[good], unseen[good, :2], radii[good])
                if kind:
                    chosen = chosen.with_multipliers(chosen.multipliers.with_digits(found[:, 1], UNDERFLOW))
                yield from self.solving.certified(positions[good], chosen, found, unseen[good, 2])
        return ended

    def _stiff_rounding(self, positions: Array) -> Array:
        """What rounding of the stiffest mode's coefficients may make of the softest (k, 1), where a method
        damps the one, so that grids do not tell."""
        if not self.method.l_stable:
            return np.zeros((len(positions), 1))
        turns = self.solving.modes[positions].few_reach / (2 * np.pi)
        return (_STIFF_ROUNDING * turns**2)[:, None]


def _taken(trails: list[_Trail], known: Array) -> Iterator[_Trail]:
    """Of points side by side those at the positions (k,)."""
    end = 0
    for trail in trails:
        first, end = end, end + len(trail)
        yield trail[known[(known >= first) & (known < end)] - first]


def _parted(trail: _Trail, steps: Array) -> list[tuple[int, _Trail]]:
    """The points by the steps (k,) of the grids to which they go on."""
    return [(to, trail[np.flatnonzero(steps == to)]) for to in different(steps)]
