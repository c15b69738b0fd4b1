"""Figure and tables of a stability chart: stable and unstable regions, growth per period, and boundaries."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from solve.arrays import Array
from solve.labels import unit_of
from solve.period.multipliers import UNDETERMINED
from solve.results.chart import Chart, Cut
from solve.results.formatting import headed, prefixed
from solve.system import PeriodicSystem
from solve.views.panels import axis_label, draw_map, title_of
from solve.views.show import figure, tables
from solve.views.style import BLACK, GREY, Axes, Figure, page
from solve.views.sweep import KIND_COLORS, KIND_NAMES
from solve.views.tables import MOST_LISTED, RenderableType, table, text

_LINES = {"+1": "-", "-1": (0, (5, 2)), "complex": (0, (1, 1.2))}
_SHORT = {"+1": "+1", "-1": "−1", "complex": "pair"}
_STABLE, _UNKNOWN = "#DCE9F4", "#9A9A9A"
_MOST_GROWTH = 4.0
"""Growth exponent per period above which colours no longer change. Chosen by judgement, so that colours
resolve the boundaries."""

_FEW = 40_000
"""Maximum number of grid points for which colours are interpolated up to the boundaries. A denser grid
resolves the boundaries without interpolation. Chosen by judgement."""

_LETTER = 0.007, 0.035
"""Measured half-width and half-height of a letter, including its margin, as fractions of the figure."""

_FEWEST = 5
"""Minimum number of points with which a curve is smoothed by Akima's cubics."""


class Field(NamedTuple):
    """Stability as a function of x (nx,) and y (ny,), in the displayed units. `growth` (ny, nx) is ln|ρ| per
    period. `kinds` (ny, nx) are the kinds of instability, empty for stable points. `unknown` (ny, nx) is True
    where the verdict is unknown. `boundaries` are pairs of a kind and a curve (k, 2). `decided` (k, 4) are
    boxes with a proved verdict, `open` (k, 4) boxes without one; each row contains the ends of a box along x,
    then along y."""

    x: Array
    y: Array
    growth: Array
    kinds: Array
    unknown: Array
    boundaries: Sequence[tuple[str, Array]]
    decided: Array | None = None
    open: Array | None = None


@figure.register(Chart)
def chart_figure(chart: Chart) -> Figure:
    """Figure of the stable and unstable regions and their boundaries, coloured by the growth ln|ρ| per period
    or by the requested quantity."""
    system, names = chart.system, (chart.x_name, chart.y_name)
    units = [unit_of(system, name) for name in names]
    with np.errstate(divide="ignore"):
        growth = np.log(chart.spectral_radius)
    field = Field(
        units[0].from_si(chart.x),
        units[1].from_si(chart.y),
        growth,
        chart.kinds,
        np.isnan(chart.stable),
        [(kind, points / [unit.size for unit in units]) for kind, points in chart.boundaries],
        *_boxes(chart, np.repeat([unit.size for unit in units], 2)),
    )
    labels = axis_label(system, names[0]), axis_label(system, names[1])
    if chart.of is None or chart.values is None:
        return regions_figure(system, field, labels)
    factor, unit = prefixed(chart.of.unit, float(np.nanmax(np.abs(chart.values), initial=0.0)))
    return values_figure(system, field, labels, factor * chart.values, headed(chart.of.text, unit))


def _boxes(chart: Chart, sizes: Array) -> tuple[Array | None, Array | None]:
    """Return the boxes with a proved verdict, and the boxes without a proved verdict, in the displayed
    units."""
    if chart.proved is None:
        return None, None
    open_ = chart.proved.verdicts == UNDETERMINED
    return chart.proved.ends[~open_] / sizes, chart.proved.ends[open_] / sizes


def regions_figure(system: PeriodicSystem, field: Field, labels: tuple[str, str]) -> Figure:
    """Figure of the stable regions, the unstable regions and the boundaries. Unstable regions are shaded by
    growth per period, with one colour for each kind of instability."""
    from matplotlib.patches import Patch

    found = {*field.kinds.flat, *(kind for kind, _ in field.boundaries)}
    shown = [kind for kind in KIND_NAMES if kind in found]
    with page(5.0, f"{title_of(system)}: stability") as figure:
        axes = figure.subplots()
        axes.set_facecolor(_STABLE)
        _draw_unstable(figure, axes, field, shown)
        keys: list[Any] = [Patch(facecolor=_STABLE, edgecolor=GREY, linewidth=0.4, label="stable")]
        names = {kind: f"unstable, {KIND_NAMES[kind]}" for kind in shown}
        keys += [Patch(facecolor=KIND_COLORS[kind], label=names[kind]) for kind in shown]
        if field.unknown.any():
            keys.append(Patch(facecolor=_UNKNOWN, label="no result, or undetermined"))
        _draw_boundaries(figure, axes, field, labels, keys)
        _name_regions(axes, field, shown)
        axes.ticklabel_format(scilimits=(-3, 6))
        axes.grid(visible=False)
    return figure


