"""`solve critical`: critical speeds three ways."""

from typing import Annotated

import typer

import solve
from solve.commands.deliver import deliver
from solve.commands.groups import Problem, Results, Settings, Speeds, progressing
from solve.commands.parse import figure_kept, number, whole
from solve.methods.choice import chosen


def critical(
    problem: Problem,
    speeds: Speeds,
    settings: Settings,
    results: Results,
    of: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Coordinate or output; the first coordinate by default."),
    ] = None,
    figure: Annotated[
        str, typer.Option(metavar="max|rms", help="Of its modulus over a turn, what is to be largest.")
    ] = "max",
    orders: Annotated[
        int, typer.Option(metavar="K", parser=whole, help="Highest order of integer divisions.")
    ] = 20,
    campbell: Annotated[bool, typer.Option("--campbell", help="Draw the Campbell diagram alone.")] = False,
    method: Annotated[str, typer.Option(metavar="NAME", help="Method; auto chooses.")] = "auto",
    rtol: Annotated[
        float, typer.Option(metavar="R", parser=number, help="Relative error of each solution.")
    ] = 1e-8,
) -> None:
    """Critical speeds: largest response, dominant multiplier, integer divisions of frequencies."""
    results.files()
    omegas = speeds.omegas()
    kept = figure_kept(figure)
    model, _ = problem.loaded()
    rule = chosen(method, **vars(settings))
    with progressing("points") as progress:
        found = solve.critical_speeds(model, omegas, of, kept, orders, rule, rtol, progress=progress)
    deliver(
        results,
        [*found.notes, *found.warnings],
        record=found.record,
        report=lambda: found.report(problem.choices),
        figure=lambda: found.plot(campbell),
        contents=found.contents,
    )
