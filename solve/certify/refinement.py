"""Points solved with errors that are estimated, and judged by other methods where grids do not tell."""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from solve.arrays import Array
from solve.certify.certified import Certified, Failed, Request
from solve.certify.estimates import radius_changes, raised, rounding
from solve.certify.hidden import hidden
from solve.certify.ladder import Ladder
from solve.certify.orders import aliasing
from solve.certify.pace import judged
from solve.certify.solving import Solving
from solve.certify.two_orders import refinement as two_orders
from solve.methods.method import Method, Solutions
from solve.period.multipliers import Multipliers
from solve.period.points import Points
from solve.period.rigid_body import Free
from solve.progress import stage

_FEW_STEPS = 360
"""Of an approximation whose steps are not given."""

_WITNESS_RTOL = 1e-10
"""Accuracy of multipliers by which others are judged, at most."""

_WITNESS_PART, _WITNESS_LEAST = 0.01, 1e-3
"""Part of the errors of others that those of multipliers by which they are judged may have, and at least so
much accuracy."""


def certified(points: Points, method: Method, request: Request) -> Iterator[Certified | Failed]:
    """Each of the points once, in groups as they come.

    With `steps`: that grid, judged by one twice as fine. Without: refined until both errors of the finer
    of two grids are estimated at `rtol` or less, or the precision in reach is achieved. A point fails with
    ResonanceError where an orbit is asked for and a multiplier is at +1 for all that the method can tell.
    Raises StepsError for `steps` that the method cannot use at any point.
    """
    solving = Solving(points, method, request)
    if request.two_orders and method.converges and solving.free is None:
        yield from two_orders.certified(points, method, request)
        return
    if solving.free is not None and len(points) > 1 and len(kinds := _kinds(solving.free)) > 1:
        yield from _apart(solving, kinds)
        return
    refused = solving.refused()
    yield from refused
    every = np.delete(np.arange(len(points)), [failure.position for failure in refused])
    if not method.converges:
        yield from _approximated(solving, every)
    elif request.steps is None:
        yield from Ladder(solving, partial(_unseen, solving)).refined(every)
    else:
        yield from _on_given_steps(solving, every)


def _kinds(free: Free) -> list[Array]:
    """Positions of points that are free to turn, of those that conserve a momentum besides, and of others."""
    found, conserving = free.modes.any, free.modes.conserving
    kinds = (np.flatnonzero(each) for each in (found & ~conserving, conserving, ~found))
    return [each for each in kinds if len(each)]


def _apart(solving: Solving, kinds: list[Array]) -> Iterator[Certified | Failed]:
    """Points of different kinds one after the other."""
    for at in kinds:
        for found in certified(solving.points[at], solving.method, solving.request):
            if isinstance(found, Failed):
                yield Failed(int(at[found.position]), found.reason)
            else:
                yield replace(found, positions=at[found.positions])


def on_one_grid(
    points: Points, method: Method, request: Request, steps: int
) -> Iterator[tuple[Array, Solutions]]:
    """The points on that many steps, not judged, in parts with their positions (k,); failures left out."""
    solving = Solving(points, method, request)
    for part in solving.parts(steps, np.arange(len(points))):
        solutions = solving.solved(steps, part)
        yield part[solutions.known], solutions[solutions.known]


def _approximated(solving: Solving, positions: Array) -> Iterator[Certified | Failed]:
    """A method that does not converge to the truth, judged by one that does."""
    steps = min(_FEW_STEPS, solving.most) if solving.request.steps is None else solving.request.steps
    truth = replace(solving.request, rtol=min(solving.request.rtol, 1e-8), steps=None)
    for part in solving.parts(steps, positions):
        chosen, part = yield from solving.sound(solving.solved(steps, part), part)
        if not len(part):
            continue
        points = solving.points[part]
        for method, at in solving.request.reference(points):
            for better in certified(points[at], method, truth):
                if isinstance(better, Failed):
                    yield Failed(int(part[at[better.position]]), better.reason)
                    continue
                own = chosen[at[better.positions]]
                these = part[at[better.positions]]
                found = solving.differences(own, better.solutions, these)
                errors = np.maximum(found, rounding(own))
                radius = better.solutions.multipliers.spectral_radius
                yield from solving.certified(these, own, errors, errors[:, 1] * radius)


