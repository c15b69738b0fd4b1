"""`solve sweep`: response and stability over many speeds."""

from typing import Annotated, Any

from solve.commands.deliver import deliver_result
from solve.commands.groups import Flag, Problem, Results, Speeds, Steps
from solve.commands.parse import harmonic_count, points
from solve.errors import MissingValueError, ValueOutOfBoundsError
from solve.results.plot import shown
from solve.results.style import Figure
from solve.results.sweep import Sweep
from solve.results.turn_plot import checked_turn, turn_figure
from solve.single import periodic as solved
from solve.studies.sweep import sweep as swept
from solve.system import PeriodicSystem


def sweep(
    problem: Problem,
    speeds: Speeds,
    accuracy: Steps,
    results: Results,
    show: Annotated[
        list[str] | None, Flag("Coordinate or output to show; repeatable; coordinates by default.", "NAME")
    ] = None,
    waterfall: Annotated[
        str | None, Flag("Draw this coordinate's or output's spectrum over speed instead.", "NAME")
    ] = None,
    harmonics: Annotated[int | None, Flag("Orders of the spectrum.", "N", "60")] = None,
    over: Annotated[
        list[str] | None, Flag("N values of a parameter from A to B, in SI; repeatable.", "NAME=A:B:N")
    ] = None,
    turn: Annotated[
        str | None, Flag("Draw its curve over one turn instead, a line a speed: up to 12.", "NAME")
    ] = None,
) -> None:
    """Periodic vibration and stability over many speeds, and values of parameters."""
    orders, varied = harmonic_count(harmonics), _varied(over)
    omegas = None if varied and speeds.speeds is None else speeds.omegas()
    model, count = problem.loaded(), 1 if omegas is None else len(omegas)
    names, spectra = shown(model, show), [waterfall] if waterfall else []
    if over and (turn or waterfall):
        raise ValueOutOfBoundsError("--over varies parameters; --turn and --waterfall show speeds alone")
    if turn is not None:
        _check_turn(model, turn, count, results, waterfall)
    asked = accuracy.rule, accuracy.steps, accuracy.rtol
    kept: dict[str, Any] = {"spectra": spectra, "harmonics": orders, "over": varied or None}
    result = swept(model, omegas, *asked, **kept)
    result.results.require_any()

    def figure() -> Figure:
        if turn:
            return turn_figure([solved(model, omega, *asked) for omega in _solved(result, turn)], turn)
        return result.waterfall(waterfall) if waterfall else result.plot(show)

    deliver_result(
        results,
        result,
        problem.choices,
        result.notes,
        report=lambda: result.report(problem.choices, names),
        figure=figure,
    )


def _varied(over: list[str] | None) -> dict[str, list[float]]:
    """Values by name. Raises ValueOutOfBoundsError."""
    pairs = [points("--over", text) for text in over or []]
    for name in (name for at, (name, _) in enumerate(pairs) if name in dict(pairs[:at])):
        raise ValueOutOfBoundsError(f"--over gives {name} twice; give it once")
    return dict(pairs)


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


def _solved(sweep: Sweep, turn: str) -> list[float]:
    """The speeds that have a result to draw. Raises ValueOutOfBoundsError where none has."""
    speeds = [point.speed for point in sweep.points if point.error is None]
    if not speeds:
        raise ValueOutOfBoundsError(f"--turn {turn}: no speed has a result to draw; {sweep.points[0].error}")
    return speeds
