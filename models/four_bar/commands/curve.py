"""`python -m models.four_bar curve`: a coupler curve beside its rigid one (thesis Figs. 8.3, 8.4)."""

from typing import Annotated

from models.four_bar.commands.groups import FourBar
from models.four_bar.results.curve import curve_of_point
from solve.commands.deliver import deliver_result
from solve.commands.groups import Flag, Results


def curve(
    four_bar: FourBar,
    results: Results,
    speed: Annotated[str, Flag("Speed with unit: rpm, rad/s or Hz.", '"30 rad/s"')] = "30 rad/s",
    along: Annotated[float, Flag("Place on the coupler, 0 at A to 1 at B.", "S")] = 0.5,
    across: Annotated[float, Flag("Distance beside its axis, in m.", "M")] = 0.0,
    quasi_static: Annotated[bool, Flag("The kinetostatic curve instead of the full one.")] = False,
    rtol: Annotated[float, Flag("Relative error of the solution.", "R")] = 1e-6,
) -> None:
    """The curve of a point of the coupler beside that of the rigid linkage."""
    found = curve_of_point(four_bar.loaded(), speed, along, across, quasi_static, rtol)
    deliver_result(results, found, four_bar.choices)
