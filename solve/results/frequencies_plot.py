"""Pictures of natural frequencies: mode shapes, over the turn, over a parameter."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from solve.arrays import Array
from solve.contracts import DrawnLink, ModeShape
from solve.results.plot import axis_label, title_of
from solve.results.style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    LIGHT,
    ORANGE,
    PAGE_WIDTH,
    PURPLE,
    SKY,
    VERMILION,
    Axes,
    Figure,
    page,
)
from solve.system import PeriodicSystem

_COLORS = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY)

_DEFLECTION = 0.1
"""Largest displacement drawn, as a part of the structure's size."""

_MOST_SHAPES = 8

_MARKERS: dict[str, dict[str, Any]] = {
    "pinned": {"marker": "^", "color": BLACK, "markersize": 6},
    "clamped": {"marker": "s", "color": BLACK, "markersize": 6},
    "joined": {"marker": "o", "color": BLUE, "markerfacecolor": "white", "markersize": 4.5},
}
"""Of the ends of a link."""


def shapes_figure(system: PeriodicSystem, position: float, every: Sequence[ModeShape]) -> Figure:
    """Mode shapes of a structure at one position (rad), its links at rest in grey."""
    shapes = every[:_MOST_SHAPES]
    columns = 3 if len(shapes) in (3, 5, 6) else min(len(shapes), 4)
    rows = math.ceil(len(shapes) / columns)
    low, high = _frame(shapes)
    width, height = high - low
    row = 0.3 + 0.95 * PAGE_WIDTH / columns * height / width
    where = f" at {math.degrees(position):.4g}°" if system.moves else ""
    lowest = f", the lowest {len(shapes)} of {len(every)}" if len(shapes) < len(every) else ""
    with page(0.4 + rows * row, f"{title_of(system)}: mode shapes{where}{lowest}") as made:
        axes = made.subplots(rows, columns, squeeze=False)
        for place in axes.flat:
            place.set_axis_off()
        for k, (place, shape) in enumerate(zip(axes.flat, shapes, strict=False), start=1):
            _draw_shape(place, shape, system.links)
            place.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
            hertz = shape.frequency / (2 * math.pi)
            place.set_title(f"{k}: {shape.frequency:.5g} rad/s, {hertz:.4g} Hz", pad=2)
    return made


def positions_figure(system: PeriodicSystem, positions: Array, frequencies: Array) -> Figure:
    """Frequencies (m, k) over the positions (m,) of a revolution, with dashed means; growth rates are
    negative."""
    from matplotlib.ticker import MultipleLocator

    degrees = np.degrees(np.append(positions, positions[0] + system.period))
    with page(3.6, f"{title_of(system)}: natural frequencies over the turn") as made:
        axes = made.subplots()
        for k, values in enumerate(frequencies.T):
            color = _COLORS[k % len(_COLORS)]
            label = f"mode {k + 1}"
            if not (values < 0).any():
                label += f": mean {values.mean():.6g}"
                axes.axhline(values.mean(), color=color, linewidth=0.8, linestyle=(0, (6, 4)))
            axes.plot(
                degrees, np.append(values, values[0]), color=color, marker=".", label=label, clip_on=False
            )
        axes.set_xlim(degrees[0], degrees[-1])
        axes.set_ylim(*_limits(frequencies))
        if degrees[-1] - degrees[0] > 180:
            axes.xaxis.set_major_locator(MultipleLocator(60))
        axes.set_xlabel("position of the drive (deg)")
        _label_frequencies(axes)
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=min(frequencies.shape[1], 4))
    return made


