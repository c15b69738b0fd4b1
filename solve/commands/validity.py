"""`solve validity`: up to which speed the linear model is to be trusted."""

from typing import Annotated

import typer

import solve
from solve.commands.deliver import deliver_result
from solve.commands.groups import Accuracy, Problem, Results, Speeds
from solve.commands.parse import part


def validity(
    problem: Problem,
    speeds: Speeds,
    accuracy: Accuracy,
    results: Results,
    at: Annotated[
        float | None,
        typer.Option(metavar="5%", parser=part, help="Error up to which it is trusted; 5% by default."),
    ] = None,
) -> None:
    """How far the linear model is off over speed, and up to which speed to trust it."""
    omegas, model = speeds.omegas(), problem.loaded()
    asked = 0.05 if at is None else at, accuracy.rule, accuracy.rtol
    result = solve.validity(model, omegas, *asked)
    deliver_result(results, result, problem.choices)