def values_figure(
    system: PeriodicSystem, field: Field, labels: tuple[str, str], values: Array, scale: str
) -> Figure:
    """Figure of values (ny, nx) as colours, grey where values are missing, with the boundaries. `scale` is
    the label of the values."""
    with page(5.0, f"{title_of(system)}: {scale.partition(' (')[0]}") as figure:
        axes = figure.subplots()
        axes.set_facecolor(_UNKNOWN)
        draw_map(figure, axes, field.x, field.y, values, scale)
        _draw_boundaries(figure, axes, field, labels, [])
    return figure


def _draw_boundaries(
    figure: Figure, axes: Axes, field: Field, labels: tuple[str, str], keys: Sequence[Any]
) -> None:
    """Draw the boundaries, with a dash pattern for each kind, the axis labels, and a legend that begins with
    `keys`."""
    from matplotlib.lines import Line2D

    kinds = {kind for kind, _ in field.boundaries}
    styles = {kind: {"color": BLACK, "linestyle": line, "linewidth": 1.1} for kind, line in _LINES.items()}
    for kind, points in field.boundaries:
        axes.plot(*smooth(points).T, **styles[kind])
    lines = [
        Line2D([], [], label=f"boundary {_SHORT[kind]}", **styles[kind]) for kind in _LINES if kind in kinds
    ]
    lines += _draw_boxes(axes, field)
    if keys or lines:
        figure.legend(handles=[*keys, *lines], loc="outside lower center", ncols=3, handlelength=3)
    axes.set(xlabel=labels[0], ylabel=labels[1], xlim=field.x[[0, -1]], ylim=field.y[[0, -1]])


def _draw_boxes(axes: Axes, field: Field) -> list[Any]:
    """Draw boxes with a proved verdict as outlines, and all other boxes in black. Return the keys of the
    legend."""
    from matplotlib.collections import PolyCollection
    from matplotlib.patches import Patch

    if field.decided is None or field.open is None:
        return []
    edges: dict[str, Any] = {"facecolor": "none", "edgecolor": GREY, "linewidth": 0.2}
    filled: dict[str, Any] = {"facecolor": BLACK, "edgecolor": "none"}
    for boxes, style in ((field.decided, edges), (field.open, filled)):
        corners = boxes[:, [[0, 2], [1, 2], [1, 3], [0, 3]]]
        axes.add_collection(PolyCollection(list(corners), rasterized=True, zorder=1.6, **style))
    return [
        Patch(facecolor="none", edgecolor=GREY, linewidth=0.4, label="box with a proved verdict"),
        Patch(facecolor=BLACK, label="not proved"),
    ]


def _draw_unstable(figure: Figure, axes: Axes, field: Field, kinds: Sequence[str]) -> None:
    """Draw the growth in the unstable regions of each kind, with one colour bar per kind."""
    from matplotlib.colors import ListedColormap
    from matplotlib.ticker import MaxNLocator

    growth = np.clip(field.growth, 0.0, 2 * _MOST_GROWTH)
    top = np.clip(np.nanmax(np.where(field.kinds != "", growth, 0.0)), 1e-3, _MOST_GROWTH)
    levels = np.asarray(MaxNLocator(6, steps=[1, 2, 5, 10]).tick_values(0.0, top))
    levels = levels[levels >= 0]
    # Values outside the region are negative, so that the interpolated field is zero at the boundary.
    plane = _plane(field, np.where(field.kinds != "", growth, -levels[1]))
    colours = {"levels": levels, "extend": "max"}
    for kind in reversed(kinds):
        filled = plane.fill(axes, plane.values, **colours, colors=_shades(kind, len(levels) - 1))
        if len(kinds) > 1:
            region = plane.fill(axes, (plane.kinds == kind).astype(float), levels=[1 / 3, 2.0], colors="none")
            filled.set_clip_path(region.get_paths()[0], axes.transData)
            region.remove()
        bar = figure.colorbar(filled, ax=axes, pad=0.015, fraction=0.035, aspect=28)
        bar.ax.set_title(_SHORT[kind], fontsize=8)
        bar.outline.set_linewidth(0.5)
        if kind == kinds[-1]:
            bar.set_label("growth per period, ln |ρ|", color=GREY)
        else:
            bar.ax.set_yticklabels([])
    if field.unknown.any():
        cells = np.where(field.unknown, 1.0, np.nan)
        grey = ListedColormap([_UNKNOWN])
        axes.pcolormesh(field.x, field.y, cells, cmap=grey, shading="nearest", rasterized=True, zorder=1.5)


class _Plane(NamedTuple):
    """Values at points of the plane. `kinds` contains the kind of the nearest unstable point or boundary, for
    each point. `fill` is a function of axes and values that draws filled contours."""

    values: Array
    kinds: Array
    fill: Callable[..., Any]


