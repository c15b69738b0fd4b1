"""`python -m models.four_bar corrected`: one element a link, corrected, beside others (thesis Fig. 7.9)."""

from typing import Annotated

from models.four_bar.commands.groups import FourBar
from models.four_bar.results.corrected import corrections
from solve.commands.deliver import deliver_result
from solve.commands.groups import Flag, Results
from solve.errors import ValueOutOfBoundsError
from solve.units import speed_in_si


def corrected(
    four_bar: FourBar,
    results: Results,
    speed: Annotated[str, Flag("Speed with unit: rpm, rad/s or Hz.", '"30 rad/s"')] = "30 rad/s",
    of: Annotated[
        str, Flag("Coordinate or output to compare, or PLACE_stress on either surface.", "NAME")
    ] = "follower_midpoint_stress",
    elements: Annotated[str, Flag("Numbers of cubic elements a link to set beside it.", "A,B,C")] = "1,2,3,4",
    rtol: Annotated[float, Flag("Relative error of each solution.", "R")] = 1e-6,
) -> None:
    """One element a link corrected by dynamic stiffness, beside more elements, over one turn."""
    model = four_bar.loaded()
    counts = [each.strip() for each in elements.split(",")]
    if not all(each.isdigit() for each in counts):
        raise ValueOutOfBoundsError(
            f"--elements is '{elements}'; write numbers of elements a link, such as --elements 1,2,3"
        )
    found = corrections(model, speed_in_si(speed), of, counts, rtol)
    deliver_result(results, found, four_bar.choices)
