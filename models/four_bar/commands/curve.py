"""`python -m models.four_bar curve`: a coupler curve beside its rigid one (thesis Figs. 8.3, 8.4)."""

import math
from typing import TYPE_CHECKING, Annotated, Any

from models.four_bar.commands.groups import FourBar
from solve.commands.groups import Flag, Results

if TYPE_CHECKING:
    from rich.console import RenderableType

    from models.four_bar.coupler_curve import CouplerCurve
    from solve.results.contents import Contents
    from solve.results.orbit import Orbit

_SAMPLES = 721


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
    results.files()
    model = four_bar.loaded()

    import numpy as np

    import solve
    from models.four_bar.coupler_curve import coupler_curve, curve_figure
    from solve.commands.deliver import deliver

    orbit = solve.periodic(model, speed, rtol=rtol)
    turn = orbit.quasi_static if quasi_static else orbit
    paths = coupler_curve(model, turn, along, across, np.linspace(0.0, model.period, _SAMPLES))
    title = f"Coupler curve at {orbit.speed:.6g} rad/s" + (", quasi-static" if quasi_static else "")
    deliver(
        results,
        orbit.warnings,
        record=lambda: _record(orbit, paths, along, across),
        report=lambda: _report(orbit, paths, four_bar.choices),
        figure=lambda: curve_figure(title, paths),
        contents=lambda: _contents(orbit, paths),
    )


def _columns(paths: "CouplerCurve") -> "dict[str, tuple[Any, str, str]]":
    import numpy as np

    columns: dict[str, tuple[Any, str, str]] = {"phase": (paths.phase, "rad", "phase of the drive")}
    for name, places in (("rigid", paths.rigid), ("flexible", paths.elastic)):
        columns[f"{name}_x"] = (np.real(places), "m", f"x of the point of the {name} linkage")
        columns[f"{name}_y"] = (np.imag(places), "m", f"y of the point of the {name} linkage")
    return columns


def _record(orbit: "Orbit", paths: "CouplerCurve", along: float, across: float) -> dict[str, Any]:

    distance = abs(paths.deviation)
    from solve.results.contents import model_record, plain

    return plain(
        {
            **model_record(orbit.system),
            "speed": orbit.speed,
            "along": along,
            "across": across,
            "max_deviation": distance.max(),
            "at": paths.phase[distance.argmax()],
            "rms_deviation": (distance[:-1] ** 2).mean() ** 0.5,
            "error_estimate": orbit.error_estimate._asdict(),
            "curve": {name: values for name, (values, *_) in _columns(paths).items()},
        }
    )


def _report(orbit: "Orbit", paths: "CouplerCurve", choices: "list[str]") -> "RenderableType":
    import numpy as np
    from rich.console import Group

    from solve.results.quantities import fixed, prefixed
    from solve.results.report import heading, table

    parts = {"distance": abs(paths.deviation)}
    parts |= {"along x": np.real(paths.deviation), "along y": np.imag(paths.deviation)}
    largest = parts["distance"].max()
    factor, unit = prefixed("m", largest)
    made = table("Deviation from the rigid curve", "", f"max|…| ({unit})", "at", f"rms ({unit})")
    for name, values in parts.items():
        at = np.abs(values).argmax()
        made.add_row(
            name,
            fixed(abs(values[at]) * factor, largest * factor, 5),
            f"{math.degrees(paths.phase[at]):.1f}°",
            fixed(float(np.sqrt((values[:-1] ** 2).mean())) * factor, largest * factor, 5),
        )
    return Group(heading(orbit.system, orbit.speed, choices), made)


def _contents(orbit: "Orbit", paths: "CouplerCurve") -> "Contents":
    from solve.results.contents import model_record, table_contents

    return table_contents(_columns(paths), {**model_record(orbit.system), "speed": orbit.speed})
