"""`solve frequencies`: natural frequencies and mode shapes with the drive held still."""

from typing import Annotated

import typer

from solve.commands.deliver import deliver_result
from solve.commands.groups import Problem, Results
from solve.commands.parse import points, whole
from solve.errors import ValueOutOfBoundsError
from solve.results.frequencies import Findings
from solve.studies import frequencies as study


def frequencies(
    problem: Problem,
    results: Results,
    position: Annotated[
        str | None, typer.Option(metavar='"70 deg"', help="Where the drive is held; 0 by default.")
    ] = None,
    count: Annotated[
        int | None, typer.Option(metavar="N", parser=whole, help="How many, from the lowest; 4 by default.")
    ] = None,
    turn: Annotated[
        int | None,
        typer.Option(metavar="N", parser=whole, help="Also at N positions of the turn, with their mean."),
    ] = None,
    over: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=A:B:N",
            help="Also over N values of a parameter: the turn's mean, or at --position where given.",
        ),
    ] = None,
    modes: Annotated[bool, typer.Option("--modes", help="Also the mode shapes of a structure.")] = False,
) -> None:
    """Natural frequencies and mode shapes with the drive held still."""
    if over and len(over) > 1:
        raise ValueOutOfBoundsError(f"--over is given {len(over)} times; vary one parameter a run")
    varied = points("--over", over[0]) if over else None
    model = problem.loaded(still=True)
    study.require_position(model, position)
    here = study.frequencies(model, position or 0.0, count)
    whole_turn = None if turn is None else study.frequencies(model, study.turn(model, turn), count)
    variation = None
    if varied is not None:
        at = here.positions
        if position is None and model.moves:
            at = study.turn(model, turn or study.TURN)
        variation = study.frequencies_over(model, *varied, at, count)
    result = Findings(here, whole_turn, variation, here.shapes() if modes else ())
    deliver_result(results, result, problem.choices)
