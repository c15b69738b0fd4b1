"""Figures and tables over speed: sweeps of several systems and the linearisation error."""

from collections.abc import Sequence

import numpy as np

from solve.arguments import unique_names
from solve.results.contents import MOST_SHOWN
from solve.results.formatting import fixed, named, prefixed
from solve.results.sweeps import Sweeps
from solve.results.validity import Validity
from solve.views.panels import draw_through, label_quantity, panels_over, shades
from solve.views.show import figure, tables
from solve.views.style import GREY, Figure
from solve.views.tables import RenderableType, table, table_of, text


@figure.register(Sweeps)
def sweeps_figure(
    sweeps: Sweeps, quantities: Sequence[str] | None = None, figure: str | None = None
) -> Figure:
    """Figure with a panel per quantity with a curve per system; see `Sweeps.plot`."""
    responses = {name: sweeps.figures(name, figure) for name in unique_names(quantities or sweeps.quantities)}
    order, count = np.argsort(sweeps.speeds), len(responses)
    speeds = sweeps.system.speed_unit.of(sweeps.speeds[order])
    with panels_over(sweeps.system, sweeps.speeds, "response over speed", 1.1 + 1.9 * count, count) as (
        page,
        panels,
    ):
        for axes, (name, values) in zip(panels, responses.items(), strict=True):
            factor = label_quantity(axes, sweeps.system, name, values, figure or sweeps.figure)
            for label, row, shade in zip(sweeps.sweeps, values, shades(len(sweeps.sweeps)), strict=True):
                draw_through(axes, speeds, row[order] * factor, label=label, **shade)
            if np.nanmin(values, initial=0.0) >= 0:
                axes.set_ylim(bottom=0.0)
        handles, names = panels[0].get_legend_handles_labels()
        page.legend(handles, names, title=sweeps.title, loc="outside right center", handlelength=2.4)
    return page


@figure.register(Validity)
def validity_figure(validity: Validity) -> Figure:
    """Figure of the linearisation errors over speed."""
    unit, names = validity.system.speed_unit, validity.system.coordinates[:MOST_SHOWN]
    with panels_over(validity.system, validity.speeds, "error of the linear orbit", 3.4, 1) as (
        page,
        (axes,),
    ):
        for name, row, shade in zip(names, validity.errors.T, shades(len(names)), strict=False):
            draw_through(axes, unit.of(validity.speeds), 100 * row, True, label=name, **shade)
        limit = {"color": GREY, "linewidth": 0.8}
        axes.axhline(100 * validity.allowed, linestyle="--", label=f"{100 * validity.allowed:g} %", **limit)
        if validity.trusted_to is not None:
            axes.axvline(unit.of(validity.trusted_to), linestyle=":", label="trusted to here", **limit)
        axes.set_yscale("log")
        axes.set_ylabel("max|difference| / max|q| (%)")
        axes.legend()
    return page


@tables.register(Sweeps)
def sweeps_tables(sweeps: Sweeps) -> Sequence[RenderableType]:
    """Table per quantity with its peaks, quiet speeds and largest values."""
    return [_extremes_table(sweeps, name) for name in sweeps.quantities]


def _extremes_table(sweeps: Sweeps, name: str) -> RenderableType:
    values = sweeps.figures(name)
    factor, unit = prefixed(sweeps.system.units.get(name, ""), float(np.nanmax(np.abs(values), initial=0.0)))
    speed_unit = sweeps.system.speed_unit

    def numbers(responses: Sequence[float]) -> list[str]:
        return [fixed(response * factor, response * factor, 4) for response in responses]

    extremes = sweeps.extremes(name)
    return table(
        f"{named(sweeps.figure, name)} in {unit}, for {sweeps.title or 'each'}",
        *(speed_unit.name, "", *sweeps.sweeps),
        left=2,
        rows=[
            *(
                [f"{speed_unit.of(speed):.2f}", kind, *numbers(responses)]
                for speed, kind, responses in extremes
            ),
            ["largest", "", *numbers(np.nanmax(values, axis=1).tolist())],
        ],
        caption="peaks and quiet speeds are those of the first curve, among the given speeds",
    )


@tables.register(Validity)
def validity_tables(validity: Validity) -> Sequence[RenderableType]:
    """Columns of the table, with one row per speed."""
    return [table_of("Linearisation error, %", validity.columns), text("\n" + validity.limit)]
