"""`solve validity`: up to which speed the linear model is to be trusted."""

from typing import Annotated

from solve.commands.deliver import deliver_result
from solve.commands.groups import Accuracy, Flag, Problem, Results, Speeds
from solve.commands.parse import part
from solve.studies.sweep import validity as found


def validity(
    problem: Problem,
    speeds: Speeds,
    accuracy: Accuracy,
    results: Results,
    at: Annotated[float, Flag("Error up to which it is trusted.", "5%", read=part)] = 0.05,
) -> None:
    """How far the linear model is off over speed, and up to which speed to trust it."""
    omegas, model = speeds.omegas(), problem.loaded()
    result = found(model, omegas, at, accuracy.rule, accuracy.rtol)
    result.require_any()
    deliver_result(results, result, problem.choices)
