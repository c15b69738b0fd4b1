"""Curves of folds and of period doublings in two parameters, which start at the special points of a
branch."""

from collections.abc import Sequence

import numpy as np

from solve.arguments import checked_rtol, require_integer
from solve.errors import ValueOutOfBoundsError
from solve.kernel.engines import chosen_engine
from solve.labels import SPEED, speed_or_usual
from solve.methods.radau import Radau
from solve.newton.arclength import first_point, follow_branch
from solve.newton.branch_points import ContinuationParameters, Point
from solve.newton.branch_starts import MAX_START_RTOL
from solve.newton.branches import range_of
from solve.newton.iteration import Task
from solve.newton.orbits import nonlinear
from solve.newton.special_curves import follow_curve
from solve.newton.starts import Start
from solve.period.signals import FIGURES
from solve.results.branch import DOUBLING, FOLD
from solve.results.special_curves import CUSP, SpecialCurves
from solve.system import PeriodicSystem, of_system, shown_in

_MAX_ABS = FIGURES.index("max_abs")

_SAME = 1e-4
"""Distance, relative to the parameter ranges, below which the end of one curve and the start of another count
as the same point. Chosen by judgement."""


@of_system
def special_curves(
    system: PeriodicSystem,
    kind: str,
    over: Sequence[str],
    speed: float | str | None = None,
    periods: int = 1,
    start: Start | None = None,
    points: int = 200,
    rtol: float = 1e-3,
    engine: str = "auto",
) -> SpecialCurves:
    """Follow folds or period doublings of nonlinear orbits in two parameters.

    The curves start at the folds or doublings of a branch. On this branch, the first parameter varies, and
    the second one has the first value of its range.

    Parameters
    ----------
    system : Model
        Model with nonlinear equations.
    kind : str
        "fold" or "doubling".
    over : sequence of str
        Two parameters with their ranges, such as ["speed=1:2 rad/s", "f=0.3:0.1"].
    speed : float or str, optional
        Constant speed in rad/s, or a string with a unit, if the speed is not one of the two parameters. By
        default, the speed of the case.
    periods : int
        Number of model periods per period of the orbits.
    start : Orbit, Transient, (q, q̇), callable or path, optional
        `start` of `solve.nonlinear` for the orbit at the first values of both parameters.
    points : int
        Maximum number of points of the branch, and of each curve.
    rtol : float
        Largest permitted error of the orbits, relative to the scale of each coordinate.
    engine : str
        "auto", "compiled" or "numpy".

    Returns
    -------
    SpecialCurves
        Points of all curves, including cusps.

    Raises
    ------
    ValueOutOfBoundsError, MissingValueError
        For bad input.
    LinearModelError
        For linear systems.
    NoOrbitError
        If there is no orbit at the first values of both parameters.

    Notes
    -----
    See `solve.newton.special_curves` for the equations.
    """
    if kind not in (FOLD, DOUBLING):
        raise ValueOutOfBoundsError(f"kind is {kind!r}; allowed: {FOLD}, {DOUBLING}")
    require_integer("points", points, 2)
    require_integer("periods", periods)
    parameters, notes = _continuation(system, over, speed, periods, rtol, engine)
    task, names = parameters.task, parameters.names
    first = ContinuationParameters(
        parameters.task_at(parameters.ranges[:, 0]), names[:1], parameters.ranges[:1]
    )
    start_rtol = min(task.rtol, MAX_START_RTOL)
    orbit = nonlinear(first.task.system, first.task.speed, start, periods, rtol=start_rtol, engine=engine)
    found, ended = follow_branch(first, lambda: first_point(first, orbit, first.ranges[0, 0]), int(points))
    curves, reasons = list[list[Point]](), [f"branch over {names[0]}: {ended}"] if ended else []
    for point in found:
        if point.kind != kind or any(_starts(parameters, point, curve[-1]) for curve in curves):
            continue
        curve, reason = follow_curve(parameters, point, kind, int(points))
        curves.append(curve)
        reasons += [f"curve {len(curves)}: {reason}"] if reason else []
    return _result(parameters, kind, curves, "; ".join(reasons), notes)


def _continuation(
    system: PeriodicSystem,
    over: Sequence[str],
    speed: float | str | None,
    periods: int,
    rtol: float,
    engine: str,
) -> tuple[ContinuationParameters, Sequence[str]]:
    """Validate the input. Return the two parameters of the continuation, and notes on the engine. Raises
    SolveError subclasses for invalid input."""
    if isinstance(over, str) or len(over) != 2:
        raise ValueOutOfBoundsError(
            f"over is {over!r}; give two parameters, such as ['speed=1:2 rad/s', 'k1=1e4:9e4']"
        )
    rtol, (used, notes) = checked_rtol(rtol), chosen_engine(engine)
    names, ranges = [], []
    for text in over:
        name, *ends = range_of(system, text)
        names.append(name)
        ranges.append(ends)
    if names[0] == names[1]:
        raise ValueOutOfBoundsError(f"'over' gives {names[0]} twice; give two different parameters")
    omega = ranges[names.index(SPEED)][0] if SPEED in names else speed_or_usual(system, speed)
    task = Task(shown_in(system, omega), float(omega), int(periods), Radau(), used, rtol)
    return ContinuationParameters(task, tuple(names), np.array(ranges)), notes


def _starts(parameters: ContinuationParameters, point: Point, end: Point) -> bool:
    """Whether the point `end`, at which an earlier curve ends, is the special point `point` of the branch
    over the first parameter."""
    values = np.array([point.value, parameters.ranges[1, 0]])
    return bool((np.abs(end.orbit.values - values) <= _SAME * parameters.spans).all())


def _result(
    parameters: ContinuationParameters,
    kind: str,
    curves: Sequence[Sequence[Point]],
    ended: str,
    notes: Sequence[str],
) -> SpecialCurves:
    task, points = parameters.task, [point for curve in curves for point in curve]
    n = task.system.n
    return SpecialCurves(
        task.system,
        kind,
        (parameters.names[0], parameters.names[1]),
        np.array([point.orbit.values for point in points]).reshape(-1, 2),
        np.array([point.orbit.figures[:n, _MAX_ABS] for point in points]).reshape(-1, n),
        np.array([point.orbit.radius for point in points]),
        np.array([point.orbit.errors[0] for point in points]),
        np.array([point.kind == CUSP for point in points], dtype=bool),
        np.repeat(np.arange(len(curves)), [len(curve) for curve in curves]),
        task.rtol,
        ended,
        notes,
        task.periods,
    )
