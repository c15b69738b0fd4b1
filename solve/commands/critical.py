"""`solve critical`: critical speeds three ways."""

from functools import partial
from typing import Annotated

from solve.commands.deliver import deliver_result
from solve.commands.groups import Accuracy, Flag, Moved, Problem, Results, Speeds
from solve.commands.parse import figure_kept
from solve.studies.critical_speeds import critical_speeds as found


def critical(
    problem: Problem,
    speeds: Speeds,
    accuracy: Accuracy,
    results: Results,
    moved: Moved,
    of: Annotated[str | None, Flag("Coordinate or output; the first coordinate by default.", "NAME")] = None,
    figure: Annotated[str, Flag("Of its modulus over a turn, what is to be largest.", "max|rms")] = "max",
    orders: Annotated[int, Flag("Highest order of integer divisions.", "K")] = 20,
    campbell: Annotated[bool, Flag("Draw the Campbell diagram alone.")] = False,
) -> None:
    """Critical speeds: largest response, dominant multiplier, integer divisions of frequencies."""
    omegas, kept, model = speeds.omegas(), figure_kept(figure), problem.loaded()
    moved.require_known(model)
    result = found(model, omegas, of, kept, orders, accuracy.rule, accuracy.rtol)
    drawn = None if moved.by else partial(result.plot, campbell=campbell)
    deliver_result(results, moved.of(result, accuracy), problem.choices, result.notes, figure=drawn)
