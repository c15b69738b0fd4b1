"""Sensitivities at one speed: elasticities as bars and tables."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from solve.labels import SPEED
from solve.results.sensitivities import MOST_ROWS, Sensitivities, number
from solve.views.panels import title_of, titled
from solve.views.show import figure, tables
from solve.views.style import BLUE, VERMILION, Figure, page
from solve.views.tables import RenderableType, table

_MOST_BARS = 12


@figure.register(Sensitivities)
def sensitivities_figure(found: Sensitivities) -> Figure:
    """Elasticities of every quantity as bars, the largest uppermost; imaginary parts beside real ones."""
    count = len(found.found)
    ranked = {quantity: found.ranked(quantity)[:_MOST_BARS] for quantity in found.found}
    heights = [0.6 + 0.22 * max(1, len(names)) for names in ranked.values()]
    name = title_of(found.system) if found.speed is None else titled(found.system, found.speed)
    title = f"{name}: what matters most"
    with page(0.6 + sum(heights), title) as figure:
        panels = figure.subplots(count, 1, squeeze=False, height_ratios=heights)[:, 0]
        for axes, (quantity, names) in zip(panels, ranked.items(), strict=True):
            sizes: Any = np.array([found.elasticities(quantity)[name] for name in names])
            places = np.arange(len(names))
            if np.iscomplexobj(sizes):
                axes.barh(places - 0.2, sizes.real, 0.4, color=BLUE, label="real part")
                axes.barh(places + 0.2, sizes.imag, 0.4, color=VERMILION, label="imaginary part")
                axes.legend()
            else:
                axes.barh(places, sizes, 0.6, color=np.where(sizes < 0, VERMILION, BLUE))
            axes.set_yticks(places, names)
            axes.invert_yaxis()
            axes.axvline(0.0, color="black", linewidth=0.7)
            axes.set_title(quantity, loc="left")
        panels[-1].set_xlabel("elasticity: relative change by relative change of the parameter")
    return figure


@tables.register(Sensitivities)
def sensitivities_tables(found: Sensitivities) -> Sequence[RenderableType]:
    """For each quantity what matters most, a row a parameter."""
    return [_table(found, quantity) for quantity in found.found]


def _table(result: Sensitivities, quantity: str) -> RenderableType:
    found = result.found[quantity]
    title = f"{quantity} = {number(found.value, 8)} {found.unit}".removesuffix(" 1")
    made = table(title, "by", "at", "unit", "derivative", "error", "elasticity", left=1)
    elasticities = result.elasticities(quantity)
    order = result.ranked(quantity)
    for name in order[:MOST_ROWS]:
        at = list(result.by).index(name)
        cells = (
            number(found.derivatives[at], 7),
            f"{found.errors[at]:.0e}" if math.isfinite(found.errors[at]) else "–",
            number(elasticities[name], 4),
        )
        made.add_row(name, f"{result.by[name]:.6g}", _unit_of(result, name), *cells)
    if len(order) > MOST_ROWS:
        made.caption = f"and {len(order) - MOST_ROWS} that matter less"
    return made


def _unit_of(result: Sensitivities, name: str) -> str:
    return "rad/s" if name == SPEED else result.system.unit_of(name).name
