"""Branches of nonlinear orbits over the speed."""

from collections.abc import Sequence

import numpy as np

from solve.arguments import require_integer
from solve.errors import ValueOutOfBoundsError
from solve.kernel.engines import chosen_engine
from solve.labels import SPEED
from solve.methods.radau import Radau
from solve.newton.arclength import follow_branch
from solve.newton.branch_points import ContinuationParameter, Point
from solve.newton.iteration import Task
from solve.newton.orbits import nonlinear
from solve.newton.starts import Start
from solve.results.branch import Branch
from solve.system import PeriodicSystem, of_system
from solve.units import checked_rtol, ramp_in_si

_FIELDS = "figures", "figure_errors", "radius", "errors", "repeats"

_MAX_START_RTOL = 1e-3
"""Largest rtol of the orbit from which a branch starts, since the next orbits take its steps. On coarser
grids Newton's iteration along the branch may diverge. For the cam at 300 rpm it does at 1e-2, not at 3e-3."""


@of_system
def branch(
    system: PeriodicSystem,
    speeds: str | tuple[float | str, float | str],
    start: Start | None = None,
    points: int = 200,
    rtol: float = 1e-3,
    engine: str = "auto",
    periods: int = 1,
) -> Branch:
    """Continue nonlinear orbits in the speed, through folds.

    Parameters
    ----------
    system : Model
        Model with nonlinear equations.
    speeds : str or (float or str, float or str)
        First speed, and the speed towards which the branch is continued: "300:600 rpm", or rad/s. The
        branch ends where it leaves this range.
    start : optional
        Start of `solve.nonlinear` at the first speed.
    points : int
        Maximum number of orbits.
    rtol : float
        Largest error of the orbits, relative to the scale of each coordinate.
    engine : str
        "auto", "compiled" or "numpy".
    periods : int
        Number of model periods per period of the orbits.

    Returns
    -------
    Branch
        Orbits in the order of the branch.

    Raises
    ------
    ValueOutOfBoundsError
        For bad input.
    LinearModelError
        For linear systems.
    NoOrbitError
        If there is no orbit at the first speed.
    NoDerivativeError
        If the equations have no derivative with respect to the speed.

    Notes
    -----
    Every orbit is converged on one grid and corrected once on a grid with twice the number of steps. The
    corrected orbit is returned. The differences give the errors; grids are refined if these exceed rtol.
    """
    first, last = ramp_in_si(speeds)
    if not (first > 0 and last > 0) or first == last:
        raise ValueOutOfBoundsError(
            f"speeds are {speeds!r}; give two different ones above 0, such as '300:600 rpm'"
        )
    require_integer("points", points, 2)
    rtol, (used, notes) = checked_rtol(rtol), chosen_engine(engine)
    orbit = nonlinear(system, first, start, periods, rtol=min(rtol, _MAX_START_RTOL), engine=engine)
    task = Task(system.shown_in(first), float(first), int(periods), Radau(), used, rtol)
    parameter = ContinuationParameter(task)
    branch_points, ended = follow_branch(parameter, (float(first), float(last)), orbit, int(points))
    return _result(parameter, branch_points, ended, notes)


def _result(
    parameter: ContinuationParameter, points: Sequence[Point], ended: str, notes: Sequence[str]
) -> Branch:
    task, values = parameter.task, np.array([point.value for point in points])
    at_speed = parameter.name == SPEED
    fields = {name: np.array([getattr(point.orbit, name) for point in points]) for name in _FIELDS}
    return Branch(
        task.system,
        values if at_speed else np.full(len(points), task.speed),
        turns=np.array([point.turns for point in points]),
        rtol=task.rtol,
        ended=ended,
        notes=notes,
        periods=task.periods,
        parameters={} if at_speed else {parameter.name: values},
        **fields,
    )
