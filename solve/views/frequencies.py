"""Figures and tables of natural frequencies: mode shapes at a position, and frequencies over the revolution
and versus a parameter."""

import itertools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from solve.arrays import Array
from solve.contracts import DrawnLink, ModeShape
from solve.equations import most_frequencies
from solve.errors import ValueOutOfBoundsError
from solve.results.contents import MOST_SHOWN, Column, digits
from solve.results.frequencies import Findings, Frequencies, Variation
from solve.system import PeriodicSystem
from solve.views.panels import DEFLECTION, MOST_DRAWN, axis_label, title_of
from solve.views.show import figure, tables
from solve.views.style import (
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
from solve.views.tables import MOST_ROWS, RenderableType, Table, table_of

_COLORS = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY)

_MARKERS: dict[str, dict[str, Any]] = {
    "pinned": {"marker": "^", "color": BLACK, "markersize": 6},
    "clamped": {"marker": "s", "color": BLACK, "markersize": 6},
    "joined": {"marker": "o", "color": BLUE, "markerfacecolor": "white", "markersize": 4.5},
}
"""Markers of the ends of a link."""


@figure.register(Frequencies)
def frequencies_figure(found: Frequencies) -> Figure:
    """Figure of the mode shapes at one position, or of the frequencies versus position. Raises
    ValueOutOfBoundsError for a system without links to draw."""
    system = found.system
    if len(found.positions) > 1:
        return positions_figure(system, found.positions, found.signed)
    if not system.labels.links:
        raise ValueOutOfBoundsError(
            f"{system.labels.name} at one position has no mode shapes to draw; draw the frequencies "
            "for a revolution with --turn 36"
        )
    return shapes_figure(system, float(found.positions[0]), found.shapes())


@figure.register(Findings)
def findings_figure(found: Findings) -> Figure:
    """Figure of the frequencies versus the parameter if they are computed; otherwise, of the frequencies over
    the revolution if they are computed; otherwise, of the mode shapes at the position."""
    return figure(found.widest)


def shapes_figure(system: PeriodicSystem, position: float, all_shapes: Sequence[ModeShape]) -> Figure:
    """Figure of the mode shapes of a structure at one position (rad), with the undeformed links in grey."""
    shapes = all_shapes[:MOST_DRAWN]
    columns = 3 if len(shapes) in (3, 5, 6) else min(len(shapes), 4)
    rows = math.ceil(len(shapes) / columns)
    low, high = _frame(shapes)
    width, height = high - low
    row = 0.3 + 0.95 * PAGE_WIDTH / columns * height / width
    where = f" at {math.degrees(position):.4g}°" if system.labels.moves else ""
    lowest = f", the lowest {len(shapes)} of {len(all_shapes)}" if len(shapes) < len(all_shapes) else ""
    with page(0.4 + rows * row, f"{title_of(system)}: mode shapes{where}{lowest}") as drawing:
        axes = drawing.subplots(rows, columns, squeeze=False)
        for place in axes.flat:
            place.set_axis_off()
        for k, (place, shape) in enumerate(zip(axes.flat, shapes, strict=False), start=1):
            _draw_shape(place, shape, system.labels.links)
            place.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
            hertz = shape.frequency / (2 * math.pi)
            place.set_title(f"{k}: {shape.frequency:.5g} rad/s, {hertz:.4g} Hz", pad=2)
    return drawing


def positions_figure(system: PeriodicSystem, positions: Array, frequencies: Array) -> Figure:
    """Figure of the frequencies (m, k) versus positions (m,) of a revolution. Means are dashed. Growth rates
    are drawn as negative frequencies."""
    from matplotlib.ticker import MultipleLocator

    degrees = np.degrees(np.append(positions, positions[0] + system.period))
    with page(3.6, f"{title_of(system)}: natural frequencies over a revolution") as drawing:
        axes = drawing.subplots()
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
    return drawing


@figure.register(Variation)
def variation_figure(found: Variation) -> Figure:
    """Figure of the lowest elastic frequency versus the parameter, with its range over the revolution. The
    figure also shows the frequencies of the separate links (Fig. 9.1 of the thesis)."""
    system, parameter, values, mode = found.system, found.parameter, found.values, found.shown_modes[-1]
    figures = {name: values[:, mode] for name, values in found.statistics(1).items()}
    which = "lowest frequency" if mode == 0 else f"frequency of mode {mode + 1}, the first elastic one,"
    several = not np.array_equal(figures["min"], figures["max"], equal_nan=True)
    with page(3.8, f"{title_of(system)}: {which} versus {parameter}") as drawing:
        axes = drawing.subplots()
        if several:
            axes.fill_between(values, figures["min"], figures["max"], color=BLUE, alpha=0.15, linewidth=0)
        label = "mechanism: mean and range over a revolution" if several else "mechanism"
        axes.plot(values, figures["mean"], color=BLUE, marker="o", label=label)
        top = 2.2 * np.nanmax(figures["max"], initial=0.0)
        for (link, pinned), color in zip(
            found.pinned.items(), (GREY, VERMILION, GREEN, *_COLORS), strict=False
        ):
            if np.nanmin(pinned, initial=math.inf) < top:
                axes.plot(values, pinned, color=color, linestyle="--", label=f"{link} alone, pinned")
        axes.set_ylim(*_limits(figures["min"], top))
        axes.set_xlim(values.min(), values.max())
        axes.set_xlabel(axis_label(system, parameter))
        _label_frequencies(axes)
        axes.legend(loc="best")
    return drawing


