"""Continuation of a branch beyond a grazing orbit, where multipliers change abruptly.

Newton's iteration does not converge across the grazing orbit, because the linearisation contains the events
of one side only. The orbit beyond is found by integration: a motion that starts on the last orbit before the
grazing orbit settles on the orbit beyond, if that orbit is stable."""

import numpy as np

from solve.contracts import Events
from solve.equations import events_of, nonlinear_of
from solve.errors import NoOrbitError, SolveError
from solve.newton.branch_points import Point, Unknowns
from solve.newton.manifold import Manifold
from solve.newton.strategies import from_state, linear_sizes

_STEPS = 0.01, 0.02, 0.04
"""Steps of the parameter beyond the grazing orbit, as fractions of its range. Choices: short enough to find a
near orbit, long enough for unambiguous events."""

_PERIODS = 8
"""Number of periods of the orbit that are integrated. A choice: the difference from a stable orbit beyond the
grazing orbit decays within a few periods."""

_STATES, _RTOL = 512, 1e-8
"""Number of states per period of the motion, and its tolerance. Choices."""

_HALVINGS, _SAME = 10, 0.02
"""Number of halvings of the step, and largest distance from the grazing orbit after them, in scaled
coordinates. Choices: if the distance decreases with the square root of the step, the orbit comes 32 times
nearer; a stable orbit of another branch does not."""


def point_beyond(manifold: Manifold, before: Point) -> Point:
    """First point beyond a grazing orbit near `before`; its orbit passes other switches.

    Raises NoOrbitError if the equations have no switches, and if no motion settles on such an orbit."""
    parameters, here = manifold.parameters, _events(manifold, before)
    if not here.sides:
        raise NoOrbitError("the equations have no switches")
    for step in _STEPS:
        value = before.value + step * np.sign(before.direction.value) * parameters.spans[0]
        try:
            after = _settled(manifold, before, float(value))
        except SolveError:
            continue
        there = _events(manifold, after)
        passes = here.grazing or len(here.phases) != len(there.phases) or here.sides != there.sides
        if passes and _begins_at(manifold, before, after):
            return after
    raise NoOrbitError("no motion settles beyond a grazing orbit")


def grazes(manifold: Manifold, point: Point) -> bool:
    """Whether the orbit of a point grazes a switch, where multipliers change abruptly."""
    return bool(_events(manifold, point).grazing)


def _events(manifold: Manifold, point: Point) -> Events:
    """Events of the orbit of a point."""
    task = manifold.parameters.task_at(point.unknowns.values)
    return events_of(task.along(point.unknowns.curve))


def _begins_at(manifold: Manifold, before: Point, after: Point) -> bool:
    """Whether the branch through the orbit beyond begins at the grazing orbit. Otherwise the motion has
    jumped to another branch, as in a slow sweep."""
    point = after
    for _ in range(_HALVINGS):
        if manifold.distance(point.unknowns, before.unknowns, before.sizes) <= _SAME:
            return True
        step = (before.value - point.unknowns.value) / 2
        back = point.unknowns.plus(step / point.direction.value, point.direction)
        try:
            point = manifold.held(back, point.tangents, point.grid)
        except SolveError:
            break
    return manifold.distance(point.unknowns, before.unknowns, before.sizes) <= _SAME


def _settled(manifold: Manifold, before: Point, value: float) -> Point:
    """Point at a value of the parameter, from the orbit on which a motion that starts on the orbit `before`
    settles."""
    parameters, values = manifold.parameters, np.array([value])
    task, curve = parameters.task_at(values), before.unknowns.curve
    march = nonlinear_of(task.system).marcher(linear_sizes(task, before.grid), _STATES, _RTOL)
    state = np.concatenate([curve(np.zeros(1), order)[:, 0] for order in range(2)])
    for turn in range(_PERIODS * task.periods):
        state = march(state, turn * task.system.period, task.speed)[:2, :, -1].ravel()
    found = from_state(task, state, before.grid)
    grid = parameters.task.grid(found.solutions.grid.steps)
    towards = Unknowns(parameters.task.rest(grid), np.array([before.direction.value]))
    return manifold.held(Unknowns(found.curve, values), [towards], grid)
