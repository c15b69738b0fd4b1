"""`python -m models.four_bar linkage`: the rigid linkage."""

import json
import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from solve.commands.groups import CaseNumbers, Flag, Results
from solve.errors import ValueOutOfBoundsError
from solve.units import LARGEST

if TYPE_CHECKING:
    from models.four_bar.linkage import Linkage


def linkage(
    numbers: CaseNumbers,
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
    plot: Annotated[
        str | None, Flag("Draw positions, coupler curves and the turn: .png, .pdf or .svg.", "FILE")
    ] = None,
    base_planes: Annotated[
        str | None, Flag("Draw Barker's base planes with the linkage in them.", "FILE")
    ] = None,
    json_: Annotated[bool, Flag("Print one JSON object instead of tables.")] = False,
) -> None:
    """Rigid motion: class, transmission angle, mechanical advantage, coupler curves, joint forces."""
    from models.four_bar.linkage import Linkage
    from models.four_bar.rigid.record import linkage_record
    from solve.units import speed_in_si, with_unit

    files = [Results(plot=file).files()[0] for file in (plot, base_planes)]
    case = numbers.case_of("four_bar")
    links = Linkage(*(case.parameters[name] for name in ("L1", "L2", "L3", "L4")), branch=branch)
    of_case = case.speed if speed is None else speed
    omega = None if of_case is None else speed_in_si(of_case)
    t1 = None if position is None else with_unit(position, "rad")
    if t1 is not None and math.isinf(t1):
        raise ValueOutOfBoundsError(f"--position is '{position}'; allowed: finite angles, such as '70 deg'")
    points = [_point(text) for text in coupler_point or ()] or [complex(links.L2 / 2)]
    record = linkage_record(case.name, case.parameters, links, omega, t1, points)
    _draw(files, links, case.parameters, omega, points, t1)
    _deliver(record, json_, [file for file in files if file])


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


def _draw(
    files: Sequence[Path | None],
    linkage: "Linkage",
    parameters: Mapping[str, float],
    speed: float | None,
    points: Sequence[complex],
    position: float | None,
) -> None:
    positions, planes = files
    if not (positions or planes):
        return
    from models.four_bar.rigid.base_planes import base_planes_figure
    from models.four_bar.rigid.draw import linkage_figure
    from models.four_bar.rigid.forces import bodies
    from solve.results.save import Whole
    from solve.results.style import drawn

    with Whole() as written:
        if positions:
            figure = linkage_figure(linkage, bodies(parameters), speed, points, position)
            written.write(positions, drawn(figure, positions))
        if planes:
            written.write(planes, drawn(base_planes_figure(linkage), planes))


def _deliver(record: Mapping[str, Any], as_json: bool, written: Sequence[Path]) -> None:
    from rich.console import Console

    from models.four_bar.rigid.report import linkage_report
    from solve.results.contents import plain

    if as_json:
        print(json.dumps(plain(record), ensure_ascii=False, allow_nan=False), flush=True)
    else:
        Console(highlight=False).print(linkage_report(record))
    for line in [
        *(f"warning: {text}" for text in record["warnings"]),
        *(f"wrote {file}" for file in written),
    ]:
        print(line, file=sys.stderr)