def _frame(shapes: Sequence[ModeShape]) -> tuple[Array, Array]:
    """Return the lower left and the upper right corner (x, y) of the area that contains the structure and its
    displaced links."""
    points = np.concatenate(
        [*shapes[0].places, *(curve for shape in shapes for curve in _displaced_points(shape))]
    )
    margin = 0.04 * np.linalg.norm(np.ptp(points, axis=0))
    return points.min(axis=0) - margin, points.max(axis=0) + margin


def _displaced_points(shape: ModeShape) -> list[Array]:
    """Return the positions x + iy of points on the displaced links, one array per link."""
    scale = DEFLECTION * np.ptp(np.concatenate(shape.places), axis=0).max()
    links = zip(shape.places, shape.displacements, strict=True)
    return [place + scale * displacement for place, displacement in links]


def _draw_shape(axes: Axes, shape: ModeShape, links: Sequence[DrawnLink]) -> None:
    """Draw a mode shape, with circles for pins, triangles for fixed pins and squares for clamped ends."""
    for link, place, moved in zip(links, shape.places, _displaced_points(shape), strict=True):
        axes.plot(*place.T, color=LIGHT, linewidth=2.5, solid_capstyle="round")
        axes.plot(*moved.T, color=BLUE)
        for support, end in zip(link.ends, (0, -1), strict=True):
            if support in _MARKERS:
                axes.plot(*moved[end], zorder=3, **_MARKERS[support])


def _limits(roots: Array, top: float | None = None) -> tuple[float, float | None]:
    """Return the limits of the vertical axis. The lower limit is 0 unless a mode grows. `top` is the upper
    limit for frequencies, if known."""
    lowest = float(np.nanmin(roots, initial=0.0))
    if lowest == 0.0 and not top:
        return 0.0, 1.0 if not np.nan_to_num(roots).any() else None
    return 1.1 * lowest, top or None if lowest == 0.0 else None


def _label_frequencies(axes: Axes) -> None:
    """Label the left axis in rad/s and the right axis in Hz. Growth rates are drawn below zero, as negative
    frequencies."""
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


@tables.register(Frequencies)
def frequencies_tables(found: Frequencies) -> Sequence[Table]:
    """Table with one row per position, and statistics."""
    listed = _lowest(min(found.values.shape[1], MOST_SHOWN), most_frequencies(found.system))
    table = table_of(f"Frequencies over a revolution, rad/s{listed}", found.columns, most=MOST_ROWS)
    table.add_section()
    for name, values in found.statistics(0).items():
        table.add_row(name, *map(found.text_of, values[:MOST_SHOWN]))
    return [table]


@tables.register(Variation)
def variation_tables(found: Variation) -> Sequence[Table]:
    """Table with one row per value of the parameter. It contains the lowest frequency; the lowest elastic
    frequency if the lowest mode is a rigid-body mode; and the frequencies of up to three separate links."""
    mean_of = f": the mean of {len(found.positions)} positions" if found.several else ""
    caption = "alone: the link's lowest frequency, pinned at both ends" if found.pinned else None
    title = f"Frequencies versus {found.parameter}, rad/s{mean_of}"
    return [table_of(title, found.columns, most=MOST_ROWS, caption=caption)]


@tables.register(Findings)
def findings_tables(found: Findings) -> Sequence[RenderableType]:
    """Tables of the frequencies at the position, over the revolution, and versus a parameter. The first table
    also contains the largest deflection of each link in each mode shape."""
    roots, captions = found.here.signed[0], _about_modes(found)
    columns = {
        "mode": Column(range(1, len(roots) + 1), heading="mode"),
        "frequency": Column(roots, heading="rad/s", text=found.here.texts(0, ".7g")),
        "hertz": Column(roots, heading="Hz", text=found.here.texts(0, ".7g", 1 / (2 * math.pi))),
    }
    if found.shapes:
        masses = [shape.modal_mass for shape in found.shapes]
        columns["mass"] = Column(masses, heading="modal mass (kg)", text=digits(".4g"))
        captions = [*captions, "per link: largest deflection, relative to the largest of the mode"]
        for number, link in enumerate(found.system.labels.links):
            bending = [np.abs(shape.transverse[number]).max() for shape in found.shapes]
            columns[link.name] = Column(bending, heading=link.name, text=digits(".3f"))
    further = (tables(result) for result in (found.turn, found.variation) if result is not None)
    caption = "\n".join(captions) or None
    title = "Natural frequencies" + _lowest(len(roots), most_frequencies(found.system))
    return [table_of(title, columns, caption=caption), *itertools.chain(*further)]


def _lowest(listed: int, count: int) -> str:
    """Return the text that a title adds if a table lists only the lowest modes."""
    return f": the lowest {listed} of {count}" if listed < count else ""


def _about_modes(found: Findings) -> list[str]:
    """Return captions about growing modes and rigid-body modes."""
    first = int((found.here.signed[0] < 0).sum())
    texts = ["i: growth rate in 1/s of a mode that grows instead of vibrating"] * (first > 0)
    names = found.here.system.coordinates
    for number, mode in enumerate(found.here.rigid_body_modes, start=first + 1):
        texts.append(f"mode {number} is a rigid-body mode, {mode.ratio(names)}")
    return texts
