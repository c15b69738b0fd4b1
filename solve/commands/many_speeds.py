"""Commands for many speeds or parameter values: `sweep`, `chart`, `bands`, `critical`, `modes` and
`validity`."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any

import solve
from solve.commands.deliver import ContradictionError, deliver_result
from solve.commands.groups import (
    Accuracy,
    Execution,
    Loop,
    Results,
    Speed,
    SpeedOrSpeeds,
    Speeds,
    Steps,
)
from solve.commands.parse import (
    Flag,
    assignments,
    fraction,
    harmonic_count,
    points,
    quantities,
    require_with,
    statistic_name,
)
from solve.errors import MissingValueError, ValueOutOfBoundsError, counted, require_name
from solve.labels import in_own_unit
from solve.model.model import Model
from solve.results.bands import Bands
from solve.results.critical_speeds import CriticalSpeeds
from solve.results.result import Result
from solve.results.sweep import Sweep
from solve.results.sweeps import ACCEPTABLE_ERROR
from solve.system import PeriodicSystem
from solve.units import speed_in_si, speeds_in_si
from solve.views.over_time import require_turn, turn_figure, turns_figure
from solve.views.panels import shown
from solve.views.show import printout
from solve.views.style import Figure
from solve.views.sweep import labelled_by, moving

_RANGE = '"NAME=A:B:N unit"'


@dataclass(frozen=True)
class SpeedDerivatives:
    """Flag for the parameters with respect to which computed speeds are differentiated."""

    by: Annotated[
        list[str] | None,
        Flag(
            "Compute the derivatives of the resulting speeds with respect to this parameter; repeatable.",
            "NAME",
        ),
    ] = None

    def require_known(self, model: Model) -> None:
        """Raise SolveError subclasses, before the computation, for names that are not parameters."""
        if self.by:
            from solve.studies.sensitivities import moving_parameters

            moving_parameters(model, self.by)

    def requested(self, result: Bands | CriticalSpeeds, accuracy: Accuracy) -> Result:
        """Return the derivatives of the result's speeds if they are requested, and otherwise the result."""
        if not self.by:
            return result
        from solve.studies.sensitivities import speed_sensitivities

        return speed_sensitivities(result, self.by, accuracy.rule, accuracy.rtol)


def sweep(
    problem: Loop,
    speeds: SpeedOrSpeeds,
    accuracy: Steps,
    execution: Execution,
    results: Results,
    show: Annotated[
        list[str] | None,
        Flag("Coordinate or output to show; repeatable; all coordinates by default.", "NAME"),
    ] = None,
    waterfall: Annotated[
        str | None, Flag("Draw only the spectra of this coordinate or output.", "NAME")
    ] = None,
    harmonics: Annotated[int | None, Flag("Number of harmonics of the spectra.", "N", "60")] = None,
    over: Annotated[
        list[str] | None, Flag("Vary a parameter: N values from A to B, unit optional; repeatable.", _RANGE)
    ] = None,
    turn: Annotated[
        str | None,
        Flag("Draw only this coordinate or output over one period, one curve per point, up to 12.", "NAME"),
    ] = None,
    nonlinear: Annotated[
        bool, Flag("Solve for orbits of the nonlinear equations, each starting from a neighbour.")
    ] = False,
) -> None:
    """Periodic vibration and stability at many speeds and parameter values."""
    harmonic, varied = harmonic_count(harmonics), _varied(over)
    omegas = _omegas(speeds, bool(varied))
    model, count = problem.loaded(rigid=True, varied=varied), 1 if omegas is None else len(omegas)
    names, spectra = shown(model, show), [waterfall] if waterfall else []
    if turn is not None:
        _check_turn(model, turn, count * math.prod(map(len, varied.values())), results, waterfall)
    if waterfall:
        _check_waterfall(waterfall, results, [count, *map(len, varied.values())])
    require_with("--waterfall NAME", waterfall is not None, {"--harmonics": harmonics})
    rule = accuracy.rule, accuracy.steps, accuracy.rtol
    if nonlinear and turn is not None:
        raise ValueOutOfBoundsError("--turn draws linear orbits; omit --turn or --nonlinear")
    output: dict[str, Any] = {"spectra": spectra, "harmonics": harmonic, "over": varied or None}
    output["nonlinear"] = nonlinear
    with execution.given() as resources:
        result = solve.sweep(model, omegas, *rule, **output, **resources)
    result.results.require_any()
    report = partial(printout, result, problem.choices, names=names)
    figure = partial(result.waterfall, waterfall) if waterfall else partial(result.plot, show)
    if turn:
        figure = partial(_turns, model, result, turn, rule)
    deliver_result(results, result, problem.choices, result.notes, report=report, figure=figure)


