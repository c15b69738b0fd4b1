"""`solve sweep`: response and stability over many speeds."""

import math
from collections.abc import Sequence
from functools import partial
from typing import Annotated, Any

from solve.commands.deliver import deliver_result
from solve.commands.groups import Flag, Places, Problem, Results, Speed, Speeds, Steps
from solve.commands.parse import harmonic_count, points
from solve.errors import MissingValueError, ValueOutOfBoundsError
from solve.model.model import Model
from solve.results.sweep import Sweep
from solve.single import periodic as solved
from solve.studies.sweep import sweep as swept
from solve.system import PeriodicSystem
from solve.units import speed_in_si
from solve.views.panels import shown
from solve.views.show import printout
from solve.views.style import Figure
from solve.views.sweep import labelled_by, moving
from solve.views.turn import require_turn, turn_figure, turns_figure


def sweep(
    problem: Problem,
    speeds: Speeds,
    speed: Speed,
    accuracy: Steps,
    places: Places,
    results: Results,
    show: Annotated[
        list[str] | None, Flag("Coordinate or output to show; repeatable; coordinates by default.", "NAME")
    ] = None,
    waterfall: Annotated[
        str | None, Flag("Draw this coordinate's or output's spectrum instead, over what varies.", "NAME")
    ] = None,
    harmonics: Annotated[int | None, Flag("Orders of the spectrum.", "N", "60")] = None,
    over: Annotated[
        list[str] | None,
        Flag("N values of a parameter from A to B, unit optional; repeatable.", '"NAME=A:B:N unit"'),
    ] = None,
    turn: Annotated[
        str | None, Flag("Draw its curve over one turn instead, a line a point: up to 12.", "NAME")
    ] = None,
) -> None:
    """Periodic vibration and stability over many speeds, and values of parameters."""
    orders, varied = harmonic_count(harmonics), _varied(over)
    omegas = _omegas(speeds, speed, bool(varied))
    model, count = problem.loaded(rigid=True, varied=varied), 1 if omegas is None else len(omegas)
    names, spectra = shown(model, show), [waterfall] if waterfall else []
    if turn is not None:
        _check_turn(model, turn, count * math.prod(map(len, varied.values())), results, waterfall)
    if waterfall and sum(len(values) > 1 for values in ([0] * count, *varied.values())) > 1:
        raise ValueOutOfBoundsError(
            "--waterfall draws a spectrum over one quantity; give one speed, or one value of the others"
        )
    if waterfall and not (results.plot or results.save or results.json):
        raise MissingValueError(
            f"--waterfall {waterfall} draws a picture; add the file, such as --plot waterfall.png"
        )
    asked = accuracy.rule, accuracy.steps, accuracy.rtol
    kept: dict[str, Any] = {"spectra": spectra, "harmonics": orders, "over": varied or None}
    with places.given() as given:
        result = swept(model, omegas, *asked, **kept, **given)
    result.results.require_any()
    report = partial(printout, result, problem.choices, names=names)
    figure = partial(result.waterfall, waterfall) if waterfall else partial(result.plot, show)
    if turn:
        figure = partial(_turns, model, result, turn, asked)
    deliver_result(results, result, problem.choices, result.notes, report=report, figure=figure)


def _omegas(speeds: Speeds, speed: Speed, varied: bool) -> Sequence[float] | None:
    """Speeds in rad/s of --speeds or --speed; None stands for the case's speed if parameters vary. Raises
    MissingValueError, UnitError, ValueOutOfBoundsError."""
    if speed.speed is not None and speeds.speeds is not None:
        raise ValueOutOfBoundsError("--speed and --speeds are both given; give one of them")
    if speed.speed is not None:
        return [speed_in_si(speed.speed)]
    return None if varied and speeds.speeds is None else speeds.omegas()


def _varied(over: list[str] | None) -> dict[str, Sequence[float | str]]:
    """Values by name. Raises ValueOutOfBoundsError."""
    pairs: list[tuple[str, Sequence[float | str]]] = [points("--over", text) for text in over or []]
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
    require_turn(model, name, count)


def _turns(model: Model, sweep: Sweep, turn: str, asked: tuple[Any, ...]) -> Figure:
    """A curve a point that has a result, named by its speed or by what varies. Raises ValueOutOfBoundsError
    where none has."""
    orbits, vary = {}, moving(sweep.varied)
    labels = labelled_by(model, {name: sweep.varied[name] for name in vary})
    for label, point in zip(labels, sweep.points, strict=True):
        if point.error is None:
            orbits[label] = solved(model.varied(point.parameters), point.speed, *asked)
    if not orbits:
        raise ValueOutOfBoundsError(f"--turn {turn}: no point has a result to draw; {sweep.points[0].error}")
    if not sweep.parameters:
        return turn_figure([*orbits.values()], turn)
    return turns_figure(orbits, turn, ", ".join(vary))
