"""Commands at one speed: `periodic`, `floquet`, `compare` and `transient`."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any

import solve
from solve.commands.deliver import deliver_result
from solve.commands.groups import Loop, PointAccuracy, Proving, Results, Settings, Speed
from solve.commands.parse import Flag, harmonic_count, require_with
from solve.errors import NoResultError, ValueOutOfBoundsError, require_name
from solve.methods.choice import METHODS, Rule, chosen, settings_of
from solve.model.model import Model
from solve.results.orbit import Orbit
from solve.studies.compare import TARGETS
from solve.views.orbit import SCALES
from solve.views.panels import shown, titled
from solve.views.show import printout
from solve.views.style import Figure
from solve.views.tables import RenderableType, stacked

if TYPE_CHECKING:
    from solve.studies.measured import Measured


def periodic(
    problem: Loop,
    speed: Speed,
    accuracy: PointAccuracy,
    proving: Proving,
    results: Results,
    harmonics: Annotated[int | None, Flag("Number of harmonics of the spectrum; 60 by default.", "N")] = None,
    nonlinear: Annotated[
        bool, Flag("Solve for the orbit of the nonlinear equations, and show the linear one for comparison.")
    ] = False,
    periods: Annotated[
        int | None,
        Flag("With --nonlinear: period of the orbit, in periods of the system; 1 by default.", "K"),
    ] = None,
    start: Annotated[
        str | None, Flag("With --nonlinear: start from a saved orbit or transient.", "FILE")
    ] = None,
    quasi_static: Annotated[bool, Flag("Show the quasi-static response for comparison.")] = False,
    show: Annotated[list[str] | None, Flag("Coordinate or output to draw; repeatable.", "NAME")] = None,
    data: Annotated[
        str | None, Flag("File of vibration measured at this speed, drawn for comparison.", "FILE")
    ] = None,
    fits: Annotated[
        bool,
        Flag(
            "With --plot: draw the case's tabulated functions, with the series fitted to them, not the orbit."
        ),
    ] = False,
    scale: Annotated[str, Flag("Scale of the spectrum in the picture.", "linear|dB")] = "linear",
) -> None:
    """Periodic vibration, its spectrum and its stability."""
    count, model = harmonic_count(harmonics), problem.loaded(rigid=True)
    proving.require_provable(model, nonlinear)
    require_name("scale", scale, SCALES)
    shown(model, show)
    pictured = {"--fits": fits, "--show": show, "--scale": None if scale == SCALES[0] else scale}
    require_with("--plot FILE", results.plot is not None, pictured)
    require_with("--nonlinear", nonlinear, {"--periods": periods, "--start": start})
    _check_flags(nonlinear, quasi_static, fits, data)
    records, picture = None, None
    if data is not None:
        from solve.studies.measured import measured

        records = measured(data, model, speed.omega(model))
    if fits:
        from solve.views.over_time import fits_figure

        picture = fits_figure(model)
    solver = solve.periodic
    if nonlinear:
        solver = partial(_nonlinear, start=start, periods=1 if periods is None else periods)
    orbit = accuracy.solved(solver, model, speed.omega(model))
    proof = proving.proof(orbit)
    figure = partial(orbit.plot, show, quasi_static, scale, harmonics) if picture is None else lambda: picture
    record = partial(orbit.record, count, quasi_static)
    report = partial(printout, orbit, problem.choices, quasi_static=quasi_static)
    if records is not None:
        record, report, figure = _with_measured(orbit, records, record, report)
    deliver_result(results, orbit, problem.choices, record=record, report=report, figure=figure, proof=proof)


def _check_flags(nonlinear: bool, quasi_static: bool, fits: bool, data: str | None) -> None:
    """Raise ValueOutOfBoundsError if two flags exclude each other."""
    if fits and data is not None:
        raise ValueOutOfBoundsError("--fits and --data select two different pictures; give one of them")
    if nonlinear and quasi_static:
        raise ValueOutOfBoundsError(
            "--quasi-static requires the linear orbit; omit --quasi-static or --nonlinear"
        )


def _nonlinear(
    model: Model, omega: float, *rule: Any, start: str | None, periods: int, all_multipliers: bool
) -> Orbit:
    method, steps, rtol = rule
    return solve.nonlinear(model, omega, start, periods, method, steps, rtol, all_multipliers=all_multipliers)


def _with_measured(
    orbit: Orbit,
    records: Sequence["Measured"],
    record: Callable[[], dict[str, Any]],
    report: Callable[[], RenderableType],
) -> tuple[Callable[[], dict[str, Any]], Callable[[], RenderableType], Callable[[], Figure]]:
    """Return the functions `record`, `report` and `figure` of an orbit, with measured values added. Raises
    ValueOutOfBoundsError."""
    from solve.studies.measured import compared_at_speed
    from solve.views.fit import compared_figure, differences_table

    channels = compared_at_speed(orbit, records)
    title = f"{titled(orbit.system, orbit.speed)}: computed and measured"
    return (
        lambda: {**record(), "measured": [channel.record for channel in channels]},
        lambda: stacked(report(), differences_table(channels, orbit.system.labels.speed_unit)),
        lambda: compared_figure(orbit.system, channels, title),
    )


def floquet(problem: Loop, speed: Speed, accuracy: PointAccuracy, proving: Proving, results: Results) -> None:
    """Floquet multipliers, exponents and the stability verdict."""
    model = problem.loaded()
    proving.require_provable(model)
    result = accuracy.solved(solve.floquet, model, speed.omega(model))
    deliver_result(results, result, problem.choices, proof=proving.proof(result))


def compare(
    problem: Loop,
    speed: Speed,
    settings: Settings,
    results: Results,
    method: Annotated[
        list[str] | None, Flag("Method to compare; repeatable; all by default.", "NAME")
    ] = None,
    steps: Annotated[
        list[int] | None,
        Flag("Number of steps per period, the same for all methods; repeatable.", "N"),
    ] = None,
    rtol: Annotated[
        list[float] | None,
        Flag(
            "Target error of the orbit (of the multipliers without a load); repeatable; 1e-3 and 1e-6 by "
            "default.",
            "R",
        ),
    ] = None,
) -> None:
    """Comparison of methods: error, steps and time."""
    model = problem.loaded()
    omega, methods = speed.omega(model), _methods(method, settings.settings)
    result = solve.compare(model, omega, methods, steps, rtol or TARGETS)
    if all(row.reason for row in result.rows):
        raise NoResultError(f"no method has a result; {result.rows[0].method}: {result.rows[0].reason}")
    deliver_result(results, result, problem.choices)


def _methods(names: Sequence[str] | None, settings: Mapping[str, float | None]) -> list[Rule]:
    """Return the methods, each with the settings that it supports. Raises UnknownNameError, and
    ValueOutOfBoundsError for a setting that no method supports."""
    selected = list(dict.fromkeys(names or [name for name in METHODS if name != "auto"]))
    allowed = {name: settings_of(name) for name in selected if name in METHODS}
    for setting, value in settings.items():
        if value is not None and not any(setting in fields for fields in allowed.values()):
            chosen(selected[0], **{setting: value})
    return [
        chosen(name, **{key: value for key, value in settings.items() if key in allowed.get(name, ())})
        for name in selected
    ]


def transient(
    problem: Loop,
    speed: Speed,
    results: Results,
    turns: Annotated[int, Flag("Number of periods.", "N")] = 40,
    start: Annotated[
        str,
        Flag("Initial state: rest, the orbit, or the end of a saved transient (.npz).", "FILE|rest|orbit"),
    ] = "rest",
    nonlinear: Annotated[bool, Flag("Integrate the nonlinear equations of motion.")] = False,
    rtol: Annotated[
        float,
        Flag(
            "Relative distance from the orbit within which the orbit counts as reached; also the tolerance "
            "of the integration.",
            "R",
        ),
    ] = 1e-3,
    show: Annotated[list[str] | None, Flag("Coordinate or output to draw; repeatable.", "NAME")] = None,
    speeds: Annotated[
        str | None,
        Flag("Run-up or run-down, linear in time, instead of one speed; one end may be 0.", '"A:B unit"'),
    ] = None,
) -> None:
    """Transient from initial conditions to the periodic orbit at constant speed; run-up or run-down."""
    model = problem.loaded()
    shown(model, show)
    require_with("--plot FILE", results.plot is not None, {"--show": show})
    if speeds is not None and speed.speed is not None:
        raise ValueOutOfBoundsError("--speed gives a constant speed and --speeds a run-up; give one of them")
    omega = speed.omega(model) if speeds is None else None
    result = solve.transient(model, omega, turns, start, nonlinear, rtol, speeds=speeds)
    deliver_result(results, result, problem.choices, figure=partial(result.plot, show))