def _omegas(speeds: SpeedOrSpeeds, varied: bool) -> Sequence[float] | None:
    """Return the speeds in rad/s from --speeds or --speed. If neither is given and parameters vary, return
    None, which selects the speed of the case. Raises MissingValueError, UnitError, ValueOutOfBoundsError."""
    if speeds.speed is not None:
        return [speed_in_si(speeds.speed)]
    return None if varied and speeds.speeds is None else speeds.omegas()


def _varied(over: list[str] | None) -> dict[str, Sequence[float | str]]:
    """Return a mapping from the names in --over to values. Raises ValueOutOfBoundsError."""
    varied: dict[str, Sequence[float | str]] = {}
    for name, values in (points("--over", text) for text in over or []):
        if name in varied:
            raise ValueOutOfBoundsError(f"--over gives {name} twice; give it once")
        varied[name] = values
    return varied


def _check_turn(
    model: PeriodicSystem, name: str, count: int, results: Results, waterfall: str | None
) -> None:
    """Raise SolveError subclasses, before the computation, if the picture of --turn cannot be drawn."""
    if results.plot is None:
        raise MissingValueError(f"--turn {name} draws a picture; add the file, such as --plot turn.png")
    if waterfall is not None:
        raise ValueOutOfBoundsError("--turn and --waterfall select two different pictures; give one of them")
    require_turn(model, name, count)


def _check_waterfall(name: str, results: Results, counts: Sequence[int]) -> None:
    """Raise SolveError subclasses, before the computation, if the picture of --waterfall cannot be drawn.
    `counts` contains the number of speeds and the number of values of each parameter."""
    if sum(count > 1 for count in counts) > 1:
        raise ValueOutOfBoundsError(
            "--waterfall draws spectra versus one quantity, but several vary; let one vary, and give a "
            "single value for each of the others"
        )
    if not (results.plot or results.save or results.json):
        raise MissingValueError(
            f"--waterfall {name} draws a picture; add the file, such as --plot waterfall.png"
        )


def _turns(model: Model, sweep: Sweep, turn: str, rule: tuple[Any, ...]) -> Figure:
    """Return a figure with one curve for each point that has a result. Raises ValueOutOfBoundsError if no
    point has a result."""
    orbits, varying = {}, moving(sweep.varied)
    labels = labelled_by(model, {name: sweep.varied[name] for name in varying})
    for label, point in zip(labels, sweep.points, strict=True):
        if point.error is None:
            orbits[label] = solve.periodic(model.varied(point.parameters), point.speed, *rule)
    if not orbits:
        raise ValueOutOfBoundsError(f"--turn {turn}: no point has a result to draw; {sweep.points[0].error}")
    if not sweep.parameters:
        return turn_figure([*orbits.values()], turn)
    return turns_figure(orbits, turn, ", ".join(varying))


def chart(
    problem: Loop,
    speed: Speed,
    accuracy: Accuracy,
    execution: Execution,
    results: Results,
    x: Annotated[
        str | None, Flag("Quantity on the x axis: N values from A to B; a speed requires its unit.", _RANGE)
    ] = None,
    y: Annotated[str | None, Flag("Quantity on the y axis: N values from A to B.", _RANGE)] = None,
    cut: Annotated[
        list[str] | None,
        Flag("Cut: draw results along the line at this value of x or y; repeatable.", "NAME=NUMBER[unit]"),
    ] = None,
    of: Annotated[
        str | None, Flag("Quantity to draw, for example q3.max_abs, rho1.re or exponent1.re.", "QUANTITY")
    ] = None,
    tolerance: Annotated[
        float, Flag("Accuracy of the boundaries, relative to the ranges of x and y.", "R")
    ] = 1e-9,
    prove: Annotated[
        bool, Flag("Prove verdicts on rectangles that cover the chart; requires python-flint.")
    ] = False,
) -> None:
    """Stability as a function of two quantities, with labelled boundaries."""
    across, upwards = _axis("--x", x), _axis("--y", y)
    model = problem.loaded(varied={**across, **upwards})
    lines = [_held(text, model) for text in cut or []]
    for name, _ in lines:
        require_name("quantity of the chart", name, [*across, *upwards])
    omega = None if "speed" in {*across, *upwards} else speed.omega(model)
    options = {"method": accuracy.rule, "rtol": accuracy.rtol, "tolerance": tolerance, "of": of}
    options["prove"] = prove
    with execution.given() as resources:
        result = solve.chart(model, across, upwards, omega, **options, **resources).with_cuts(lines)
    deliver_result(results, result, problem.choices, result.notes)
    if result.contradicted:
        raise ContradictionError(
            f"proved verdicts contradict {counted(result.contradicted, 'point')} of the chart"
        )


