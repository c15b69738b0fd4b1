"""Figures and tables versus speed or a parameter: sweeps of one or several systems, unstable bands, and
validity."""

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from solve.arguments import described, unique_names
from solve.arrays import Array
from solve.errors import ValueOutOfBoundsError
from solve.labels import SPEED, known_quantities, unit_of
from solve.results.bands import Bands
from solve.results.contents import MOST_SHOWN, Column, digits, sized, speeds_of
from solve.results.formatting import fixed, greek, headed, named, prefixed
from solve.results.sweep import Sweep
from solve.results.sweeps import Sweeps, Validity
from solve.system import PeriodicSystem
from solve.views.panels import (
    MOST_CURVES,
    axis_label,
    distinct_labels,
    draw_map,
    draw_through,
    label_quantity,
    label_radius,
    legend_above,
    omission,
    panels_over,
    shades,
    title_of,
)
from solve.views.show import figure, tables, waterfall
from solve.views.style import BLUE, GREEN, GREY, PURPLE, VERMILION, Axes, Figure, page
from solve.views.tables import MOST_ROWS, WIDEST, RenderableType, table, table_of, text

KIND_COLORS = {"+1": VERMILION, "-1": PURPLE, "complex": GREEN}
"""Colours of unstable bands and boundaries, by the way in which a multiplier leaves the unit circle."""

KIND_NAMES = {"+1": "ρ = +1: period T", "-1": "ρ = −1: period 2T", "complex": "complex pair"}

_FLOOR = -80.0
"""Lowest amplitude that spectra show, in dB."""

Edges = Sequence[tuple[float, float, str]]
"""Type of a sequence of unstable bands. Each band is a lower edge (rad/s), an upper edge (rad/s) and a
kind."""


def _quantities_to_draw(sweep: Sweep) -> Sequence[str]:
    """Return the names of the quantities to draw: the stored coordinates, or the outputs if no coordinate is
    stored."""
    kept = sweep.results.kept.names
    return [name for name in kept if name in sweep.system.coordinates] or kept


@figure.register(Sweep)
def sweep_figure(sweep: Sweep, names: Sequence[str] | None = None, figure: str = "max_abs") -> Figure:
    """Figure of the response and the spectral radius versus speed; see `Sweep.plot`."""
    names = known_quantities(sweep.system, _quantities_to_draw(sweep) if names is None else names)
    responses = {name: sweep.figures(name, figure) for name in names}
    radius = sweep.spectral_radius if sweep.system.labels.vibrates else None
    return response_figure(sweep.system, sweep.varied, responses, radius, figure, sweep.unstable)


@tables.register(Sweep)
def sweep_tables(sweep: Sweep, names: Sequence[str] = ()) -> Sequence[RenderableType]:
    """Table with one row per point. It contains the largest absolute values of the quantities `names`; by
    default, of the coordinates, as many as fit."""
    names = names or _quantities_to_draw(sweep)
    units = sweep.system.labels.units
    moduli = {name: sized(sweep.figures(name), units.get(name, ""), "", f"max|{name}|", 6) for name in names}
    widths = itertools.accumulate(len(column.heading) + 2 for column in moduli.values())
    fitting = max(1, sum(width <= WIDEST for width in widths))
    columns = {
        f"parameter {name}": Column(
            values, heading=headed(name, unit_of(sweep.system, name).name), text=digits(".6g")
        )
        for name, values in sweep.parameters.items()
    }
    columns[SPEED] = speeds_of(sweep.system, sweep.speeds, heading="{}", form=".7g")
    columns |= itertools.islice(moduli.items(), fitting)
    if sweep.system.labels.vibrates:
        columns["radius"] = Column(sweep.spectral_radius, heading="|ρ|", text=digits(".6g"))
        columns["verdict"] = Column([point.stability for point in sweep.points], heading="stability")
    title = f"Response versus {', '.join([*sweep.parameters, SPEED])}"
    caption = "others by --show NAME, all by --json" if fitting < len(names) else None
    return [table_of(title, columns, most=MOST_ROWS, caption=caption)]


