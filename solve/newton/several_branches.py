"""Branches followed in both directions from given orbits, including isolated branches."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from solve.newton.arclength import first_point, follow_branch, orbits_at
from solve.newton.branch_points import SAMPLES, ContinuationParameters, Point
from solve.newton.branch_store import BranchStore
from solve.newton.switching import Followed
from solve.results.branch_jumps import is_closed
from solve.results.orbit import Orbit

_SAME = 1e-2
"""Largest difference, relative to the scales of the coordinates, at which two orbits count as the same.
Chosen by judgement: above the errors of orbits and, except near folds, far below the distance between
different orbits."""

_PHASES = 64 * SAMPLES
"""Number of phases per period of the model at which orbits are compared. Chosen by judgement."""


def follow_orbits(
    parameters: ContinuationParameters,
    starts: Sequence[tuple[int, Callable[[], Orbit]]],
    value: float,
    most: int,
    store: BranchStore,
) -> list[Followed]:
    """Return the branches through several orbits at the parameter value `value`. Each branch has at most
    `most` points in each direction.

    starts: for each orbit, its number of periods and a function that returns the orbit. An orbit that lies on
    an earlier branch is skipped."""
    followed, crossings = list[Followed](), list[tuple[int, list[Point]]]()
    for periods, start in starts:
        by_periods = parameters.over_periods(periods)
        if followed:
            orbit = start()
            if any(
                _is_one(point, orbit) for count, points in crossings if count == periods for point in points
            ):
                continue
        branch = _both_ways(
            by_periods,
            lambda by_periods=by_periods, start=start: first_point(by_periods, start(), value),
            most,
            store,
        )
        followed.append(branch)
        if len(starts) > 1:
            crossings.append((periods, orbits_at(by_periods, branch[1], value)))
    return followed


def _both_ways(
    parameters: ContinuationParameters, start: Callable[[], Point], most: int, store: BranchStore
) -> Followed:
    """Return the branch through a first point, with its points in the order along the branch. It is followed
    towards the last value of the parameter, and then in the other direction. The second direction is omitted
    if the first point lies at an end of the range, or if the branch is closed."""
    points, ended = follow_branch(parameters, start, most, saved=store.next())
    backwards = store.next()
    closed = is_closed([point.value for point in points], [point.orbit.figures for point in points])
    if closed or points[0].value in parameters.ranges[0]:
        return parameters, points, ended
    others, reason = follow_branch(parameters, lambda: _reversed(points[0]), most, saved=backwards)
    points = [*map(_reversed, others[:0:-1]), *points]
    return parameters, points, "; ".join(dict.fromkeys(filter(None, (reason, ended))))


def _reversed(point: Point) -> Point:
    """Return a copy of a point with the opposite direction along the branch."""
    return replace(point, tangents=tuple(tangent.times(-1.0) for tangent in point.tangents))


def _is_one(point: Point, orbit: Orbit) -> bool:
    """Whether the orbit of a point is the same as `orbit`, except for a shift by periods of the model."""
    count = point.periods * _PHASES
    phase = np.arange(count) * (float(point.unknowns.curve.nodes[-1]) / count)
    one, other = point.unknowns.curve(phase), orbit.curve(phase)
    shifts = [np.roll(other, shift * _PHASES, axis=1) for shift in range(point.periods)]
    return any(float((np.abs(one - each).max(axis=1) / point.sizes).max()) <= _SAME for each in shifts)
