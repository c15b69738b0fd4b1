"""Figures and tables of fits, with measured and computed values, and of sensitivities."""

import math
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from solve import labels
from solve.arrays import Array
from solve.errors import counted
from solve.labels import SPEED, unit_of
from solve.period.signals import spectrum
from solve.results.fit import Channel, Fitted
from solve.results.formatting import prefixed
from solve.results.sensitivities import MOST_ROWS, Sensitivities, SensitivitiesOver, number
from solve.system import PeriodicSystem
from solve.units import ShownUnit
from solve.views.orbit import FLOOR
from solve.views.panels import (
    MOST_DRAWN,
    labelled,
    legend_above,
    omission,
    panels_over,
    shades,
    title_of,
    titled,
)
from solve.views.show import figure, tables
from solve.views.style import BLUE, VERMILION, Axes, Figure, page
from solve.views.tables import RenderableType, Table, table, text

_SAME, _EVEN = 1e-6, 1e-3
"""Relative difference up to which two phases count as equal, and relative difference up to which two
distances between phases count as equal. Chosen by judgement, below the precision of measured data."""

_CLOSE = 0.9
"""Correlation above which a pair of parameters is listed. Chosen by judgement."""


@figure.register(Fitted)
def fit_figure(fitted: Fitted) -> Figure:
    """Figure of measured points and computed curves, with one panel per channel and speed, and at most 8
    panels."""
    title = f"{title_of(fitted.system)}: fitted to {fitted.data}"
    return compared_figure(fitted.system, fitted.channels, title)


@tables.register(Fitted)
def fit_tables(fitted: Fitted) -> Sequence[RenderableType]:
    """Tables of the parameters with their correlations, and of the differences between computed and measured
    values."""
    names, unit_of = list(fitted.parameters), partial(labels.unit_of, fitted.system)
    correlated = [
        f"{names[i]} and {names[j]} {fitted.correlations[i, j]:+.3f}"
        for i in range(len(names))
        for j in range(i)
        if abs(fitted.correlations[i, j]) >= _CLOSE
    ]
    parameters = table(
        "Fitted, with 95 % intervals",
        *("parameter", "unit", "value", "low", "high"),
        left=2,
        rows=[
            (name, unit_of(name).name, *(f"{x:.6g}" if math.isfinite(x) else "–" for x in interval))
            for name, interval in fitted.parameters.items()
        ],
        caption=f"correlated: {', '.join(correlated)}" if correlated else None,
    )
    residual = text(f"\nresidual {100 * fitted.residual:.3g} % of the measured values")
    return [parameters, differences_table(fitted.channels, fitted.system.labels.speed_unit), residual]


def differences_table(channels: Sequence[Channel], unit: ShownUnit) -> Table:
    """Table of relative differences between computed and measured values, one row per channel."""
    rows = [
        (channel.name, channel.where(unit), str(len(channel.at)), f"{100 * channel.relative:.3g}")
        for channel in channels
    ]
    headings = "quantity", "where", "values", "difference, %"
    return table("Computed against measured", *headings, left=2, rows=rows)


