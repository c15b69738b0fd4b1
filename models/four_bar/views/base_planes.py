"""Figure of base planes of Barker's solution space, divided into the regions of the classes (section 3.4 of
the thesis).

On a base plane λ2 + λ3 + λ4 = S, the lines of zero mobility are λ2 = (S + 1)/2, λ3 = (S + 1)/2 and λ4 = (S +
1)/2. The lines of change points are λ2 = (S - 1)/2, λ3 = (S - 1)/2 and λ4 = (S - 1)/2. These enclose the
region RRR2 if S < 3, and GCRR if S > 3. If S = 3, they meet at one point, which represents four equal links.
"""

import math
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Polygon

from models.four_bar.barker import REGIONS, base_plane, classify, solution_space
from models.four_bar.linkage import Linkage
from solve.arrays import Array
from solve.views.style import BLACK, BLUE, GREEN, GREY, ORANGE, VERMILION, new_figure, styled

_TYPICAL = (1.05, math.sqrt(3), 3.2)
"""Distances λ of the planes in the figure, one for each pattern of classes on a plane."""

_CORNERS = np.exp(1j * np.radians([90, 210, 330]))
"""Corners of the triangle in the figure. At each corner, only one of λ2, λ3 and λ4 is nonzero."""

_MARKED = {"1": ("frame", ORANGE), "2": ("input", BLUE), "3": ("coupler", GREEN), "4": ("output", VERMILION)}
_STRONG, _PALE = 0.65, 0.2
"""Opacities of Grashof regions and of non-Grashof regions."""

_LEAST_ROOM = 0.045
"""Smallest width of a labelled region, relative to the size of its plane. Chosen by appearance."""

_EXPLAINED = (
    "Strong colours: Grashof, by the shortest link; pale colours: non-Grashof, by the longest link. Lines:\n"
    "change points, CP2X where two cross, CP3X where three meet. Outside: no linkage can be assembled."
)
_GRASHOF = {"GCCC": "1", "GCRR": "2", "GRCR": "3", "GRRC": "4"}


def base_planes_figure(linkage: Linkage) -> Figure:
    """Figure of three typical base planes, and of the plane that contains the linkage, which is drawn as a
    dot."""
    with styled():
        figure = new_figure(7.8)
        figure.suptitle("Base planes of Barker's solution space", fontweight="bold")
        panels = figure.subplots(2, 2)
        for axes, distance in zip(panels.flat, _TYPICAL, strict=False):
            _draw_plane(axes, distance)
            axes.set_title(f"λ = {distance:.4g}", loc="left")
        _draw_linkage(panels[1, 1], linkage)
        figure.legend(handles=_legend(), title=_EXPLAINED, loc="outside lower center", ncols=4)
    return figure


def _draw_plane(axes: Axes, distance: float, unnamed: str = "") -> None:
    total = math.sqrt(3) * distance
    movable = total * np.eye(3)
    for link in range(3):
        movable = _clipped(movable, link, (total + 1) / 2, -1)
    size = np.ptp(_flat(movable), axis=0).max()
    for signs, symbol in REGIONS.items():
        region = movable
        for link, sign in enumerate(signs):
            region = _clipped(region, link, (total - 1) / 2, sign)
        if len(region) > 2:
            _draw_region(axes, _flat(region), symbol)
            if symbol != unnamed:
                _name_region(axes, _flat(region), symbol, size)
    for link in range(3):
        _label_edge(axes, link, (total + 1) / 2, total, size)
        _label_edge(axes, link, 0.0, total, size)
    axes.margins(0.02, 0.10)
    axes.set_aspect("equal")
    axes.axis("off")


def _label_edge(axes: Axes, link: int, value: float, total: float, size: float) -> None:
    """Write a label outside the triangle, next to the line on which the coordinate λ of a link has this
    value."""
    middle = np.full((1, 3), (total - value) / 2)
    middle[0, link] = value
    outward = _CORNERS[link] if value > 0 else -_CORNERS[link]
    x, y = _flat(middle)[0] + 0.05 * size * np.array([outward.real, outward.imag])
    text = f"$λ_{link + 2}$ = {value:.4g}"
    axes.text(x, y, text, ha="center", va="center", rotation=(0, -60, 60)[link], color=GREY, fontsize=7.5)


def _draw_region(axes: Axes, region: Array, symbol: str) -> None:
    grashof = symbol in _GRASHOF
    colour = _MARKED[_GRASHOF.get(symbol, symbol[-1])][1]
    axes.add_patch(Polygon(region, facecolor=colour, alpha=_STRONG if grashof else _PALE, linewidth=0))
    axes.add_patch(Polygon(region, facecolor="none", edgecolor=BLACK, linewidth=0.9, joinstyle="round"))


def _name_region(axes: Axes, region: Array, symbol: str, size: float) -> None:
    """Write the class in the middle of a region (k, 2) if the region is large enough, relative to the size of
    its plane."""
    perimeter = np.linalg.norm(region - np.roll(region, 1, axis=0), axis=1).sum()
    area, (x, y) = _area_and_centroid(region)
    if 2 * area > _LEAST_ROOM * size * perimeter:
        axes.text(x, y, symbol, ha="center", va="center", fontsize=7)


def _draw_linkage(axes: Axes, linkage: Linkage) -> None:
    """Draw the plane that contains the linkage. The title states the class of the linkage, because the dot
    would hide a label."""
    symbol, distance = classify(linkage).symbol, base_plane(linkage)
    _draw_plane(axes, distance, unnamed=symbol)
    place = _flat(np.array([solution_space(linkage)]))
    axes.plot(*place.T, "o", color=BLACK, markersize=7, markeredgecolor="white", zorder=5)
    axes.set_title(f"λ = {distance:.4g}: this linkage, {symbol}", loc="left")


def _legend() -> list[Patch]:
    return [
        Patch(color=colour, alpha=alpha, linewidth=0, label=f"{role} {extreme}")
        for role, colour in _MARKED.values()
        for alpha, extreme in ((_STRONG, "shortest"), (_PALE, "longest"))
    ]


def _flat(points: Array) -> Array:
    """Return positions (k, 2) in the triangle of the figure, from λ2, λ3, λ4 (k, 3)."""
    flat = points @ _CORNERS / points.sum(axis=1)
    return np.column_stack((flat.real, flat.imag))


def _clipped(polygon: Array, link: int, limit: float, side: int) -> Array:
    """Return the part of a convex polygon (k, 3) in which side · (λ - limit) >= 0, where λ is the coordinate
    of a link."""
    corners = []
    for first, second in pairwise([*polygon, *polygon[:1]]):
        start, end = side * (first[link] - limit), side * (second[link] - limit)
        if start >= 0:
            corners.append(first)
        if start * end < 0:
            corners.append(first + (second - first) * start / (start - end))
    return np.array(corners).reshape(-1, 3)


def _area_and_centroid(polygon: Array) -> tuple[float, Array]:
    """Return the area and the centroid of a polygon (k, 2)."""
    x, y = polygon.T
    cross = x * np.roll(y, -1) - np.roll(x, -1) * y
    moments = np.array([(x + np.roll(x, -1)) @ cross, (y + np.roll(y, -1)) @ cross])
    return float(abs(cross.sum())) / 2, moments / (3 * cross.sum())
