"""Sensitivities at one speed, as bars and tables of elasticities, and over speed."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from solve.labels import SPEED
from solve.results.sensitivities import MOST_ROWS, Sensitivities, SensitivitiesOver, number
from solve.views.panels import panels_over, shades, title_of, titled
from solve.views.show import figure, tables
from solve.views.style import BLUE, VERMILION, Figure, page
from solve.views.tables import RenderableType, table

_MOST_BARS = 12


@figure.register(Sensitivities)
def sensitivities_figure(result: Sensitivities) -> Figure:
    """Figure of the elasticities of every quantity as bars, the largest at the top; for complex quantities,
    real and imaginary parts."""
    ranked = {quantity: result.ranked(quantity)[:_MOST_BARS] for quantity in result.found}
    heights = [0.6 + 0.22 * max(1, len(names)) for names in ranked.values()]
    name = title_of(result.system) if result.speed is None else titled(result.system, result.speed)
    with page(0.6 + sum(heights), f"{name}: most influential parameters") as figure:
        panels = figure.subplots(len(ranked), 1, squeeze=False, height_ratios=heights)[:, 0]
        for axes, (quantity, names) in zip(panels, ranked.items(), strict=True):
            elasticities = result.elasticities(quantity)
            sizes: Any = np.array([elasticities[name] for name in names])
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
        panels[-1].set_xlabel(
            "elasticity: relative change of the quantity per relative change of the parameter"
        )
    return figure


@tables.register(Sensitivities)
def sensitivities_tables(result: Sensitivities) -> Sequence[RenderableType]:
    """Table per quantity with a row per parameter, the largest elasticity first."""
    return [_table(result, quantity) for quantity in result.found]


def _table(result: Sensitivities, quantity: str) -> RenderableType:
    sensitivity, elasticities = result.found[quantity], result.elasticities(quantity)
    ranked, names = result.ranked(quantity), list(result.by)
    rows = []
    for name in ranked[:MOST_ROWS]:
        place, unit = names.index(name), "rad/s" if name == SPEED else result.system.unit_of(name).name
        error = f"{sensitivity.errors[place]:.0e}" if math.isfinite(sensitivity.errors[place]) else "–"
        derivative, elasticity = number(sensitivity.derivatives[place], 7), number(elasticities[name], 4)
        rows.append((name, f"{result.by[name]:.6g}", unit, derivative, error, elasticity))
    return table(
        f"{quantity} = {number(sensitivity.value, 8)} {sensitivity.unit}".removesuffix(" 1"),
        *("by", "at", "unit", "derivative", "error", "elasticity"),
        rows=rows,
        caption=f"and {len(ranked) - MOST_ROWS} less influential parameters"
        if len(ranked) > MOST_ROWS
        else None,
    )


@figure.register(SensitivitiesOver)
def sensitivities_over_figure(result: SensitivitiesOver) -> Figure:
    """Figure with a panel per quantity of the largest elasticities over speed; for complex quantities,
    moduli."""
    count, speeds = len(result.quantities), result.system.speed_unit.of(result.speeds)
    with panels_over(
        result.system, result.speeds, "what matters most", 0.7 + 2.2 * count, count, align=False
    ) as (page, panels):
        for place, (axes, quantity) in enumerate(zip(panels, result.quantities, strict=True)):
            ranked = result.ranked(place)
            for k, shade in zip(ranked, shades(len(ranked)), strict=True):
                elasticities = result.elasticities[:, place, k]
                sizes = np.abs(elasticities) if np.any(np.imag(elasticities)) else np.real(elasticities)
                axes.plot(speeds, sizes, marker=".", label=result.by[k], **shade)
            axes.axhline(0.0, color="black", linewidth=0.7)
            axes.set_title(quantity, loc="left")
            axes.set_ylabel("elasticity")
            axes.legend(ncols=3, fontsize="small")
    return page


@tables.register(SensitivitiesOver)
def sensitivities_over_tables(result: SensitivitiesOver) -> Sequence[RenderableType]:
    """Table per quantity with the largest elasticities, a row per speed."""
    return [_over_table(result, place) for place in range(len(result.quantities))]


def _over_table(result: SensitivitiesOver, place: int) -> RenderableType:
    unit, quantity, ranked = result.system.speed_unit, result.quantities[place], result.ranked(place)
    values, elasticities = result.values[:, place], result.elasticities[:, place][:, ranked]
    return table(
        f"Elasticities of {quantity}",
        *(unit.name, quantity, *(result.by[k] for k in ranked)),
        left=0,
        rows=[
            (f"{unit.of(speed):.6g}", _size(value), *map(_size, row))
            for speed, value, row in zip(result.speeds, values, elasticities, strict=True)
        ],
    )


def _size(value: Any) -> str:
    """Text of a value, or of the modulus of a complex one."""
    size = abs(value) if value.imag else value.real
    return f"{size:.4g}" if math.isfinite(size) else "–"
