"""`solve critical`: critical speeds three ways."""

from functools import partial
from typing import Annotated

from solve.commands.deliver import deliver_result
from solve.commands.groups import BY_PARAMETER, Accuracy, Flag, Problem, Results, Speeds
from solve.commands.parse import figure_kept
from solve.studies.critical_speeds import critical_speeds as found
from solve.studies.sensitivities import speed_sensitivities


def critical(
    problem: Problem,
    speeds: Speeds,
    accuracy: Accuracy,
    results: Results,
    of: Annotated[str | None, Flag("Coordinate or output; the first coordinate by default.", "NAME")] = None,
    figure: Annotated[str, Flag("Of its modulus over a turn, what is to be largest.", "max|rms")] = "max",
    orders: Annotated[int, Flag("Highest order of integer divisions.", "K")] = 20,
    campbell: Annotated[bool, Flag("Draw the Campbell diagram alone.")] = False,
    by: Annotated[list[str] | None, Flag(BY_PARAMETER, "NAME")] = None,
) -> None:
    """Critical speeds: largest response, dominant multiplier, integer divisions of frequencies."""
    omegas, kept, model = speeds.omegas(), figure_kept(figure), problem.loaded()
    result = found(model, omegas, of, kept, orders, accuracy.rule, accuracy.rtol)
    if by:
        moved = speed_sensitivities(result, by, accuracy.rule, accuracy.rtol)
        return deliver_result(results, moved, problem.choices, result.notes)
    drawn = partial(result.plot, campbell)
    return deliver_result(results, result, problem.choices, result.notes, figure=drawn)
