"""`solve bands`: the speeds at which the motion is unstable."""

import math
from typing import TYPE_CHECKING, Annotated, Any

import typer

from solve.commands.groups import Problem, Results, Settings
from solve.commands.speeds import Speeds, progressing

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import RenderableType

    from solve.loading import Model
    from solve.results.contents import Contents
    from solve.studies.bands import Band, Bands

_MEANINGS = {"+1": "period T", "-1": "period 2T", "complex": "combination"}


def bands(
    problem: Problem,
    speeds: Speeds,
    settings: Settings,
    results: Results,
    method: Annotated[str, typer.Option(metavar="NAME", help="Method; auto chooses.")] = "auto",
    rtol: Annotated[float, typer.Option(metavar="R", help="Relative error of multipliers to reach.")] = 1e-8,
) -> None:
    """Unstable bands between the lowest and the highest speed, their edges refined.

    Speeds are added as the model needs them; narrow bands are looked for between them.
    """
    results.files()
    omegas = speeds.omegas()
    model, _ = problem.loaded()

    import solve
    from solve.commands.deliver import deliver
    from solve.methods.choice import chosen

    with progressing("points") as progress:
        found = solve.bands(model, omegas, chosen(method, **vars(settings)), rtol, progress=progress)

    def figure() -> Any:
        from solve.results.sweep_plot import radius_figure

        over = solve.sweep(model, omegas, chosen(method, **vars(settings)), rtol=rtol)
        edges = [(band.low, band.high, band.kind) for band in found]
        return radius_figure(model, over.speeds, over.spectral_radius, edges)

    deliver(
        results,
        [*found.notes, *model.doubts(max(omegas))],
        record=lambda: _record(model, omegas, found),
        report=lambda: _report(model, omegas, found, problem.choices),
        figure=figure,
        contents=lambda: _contents(model, found),
    )


def _record(model: "Model", omegas: "Sequence[float]", found: "Bands") -> dict[str, Any]:
    from solve.results.record import model_record, plain

    rows = [
        {
            "from": band.low,
            "to": band.high,
            "kind": band.kind,
            "spectral_radius": band.spectral_radius,
            "open_low": band.open_low,
            "open_high": band.open_high,
        }
        for band in found
    ]
    within = {"range": [min(omegas), max(omegas)], "spacing": found.spacing, "notes": found.notes}
    within["warnings"] = model.doubts(max(omegas))
    return plain({**model_record(model), **within, "bands": rows})


def _report(
    model: "Model", omegas: "Sequence[float]", found: "Bands", choices: "Sequence[str]"
) -> "RenderableType":
    from rich.console import Group
    from rich.text import Text

    from solve.results.report import model_heading, table

    low, high = (speed * 30 / math.pi for speed in (min(omegas), max(omegas)))
    head = model_heading(model, choices)
    width = f"{found.spacing * 30 / math.pi:.3g} rpm"
    limit = Text(f"solved at speeds up to {width} apart: narrower bands may be missed", "dim")
    if not found:
        verdict = f"\nno unstable band found from {low:.6g} to {high:.6g} rpm"
        return Group(head, Text(verdict, "bold green"), limit)
    title = f"Unstable between {low:.6g} and {high:.6g} rpm"
    made = table(title, "kind", "", "from (rpm)", "to (rpm)", "width (rpm)", "largest |ρ|", left=2)
    for band in found:
        edges = (
            ("< " if open_ else "") + f"{speed * 30 / math.pi:.3f}"
            for speed, open_ in ((band.low, band.open_low), (band.high, band.open_high))
        )
        width = f"{(band.high - band.low) * 30 / math.pi:.3g}"
        made.add_row(band.kind, _MEANINGS[band.kind], *edges, width, f"{band.spectral_radius:.6g}")
    return Group(head, made, limit)


def _contents(model: "Model", found: "Sequence[Band]") -> "Contents":
    from solve.results.contents import table_contents
    from solve.results.record import model_record

    columns = {
        "from": ([band.low for band in found], "rad/s", "lower edge"),
        "to": ([band.high for band in found], "rad/s", "upper edge"),
        "kind": ([band.kind for band in found], "", "multiplier that leaves the unit circle"),
        "spectral_radius": ([band.spectral_radius for band in found], "1", "largest in the band"),
    }
    return table_contents(columns, model_record(model))
