"""`solve transient`: the motion in time, and how soon it reaches the periodic vibration."""

from typing import Annotated

from solve.commands.deliver import deliver_result
from solve.commands.groups import Flag, Problem, Results, Speed
from solve.newton.transients import transient as found


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
) -> None:
    """Start-up in time from any state, and how soon it reaches the periodic vibration."""
    model = problem.loaded()
    result = found(model, speed.omega(model), turns, start, nonlinear, rtol)
    deliver_result(results, result, problem.choices)
