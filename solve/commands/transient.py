"""`solve transient`: the motion in time, and how soon it reaches the periodic vibration."""

from typing import Annotated

import typer

import solve
from solve.commands.deliver import deliver_result
from solve.commands.groups import Problem, Results, Speed
from solve.commands.parse import number, whole


def transient(
    problem: Problem,
    speed: Speed,
    results: Results,
    turns: Annotated[
        int | None, typer.Option(metavar="N", parser=whole, help="Periods to follow; 40 by default.")
    ] = None,
    start: Annotated[
        str,
        typer.Option(metavar="FILE|rest|orbit", help="Where it starts: a saved .npz goes on from its end."),
    ] = "rest",
    nonlinear: Annotated[
        bool, typer.Option("--nonlinear", help="By the nonlinear equations of motion.")
    ] = False,
    rtol: Annotated[
        float | None,
        typer.Option(metavar="R", parser=number, help="To which the orbit is reached; 1e-3 by default."),
    ] = None,
) -> None:
    """Start-up in time from any state, and how soon it reaches the periodic vibration."""
    model = problem.loaded()
    count, tolerance = 40 if turns is None else turns, 1e-3 if rtol is None else rtol
    result = solve.transient(model, speed.omega(model), count, start, nonlinear, tolerance)
    deliver_result(results, result, problem.choices)