def _axis(flag: str, text: str | None) -> dict[str, Sequence[float | str]]:
    """Return a mapping from the name of the quantity on an axis to its values. Raises MissingValueError,
    ValueOutOfBoundsError, UnitError."""
    if text is None:
        raise MissingValueError(
            f"no {flag} given; add {flag} NAME=A:B:N, N values of a parameter from A to B"
        )
    name, _, values = text.partition("=")
    if name.strip() == "speed":
        return {"speed": speeds_in_si(values)}
    return dict([points(flag, text)])


def _held(text: str, model: Model) -> tuple[str, float]:
    """Return the name, and the value in the model's unit, from a string NAME=NUMBER[unit]."""
    ((name, value),) = assignments("--cut", [text], "NAME=NUMBER").items()
    if name == "speed":
        return name, speed_in_si(value)
    return name, in_own_unit(model, name, quantities("--cut", [text])[name])


def bands(
    problem: Loop, speeds: Speeds, accuracy: Accuracy, results: Results, derivatives: SpeedDerivatives
) -> None:
    """Unstable bands between the lowest and the highest speed, with refined edges.

    Speeds are added where the model requires them, and narrow bands are searched for between the speeds.
    """
    omegas, model = speeds.omegas(), problem.loaded()
    derivatives.require_known(model)
    result = solve.bands(model, omegas, accuracy.rule, accuracy.rtol)
    deliver_result(results, derivatives.requested(result, accuracy), problem.choices, result.notes)


def critical(
    problem: Loop,
    speeds: Speeds,
    accuracy: Accuracy,
    results: Results,
    derivatives: SpeedDerivatives,
    of: Annotated[str | None, Flag("Coordinate or output; the first coordinate by default.", "NAME")] = None,
    figure: Annotated[
        str, Flag("Statistic of |quantity| whose maxima are sought: max or rms.", "max|rms")
    ] = "max",
    orders: Annotated[int, Flag("Highest order of integer divisions.", "K")] = 20,
    campbell: Annotated[bool, Flag("Draw only the response and the Campbell diagram.")] = False,
) -> None:
    """Critical speeds: maxima of response and of multipliers, divisions ω̄/k of mean frequencies."""
    omegas, statistic, model = speeds.omegas(), statistic_name(figure), problem.loaded()
    derivatives.require_known(model)
    require_with("--plot FILE", results.plot is not None, {"--campbell": campbell})
    if campbell and derivatives.by:
        raise ValueOutOfBoundsError("--campbell and --by select two different results; give one of them")
    result = solve.critical_speeds(model, omegas, of, statistic, orders, accuracy.rule, accuracy.rtol)
    drawn = None if derivatives.by else partial(result.plot, campbell=campbell)
    deliver_result(
        results, derivatives.requested(result, accuracy), problem.choices, result.notes, figure=drawn
    )


def modes(
    problem: Loop,
    speeds: SpeedOrSpeeds,
    accuracy: Steps,
    results: Results,
    over: Annotated[
        list[str] | None, Flag("Vary a parameter instead of the speed: N values from A to B.", _RANGE)
    ] = None,
) -> None:
    """Floquet modes versus speed or a parameter: frequencies, damping, veerings."""
    varied = _varied(over)
    omegas = _omegas(speeds, bool(varied))
    model, rule = problem.loaded(varied=varied), (accuracy.rule, accuracy.steps, accuracy.rtol)
    result = solve.follow_modes(model, omegas, *rule, over=varied or None)
    deliver_result(results, result, problem.choices)


def validity(
    problem: Loop,
    speeds: Speeds,
    accuracy: Accuracy,
    results: Results,
    at: Annotated[
        float,
        Flag("Largest linearisation error for which the linear model counts as valid.", "5%", read=fraction),
    ] = ACCEPTABLE_ERROR,
) -> None:
    """Linearisation error versus speed, and the speed up to which the linear model is valid."""
    omegas, model = speeds.omegas(), problem.loaded()
    result = solve.validity(model, omegas, at, accuracy.rule, accuracy.rtol)
    result.require_any()
    deliver_result(results, result, problem.choices)
