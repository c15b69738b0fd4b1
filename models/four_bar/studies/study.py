"""Response versus speed for several values of a parameter or option."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated

import solve
from models.four_bar.dynamic_correction import Corrected
from models.four_bar.studies.shared import EachTolerance, FourBar
from solve.beams.structure import StructureModel
from solve.commands.deliver import deliver_result
from solve.commands.groups import Execution, Flag, Results, Speeds
from solve.commands.parse import assignments, points, statistic_name
from solve.errors import MissingValueError, ValueOutOfBoundsError
from solve.labels import parts_of, unit_of
from solve.results.formatting import headed
from solve.system import PeriodicSystem, shown_in
from solve.units import apart, is_number
from solve.views.panels import MOST_CURVES, shown

_USAGE = "write --over NAME=A,B,C or NAME=A:B:N, such as --over L4=0.547,0.6,0.65"


def study(
    four_bar: FourBar,
    speeds: Speeds,
    execution: Execution,
    results: Results,
    over: Annotated[
        str | None,
        Flag(
            "Parameter or option with its values; or NAME=A:B:N, N values from A to B; unit optional.",
            '"NAME=A,B,C unit"',
        ),
    ] = None,
    of: Annotated[
        list[str] | None,
        Flag(
            "Coordinate or output, or PLACE_stress on either surface; repeatable; by default "
            "follower_midpoint_stress.",
            "NAME",
        ),
    ] = None,
    figure: Annotated[str, Flag("Statistic of the modulus over a revolution.", "max|rms")] = "max",
    corrected: Annotated[
        bool, Flag("Add the model with one corrected element per link; see the command `corrected`.")
    ] = False,
    rtol: EachTolerance = 1e-6,
) -> None:
    """Stress, deflection or energy versus speed for several values of a parameter or option."""
    omegas, statistic, model = speeds.omegas(), statistic_name(figure), four_bar.loaded()
    title, systems = _systems(model, over, corrected)
    names = list(dict.fromkeys(of or ["follower_midpoint_stress"]))
    shown(model, [parts_of(model, name)[0] for name in names])
    with execution.given() as resources:
        compared = solve.sweeps(systems, omegas, names, title, rtol=rtol, **resources)
    if all(sweep.results.failed.all() for sweep in compared.sweeps.values()):
        next(iter(compared.sweeps.values())).results.require_any()
    result = replace(compared, system=shown_in(model, omegas[0]), figure=statistic)
    deliver_result(results, result, four_bar.choices)


def _systems(
    model: StructureModel, over: str | None, corrected: bool
) -> tuple[str, dict[str, PeriodicSystem]]:
    """Return a heading that names the varied quantity, and a mapping from the values of this quantity to
    systems. Raises SolveError subclasses."""
    systems: dict[str, PeriodicSystem] = {}
    title = ""
    if over is not None:
        name, values = _values(over)
        systems.update(solve.variants(model, name, values))
        title = headed(name, unit_of(model, name).name)
    elif corrected:
        systems["as given"] = model
    else:
        raise MissingValueError(f"nothing varies; {_USAGE}")
    if corrected:
        systems["corrected"] = Corrected(model.varied(options={"elements": 1}))
    if len(systems) > MOST_CURVES:
        raise ValueOutOfBoundsError(
            f"{len(systems)} curves versus speed; allowed: up to {MOST_CURVES} in one picture"
        )
    return title, systems


def _values(over: str) -> tuple[str, Sequence[float | str]]:
    """Parse a string NAME=A,B,C or NAME=A:B:N, with an optional common unit, to the name and the values.
    Values of options may be words."""
    ((name, text),) = assignments("--over", [over], "NAME=A,B,C").items()
    if ":" in text:
        return points("--over", over)
    values = [value.strip() for value in text.split(",")]
    number, _, unit = apart(values[-1]).partition(" ")
    numbers = [*values[:-1], number]
    if unit and all(map(is_number, numbers)):
        values = [f"{number} {unit}" for number in numbers]
    if not all(values):
        raise ValueOutOfBoundsError(f"--over is '{over}'; {_USAGE}")
    return name, values
