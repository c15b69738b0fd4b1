"""`solve frequencies`: natural frequencies and mode shapes with the drive held still."""

from typing import Annotated

from solve.commands.deliver import deliver_result
from solve.commands.groups import Flag, Problem, Results
from solve.commands.parse import points
from solve.errors import ValueOutOfBoundsError
from solve.results.frequencies import Findings
from solve.studies import frequencies as study


def frequencies(
    problem: Problem,
    results: Results,
    position: Annotated[str | None, Flag("Where the drive is held; 0 by default.", '"70 deg"')] = None,
    count: Annotated[int | None, Flag("How many, from the lowest; 4 by default.", "N")] = None,
    turn: Annotated[int | None, Flag("Also at N positions of the turn, with their mean.", "N")] = None,
    over: Annotated[
        list[str] | None,
        Flag(
            "Also over N values of a parameter: mean over the revolution, or at --position if given.",
            '"NAME=A:B:N unit"',
        ),
    ] = None,
    modes: Annotated[bool, Flag("Also the mode shapes of a structure.")] = False,
) -> None:
    """Natural frequencies and mode shapes with the drive held still."""
    if over and len(over) > 1:
        raise ValueOutOfBoundsError(f"--over is given {len(over)} times; vary one parameter a run")
    varied = points("--over", over[0]) if over else None
    model = problem.loaded(still=True, varied={} if varied is None else dict([varied]))
    study.require_position(model, position)
    here = study.frequencies(model, position or 0.0, count)
    whole_turn = None if turn is None else study.frequencies(model, study.turn(model, turn), count)
    variation = None
    if varied is not None:
        at = here.positions
        if position is None and model.moves:
            at = study.turn(model, turn or study.TURN)
        variation = study.frequencies_over(model, *varied, at, count)
    first = [name for name in varied[:1] if name in problem.unset(problem.model)] if varied else []
    result = Findings(here, whole_turn, variation, here.shapes() if modes else (), first)
    deliver_result(results, result, problem.choices)
