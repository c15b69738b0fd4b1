"""`solve sweep`: response and stability over many speeds."""

from typing import Annotated

import typer

import solve
from solve.commands.deliver import deliver
from solve.commands.groups import Accuracy, Problem, Results, Settings, Speeds, progressing
from solve.commands.parse import harmonic_count, whole
from solve.errors import MissingValueError, ValueOutOfBoundsError
from solve.results.rows import shown
from solve.results.style import Figure
from solve.results.sweep import Sweep
from solve.results.turn_plot import checked_turn, turn_figure
from solve.system import PeriodicSystem


def sweep(
    problem: Problem,
    speeds: Speeds,
    accuracy: Accuracy,
    settings: Settings,
    results: Results,
    show: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME", help="Coordinate or output to show; repeatable; coordinates by default."
        ),
    ] = None,
    waterfall: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Draw this coordinate's or output's spectrum over speed instead."),
    ] = None,
    harmonics: Annotated[
        int | None, typer.Option(metavar="N", parser=whole, help="Orders of the spectrum.", show_default="60")
    ] = None,
    turn: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Draw its curve over one turn instead, a line a speed: up to 12."),
    ] = None,
) -> None:
    """Periodic vibration and stability over many speeds."""
    results.files()
    orders = harmonic_count(harmonics)
    omegas = speeds.omegas()
    model, _ = problem.loaded()
    names = shown(model, show)
    if turn is not None:
        _check_turn(model, turn, len(omegas), results, waterfall)
    with progressing("sweep", len(omegas)) as progress:
        found = solve.sweep(
            model,
            omegas,
            accuracy.chosen(settings),
            accuracy.steps,
            accuracy.rtol,
            progress=progress,
            spectra=[waterfall] if waterfall else [],
            harmonics=orders,
        )

    def figure() -> Figure:
        if turn:
            return _turns(found, turn, accuracy, settings)
        return found.waterfall(waterfall) if waterfall else found.plot(show)

    deliver(
        results,
        [*found.notes, *found.warnings],
        record=found.record,
        report=lambda: found.report(names, problem.choices),
        figure=figure,
        contents=found.contents,
    )


def _check_turn(
    model: PeriodicSystem, name: str, count: int, results: Results, waterfall: str | None
) -> None:
    """Raise before anything is calculated: for a picture that nobody asked for, or two in one file, or one
    that cannot be drawn."""
    if results.plot is None:
        raise MissingValueError(f"--turn {name} draws a picture; add the file, such as --plot turn.png")
    if waterfall is not None:
        raise ValueOutOfBoundsError("--turn and --waterfall draw one picture each; give one of them")
    checked_turn(model, name, count)


def _turns(found: Sweep, name: str, accuracy: Accuracy, settings: Settings) -> Figure:
    """The curves of the speeds that have a result. Raises ValueOutOfBoundsError where none has."""
    speeds = [point.speed for point in found.points if point.error is None]
    if not speeds:
        raise ValueOutOfBoundsError(f"--turn {name}: no speed has a result to draw; {found.points[0].error}")
    method = accuracy.chosen(settings)
    orbits = [solve.periodic(found.system, speed, method, accuracy.steps, accuracy.rtol) for speed in speeds]
    return turn_figure(orbits, name)
