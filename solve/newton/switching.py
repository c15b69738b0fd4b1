"""Branches of orbits with twice the period, which start at period doublings (Y. A. Kuznetsov, Elements of
Applied Bifurcation Theory, 10.2)."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from solve.arrays import Array
from solve.errors import NoOrbitError, SolveError
from solve.newton.arclength import follow_branch
from solve.newton.branch_points import SAMPLES, ContinuationParameters, Point, Unknowns
from solve.newton.branch_store import BranchStore
from solve.newton.iteration import on
from solve.newton.linear_families import mode_of
from solve.newton.manifold import Manifold
from solve.period.curve import Curve
from solve.results.branch import DOUBLING

_FIRST_LENGTHS = 0.05, 0.02, 0.01, 0.005, 0.002, 0.001, 5e-4, 2e-4
"""Lengths of the first step onto a branch, in scaled coordinates, in the order of the trials. Chosen by
judgement."""

_MOST_MOVED = 0.01
"""Largest permitted change of the parameter in the first step, as a fraction of the range. Chosen by
judgement."""

_MOST_DOUBLINGS = 3
"""Maximum number of successive doublings that are followed. Chosen by judgement: each doubling doubles the
computing time per orbit."""

Followed = tuple[ContinuationParameters, list[Point], str]


def follow_doublings(
    parameters: ContinuationParameters, found: Sequence[Point], most: int, store: BranchStore
) -> list[Followed]:
    """Return the branches that start at the period doublings of a branch with the points `found`, and at the
    doublings of these new branches. Each new branch has at most `most` points, and ends where it returns to
    orbits of half its period. Doublings whose branch cannot be started are skipped."""
    waiting, followed, last = [(parameters, point) for point in _doublings(found)], list[Followed](), []
    limit = parameters.task.periods * 2**_MOST_DOUBLINGS
    while waiting:
        before, point = waiting.pop(0)
        if 2 * before.task.periods > limit or any(_is_same_branch(point, one, size) for one, size in last):
            continue
        doubled = before.over_periods(2 * before.task.periods)
        left = _ReturnTest()
        try:
            points, ended = follow_branch(
                doubled, partial(_first_point, before, doubled, point), most, left, store.next()
            )
        except SolveError:
            continue
        if left.returned and len(points) > 1:
            last.append((points[-1], abs(points[-1].value - points[-2].value)))
        followed.append((doubled, points, ended))
        waiting += [(doubled, one) for one in _doublings(points)]
    return followed


def _doublings(points: Sequence[Point]) -> list[Point]:
    return [point for point in points if point.kind == DOUBLING]


def _is_same_branch(point: Point, end: Point, size: float) -> bool:
    """Whether the branch that starts at `point` is an earlier branch, followed from its other end. The
    earlier branch ends at `end`; the change of the parameter in its last step is `size`."""
    return 2 * point.periods == end.periods and abs(point.value - end.value) <= 2 * size


def _first_point(before: ContinuationParameters, doubled: ContinuationParameters, point: Point) -> Point:
    """Return the first point of the branch that starts at the period doubling `point`. Raises
    NoOrbitError."""
    mode = mode_of(before, point.unknowns, point.grid, -1.0)
    grid = doubled.task.grid(2 * point.grid.steps)
    unknowns = Unknowns(on(grid, _over_two_periods(point.unknowns.curve, 1.0)), point.unknowns.values)
    direction = Unknowns(on(grid, _over_two_periods(mode, -1.0)), np.zeros_like(unknowns.values))
    manifold = Manifold(doubled)
    direction = manifold.unit(direction, (), point.sizes)
    start = replace(point, unknowns=unknowns, grid=grid, tangents=(direction,))
    for length in _FIRST_LENGTHS:
        try:
            reached, _ = manifold.reached(start, [direction], [length])
        except SolveError:
            continue
        if abs(reached.value - point.value) <= _MOST_MOVED * doubled.spans[0]:
            return reached
    raise NoOrbitError("no orbit was found on the branch that begins at the period doubling")


def _over_two_periods(curve: Curve, factor: float) -> Curve:
    """Return a curve over two periods. The motion over the second period is `factor` times that over the
    first."""
    period = curve.nodes[-1]
    coefficients = np.concatenate((curve.coefficients, factor * curve.coefficients), axis=-2)
    return Curve(np.append(curve.nodes[:-1], curve.nodes + period), coefficients, drift=curve.drift)


class _ReturnTest:
    """Test for the return of a doubled branch to orbits of half its period. At the return, the difference
    between the two halves of the orbit changes sign."""

    def __init__(self) -> None:
        self.returned, self._before = False, np.zeros(1)

    def __call__(self, point: Point) -> bool:
        after = _difference(point)
        self.returned = float((after * self._before).sum()) < 0
        self._before = after
        return self.returned


def _difference(point: Point) -> Array:
    """Return the difference (n, k) between the two halves of an orbit at k fixed phases, relative to the
    scales of the coordinates."""
    period = float(point.unknowns.curve.nodes[-1])
    phase = np.arange(64 * SAMPLES) * (period / 2 / (64 * SAMPLES))
    curve = point.unknowns.curve
    return (curve(phase) - curve(phase + period / 2)) / point.sizes[:, None]