def _on_given_steps(solving: Solving, positions: Array) -> Iterator[Certified | Failed]:
    """On the steps given, by twice as many."""
    steps = solving.request.steps
    assert steps is not None
    for part in solving.parts(2 * steps, positions):
        coarse, part = yield from solving.sound(solving.solved(steps, part), part)
        if not len(part):
            continue
        fine = solving.solved(2 * steps, part)
        known = fine.known
        fine, part = yield from solving.sound(fine, part)
        coarse = coarse[known]
        if not len(part):
            continue
        resonant = solving.resonant(coarse.multipliers, fine, 2.0)
        yield from solving.no_orbits(part[resonant])
        coarse, fine, part = coarse[~resonant], fine[~resonant], part[~resonant]
        if not len(part):
            continue
        errors = judged(solving.differences(coarse, fine, part), solving.orders)
        unseen = _unseen(solving, np.full((len(part), 2), steps), part, coarse, errors)
        alias = aliasing(solving.points[part], solving.method, 2 * steps, given=True)
        radii = radius_changes(coarse.multipliers, fine.multipliers)
        with np.errstate(over="ignore", invalid="ignore"):
            absolute = np.fmax(errors[:, 1] * fine.multipliers.spectral_radius, unseen[:, 2])
        errors = raised(errors, rounding(coarse), alias, unseen[:, :2], radii)
        yield from solving.certified(part, coarse, errors, absolute)


def _unseen(solving: Solving, steps: Array, positions: Array, solutions: Solutions, errors: Array) -> Array:
    """What two grids of steps (k, 2) with the errors (k, 2) do not show, see `hidden`."""

    def witness(at: Array) -> tuple[Multipliers, Array]:
        return _witnessed(solving, positions[at], solutions[at], errors[at])

    modes, rho, rtol = solving.modes[positions], solutions.multipliers, solving.request.rtol
    return hidden(modes, solving.method, steps, rho, rtol, witness)


def _witnessed(
    solving: Solving, positions: Array, solutions: Solutions, errors: Array
) -> tuple[Multipliers, Array]:
    """Multipliers of the points by the witness, zero with an infinite bound where it cannot tell; and the
    errors of orbits that are series, which agree however long they lack a resonant harmonic."""
    values = np.zeros((len(positions), 2 * solving.points.n), dtype=complex)
    resolved, bound = np.zeros(len(positions), dtype=int), np.full(len(positions), np.inf)
    orbits = np.zeros(len(positions))
    orbit = solving.request.orbit and solving.method.spectral
    least = np.fmin.reduce(errors if orbit else errors[:, 1:], axis=1)
    # Of a point's own, whatever its neighbours need, but few different ones.
    decades = np.floor(np.log10(np.clip(_WITNESS_PART * least, _WITNESS_RTOL, _WITNESS_LEAST)) / 2) * 2
    accuracies = np.where(np.isnan(least), _WITNESS_RTOL, np.maximum(10.0**decades, _WITNESS_RTOL))
    with stage("multipliers by another method"):
        for rtol in np.unique(accuracies).tolist():
            some = np.flatnonzero(accuracies == rtol)
            request = replace(solving.request, orbit=orbit, rtol=rtol, steps=None)
            for found in certified(solving.points[positions[some]], solving.request.witness, request):
                if isinstance(found, Certified):
                    at, rho = some[found.positions], found.solutions.multipliers
                    values[at], resolved[at], bound[at] = rho.values, rho.resolved, rho.bound
                    if orbit:
                        apart = solving.differences(solutions[at], found.solutions, positions[at])
                        orbits[at] = apart[:, 0]
    return Multipliers(values, resolved, bound), orbits
