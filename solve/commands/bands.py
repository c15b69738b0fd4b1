"""`solve bands`: the speeds at which the motion is unstable."""

from solve.commands.deliver import deliver_result
from solve.commands.groups import Accuracy, Moved, Problem, Results, Speeds
from solve.studies.bands import bands as found


def bands(problem: Problem, speeds: Speeds, accuracy: Accuracy, results: Results, moved: Moved) -> None:
    """Unstable bands between the lowest and the highest speed, their edges refined.

    Speeds are added as the model needs them; narrow bands are looked for between them.
    """
    omegas, model = speeds.omegas(), problem.loaded()
    moved.require_known(model)
    result = found(model, omegas, accuracy.rule, accuracy.rtol)
    deliver_result(results, moved.of(result, accuracy), problem.choices, result.notes)
