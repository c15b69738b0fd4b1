"""`solve periodic`: the periodic vibration, its spectrum and its stability."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any

from solve.commands.deliver import deliver_result
from solve.commands.groups import Flag, OnePoint, Problem, Proving, Results, Speed
from solve.commands.parse import harmonic_count
from solve.errors import ValueOutOfBoundsError, require_name
from solve.model.model import Model
from solve.results.orbit import Orbit
from solve.single import periodic as linear_orbit
from solve.views.orbit import SCALES
from solve.views.panels import shown, titled
from solve.views.show import printout
from solve.views.style import Figure
from solve.views.tables import RenderableType, stacked
from solve.views.turn import fits_figure

if TYPE_CHECKING:
    from solve.studies.measured import Measured


def periodic(
    problem: Problem,
    speed: Speed,
    accuracy: OnePoint,
    proving: Proving,
    results: Results,
    harmonics: Annotated[int | None, Flag("Orders of the spectrum; 60 by default.", "N")] = None,
    nonlinear: Annotated[bool, Flag("The orbit of the nonlinear equations, the linear one beside.")] = False,
    periods: Annotated[
        int | None, Flag("With --nonlinear: an orbit of K periods; 1 by default.", "K")
    ] = None,
    start: Annotated[
        str | None, Flag("With --nonlinear: a saved orbit or transient as the start.", "FILE")
    ] = None,
    quasi_static: Annotated[bool, Flag("The kinetostatic solution beside the full one.")] = False,
    show: Annotated[list[str] | None, Flag("Coordinate or output to draw; repeatable.", "NAME")] = None,
    data: Annotated[str | None, Flag("Measured vibration of this speed, drawn beside.", "FILE")] = None,
    fits: Annotated[bool, Flag("With --plot: the case's tables and the series fitted to them.")] = False,
    scale: Annotated[str, Flag("Scale of the spectrum in the picture.", "linear|dB")] = "linear",
) -> None:
    """Periodic vibration, its spectrum and its stability."""
    orders, model = harmonic_count(harmonics), problem.loaded(rigid=True)
    proving.require_provable(model)
    if nonlinear and proving.prove:
        raise ValueOutOfBoundsError("only linear equations can be proved; leave out --nonlinear or --prove")
    require_name("scale", scale, SCALES)
    shown(model, show)
    if fits and results.plot is None:
        raise ValueOutOfBoundsError("--fits chooses what is drawn; add --plot FILE")
    if fits and data is not None:
        raise ValueOutOfBoundsError("--fits and --data both say what is drawn; give one of them")
    records = None
    if data is not None:
        from solve.studies.measured import measured

        records = measured(data, model, speed.omega(model))
    picture = fits_figure(model) if fits else None
    if nonlinear and quasi_static:
        raise ValueOutOfBoundsError(
            "--quasi-static is of the linear orbit; leave out --quasi-static or --nonlinear"
        )
    if periods is not None and not nonlinear:
        raise ValueOutOfBoundsError(f"--periods {periods} requires --nonlinear; add it")
    if start is not None and not nonlinear:
        raise ValueOutOfBoundsError(f"--start {start} requires --nonlinear; add it")
    find = linear_orbit
    if nonlinear:
        find = partial(_nonlinear, start=start, periods=1 if periods is None else periods)
    orbit = accuracy.solved(find, model, speed.omega(model))
    proof = proving.proof(orbit)
    figure = partial(orbit.plot, show, quasi_static, scale, harmonics) if picture is None else lambda: picture
    record = partial(orbit.record, orders, quasi_static)
    report = partial(printout, orbit, problem.choices, quasi_static=quasi_static)
    if records is not None:
        record, report, figure = _with_measured(orbit, records, record, report)
    deliver_result(results, orbit, problem.choices, record=record, report=report, figure=figure, proof=proof)


def _nonlinear(
    model: Model, omega: float, *given: Any, start: str | None, periods: int, all_multipliers: bool
) -> Orbit:
    from solve.newton.orbits import nonlinear

    rule, steps, rtol = given
    return nonlinear(model, omega, start, periods, rule, steps, rtol, all_multipliers=all_multipliers)


def _with_measured(
    orbit: Orbit,
    records: Sequence["Measured"],
    record: Callable[[], dict[str, Any]],
    report: Callable[[], RenderableType],
) -> tuple[Callable[[], dict[str, Any]], Callable[[], RenderableType], Callable[[], Figure]]:
    """Record, report and figure with what was measured beside the orbit. Raises ValueOutOfBoundsError."""
    from solve.studies.measured import beside
    from solve.views.fit import compared_figure, differences_table

    channels = beside(orbit, records)
    title = f"{titled(orbit.system, orbit.speed)}: computed over measured"
    return (
        lambda: {**record(), "measured": [each.record for each in channels]},
        lambda: stacked(report(), differences_table(channels, orbit.system.speed_unit)),
        lambda: compared_figure(orbit.system, channels, title),
    )
