"""Pictures over speed or a parameter: response, spectral radius and unstable bands."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from solve.arrays import Array
from solve.errors import ValueOutOfBoundsError
from solve.labels import SPEED
from solve.results.plot import (
    axis_label,
    draw_map,
    draw_through,
    label_quantity,
    label_speeds,
    shades,
    title_of,
    told_apart,
)
from solve.results.quantities import greek, prefixed
from solve.results.style import BLACK, BLUE, GREEN, GREY, PURPLE, VERMILION, Axes, Figure, page
from solve.system import PeriodicSystem

KIND_COLORS = {"+1": VERMILION, "-1": PURPLE, "complex": GREEN}
"""Of unstable bands and boundaries by the multiplier that leaves the unit circle."""

KIND_NAMES = {"+1": "ρ = +1: period T", "-1": "ρ = −1: period 2T", "complex": "complex pair"}

_ALIKE = 1e-6
"""Distance from 1 below which spectral radii are drawn as a line at 1, since the rest is round-off."""

_FLOOR = -80.0
"""Decibels at and below which a spectrum shows nothing."""

MOST_LINES = 12

Edges = Sequence[tuple[float, float, str]]
"""Unstable bands: from, to (rad/s), kind."""


def sweep_figure(
    system: PeriodicSystem,
    varied: Mapping[str, Array],
    responses: Mapping[str, Array],
    radius: Array | None,
    figure: str = "max_abs",
    bands: Edges = (),
) -> Figure:
    """One row per quantity: its statistic over the last varying parameter, values (P,) by name, with a line
    for each combination of the others; a single line has its maxima marked. The spectral radius is below, if
    there is vibration. Unstable bands are shaded, and the response is not drawn there because it is never
    reached. Raises ValueOutOfBoundsError for more lines than can be distinguished."""
    *others, along = moving(varied)
    lines = _lines(system, varied, others, along)
    styles: list[dict[str, Any]] = shades(len(lines)) if others else [{"color": BLUE}]
    x = system.unit_of(along).of(varied[along])
    rows = len(responses) + (radius is not None)
    with page(1.4 + 1.35 * rows, f"{title_of(system)}: response over {along}") as made:
        axes = made.subplots(rows, 1, sharex=True, squeeze=False)[:, 0]
        for place, (name, values) in zip(axes, responses.items(), strict=False):
            heights = values * label_quantity(place, system, name, values, figure)
            for low, high, _ in bands:
                heights[(varied[along] >= low) & (varied[along] <= high)] = np.nan
            named = radius is None and place is axes[0]
            for (words, index), style in zip(lines.items(), styles, strict=True):
                draw_through(
                    place, x[index], heights[index], label=words if named and words else None, **style
                )
                if not others:
                    _mark_maxima(place, x[index], heights[index])
            _shade(place, system, bands)
        if radius is not None:
            for (words, index), style in zip(lines.items(), styles, strict=True):
                _draw_radius(axes[-1], x[index], radius[index], label=words or None, **style)
        label_speeds(axes[-1], system, np.sort(varied[along]), along)
        _name_bands(axes[-1], system, bands)
        if others:
            made.legend(loc="outside right center")
        made.align_ylabels(axes)
    return made


def _lines(
    system: PeriodicSystem, varied: Mapping[str, Array], others: Sequence[str], along: str
) -> dict[str, list[int]]:
    """Places of the points of each line, rising along it, by what the others are on it."""
    lines: dict[str, list[int]] = {}
    labels: Sequence[str] = [""] * len(varied[along])
    if others:
        labels = labelled_by(system, {name: varied[name] for name in others})
    for at in map(int, np.argsort(varied[along], kind="stable")):
        lines.setdefault(labels[at], []).append(at)
    if len(lines) > MOST_LINES:
        raise ValueOutOfBoundsError(
            f"{len(lines)} lines to draw, one for each {' and '.join(others)}; allowed: up to {MOST_LINES}"
        )
    return dict(sorted(lines.items(), key=lambda line: min(line[1])))


def _mark_maxima(axes: Axes, x: Array, heights: Array) -> None:
    """Those that lie between two lower neighbours: beside a gap the response may rise on."""
    inner = heights[1:-1]
    top = 1 + np.flatnonzero((inner > heights[:-2]) & (inner >= heights[2:]))
    axes.plot(x[top], heights[top], "v", color=BLUE, label="maximum" if len(top) else None)
    if len(top):
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.1)


def moving(varied: Mapping[str, Array]) -> list[str]:
    """Those of the quantities, values (P,) by name, that vary, the last of them if none does."""
    return [name for name, values in varied.items() if np.ptp(values) > 0] or [*varied][-1:]


def labelled_by(system: PeriodicSystem, values: Mapping[str, Array]) -> Sequence[str]:
    """Points (P,) in words, by their values of the speed (rad/s) or of parameters by name."""
    points = list(zip(*(each.tolist() for each in values.values()), strict=True))

    def words(point: tuple[float, ...], form: str) -> str:
        parts = (
            ("" if name == SPEED else f"{greek(name)} = ") + system.unit_of(name).text(value, form)
            for name, value in zip(values, point, strict=True)
        )
        return ", ".join(parts)

    return told_apart(points, words)


def waterfall_figure(
    system: PeriodicSystem, varied: Mapping[str, Array], name: str, amplitudes: Array
) -> Figure:
    """Amplitudes (P, orders + 1) of a quantity over what varies, values (P,) by name, and order of rotation,
    0 dB the largest. Raises ValueOutOfBoundsError where several quantities vary."""
    *others, along = moving(varied)
    if others:
        raise ValueOutOfBoundsError(
            f"{', '.join([*others, along])} vary; a spectrum is drawn over one of them: give one value "
            "of the others"
        )
    if amplitudes.shape[1] < 2:
        raise ValueOutOfBoundsError("no harmonics above the mean were kept; ask the sweep for some")
    order = np.argsort(varied[along])
    x, label = system.unit_of(along).of(varied[along][order]), axis_label(system, along)
    heights = amplitudes[order, 1:].T
    rotation = 2 * math.pi / system.period
    largest = float(np.nanmax(heights, initial=0.0)) or 1.0
    factor, unit = prefixed(system.units.get(name, ""), largest)
    with np.errstate(divide="ignore"):
        decibels = 20 * np.log10(heights / largest)
    with page(4.4, f"{title_of(system)}: spectrum of {name} over {along}") as made:
        axes = made.subplots()
        orders = np.arange(1, len(heights) + 1) * rotation
        seen = np.where(decibels > _FLOOR, decibels, np.nan)
        scale = f"amplitude (dB re {largest * factor:.3g} {unit})"
        draw_map(made, axes, x, orders, seen, scale, cmap="magma_r", vmin=_FLOOR, vmax=0.0)
        axes.set_title(system.meanings.get(name, ""), loc="left", color=GREY)
        axes.set_xlabel(label)
        axes.set_ylabel("order of rotation")
    return made


def radius_figure(system: PeriodicSystem, speeds: Array, radius: Array, bands: Edges) -> Figure:
    """The spectral radius over speed with the unstable bands shaded by their kind."""
    order = np.argsort(speeds)
    with page(2.9, f"{title_of(system)}: unstable bands") as made:
        axes = made.subplots()
        _draw_radius(axes, system.speed_unit.of(speeds[order]), radius[order], color=BLUE)
        label_speeds(axes, system, speeds[order])
        _name_bands(axes, system, bands)
    return made


def _draw_radius(axes: Axes, x: Array, radius: Array, **style: Any) -> None:
    axes.axhline(1.0, color=BLACK, linewidth=0.9)
    positive = np.where(radius > 0, radius, np.nan)
    draw_through(axes, x, positive, True, **style)
    if np.nanmin(positive, initial=1.0) <= 0.1 or np.nanmax(positive, initial=1.0) >= 10:
        axes.set_yscale("log")
    elif np.nanmax(np.abs(positive - 1), initial=0.0) < _ALIKE:
        # Round-off is not resolved by the scale.
        axes.set_ylim(0.99, 1.01)
    axes.set_ylabel("spectral\nradius |ρ|")


def _name_bands(axes: Axes, system: PeriodicSystem, bands: Edges) -> None:
    _shade(axes, system, bands)
    if bands:
        axes.legend(loc="best")


def _shade(axes: Axes, system: PeriodicSystem, bands: Edges) -> None:
    names, unit = dict(KIND_NAMES), system.speed_unit
    for low, high, kind in bands:
        # Each kind once in the legend.
        style = {"color": KIND_COLORS[kind], "alpha": 0.3, "linewidth": 0.8, "label": names.pop(kind, None)}
        axes.axvspan(unit.of(low), unit.of(high), **style)
