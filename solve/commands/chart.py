"""`solve chart`: stability over two quantities."""

import math
from typing import TYPE_CHECKING, Annotated, Any

import typer

from solve.commands.groups import Problem, Results, Settings, Speed
from solve.commands.parse import assignments, number, points
from solve.commands.speeds import progressing
from solve.errors import MissingValueError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import RenderableType

    from solve.results.contents import Contents
    from solve.studies.chart import Chart, Cut

_RANGE = 'NAME=A:B:N|"speed=A:B:N rpm"'
_MOST_CURVES = 20


def chart(
    problem: Problem,
    speed: Speed,
    settings: Settings,
    results: Results,
    x: Annotated[str | None, typer.Option(metavar=_RANGE, help="N values from A to B, across.")] = None,
    y: Annotated[str | None, typer.Option(metavar=_RANGE, help="N values from A to B, upwards.")] = None,
    cut: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=NUMBER", help="Also along the line where x or y is this; repeatable."),
    ] = None,
    method: Annotated[str, typer.Option(metavar="NAME", help="Method; auto chooses.")] = "auto",
    rtol: Annotated[
        float, typer.Option(metavar="R", parser=number, help="Relative error of multipliers to reach.")
    ] = 1e-8,
    tolerance: Annotated[
        float,
        typer.Option(metavar="R", parser=number, help="Accuracy of boundaries, as part of the ranges."),
    ] = 1e-9,
) -> None:
    """Stability over two quantities, with named boundaries."""
    results.files()
    across, upwards = _axis("--x", x), _axis("--y", y)
    lines = [_held(text) for text in cut or []]
    model, of_case = problem.loaded()

    import solve
    from solve.commands.deliver import deliver
    from solve.methods.choice import chosen

    omega = None if "speed" in {*across, *upwards} else speed.omega(model, of_case)
    with progressing("points") as progress:
        found = solve.chart(
            model,
            across,
            upwards,
            omega,
            method=chosen(method, **vars(settings)),
            rtol=rtol,
            tolerance=tolerance,
            progress=progress,
        )
        cuts = [found.cut_at(name, value) for name, value in lines]
    deliver(
        results,
        [*found.notes, *_failures(found)],
        record=lambda: _record(found, cuts),
        report=lambda: _report(found, cuts, problem.choices),
        figure=found.plot,
        contents=lambda: _contents(found),
    )


def _axis(flag: str, text: str | None) -> dict[str, list[float]]:
    """{name: values in SI units}. Raises MissingValueError, ValueOutOfBoundsError, UnitError."""
    from solve.units import speeds_in_si

    if text is None:
        raise MissingValueError(
            f"no {flag} given; add {flag} NAME=A:B:N, N values of a parameter from A to B"
        )
    name, _, values = text.partition("=")
    if name.strip() == "speed":
        return {"speed": speeds_in_si(values)}
    return dict([points(flag, text)])


def _held(text: str) -> tuple[str, float]:
    """Name and value in SI units from NAME=NUMBER, or "speed=NUMBER unit"."""
    from solve.commands.parse import numbers
    from solve.units import speed_in_si

    ((name, value),) = assignments("--cut", [text], "NAME=NUMBER").items()
    if name == "speed":
        return name, speed_in_si(value)
    return name, numbers("--cut", [text])[name]


def _failures(found: "Chart") -> list[str]:
    if not found.failures:
        return []
    reason = next(iter(found.failures.values()))
    total = found.spectral_radius.size
    return [
        f"{len(found.failures)} of {total} points give no result, and boundaries end beside them: {reason}"
    ]