def _plane(field: Field, values: Array) -> _Plane:
    """Return a plane with `values` at the points of the grid and zeros at the points of the boundaries."""
    from scipy.spatial import Delaunay, KDTree

    points = np.column_stack([axis.ravel() for axis in np.meshgrid(field.x, field.y)])
    spacing = np.ptp(points, axis=0) / (np.array(values.shape[::-1]) - 1)
    unstable = field.kinds.ravel() != ""
    few = values.size <= _FEW
    boundaries = field.boundaries if few else []
    curves = [curve for _, curve in boundaries]
    corners = np.concatenate([points, *curves])
    flat = np.concatenate([values.ravel(), *(np.zeros(len(curve)) for curve in curves)])
    kinds = np.full(len(corners), "", dtype=field.kinds.dtype)
    places = np.concatenate([points[unstable], *curves])
    if len(places):
        of_curves = [np.full(len(curve), kind) for kind, curve in boundaries]
        _, nearest = KDTree(places / spacing).query(corners / spacing)
        kinds = np.concatenate([field.kinds.ravel()[unstable], *of_curves])[nearest]
    if not few:
        shape = values.shape
        x, y = field.x, field.y
        return _Plane(flat, kinds, lambda axes, z, **how: axes.contourf(x, y, z.reshape(shape), **how))
    from matplotlib.tri import Triangulation

    _, first = np.unique(corners, axis=0, return_index=True)
    triangles = Triangulation(
        corners[first, 0], corners[first, 1], Delaunay(corners[first] / spacing).simplices
    )
    return _Plane(flat[first], kinds[first], lambda axes, z, **how: axes.tricontourf(triangles, z, **how))


def _shades(kind: str, count: int) -> Array:
    """Return colours from a light to a dark shade of the kind's colour. The last colour applies above all
    levels."""
    from matplotlib.colors import LinearSegmentedColormap, to_rgb

    colour = np.array(to_rgb(KIND_COLORS[kind]))
    map_ = LinearSegmentedColormap.from_list(kind, [0.25 * colour + 0.75, colour, 0.45 * colour])
    return map_(np.linspace(0.0, 1.0, count + 1))


def _name_regions(axes: Axes, field: Field, kinds: Sequence[str]) -> None:
    """Label each large region at its centre."""
    from scipy import ndimage

    stable = (field.kinds == "") & ~field.unknown
    named: Mapping[str, Array] = {
        "stable": stable,
        **{f"unstable, {_SHORT[kind]}": field.kinds == kind for kind in kinds},
    }
    ny, nx = field.growth.shape
    for words, inside in named.items():
        regions: Any = ndimage.label(inside)
        for number in range(1, regions[1] + 1):
            framed = np.pad(regions[0] == number, 1)
            # Distances are divided by the space that the name requires on either side.
            need = _LETTER[1] * ny, _LETTER[0] * len(words) * nx
            scales = 1 / need[0], 1 / need[1]
            distance: Any = ndimage.distance_transform_edt(framed, sampling=scales)
            distance = distance[1:-1, 1:-1]
            j, i = np.unravel_index(distance.argmax(), distance.shape)
            if distance[j, i] > 1:
                box = {"boxstyle": "round,pad=0.2", "fc": "white", "alpha": 0.75, "ec": "none"}
                axes.annotate(words, (field.x[i], field.y[j]), ha="center", va="center", bbox=box)


def smooth(curve: Array) -> Array:
    """Return a curve (k, 2) with points interpolated by Akima's cubics as functions of the arc length."""
    from scipy.interpolate import Akima1DInterpolator

    steps = np.hypot(*(np.diff(curve, axis=0) / np.maximum(np.ptp(curve, axis=0), 1e-300)).T)
    curve = curve[np.append(True, steps > 0)]
    if len(curve) < _FEWEST:
        return curve
    length = np.append(0.0, np.cumsum(steps[steps > 0]))
    fine = np.interp(
        np.linspace(0, len(length) - 1, 8 * (len(length) - 1) + 1), np.arange(len(length)), length
    )
    return Akima1DInterpolator(length, curve)(fine)


@tables.register(Chart)
def chart_tables(chart: Chart) -> Sequence[RenderableType]:
    """Table of the boundaries, and table of the crossings of each cut."""
    return [_boundary_table(chart), *(_cut_table(cut, chart.system) for cut in chart.cuts)]


def _boundary_table(chart: Chart) -> RenderableType:
    if not chart.boundaries:
        return text("\nno boundary in this range")
    names = chart.x_name, chart.y_name
    curves = sorted(chart.boundaries, key=lambda curve: -len(curve.points))[:MOST_LISTED]
    rows = [(name, str(len(points)), *map(chart.span, names, points.T)) for name, points in curves]
    shorter = len(chart.boundaries) - len(curves)
    caption = f"and {shorter} shorter ones" if shorter else None
    title = "Boundaries between stable and unstable"
    return table(title, "kind", "points", *names, rows=rows, caption=caption)


def _cut_table(cut: Cut, system: PeriodicSystem) -> RenderableType:
    """Table with one row per crossing."""
    where = f"Along {cut.along} at {cut.across} = {unit_of(system, cut.across).text(cut.value)}"
    if not cut.crossings:
        return text(f"\n{where}: no boundary")
    unit = unit_of(system, cut.along)
    rows = [(unit.text(value, ".9g"), kind) for value, kind in cut.crossings]
    return table(where, "at", "kind", left=0, rows=rows)
