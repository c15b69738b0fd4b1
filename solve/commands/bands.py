"""`solve bands`: the speeds at which the motion is unstable."""

from typing import Annotated

import typer

import solve
from solve.commands.deliver import deliver
from solve.commands.groups import Problem, Results, Settings, Speeds, progressing
from solve.methods.choice import chosen


def bands(
    problem: Problem,
    speeds: Speeds,
    settings: Settings,
    results: Results,
    method: Annotated[str, typer.Option(metavar="NAME", help="Method; auto chooses.")] = "auto",
    rtol: Annotated[float, typer.Option(metavar="R", help="Relative error of multipliers to reach.")] = 1e-8,
) -> None:
    """Unstable bands between the lowest and the highest speed, their edges refined.

    Speeds are added as the model needs them; narrow bands are looked for between them.
    """
    results.files()
    omegas = speeds.omegas()
    model, _ = problem.loaded()
    rule = chosen(method, **vars(settings))
    with progressing("points") as progress:
        found = solve.bands(model, omegas, rule, rtol, progress=progress)
    deliver(
        results,
        [*found.notes, *found.warnings],
        record=found.record,
        report=lambda: found.report(problem.choices),
        figure=lambda: found.plot(solve.sweep(model, omegas, rule, rtol=rtol)),
        contents=found.contents,
    )