def response_figure(
    system: PeriodicSystem,
    varied: Mapping[str, Array],
    responses: Mapping[str, Array],
    radius: Array | None,
    figure: str = "max_abs",
    bands: Edges = (),
) -> Figure:
    """Figure of a statistic of each quantity and of the spectral radius, versus the last quantity that
    varies. There is one panel per quantity.

    `varied` and `responses` map names to values (P,). `radius` (P,) are the spectral radii; None if nothing
    vibrates. There is one curve for each combination of the other parameters; if there is only one curve, its
    maxima are marked. Unstable bands are shaded, and the response within them is not drawn, because it is not
    sustained. Raises ValueOutOfBoundsError for more curves than can be distinguished.
    """
    *others, along = moving(varied)
    lines = _lines(system, varied, others, along)
    styles: list[dict[str, Any]] = shades(len(lines)) if others else [{"color": BLUE}]
    x = unit_of(system, along).from_si(varied[along])
    rows = len(responses) + (radius is not None)
    title = f"response versus {along}"
    with panels_over(system, varied[along], title, 1.4 + 1.35 * rows, rows, along) as (page, panels):
        for axes, (name, values) in zip(panels, responses.items(), strict=False):
            heights = values * label_quantity(axes, system, name, values, figure)
            for low, high, _ in bands:
                heights[(varied[along] >= low) & (varied[along] <= high)] = np.nan
            named = radius is None and axes is panels[0]
            for (label, index), style in zip(lines.items(), styles, strict=True):
                shown = label if named and label else None
                draw_through(axes, x[index], heights[index], label=shown, **style)
                if not others:
                    _mark_maxima(axes, x[index], heights[index])
            _shade(axes, system, bands)
        if radius is not None:
            for (label, index), style in zip(lines.items(), styles, strict=True):
                _draw_radius(panels[-1], x[index], radius[index], label=label or None, **style)
        _name_bands(panels[-1], system, bands)
        if others:
            page.legend(loc="outside right center")
    return page


def _lines(
    system: PeriodicSystem, varied: Mapping[str, Array], others: Sequence[str], along: str
) -> dict[str, list[int]]:
    """Return a mapping from the labels of the curves to the indices of their points. A label states the
    values of the parameters `others`. The points are in ascending order of the parameter `along`."""
    lines: dict[str, list[int]] = {}
    labels: Sequence[str] = [""] * len(varied[along])
    if others:
        labels = labelled_by(system, {name: varied[name] for name in others})
    for index in map(int, np.argsort(varied[along], kind="stable")):
        lines.setdefault(labels[index], []).append(index)
    if len(lines) > MOST_CURVES:
        raise ValueOutOfBoundsError(
            f"{len(lines)} curves to draw, one for each {' and '.join(others)}; allowed: up to "
            f"{MOST_CURVES}; give fewer values of {' or '.join(others)}"
        )
    return dict(sorted(lines.items(), key=lambda line: min(line[1])))


def _mark_maxima(axes: Axes, x: Array, heights: Array) -> None:
    """Mark values that exceed both neighbours. Values next to a gap are not marked, because the response may
    rise further in the gap."""
    inner = heights[1:-1]
    top = 1 + np.flatnonzero((inner > heights[:-2]) & (inner >= heights[2:]))
    axes.plot(x[top], heights[top], "v", color=BLUE, label="maximum" if len(top) else None)
    legend_above(axes)


def moving(varied: Mapping[str, Array]) -> list[str]:
    """Return the names of the quantities that vary. `varied` maps names to values (P,). If no quantity
    varies, the name of the last one is returned."""
    return [name for name, values in varied.items() if np.ptp(values) > 0] or [*varied][-1:]


def labelled_by(system: PeriodicSystem, values: Mapping[str, Array]) -> Sequence[str]:
    """Return the labels (P,) of points, which state the values of the speed (rad/s) or of parameters."""
    points = list(zip(*(column.tolist() for column in values.values()), strict=True))

    def words(point: tuple[float, ...], form: str) -> str:
        parts = (
            ("" if name == SPEED else f"{greek(name)} = ") + unit_of(system, name).text(value, form)
            for name, value in zip(values, point, strict=True)
        )
        return ", ".join(parts)

    return distinct_labels(points, words)