def compared_figure(system: PeriodicSystem, channels: Sequence[Channel], title: str) -> Figure:
    """Figure of measured points and computed curves, with one panel per channel and speed, and at most 8
    panels. Curves that are measured at equidistant phases have a spectrum too."""
    shown = channels[:MOST_DRAWN]
    title += omission(len(channels), MOST_DRAWN, "curves")
    with page(0.7 + 1.9 * len(shown), title) as figure:
        rows = figure.subplots(len(shown), 2, squeeze=False, width_ratios=(2, 1))
        for (axes, spectra), channel in zip(rows, shown, strict=True):
            factor, unit = _draw(axes, system, channel)
            measured = _evenly(system, channel)
            if measured is None:
                spectra.set_axis_off()
                continue
            most = min(60, (len(measured) - 1) // 2)
            found, computed = (
                spectrum(factor * values[measured], most)[0][1:]
                for values in (channel.measured, channel.computed)
            )
            for amplitudes, mark, color in ((found, "o", VERMILION), (computed, "x", BLUE)):
                spectra.plot(np.arange(1, most + 1), amplitudes, mark, markersize=3, color=color)
            spectra.set_yscale("log")
            # Computed harmonics decay to round-off, far below measured amplitudes.
            spectra.set_ylim(bottom=max(found.min() / 10, FLOOR * found.max()) or None)
            spectra.set_xlabel("order of rotation")
            spectra.set_ylabel(labelled("amplitude", unit))
        legend_above(rows[0, 0])
    return figure


def _draw(axes: Axes, system: PeriodicSystem, each: Channel) -> tuple[float, str]:
    """Draw the measured and the computed values of a channel. Return the conversion factor from SI units, and
    the displayed unit."""
    measured, computed = (
        np.abs(values) if np.iscomplexobj(values) else values for values in (each.measured, each.computed)
    )
    unit = "rad/s" if each.position is not None else system.labels.units.get(each.name, "")
    factor, unit = prefixed(unit, float(np.abs(measured).max()))
    order = np.argsort(each.at, kind="stable")
    across = np.degrees(each.at[order]) if each.by_phase else each.at[order]
    line: dict[str, Any] = {"linewidth": 1.2} if each.by_phase else {"marker": "x", "linestyle": ""}
    axes.plot(across, factor * measured[order], "o", markersize=3, color=VERMILION, label="measured")
    axes.plot(across, factor * computed[order], color=BLUE, label="computed", **line)
    axes.set_ylabel(labelled(each.name, unit))
    axes.set_title(each.where(system.labels.speed_unit), loc="left")
    axes.set_xlabel(each.axis)
    return factor, unit


def _evenly(system: PeriodicSystem, each: Channel) -> Array | None:
    """Return the indices of values at equidistant phases over one period, in ascending order of phase; None
    if the phases are not equidistant."""
    phases = np.mod(each.at, system.period)
    order = np.argsort(phases, kind="stable")
    # The end of a period coincides with its beginning.
    order = order[np.append(np.diff(phases[order]) > _SAME * system.period, True)]
    gaps = np.diff(np.append(phases[order], phases[order[:1]] + system.period))
    even = len(order) > 4 and np.ptp(gaps) <= _EVEN * gaps.mean()
    return order if even and each.by_phase else None


@figure.register(Sensitivities)
def sensitivities_figure(result: Sensitivities) -> Figure:
    """Figure of the elasticities of every quantity as bars, the largest at the top. Complex quantities have
    bars for the real and the imaginary part."""
    ranked = {quantity: result.ranked(quantity)[:MOST_ROWS] for quantity in result.found}
    heights = [0.6 + 0.22 * max(1, len(names)) for names in ranked.values()]
    name = title_of(result.system) if result.speed is None else titled(result.system, result.speed)
    with page(0.6 + sum(heights), f"{name}: elasticities") as figure:
        panels = figure.subplots(len(ranked), 1, squeeze=False, height_ratios=heights)[:, 0]
        for axes, (quantity, names) in zip(panels, ranked.items(), strict=True):
            elasticities = result.elasticities(quantity)
            sizes: Any = np.array([elasticities[name] for name in names])
            rows = np.arange(len(names))
            if np.iscomplexobj(sizes):
                axes.barh(rows - 0.2, sizes.real, 0.4, color=BLUE, label="real part")
                axes.barh(rows + 0.2, sizes.imag, 0.4, color=VERMILION, label="imaginary part")
                axes.legend()
            else:
                axes.barh(rows, sizes, 0.6, color=np.where(sizes < 0, VERMILION, BLUE))
            axes.set_yticks(rows, names)
            axes.invert_yaxis()
            axes.axvline(0.0, color="black", linewidth=0.7)
            axes.set_title(quantity, loc="left")
        panels[-1].set_xlabel("elasticity: relative change per relative change of the parameter")
    return figure


@tables.register(Sensitivities)
def sensitivities_tables(result: Sensitivities) -> Sequence[RenderableType]:
    """Tables, one per quantity, with one row per parameter, the largest elasticity first."""
    return [_table(result, quantity) for quantity in result.found]


def _table(result: Sensitivities, quantity: str) -> RenderableType:
    found, elasticities = result.found[quantity], result.elasticities(quantity)
    ranked, names = result.ranked(quantity), list(result.by)
    rows = []
    for name in ranked[:MOST_ROWS]:
        place, unit = names.index(name), "rad/s" if name == SPEED else unit_of(result.system, name).name
        error = f"{found.errors[place]:.0e}" if math.isfinite(found.errors[place]) else "–"
        derivative, elasticity = number(found.derivatives[place], 7), number(elasticities[name], 4)
        rows.append((name, f"{result.by[name]:.6g}", unit, derivative, error, elasticity))
    return table(
        f"{quantity} = {number(found.value, 8)} {found.unit}".removesuffix(" 1"),
        *("by", "at", "unit", "derivative", "error", "elasticity"),
        rows=rows,
        caption=f"and {counted(len(ranked) - MOST_ROWS, 'less influential parameter')}"
        if len(ranked) > MOST_ROWS
        else None,
    )


@figure.register(SensitivitiesOver)
def sensitivities_over_figure(result: SensitivitiesOver) -> Figure:
    """Figure of the largest elasticities versus speed, with one panel per quantity. For complex quantities,
    the moduli are drawn."""
    count, speeds = len(result.quantities), result.system.labels.speed_unit.from_si(result.speeds)
    with panels_over(result.system, result.speeds, "elasticities", 0.7 + 2.2 * count, count, align=False) as (
        page,
        panels,
    ):
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
    """Tables of the largest elasticities, one table per quantity, with one row per speed."""
    return [_over_table(result, place) for place in range(len(result.quantities))]


def _over_table(result: SensitivitiesOver, place: int) -> RenderableType:
    unit, quantity, ranked = result.system.labels.speed_unit, result.quantities[place], result.ranked(place)
    values, elasticities = result.values[:, place], result.elasticities[:, place][:, ranked]
    return table(
        f"Elasticities of {quantity}",
        *(unit.name, quantity, *(result.by[k] for k in ranked)),
        left=0,
        rows=[
            (f"{unit.from_si(speed):.6g}", _size(value), *map(_size, row))
            for speed, value, row in zip(result.speeds, values, elasticities, strict=True)
        ],
    )


def _size(value: Any) -> str:
    """Format a real value, or the modulus of a complex value."""
    size = abs(value) if value.imag else value.real
    return f"{size:.4g}" if math.isfinite(size) else "–"
