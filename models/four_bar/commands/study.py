"""`python -m models.four_bar study`: response over speed for several values of a parameter or option."""

import math
from typing import TYPE_CHECKING, Annotated, Any

from models.four_bar.commands.groups import FourBar
from solve.commands.groups import Flag, Places, Results, Speeds
from solve.commands.parse import figure_kept
from solve.errors import MissingValueError, ValueOutOfBoundsError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import RenderableType

    from solve import Sweeps
    from solve.beams.structure import StructureModel
    from solve.results.contents import Contents
    from solve.system import PeriodicSystem

_MOST_CURVES = 12
_RPM = 30 / math.pi
_USAGE = "write --over NAME=A,B,C or NAME=A:B:N, such as --over L4=0.547,0.6,0.65"


def study(
    four_bar: FourBar,
    speeds: Speeds,
    places: Places,
    results: Results,
    over: Annotated[
        str | None, Flag("Parameter (SI units) or option with its values, or NAME=A:B:N.", "NAME=A,B,C")
    ] = None,
    of: Annotated[
        list[str] | None,
        Flag(
            "Coordinate or output, or PLACE_stress on either surface; repeatable; by default "
            "follower_midpoint_stress.",
            "NAME",
        ),
    ] = None,
    figure: Annotated[str, Flag("What of its modulus over a turn to keep.", "max|rms")] = "max",
    corrected: Annotated[bool, Flag("Add one element a link corrected by dynamic stiffness.")] = False,
    rtol: Annotated[float, Flag("Relative error of each solution.", "R")] = 1e-6,
) -> None:
    """Stress, deflection or energy over speed for several lengths, dampings, numbers of elements, …"""
    results.files()
    omegas = speeds.omegas()
    kept = figure_kept(figure)
    model = four_bar.loaded()
    title, systems = _systems(model, over, corrected)

    import solve
    from solve.commands.deliver import deliver
    from solve.results.plot import shown

    names = list(dict.fromkeys(of or ["follower_midpoint_stress"]))
    shown(model, [model.parts(name)[0] for name in names])
    with places.given() as given:
        compared = solve.sweeps(systems, omegas, names, title, rtol=rtol, **given)
    if all(each.results.failed.all() for each in compared.sweeps.values()):
        next(iter(compared.sweeps.values())).results.require_any()
    deliver(
        results,
        _warnings(compared),
        record=lambda: _record(model, compared, names, kept),
        report=lambda: _report(model, compared, names, kept, four_bar.choices),
        figure=lambda: compared.plot(names, kept),
        contents=lambda: _contents(model, compared, names, kept),
    )


def _systems(
    model: "StructureModel", over: str | None, corrected: bool
) -> tuple[str, "dict[str, PeriodicSystem]"]:
    """What varies, and the systems by its value. Raises SolveError subclasses."""
    from models.four_bar.dynamic_correction import Corrected
    from solve import variants

    systems: dict[str, PeriodicSystem] = {}
    title = ""
    if over is not None:
        name, values = _values(over)
        systems.update(variants(model, name, values))
        unit, _ = model.parameter_labels.get(name, ("", ""))
        title = f"{name} ({unit})" if unit not in ("", "1") else name
    elif corrected:
        systems["as given"] = model
    else:
        raise MissingValueError(f"nothing varies; {_USAGE}")
    if corrected:
        one = model.varied(options={"elements": 1})
        systems["corrected"] = Corrected(one)
    if len(systems) > _MOST_CURVES:
        raise ValueOutOfBoundsError(
            f"{len(systems)} curves over speed; allowed: up to {_MOST_CURVES} in one picture"
        )
    return title, systems


def _values(over: str) -> tuple[str, "Sequence[float | str]"]:
    """A name and its values, from NAME=A,B,C or NAME=A:B:N; options may be words."""
    from solve.commands.parse import assignments, points

    ((name, text),) = assignments("--over", [over], "NAME=A,B,C").items()
    if ":" in text:
        return points("--over", over)
    values = [each.strip() for each in text.split(",")]
    if not all(values):
        raise ValueOutOfBoundsError(f"--over is '{over}'; {_USAGE}")
    return name, values


def _warnings(compared: "Sweeps") -> list[str]:
    """What is doubtful or has no result, by the system."""
    return [f"{label}: {text}" for label, each in compared.sweeps.items() for text in each.warnings]


def _record(
    model: "StructureModel", compared: "Sweeps", names: "Sequence[str]", figure: str
) -> dict[str, Any]:

    from solve.results.contents import model_record, plain

    values = {name: compared.figures(name, figure) for name in names}
    return plain(
        {
            **model_record(model),
            "over": compared.title,
            "figure": figure,
            "speeds": compared.speeds,
            "systems": [
                {
                    "value": label,
                    "responses": {name: values[name][at] for name in names},
                    "spectral_radius": each.spectral_radius,
                }
                for at, (label, each) in enumerate(compared.sweeps.items())
            ],
            "extremes": {name: [one._asdict() for one in compared.extremes(name, figure)] for name in names},
        }
    )


def _report(
    model: "StructureModel",
    compared: "Sweeps",
    names: "Sequence[str]",
    figure: str,
    choices: "Sequence[str]",
) -> "RenderableType":
    import numpy as np
    from rich.console import Group

    from solve.results.quantities import fixed, prefixed
    from solve.results.report import model_heading, table

    head, parts = model_heading(model, choices), []
    low, high = (f"{speed * _RPM:.6g}" for speed in (compared.speeds.min(), compared.speeds.max()))
    head.add_row("over", f"{len(compared.speeds)} speeds from {low} to {high} rpm")
    for name in names:
        values = compared.figures(name, figure)
        factor, unit = prefixed(model.units.get(name, ""), float(np.nanmax(np.abs(values), initial=0.0)))
        shown = f"max|{name}|" if figure == "max_abs" else f"{figure} {name}"
        made = table(
            f"{shown} in {unit}, for {compared.title or 'each'}", "rpm", "", *compared.sweeps, left=2
        )
        for speed, kind, responses in compared.extremes(name, figure):
            cells = (fixed(each * factor, each * factor, 4) for each in responses)
            made.add_row(f"{speed * _RPM:.2f}", kind, *cells)
        made.add_row("largest", "", *(fixed(each, each, 4) for each in np.nanmax(values, axis=1) * factor))
        made.caption = "peaks and quiet speeds of the first, among the speeds given"
        parts.append(made)
    return Group(head, *parts)


def _contents(model: "StructureModel", compared: "Sweeps", names: "Sequence[str]", figure: str) -> "Contents":
    from solve.results.contents import model_record, table_contents

    columns: dict[str, tuple[Any, str, str]] = {"speed": (compared.speeds, "rad/s", "speed of rotation")}
    values = {name: compared.figures(name, figure) for name in names}
    for at, label in enumerate(compared.sweeps):
        for name in names:
            meaning = f"{figure} of {name}, {compared.title} {label}"
            columns[f"{name} {label}"] = (values[name][at], model.units.get(name, ""), meaning)
    return table_contents(columns, model_record(model))
