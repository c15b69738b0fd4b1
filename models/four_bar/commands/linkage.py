"""`python -m models.four_bar linkage`: the rigid linkage."""

import math
from typing import Annotated

from models.four_bar.results.linkage import rigid_motion
from solve.commands.deliver import deliver_result
from solve.commands.groups import CaseNumbers, Flag, Results
from solve.errors import ValueOutOfBoundsError
from solve.units import LARGEST, speed_in_si, with_unit


def linkage(
    numbers: CaseNumbers,
    results: Results,
    speed: Annotated[str | None, Flag("Crank speed with unit, for forces and torque.", '"300 rpm"')] = None,
    branch: Annotated[str, Flag("Branch of assembly.", "open|crossed")] = "open",
    position: Annotated[
        str | None,
        Flag("Crank angle t1 to look at, with unit; also where the crank cannot turn fully.", '"70 deg"'),
    ] = None,
    coupler_point: Annotated[
        list[str] | None,
        Flag(
            "Coupler point whose path to trace: metres from A, along AB and at +90°; repeatable; the "
            "coupler's middle by default.",
            "X,Y",
        ),
    ] = None,
    base_planes: Annotated[
        str | None, Flag("Draw Barker's base planes with the linkage in them.", "FILE")
    ] = None,
) -> None:
    """Rigid motion: class, transmission angle, mechanical advantage, coupler curves, joint forces."""
    planes = Results(plot=base_planes).files()[0]
    case = numbers.case_of("four_bar")
    of_case = case.speed if speed is None else speed
    omega = None if of_case is None else speed_in_si(of_case)
    t1 = None if position is None else with_unit(position, "rad")
    if t1 is not None and math.isinf(t1):
        raise ValueOutOfBoundsError(f"--position is '{position}'; allowed: finite angles, such as '70 deg'")
    points = [_point(text) for text in coupler_point or ()]
    found = rigid_motion(case.name, case.parameters, branch, omega, t1, points)
    beside = {} if planes is None else {planes: found.base_planes}
    deliver_result(results, found, (), beside=beside)


def _point(text: str) -> complex:
    """A coupler point X + iY from "X,Y"."""
    try:
        x, y = (float(part) for part in text.split(","))
    except ValueError:
        x = y = math.nan
    if not abs(x) + abs(y) <= LARGEST:
        raise ValueOutOfBoundsError(
            f"--coupler-point is '{text}'; write two numbers X,Y in metres, "
            "such as --coupler-point 0.164,0.05"
        )
    return complex(x, y)
