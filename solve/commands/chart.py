"""`solve chart`: stability over two quantities."""

from typing import Annotated

import typer

import solve
from solve.commands.deliver import deliver
from solve.commands.groups import Problem, Results, Settings, Speed, progressing
from solve.commands.parse import assignments, number, numbers, points
from solve.errors import MissingValueError
from solve.methods.choice import chosen
from solve.units import speed_in_si, speeds_in_si

_RANGE = 'NAME=A:B:N|"speed=A:B:N rpm"'


def chart(
    problem: Problem,
    speed: Speed,
    settings: Settings,
    results: Results,
    x: Annotated[str | None, typer.Option(metavar=_RANGE, help="N values from A to B, across.")] = None,
    y: Annotated[str | None, typer.Option(metavar=_RANGE, help="N values from A to B, upwards.")] = None,
    cut: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=NUMBER", help="Also along the line where x or y is this; repeatable."),
    ] = None,
    method: Annotated[str, typer.Option(metavar="NAME", help="Method; auto chooses.")] = "auto",
    rtol: Annotated[
        float, typer.Option(metavar="R", parser=number, help="Relative error of multipliers to reach.")
    ] = 1e-8,
    tolerance: Annotated[
        float,
        typer.Option(metavar="R", parser=number, help="Accuracy of boundaries, as part of the ranges."),
    ] = 1e-9,
) -> None:
    """Stability over two quantities, with named boundaries."""
    results.files()
    across, upwards = _axis("--x", x), _axis("--y", y)
    lines = [_held(text) for text in cut or []]
    model, of_case = problem.loaded()
    omega = None if "speed" in {*across, *upwards} else speed.omega(model, of_case)
    with progressing("points") as progress:
        found = solve.chart(
            model,
            across,
            upwards,
            omega,
            method=chosen(method, **vars(settings)),
            rtol=rtol,
            tolerance=tolerance,
            progress=progress,
        )
        cuts = [found.cut_at(name, value) for name, value in lines]
    deliver(
        results,
        [*found.notes, *found.warnings],
        record=lambda: found.record(cuts),
        report=lambda: found.report(cuts, problem.choices),
        figure=found.plot,
        contents=found.contents,
    )


def _axis(flag: str, text: str | None) -> dict[str, list[float]]:
    """{name: values in SI units}. Raises MissingValueError, ValueOutOfBoundsError, UnitError."""
    if text is None:
        raise MissingValueError(
            f"no {flag} given; add {flag} NAME=A:B:N, N values of a parameter from A to B"
        )
    name, _, values = text.partition("=")
    if name.strip() == "speed":
        return {"speed": speeds_in_si(values)}
    return dict([points(flag, text)])


def _held(text: str) -> tuple[str, float]:
    """Name and value in SI units from NAME=NUMBER, or "speed=NUMBER unit"."""
    ((name, value),) = assignments("--cut", [text], "NAME=NUMBER").items()
    if name == "speed":
        return name, speed_in_si(value)
    return name, numbers("--cut", [text])[name]
