"""Continuation of a branch beyond a grazing orbit, where the multipliers change abruptly.

The branch has a corner there, because the tangent on each side follows from the equations with the events of
that side. Beyond the corner, the branch either continues to further values of the parameter or turns back.
Newton's iteration at a fixed value of the parameter finds the orbit beyond, whether it is stable or not. The
iteration starts from the last orbit, or from slightly larger or smaller motions."""

from itertools import product

import numpy as np

from solve.contracts import Events
from solve.equations import events_of
from solve.errors import NoOrbitError, SolveError
from solve.newton.branch_points import DAMPING, Point, Unknowns
from solve.newton.iteration import iterate
from solve.newton.manifold import Manifold
from solve.newton.special_points import special_points

_STEPS = 0.001, 0.003, 0.01, 0.03
"""Steps of the parameter from the grazing orbit, as fractions of the range. Chosen by judgement: the shortest
step is short enough for Newton's iteration to converge, and the longest makes the events clearly
different."""

_FACTORS = 1.0, *(1 + sign * change for change in (6e-5, 2e-4, 6e-4, 2e-3, 6e-3) for sign in (1, -1))
"""Factors by which the last motion is multiplied to start Newton's iteration, in the order of the trials.
Chosen by judgement: with one of these factors, the motion is about as far from the switch as the orbit
beyond. For harder stops, the orbit beyond is nearer to the switch."""

_BACK = 0.01
"""Length, in scaled coordinates, of the step back to an orbit with the same events as the branch so far.
Chosen by judgement."""

_HALVINGS, _SAME = 10, 0.02
"""Number of halvings of the step, and the largest distance from the grazing orbit, in scaled coordinates,
after them. Chosen by judgement: if the distance decreases with the square root of the step, the halvings
divide it by 32; the distance of a stable orbit on another branch does not decrease."""


def points_beyond(manifold: Manifold, before: Point) -> list[Point]:
    """Return the first points beyond a grazing orbit near `before`, and the special points between them. The
    events of the orbits beyond differ from those of the orbits up to `before`.

    Raises NoOrbitError if the equations have no switches, or if no such orbit is found."""
    if not _events(manifold, before.unknowns).sides:
        raise NoOrbitError("the equations have no switches")
    # Within its errors, the last orbit may already pass the switch.
    back, _ = manifold.along(before, -_BACK)
    here, is_unforced = _events(manifold, back.unknowns), DAMPING in manifold.parameters.names
    onwards = float(np.sign(before.direction.value) * manifold.parameters.spans[0])
    for way, step, factor in product((1, -1), _STEPS, _FACTORS):
        try:
            unknowns = _orbit_at(manifold, before, before.value + way * step * onwards, factor)
            if not _differ(here, _events(manifold, unknowns)):
                continue
            away = Unknowns(manifold.parameters.task.rest(before.grid), unknowns.values - before.value)
            after = manifold.held(unknowns, [away], before.grid)
        except SolveError:
            continue
        first = _first_beyond(manifold, before, after)
        if first is not None and (is_unforced or first.orientation == back.orientation):
            located = [special_points(manifold, *ends) for ends in ((before, first), (first, after))]
            return [*located[0], first, *([] if first is after else [*located[1], after])]
    raise NoOrbitError("no orbit with other events was found nearby")


def grazes(manifold: Manifold, point: Point) -> bool:
    """Whether the orbit of a point grazes a switch, so that the multipliers change abruptly there."""
    return bool(_events(manifold, point.unknowns).grazing)


def grazes_between(manifold: Manifold, before: Point, after: Point) -> bool:
    """Whether the orbits of two points pass different switches, so that an orbit between them grazes one."""
    return _differ(_events(manifold, before.unknowns), _events(manifold, after.unknowns))


def _differ(here: Events, there: Events) -> bool:
    """Whether the events of two orbits differ, so that the orbits pass different switches."""
    return len(here.phases) != len(there.phases) or here.sides != there.sides


def _events(manifold: Manifold, unknowns: Unknowns) -> Events:
    """Return the events of an orbit."""
    return events_of(manifold.parameters.task_at(unknowns.values).along(unknowns.curve))


def _first_beyond(manifold: Manifold, before: Point, after: Point) -> Point | None:
    """Return the orbit nearest to the grazing orbit, on the branch through the orbit `after` beyond it.
    Return None if that branch does not begin at the grazing orbit; a slow sweep would then jump to it."""
    point = after
    for _ in range(_HALVINGS):
        if manifold.distance(point.unknowns, before.unknowns, before.sizes) <= _SAME:
            return point
        step = (before.value - point.unknowns.value) / 2
        back = point.unknowns.plus(step / point.direction.value, point.direction)
        try:
            point = manifold.held(back, point.tangents, point.grid)
        except SolveError:
            break
    is_same = manifold.distance(point.unknowns, before.unknowns, before.sizes) <= _SAME
    return point if is_same else None


def _orbit_at(manifold: Manifold, before: Point, value: float, factor: float) -> Unknowns:
    """Return the orbit at the parameter value `value`. Newton's iteration starts from `factor` times the
    orbit `before`."""
    values = np.array([value])
    task = manifold.parameters.task_at(values)
    return Unknowns(iterate(task, before.unknowns.times(factor).curve, before.grid).curve, values)