def variation_figure(
    system: PeriodicSystem,
    parameter: str,
    mode: int,
    values: Array,
    figures: Mapping[str, Array],
    pinned: Mapping[str, Array],
) -> Figure:
    """Frequency of a mode (index from 0) over a parameter (v,), with its range over the revolution, and the
    frequencies of the links alone.

    figures: mean, min and max (v,) over the positions; growth rates are negative. pinned: by link.
    """
    which = "lowest frequency" if mode == 0 else f"frequency of mode {mode + 1}, the first elastic one,"
    several = not np.array_equal(figures["min"], figures["max"], equal_nan=True)
    with page(3.8, f"{title_of(system)}: {which} over {parameter}") as made:
        axes = made.subplots()
        if several:
            axes.fill_between(values, figures["min"], figures["max"], color=BLUE, alpha=0.15, linewidth=0)
        label = "mechanism, mean and range of the turn" if several else "mechanism"
        axes.plot(values, figures["mean"], color=BLUE, marker="o", label=label)
        top = 2.2 * np.nanmax(figures["max"], initial=0.0)
        for (link, alone), color in zip(pinned.items(), (GREY, VERMILION, GREEN, *_COLORS), strict=False):
            if np.nanmin(alone, initial=math.inf) < top:
                axes.plot(values, alone, color=color, linestyle="--", label=f"{link} alone, pinned")
        axes.set_ylim(*_limits(figures["min"], top))
        axes.set_xlim(values.min(), values.max())
        axes.set_xlabel(axis_label(system, parameter))
        _label_frequencies(axes)
        axes.legend(loc="best")
    return made


def _frame(shapes: Sequence[ModeShape]) -> tuple[Array, Array]:
    """Lower left and upper right corner (x, y) around the structure and all its drawn displacements."""
    points = np.concatenate([*shapes[0].places, *(curve for shape in shapes for curve in _drawn(shape))])
    margin = 0.04 * np.linalg.norm(np.ptp(points, axis=0))
    return points.min(axis=0) - margin, points.max(axis=0) + margin


def _drawn(shape: ModeShape) -> list[Array]:
    """Where the displaced links are drawn."""
    scale = _DEFLECTION * np.ptp(np.concatenate(shape.places), axis=0).max()
    each = zip(shape.places, shape.displacements, strict=True)
    return [place + scale * displacement for place, displacement in each]


def _draw_shape(axes: Axes, shape: ModeShape, links: Sequence[DrawnLink]) -> None:
    """Pins as circles, held pins as triangles, clamped feet as squares; welded corners and ends bare."""
    for link, place, moved in zip(links, shape.places, _drawn(shape), strict=True):
        axes.plot(*place.T, color=LIGHT, linewidth=2.5, solid_capstyle="round")
        axes.plot(*moved.T, color=BLUE)
        for held, end in zip(link.ends, (0, -1), strict=True):
            if held in _MARKERS:
                axes.plot(*moved[end], zorder=3, **_MARKERS[held])


def _limits(roots: Array, top: float | None = None) -> tuple[float, float | None]:
    """Limits of the vertical axis: the lower one is 0 unless a mode grows; top: of frequencies, if known."""
    lowest = float(np.nanmin(roots, initial=0.0))
    if lowest == 0.0 and not top:
        return 0.0, 1.0 if not np.nan_to_num(roots).any() else None
    return 1.1 * lowest, top or None if lowest == 0.0 else None


def _label_frequencies(axes: Axes) -> None:
    """Label the vertical axis in rad/s and the right axis in Hz; growth rates, as imaginary frequencies, are
    below zero."""
    turn = 2 * math.pi
    scales = lambda omega: np.divide(omega, turn), lambda hertz: np.multiply(hertz, turn)
    right = axes.secondary_yaxis("right", functions=scales)
    right.set_ylabel("Hz")
    axes.set_ylabel("natural frequency (rad/s)")
    if axes.get_ylim()[0] < 0:
        axes.axhline(0.0, color=BLACK, linewidth=0.8)
        axes.axhspan(axes.get_ylim()[0], 0.0, color=LIGHT, alpha=0.5, linewidth=0, zorder=0)
        axes.set_ylabel("natural frequency (rad/s); shaded: growth rate (1/s)")
        for axis in (axes.yaxis, right.yaxis):
            axis.set_major_formatter(lambda value, _: f"{-value:.4g}i" if value < 0 else f"{value:.4g}")