@waterfall.register(Sweep)
def waterfall_figure(sweep: Sweep, name: str) -> Figure:
    """Figure of the amplitudes of a quantity, in dB relative to the largest, versus the varied quantity and
    the order of rotation. See `Sweep.waterfall`."""
    system, varied, amplitudes = sweep.system, sweep.varied, sweep.spectrum(name)
    *others, along = moving(varied)
    if others:
        raise ValueOutOfBoundsError(
            f"{', '.join([*others, along])} vary; a spectrum is drawn versus one quantity; give a "
            "single value of every other quantity"
        )
    if amplitudes.shape[1] < 2:
        raise ValueOutOfBoundsError(
            "no harmonics above the mean are stored; repeat the sweep with harmonics, such as harmonics=60"
        )
    order = np.argsort(varied[along])
    x, label = unit_of(system, along).from_si(varied[along][order]), axis_label(system, along)
    heights = amplitudes[order, 1:].T
    rotation = 2 * math.pi / system.period
    largest = float(np.nanmax(heights, initial=0.0)) or 1.0
    factor, unit = prefixed(system.labels.units.get(name, ""), largest)
    with np.errstate(divide="ignore"):
        decibels = 20 * np.log10(heights / largest)
    with page(4.4, f"{title_of(system)}: spectra of {name} versus {along}") as drawing:
        axes = drawing.subplots()
        orders = np.arange(1, len(heights) + 1) * rotation
        seen = np.where(decibels > _FLOOR, decibels, np.nan)
        scale = f"amplitude (dB re {largest * factor:.3g} {unit})"
        draw_map(drawing, axes, x, orders, seen, scale, cmap="magma_r", vmin=_FLOOR, vmax=0.0)
        axes.set_title(system.labels.meanings.get(name, ""), loc="left", color=GREY)
        axes.set_xlabel(label)
        axes.set_ylabel("order of rotation")
    return drawing


@figure.register(Bands)
def bands_figure(bands: Bands, sweep: Sweep | None = None) -> Figure:
    """Figure of the spectral radius versus speed, with the unstable bands shaded by kind; see
    `Bands.plot`."""
    if not isinstance(sweep, Sweep | None):
        raise ValueOutOfBoundsError(
            f"sweep is {described(sweep)}; give a Sweep, such as solve.sweep(...), or omit it; "
            'plot().savefig("FILE") writes a picture'
        )
    system, edges = bands.system, [(band.low, band.high, band.kind) for band in bands]
    if sweep is None:
        ends = [end for low, high, _ in edges for end in (low, high) if end not in bands.range]
        speeds = np.append(bands.speeds, ends)
        radius = np.append(bands.spectral_radius, np.ones(len(ends)))
    else:
        speeds, radius = sweep.speeds, sweep.spectral_radius
    order = np.argsort(speeds)
    with panels_over(system, speeds, "unstable bands", 2.9, 1) as (page, (axes,)):
        _draw_radius(axes, system.labels.speed_unit.from_si(speeds[order]), radius[order], color=BLUE)
        _name_bands(axes, system, edges)
    return page


@tables.register(Bands)
def bands_tables(bands: Bands) -> Sequence[RenderableType]:
    """Table with one row per band, and a note on the width of bands that may be missed."""
    unit = bands.system.labels.speed_unit
    width = unit.text(bands.spacing, ".3g")
    how = "eigenvalues" if bands.constant_matrices else "solved"
    limit = text(f"{how} at speed intervals of up to {width}: narrower bands may be missed", "dim")
    if not bands:
        return [text(f"\nno unstable band found from {unit.span(*bands.range)}", "bold green"), limit]
    return [table_of(f"Unstable between {unit.span(*bands.range, 'and')}", bands.columns, left=2), limit]


