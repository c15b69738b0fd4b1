"""First orbits of branches: an orbit from a given start, or all orbits on which motions from scattered
initial states settle."""

from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path

import numpy as np

from solve.errors import FileError, NoOrbitError, ValueOutOfBoundsError
from solve.labels import SPEED, in_own_unit
from solve.newton.branch_points import ContinuationParameters
from solve.newton.iteration import Task
from solve.newton.orbits import nonlinear
from solve.newton.starts import FILES, Start, motion_of
from solve.results import save
from solve.results.folder import digest
from solve.results.orbit import Orbit
from solve.results.scatter import Scatter
from solve.units import speed_in_si

MAX_START_RTOL = 1e-3
"""Largest rtol of the orbit from which a branch starts, because the next orbits use the grid of this orbit.
On coarser grids, Newton's iteration along the branch may diverge: for the cam at 300 rpm it diverges with
rtol 1e-2, but not with 3e-3."""

_PROBES = 127
"""Number of phases at which the motion of a start is sampled for its hash. Chosen by judgement."""


def scattered_or(start: Start | Scatter | None) -> Start | Scatter | None:
    """Return the result of `solve.scatter` from its file if `start` is the path of such a file; otherwise
    return `start`."""
    if isinstance(start, str | Path) and Path(start).suffix.lower() in FILES:
        with suppress(FileError):
            given = save.open(start)
            return given if isinstance(given, Scatter) else start
    return start


def first_value(
    parameters: ContinuationParameters, start: Start | Scatter | None, begin: float | str | None
) -> float:
    """Return the value of the parameter at the first orbit. Raises ValueOutOfBoundsError for a value outside
    the range, and NoOrbitError for a scatter result without orbits."""
    system, name, ends = parameters.task.system, parameters.names[0], parameters.ranges[0]
    if isinstance(start, Scatter):
        if begin is not None:
            raise ValueOutOfBoundsError(
                "'begin' is given together with scattered starting points; omit 'begin'"
            )
        one, other = ({**each.labels.parameters, name: 0.0} for each in (start.system, system))
        if one != other or (name != SPEED and start.speed != parameters.task.speed):
            raise ValueOutOfBoundsError(
                "the scattered starting points were computed for other parameter values or another speed; "
                f"vary only {name}"
            )
        if not start.orbits:
            raise NoOrbitError(
                "no motion from the scattered starting points settled on an orbit; use more points or "
                "another seed"
            )
        value = start.speed if name == SPEED else start.system.labels.parameters[name]
    elif begin is None:
        return float(ends[0])
    elif name == SPEED:
        value = speed_in_si(begin)
    else:
        value = in_own_unit(system, name, begin)
    if not ends.min() <= value <= ends.max():
        raise ValueOutOfBoundsError(
            f"the first orbit is at {parameters.text(np.array([value]))}; allowed: values between "
            f"{parameters.text(ends[:1])} and {parameters.text(ends[1:])}"
        )
    return float(value)


def orbit_starts(task: Task, start: Start | Scatter | None) -> list[tuple[int, Callable[[], Orbit]]]:
    """Return the first orbits of the branches as a list of pairs: the number of periods of an orbit, and a
    function that computes this orbit."""

    def orbit(given: Start | None, periods: int) -> Orbit:
        rtol = min(task.rtol, MAX_START_RTOL)
        return nonlinear(task.system, task.speed, given, periods, rtol=rtol, engine=task.engine)

    if isinstance(start, Scatter):
        return [(one.periods, partial(orbit, one, one.periods)) for one in start.orbits]
    return [(task.periods, partial(orbit, start, task.periods))]


def start_digest(start: Start | Scatter | None, task: Task) -> str | None:
    """Return the hash of the motions of `start`; None without a start."""
    if start is None:
        return None
    if isinstance(start, Scatter):
        motions = [orbit.curve for orbit in start.orbits]
    else:
        motions = [motion_of(start, task)]
    return digest(*(motion(np.arange(_PROBES) * (motion.nodes[-1] / _PROBES)) for motion in motions))
