"""`python -m models.four_bar modes`: what each mode gives to a deflection or stress (thesis Fig. 6.4), and
what modes that do not couple would give (thesis Fig. 6.3)."""

from typing import Annotated

import typer

from models.four_bar.commands.groups import FourBar
from models.four_bar.results.modes import modes as found
from solve.commands.deliver import deliver_result
from solve.commands.groups import Flag, Results


def modes(
    four_bar: FourBar,
    results: Results,
    speed: Annotated[str, Flag("Speed with unit: rpm, rad/s or Hz.", '"35 rad/s"')] = "35 rad/s",
    of: Annotated[
        str, Flag("A deflection or stress among the outputs.", "NAME")
    ] = "follower_midpoint_deflection",
    count: Annotated[int, typer.Option(metavar="N", min=1, help="Number of modes.")] = 4,
    uncoupled: Annotated[bool, Flag("Add the solution of modes that do not couple, and its error.")] = False,
    rtol: Annotated[float, Flag("Relative error of the solution.", "R")] = 1e-6,
) -> None:
    """What the modes of each position give to a deflection or stress over one turn."""
    result = found(four_bar.loaded(), speed, of, count, uncoupled, rtol)
    deliver_result(results, result, four_bar.choices)