def _record(found: "Chart", cuts: "Sequence[Cut]") -> dict[str, Any]:
    from solve.results.record import model_record, plain

    return plain(
        {
            **model_record(found.system),
            "x": {"name": found.x_name, "values": found.x},
            "y": {"name": found.y_name, "values": found.y},
            "spectral_radius": found.spectral_radius,
            "verdicts": found.verdicts,
            "kinds": found.kinds,
            "error_estimate": found.error_estimate,
            "boundaries": _boundaries(found),
            "cuts": [
                {
                    "along": cut.along,
                    "values": cut.values,
                    "at": {cut.across: cut.value},
                    "spectral_radius": cut.spectral_radius,
                    "stable": [None if math.isnan(one) else bool(one) for one in cut.stable],
                    "crossings": [{"at": at, "kind": kind} for at, kind in cut.crossings],
                }
                for cut in cuts
            ],
            "failures": [{"row": j, "column": i, "error": text} for (j, i), text in found.failures.items()],
        }
    )


def _report(found: "Chart", cuts: "Sequence[Cut]", choices: "Sequence[str]") -> "RenderableType":
    import numpy as np
    from rich.console import Group
    from rich.text import Text

    from solve.results.report import model_heading, table

    radius, share = found.spectral_radius, 100 * np.nanmean(found.stable)
    head = model_heading(found.system, choices)
    head.add_row("over", f"{_range(found.x_name, found.x)}, {_range(found.y_name, found.y)}")
    head.add_row("stable", f"{share:.4g} % of {radius.size} points; largest |ρ| {np.nanmax(radius):.6g}")
    parts: list[RenderableType] = [head]
    curves = sorted(found.boundaries, key=lambda curve: -len(curve.points))
    made = table(
        "Boundaries between stable and unstable", "kind", "points", found.x_name, found.y_name, left=1
    )
    for curve in curves[:_MOST_CURVES]:
        spans = (_span(name, curve.points[:, k]) for k, name in enumerate((found.x_name, found.y_name)))
        made.add_row(curve.name, str(len(curve.points)), *spans)
    if len(curves) > _MOST_CURVES:
        made.caption = f"and {len(curves) - _MOST_CURVES} shorter ones"
    parts.append(made if curves else Text("\nno boundary in this range"))
    for cut in cuts:
        where = f"Along {cut.along} at {_span(cut.across, np.array([cut.value]))}"
        if not cut.crossings:
            parts.append(Text(f"\n{where}: no boundary"))
            continue
        made = table(where, "at", "kind", left=0)
        for at, kind in cut.crossings:
            made.add_row(_span(cut.along, np.array([at]), 9), kind)
        parts.append(made)
    return Group(*parts)


def _range(name: str, values: Any) -> str:
    return f"{name} {_span(name, values)} ({len(values)})"


def _span(name: str, values: Any, digits: int = 6) -> str:
    factor, unit = (30 / math.pi, " rpm") if name == "speed" else (1.0, "")
    low, high = (f"{value * factor:.{digits}g}" for value in (values.min(), values.max()))
    return f"{low}{unit}" if low == high else f"{low} … {high}{unit}"


def _contents(found: "Chart") -> "Contents":
    import numpy as np

    from solve.results.contents import table_contents
    from solve.results.record import model_record

    xs, ys = (part.ravel() for part in np.meshgrid(found.x, found.y))
    columns: dict[str, tuple[Any, str, str]] = {
        found.x_name: (xs, "", "across"),
        found.y_name: (ys, "", "upwards"),
        "spectral_radius": (found.spectral_radius.ravel(), "1", "largest modulus of a Floquet multiplier"),
        "verdict": (found.verdicts.ravel(), "", "stability"),
        "kind": (found.kinds.ravel(), "", "largest multiplier of unstable points"),
        "error": (
            [found.failures.get(at, "") for at in np.ndindex(found.shape)],
            "",
            "why there is no result",
        ),
    }
    return table_contents(columns, {**model_record(found.system), "boundaries": _boundaries(found)})


def _boundaries(found: "Chart") -> list[dict[str, Any]]:
    return [
        {"kind": curve.name, "x": curve.points[:, 0].tolist(), "y": curve.points[:, 1].tolist()}
        for curve in found.boundaries
    ]
