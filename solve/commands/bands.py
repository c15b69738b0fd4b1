"""`solve bands`: the speeds at which the motion is unstable."""

from typing import Annotated

from solve.commands.deliver import deliver_result
from solve.commands.groups import BY_PARAMETER, Accuracy, Flag, Problem, Results, Speeds
from solve.studies.bands import bands as found
from solve.studies.sensitivities import speed_sensitivities


def bands(
    problem: Problem,
    speeds: Speeds,
    accuracy: Accuracy,
    results: Results,
    by: Annotated[list[str] | None, Flag(BY_PARAMETER, "NAME")] = None,
) -> None:
    """Unstable bands between the lowest and the highest speed, their edges refined.

    Speeds are added as the model needs them; narrow bands are looked for between them.
    """
    omegas, model = speeds.omegas(), problem.loaded()
    result = found(model, omegas, accuracy.rule, accuracy.rtol)
    if by:
        moved = speed_sensitivities(result, by, accuracy.rule, accuracy.rtol)
        return deliver_result(results, moved, problem.choices, result.notes)
    return deliver_result(results, result, problem.choices, result.notes)
