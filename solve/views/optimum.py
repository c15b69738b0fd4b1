"""Figures and tables that compare an optimum with the initial design: curves over the period, values versus
speed, and free parameters within their bounds."""

from collections.abc import Sequence
from functools import partial

import numpy as np

from solve import labels
from solve.results.formatting import measured
from solve.results.optimum import Curves, Optimum
from solve.views.panels import (
    draw_through,
    label_phases,
    label_quantity,
    label_speeds,
    labelled,
    legend_above,
    titled,
)
from solve.views.show import figure, tables
from solve.views.style import BLUE, GREY, VERMILION, Axes, Figure, page
from solve.views.tables import MOST_ROWS, RenderableType, table, table_of, text

_MOST_PARAMETERS = 24
"""Maximum number of parameters in the picture: as many as fit."""


@figure.register(Optimum)
def optimum_figure(optimum: Optimum) -> Figure:
    """Figure that compares the initial design and the optimum: curves at the worst speed, values versus
    speed, and parameters within their bounds."""
    names = list(optimum.parameters)[:_MOST_PARAMETERS]
    heights = [0.5 + 0.18 * len(names)]
    heights += [2.0] if len(optimum.speeds) > 1 else []
    heights += [2.2] if optimum.curves else []
    worst = optimum.speeds[int(np.argmax(optimum.values))]
    title = f"{titled(optimum.system, worst)}: least {optimum.minimised}"
    with page(0.6 + sum(heights), title) as drawing:
        panels = list(drawing.subplots(len(heights), 1, squeeze=False, height_ratios=heights[::-1])[:, 0])
        if optimum.curves:
            _draw_curves(panels.pop(0), optimum, optimum.curves)
        if len(optimum.speeds) > 1:
            _draw_over_speed(panels.pop(0), optimum)
        _draw_parameters(panels.pop(0), optimum, names)
    return drawing


def _draw_curves(axes: Axes, optimum: Optimum, curves: Curves) -> None:
    """Draw a coordinate or output over the period at the worst speed, for the initial design and the
    optimum."""
    name = optimum.minimised.partition(".")[0]
    factor = label_quantity(axes, optimum.system, name, np.append(curves.before, curves.after))
    phase = np.degrees(curves.phase)
    axes.plot(phase, factor * curves.before, color=GREY, label="before")
    axes.plot(phase, factor * curves.after, color=BLUE, label="optimum")
    label_phases(axes, float(curves.phase[-1]))
    legend_above(axes)


def _draw_over_speed(axes: Axes, optimum: Optimum) -> None:
    speeds = optimum.system.labels.speed_unit.from_si(optimum.speeds)
    for values, colour in ((optimum.values_before, GREY), (optimum.values, BLUE)):
        draw_through(axes, speeds, values, color=colour)
    axes.set_ylabel(labelled(optimum.minimised, optimum.unit if optimum.unit != "1" else ""))
    label_speeds(axes, optimum.system, optimum.speeds)


def _draw_parameters(axes: Axes, optimum: Optimum, names: Sequence[str]) -> None:
    """Draw the positions of the parameters between their bounds, for the initial design and the optimum."""
    rows = np.arange(len(names))
    shown = [optimum.parameters[name] for name in names]
    before, after = (
        np.array([(getattr(each, field) - each.low) / (each.high - each.low) for each in shown])
        for field in ("before", "value")
    )
    axes.hlines(rows, before, after, color=VERMILION, linewidth=1.0)
    axes.plot(before, rows, "o", color=GREY)
    axes.plot(after, rows, "o", color=BLUE)
    axes.set_yticks(rows, names)
    axes.set_xticks([0.0, 0.5, 1.0], ["lower bound", "middle", "upper bound"])
    axes.set_xlim(-0.03, 1.03)
    axes.invert_yaxis()
    axes.set_title("free parameters", loc="left", color=GREY)


@tables.register(Optimum)
def optimum_tables(optimum: Optimum) -> Sequence[RenderableType]:
    """Tables of the objective, the parameters, the requirements, and the values versus speed."""
    unit_of = partial(labels.unit_of, optimum.system)
    parameters = table(
        "Free parameters",
        *("parameter", "unit", "before", "optimum", "low", "high", "at bound"),
        left=2,
        rows=[
            (name, unit_of(name).name, *(f"{number:.6g}" for number in each), each.at_bound or "–")
            for name, each in optimum.parameters.items()
        ],
    )
    requirements = table(
        "Requirements, worst at any of the speeds",
        *("quantity", "value", "bound"),
        rows=[(each.name, f"{each.value:.6g}", f"{each.bound:.9g}") for each in optimum.constraints],
    )
    shown = [text(f"\n{optimum.summary}{_confirmation(optimum)}", "bold"), parameters, requirements]
    if len(optimum.speeds) > 1:
        shown.append(table_of(f"{optimum.minimised} versus speed", optimum.columns, most=MOST_ROWS))
    return shown


def _confirmation(optimum: Optimum) -> str:
    """Return a sentence on the nonlinear orbits; empty if they were not computed."""
    if "objective" not in optimum.confirmed:
        return ""
    verdicts = ", ".join(dict.fromkeys(optimum.confirmed["verdicts"]))
    return f" Nonlinear orbits: {measured(optimum.confirmed['objective'], optimum.unit)}, {verdicts}."