def _draw_radius(axes: Axes, x: Array, radius: Array, **style: Any) -> None:
    positive = np.where(radius > 0, radius, np.nan)
    draw_through(axes, x, positive, True, **style)
    label_radius(axes, positive)


def _name_bands(axes: Axes, system: PeriodicSystem, bands: Edges) -> None:
    _shade(axes, system, bands)
    if bands:
        axes.legend(loc="best")


def _shade(axes: Axes, system: PeriodicSystem, bands: Edges) -> None:
    names, unit = dict(KIND_NAMES), system.labels.speed_unit
    for low, high, kind in bands:
        # Each kind appears once in the legend.
        style = {"color": KIND_COLORS[kind], "alpha": 0.3, "linewidth": 0.8, "label": names.pop(kind, None)}
        axes.axvspan(unit.from_si(low), unit.from_si(high), **style)


@figure.register(Sweeps)
def sweeps_figure(
    sweeps: Sweeps, quantities: Sequence[str] | None = None, figure: str | None = None
) -> Figure:
    """Figure with one panel per quantity and one curve per system; see `Sweeps.plot`."""
    responses = {
        name: sweeps.figures(name, figure)
        for name in unique_names(sweeps.quantities if quantities is None else quantities)
    }
    order, count = np.argsort(sweeps.speeds), len(responses)
    speeds = sweeps.system.labels.speed_unit.from_si(sweeps.speeds[order])
    with panels_over(sweeps.system, sweeps.speeds, "response versus speed", 1.1 + 1.9 * count, count) as (
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
    """Figure of the linearisation errors versus speed."""
    unit, names = validity.system.labels.speed_unit, validity.system.coordinates[:MOST_SHOWN]
    title = "error of the linear orbit"
    title += omission(len(validity.system.coordinates), MOST_SHOWN, "coordinates")
    with panels_over(validity.system, validity.speeds, title, 3.4, 1) as (page, (axes,)):
        for name, row, shade in zip(names, validity.errors.T, shades(len(names)), strict=False):
            draw_through(axes, unit.from_si(validity.speeds), 100 * row, True, label=name, **shade)
        limit = {"color": GREY, "linewidth": 0.8}
        axes.axhline(100 * validity.allowed, linestyle="--", label=f"{100 * validity.allowed:g} %", **limit)
        if validity.trusted_to is not None:
            axes.axvline(unit.from_si(validity.trusted_to), linestyle=":", label="valid up to here", **limit)
        axes.set_yscale("log")
        axes.set_ylabel("max|difference| / max|q| (%)")
        axes.legend()
    return page


@tables.register(Sweeps)
def sweeps_tables(sweeps: Sweeps) -> Sequence[RenderableType]:
    """Tables, one per quantity, of the peaks, the quiet speeds and the largest values."""
    return [_extremes_table(sweeps, name) for name in sweeps.quantities]


def _extremes_table(sweeps: Sweeps, name: str) -> RenderableType:
    values = sweeps.figures(name)
    factor, unit = prefixed(
        sweeps.system.labels.units.get(name, ""), float(np.nanmax(np.abs(values), initial=0.0))
    )
    speed_unit = sweeps.system.labels.speed_unit

    def numbers(responses: Sequence[float]) -> list[str]:
        return [fixed(response * factor, response * factor, 4) for response in responses]

    extremes = sweeps.extremes(name)
    return table(
        f"{named(sweeps.figure, name)} in {unit}, for {sweeps.title or 'each'}",
        *(speed_unit.name, "", *sweeps.sweeps),
        left=2,
        rows=[
            *(
                [f"{speed_unit.from_si(speed):.2f}", kind, *numbers(responses)]
                for speed, kind, responses in extremes
            ),
            ["largest", "", *numbers(np.nanmax(values, axis=1).tolist())],
        ],
        caption="peaks and quiet speeds of the first system, among the given speeds",
    )


@tables.register(Validity)
def validity_tables(validity: Validity) -> Sequence[RenderableType]:
    """Table with one row per speed."""
    return [
        table_of("Linearisation error, %", validity.columns, most=MOST_ROWS),
        text("\n" + validity.limit),
    ]
