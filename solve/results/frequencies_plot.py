"""Pictures of natural frequencies: mode shapes, over the turn, over a parameter."""

import math
from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator

from solve.arrays import Array
from solve.beams.freedoms import Freedoms
from solve.beams.model import StructureModel
from solve.beams.shapes import Shape
from solve.errors import ValueOutOfBoundsError
from solve.results.plot import title_of
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
    new_figure,
    styled,
)
from solve.studies.frequencies import Frequencies, Variation, moves

_COLORS = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY)

_ALONE = (PURPLE, VERMILION, GREEN, ORANGE, SKY, GREY)

_DEFLECTION = 0.1
"""Largest displacement drawn, as a part of the structure's size."""

_MOST_SHAPES = 8


def shapes_figure(found: Frequencies, number: int = 0) -> Figure:
    """Mode shapes of a structure at one position, its links at rest in grey."""
    if not isinstance(found.system, StructureModel):
        raise ValueOutOfBoundsError(
            f"{found.system.name} at one position has nothing to draw; draw the whole turn: --turn 36"
        )
    every = found.shapes(number)
    shapes = every[:_MOST_SHAPES]
    columns = 3 if len(shapes) in (3, 5, 6) else min(len(shapes), 4)
    rows = math.ceil(len(shapes) / columns)
    low, high = _frame(shapes)
    width, height = high - low
    row = 0.3 + 0.95 * PAGE_WIDTH / columns * height / width
    where = f" at {math.degrees(found.positions[number]):.4g}°" if moves(found.system) else ""
    with styled():
        made = new_figure(0.4 + rows * row)
        lowest = f", the lowest {len(shapes)} of {len(every)}" if len(shapes) < len(every) else ""
        made.suptitle(f"{title_of(found.system)}: mode shapes{where}{lowest}", fontweight="bold")
        axes = made.subplots(rows, columns, squeeze=False)
        for place in axes.flat:
            place.set_axis_off()
        for k, (place, shape) in enumerate(zip(axes.flat, shapes, strict=False), start=1):
            _draw_shape(place, shape, found.system.beams.freedoms)
            place.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
            hertz = shape.frequency / (2 * math.pi)
            place.set_title(f"{k}: {shape.frequency:.5g} rad/s, {hertz:.4g} Hz", pad=2)
    return made


def turn_figure(found: Frequencies) -> Figure:
    """Every frequency over the turn, its mean dashed."""
    degrees = np.degrees(np.append(found.positions, found.positions[0] + found.system.period))
    with styled():
        made = new_figure(3.6)
        made.suptitle(f"{title_of(found.system)}: natural frequencies over the turn", fontweight="bold")
        axes = made.subplots()
        for k, values in enumerate(found.values.T):
            color = _COLORS[k % len(_COLORS)]
            label = f"mode {k + 1}: mean {values.mean():.6g}"
            axes.plot(degrees, np.append(values, values[0]), color=color, marker=".", label=label)
            axes.axhline(values.mean(), color=color, linewidth=0.8, linestyle=(0, (6, 4)))
        axes.set_xlim(degrees[0], degrees[-1])
        axes.set_ylim(bottom=0)
        if degrees[-1] - degrees[0] > 180:
            axes.xaxis.set_major_locator(MultipleLocator(60))
        axes.set_xlabel("position of the drive (deg)")
        axes.set_ylabel("natural frequency (rad/s)")
        _hertz(axes)
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=min(found.values.shape[1], 4))
    return made


def variation_figure(found: Variation) -> Figure:
    """The lowest frequency over a parameter, with its range over the turn, beside the links alone."""
    unit = next(unit for name, unit, *_ in found.model.module.PARAMETERS if name == found.parameter)
    with styled():
        made = new_figure(3.8)
        made.suptitle(f"{title_of(found.model)}: lowest frequency over {found.parameter}", fontweight="bold")
        axes = made.subplots()
        whole = len(found.positions) > 1
        if whole:
            axes.fill_between(
                found.values, found.least[:, 0], found.greatest[:, 0], color=BLUE, alpha=0.15, linewidth=0
            )
        label = "mechanism, mean and range of the turn" if whole else "mechanism"
        axes.plot(found.values, found.mean[:, 0], color=BLUE, marker="o", label=label)
        top = 2.2 * np.nanmax(found.greatest[:, 0], initial=0.0)
        for (link, alone), color in zip(
            found.pinned.items(), (GREY, VERMILION, GREEN, *_COLORS), strict=False
        ):
            if np.nanmin(alone, initial=math.inf) < top:
                axes.plot(found.values, alone, color=color, linestyle="--", label=f"{link} alone, pinned")
        axes.set_ylim(0, top)
        axes.set_xlim(found.values.min(), found.values.max())
        meaning = next(text for name, _, text, _ in found.model.module.PARAMETERS if name == found.parameter)
        axes.set_xlabel(f"{found.parameter}: {meaning}" + (f" ({unit})" if unit != "1" else ""))
        axes.set_ylabel("natural frequency (rad/s)")
        _hertz(axes)
        axes.legend(loc="best")
    return made


def _frame(shapes: Sequence[Shape]) -> tuple[Array, Array]:
    """Lower left and upper right corner (x, y) around the structure and all its drawn displacements."""
    points = np.concatenate([*shapes[0].places, *(curve for shape in shapes for curve in _drawn(shape))])
    margin = 0.04 * np.linalg.norm(np.ptp(points, axis=0))
    return points.min(axis=0) - margin, points.max(axis=0) + margin


def _drawn(shape: Shape) -> list[Array]:
    """Where the displaced links are drawn."""
    scale = _DEFLECTION * np.ptp(np.concatenate(shape.places), axis=0).max()
    each = zip(shape.places, shape.displacements, strict=True)
    return [place + scale * displacement for place, displacement in each]


def _draw_shape(axes: Axes, shape: Shape, freedoms: Freedoms) -> None:
    """Pins as circles, held pins as triangles, clamped feet as squares; welded corners and ends bare."""
    held = dict(freedoms.joints)
    shared = Counter(joint for link in freedoms.links for joint in (link.start, link.end))
    rotations = [name for link in freedoms.links for name in (link.start_rotation, link.end_rotation)]
    for link, place, moved in zip(freedoms.links, shape.places, _drawn(shape), strict=True):
        axes.plot(*place.T, color=LIGHT, linewidth=2.5, solid_capstyle="round")
        axes.plot(*moved.T, color=BLUE)
        ends = ((link.start, link.start_rotation, 0), (link.end, link.end_rotation, -1))
        for joint, rotation, end in ends:
            style: dict[str, Any] = {"color": BLACK, "markersize": 6, "zorder": 3}
            if held[joint]:
                axes.plot(*moved[end], "^" if rotation else "s", **style)
            elif shared[joint] > 1 and rotations.count(rotation) == 1:
                style |= {"color": BLUE, "markerfacecolor": "white", "markersize": 4.5}
                axes.plot(*moved[end], "o", **style)


def _hertz(axes: Axes) -> None:
    """The same scale in Hz on the right."""

    def hertz(omega: Any) -> Any:
        return omega / (2 * math.pi)

    def omega(hertz: Any) -> Any:
        return hertz * 2 * math.pi

    axes.secondary_yaxis("right", functions=(hertz, omega)).set_ylabel("Hz")
