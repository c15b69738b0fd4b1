"""Continuation of a branch beyond a grazing orbit, where the multipliers change abruptly.

The branch has a corner there, or a fold next to it, because a short contact changes the tangent. Beyond the
grazing orbit, the branch either continues to further values of the parameter or turns back. On both sides,
the value of the switching function at the phase of grazing changes steadily along the branch. A step with a
prescribed change of this value therefore passes the grazing orbit, whether the orbits beyond are stable or
not."""

from dataclasses import replace

import numpy as np

from solve.arrays import Array
from solve.contracts import Events
from solve.equations import event_normals, events_of
from solve.errors import NoOrbitError, SolveError
from solve.newton.branch_points import DAMPING, Point, Unknowns
from solve.newton.manifold import Manifold
from solve.newton.special_points import Path, special_points
from solve.period.curve import Curve

_LENGTHS = 0.01, 0.003, 0.001, 3e-4, 1e-4, 3e-5, 1e-5
"""Lengths of the step beyond a grazing orbit, in scaled coordinates, in the order of the trials. Chosen by
judgement: a long step gets past the orbits whose multipliers change abruptly; the iteration converges for a
short one."""

_WIDTH, _SAMPLES = 1 / 200, 1024
"""Width of the weight about a phase of grazing as a fraction of the period, and number of phases at which the
weight is sampled. Measured for a stop 300 times as stiff as the spring: iterations converge for widths from
1/300 to 1/60 of the period, but not for 1/20, because the weight must be narrow compared with the motion. The
samples resolve the weight."""

_PHASES = 16
"""Number of phases at which the switching functions are changed if the orbit has no phases of grazing. Chosen
by judgement."""

_NEAR = 0.02
"""Largest distance between the orbits before and after the step, in scaled coordinates. Chosen by judgement:
beyond this distance, the orbit may belong to another branch. For hard stops, the distance is many times the
length of the step, because the parameter changes much."""


def points_beyond(manifold: Manifold, before: Point) -> tuple[list[Point], Path]:
    """Return the special points on the way past the grazing orbit near `before`, followed by the first point
    beyond this orbit. Also return the path of the step to that point.

    Raises NoOrbitError if the equations have no switches, or if no point beyond the grazing orbit is found.
    """
    directions = [_towards_switch(manifold, before), *before.tangents[1:]]

    def at(length: float) -> Point:
        point = manifold.held(before.unknowns.plus(length, before.direction), directions, before.grid)
        return _forwards(manifold, before, point)

    # Within its errors, an orbit that grazes a switch may already pass it.
    least_back = _LENGTHS[0] if grazes(manifold, before) else 0.0
    for length in _LENGTHS:
        back = _events(manifold, before.unknowns.plus(-max(length, least_back), before.direction))
        try:
            after = at(length)
        except SolveError:
            continue
        apart = manifold.distance(after.unknowns, before.unknowns, before.sizes)
        if apart <= _NEAR and _differ(back, _events(manifold, after.unknowns)):
            special, _ = special_points(manifold, before, after, (at, length))
            return [*special, after], (at, length)
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


def _forwards(manifold: Manifold, before: Point, after: Point) -> Point:
    """Return a point beyond a grazing orbit with its tangent directed away from that orbit. Far beyond, a
    step along the branch may change the switching functions at the phases of grazing in the other direction.

    The orientation also changes where the orbit grazes two switches at once, as at a branch point."""
    is_same = before.orientation == after.orientation
    if is_same or manifold.component(before, after, after.direction) >= 0:
        return after
    return replace(after, tangents=(after.direction.times(-1), *after.tangents[1:]))


def _towards_switch(manifold: Manifold, before: Point) -> Unknowns:
    """Return a direction for a step past a grazing orbit. At the phases of grazing, such a step changes the
    switching functions in the same sense as a step along the branch. The inner product of this direction and
    a small change of the unknowns is the weighted mean of the resulting changes of the switching functions;
    the weight is concentrated at the phases of grazing. Raises NoOrbitError if the equations have no
    switches."""
    names, curve = manifold.parameters.names, before.unknowns.curve
    task = manifold.parameters.task_at(before.unknowns.values)
    along, varied = task.along(curve), [name for name in names if name != DAMPING]
    events = events_of(along)
    if not events.sides:
        raise NoOrbitError("the equations have no switches")
    # The distance of a circular orbit from a concentric stop is constant, and no phase is distinguished.
    phases = np.array(events.grazing or np.arange(_PHASES) * (task.period / _PHASES))
    nodes, n = np.linspace(0.0, task.period, _SAMPLES + 1), task.system.n
    samples, changes = np.zeros((_SAMPLES, n)), np.zeros(len(names))
    for phase, normal in zip(phases, event_normals(along, curve, task.speed, phases, varied), strict=True):
        weight, slope = _weight(nodes[:-1] - phase, task.period)
        # A change of q' is integrated by parts.
        by_q = np.outer(weight, normal[1 : 1 + n]) - np.outer(slope, normal[1 + n : 1 + 2 * n])
        by_q *= before.sizes**2
        by_parameters = np.zeros(len(names))
        by_parameters[: len(varied)] = weight.mean() * normal[1 + 2 * n :]
        by_parameters *= manifold.parameters.spans**2
        one = Unknowns(Curve(nodes, by_q.T[..., None]), by_parameters)
        sign = np.sign(manifold.inner(one, before.direction, before.sizes))
        samples, changes = samples + sign * by_q, changes + sign * by_parameters
    return Unknowns(Curve(nodes, samples.T[..., None]), changes)


def _weight(phase: Array, period: float) -> tuple[Array, Array]:
    """Return a weight (k,) at phases (k,), which is concentrated about phase 0, and its derivative (k,)."""
    width = _WIDTH * period
    apart = (phase + period / 2) % period - period / 2
    weight = np.exp(-((apart / width) ** 2) / 2)
    return weight, -apart / width**2 * weight
