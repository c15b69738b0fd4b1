"""`solve transient`: the motion in time, and how soon it reaches the periodic vibration."""

from functools import partial
from typing import Annotated

from solve.commands.deliver import deliver_result
from solve.commands.groups import Flag, Problem, Results, Speed
from solve.errors import ValueOutOfBoundsError
from solve.newton.transients import transient as found
from solve.views.panels import shown


def transient(
    problem: Problem,
    speed: Speed,
    results: Results,
    turns: Annotated[int, Flag("Periods to follow.", "N")] = 40,
    start: Annotated[
        str, Flag("Where it starts: a saved .npz goes on from its end.", "FILE|rest|orbit")
    ] = "rest",
    nonlinear: Annotated[bool, Flag("By the nonlinear equations of motion.")] = False,
    rtol: Annotated[float, Flag("To which the orbit is reached.", "R")] = 1e-3,
    show: Annotated[list[str] | None, Flag("Coordinate or output to draw; repeatable.", "NAME")] = None,
    speeds: Annotated[
        str | None, Flag("Instead of one speed: linear in time over the turns; one may be 0.", '"A:B unit"')
    ] = None,
) -> None:
    """Start-up from any state, until the periodic vibration is reached; run-up to a speed."""
    model = problem.loaded()
    shown(model, show)
    if speeds is not None and speed.speed is not None:
        raise ValueOutOfBoundsError("--speed is constant and --speeds varies; give one of them")
    omega = speed.omega(model) if speeds is None else None
    result = found(model, omega, turns, start, nonlinear, rtol, speeds=speeds)
    deliver_result(results, result, problem.choices, figure=partial(result.plot, show))
