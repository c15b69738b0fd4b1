"""What is drawn in the pictures of critical speeds beside the curves."""

import math
from collections.abc import Sequence

import numpy as np

from solve.arrays import Array, runs
from solve.results.plot import through
from solve.results.style import GREY, ORANGE, Axes
from solve.units import ShownUnit

_CLEAR, _ASIDE = 0.05, 0.015
"""Parts of the height and of the width that labels stay away from frames and curves."""

_BESIDE = 0.03
"""Part of the width that labels stay away from each other."""


def curve(speeds: Array, values: Array, marks: Sequence[tuple[float, float]]) -> tuple[Array, Array]:
    """A curve through the points and the maxima between them."""
    return through(*np.array([*zip(speeds, values, strict=True), *marks]).T)


def growing(speeds: Array, response: Array, ends: Sequence[float]) -> list[tuple[float, float]]:
    """Points between each speed of `ends`, at which a response (P,) over rising speeds (P,) grows beyond
    all bounds and those beside it: near such a speed it is as the inverse of the distance from there."""
    points, parts = [], np.geomspace(1.0, 1e-3, 24)[1:]
    for end in ends:
        above = int(np.searchsorted(speeds, end))
        for at in {above - 1, above} & set(range(len(response))):
            points += zip(
                (end + (speeds[at] - end) * parts).tolist(), (response[at] / parts).tolist(), strict=True
            )
    return points


def draw_marks(
    axes: Axes, unit: ShownUnit, marks: Sequence[tuple[float, float]], factor: float, color: str, label: str
) -> None:
    """Maxima: speeds (rad/s) and heights."""
    if marks:
        speeds, heights = np.array(marks).T
        style = {"color": color, "markersize": 4.5, "zorder": 4, "label": label}
        axes.plot(unit.of(speeds), heights * factor, "v", **style)


def shade(axes: Axes, unit: ShownUnit, speeds: Array, unstable: Array) -> None:
    """Unstable ones (P,) of rising speeds (P,), half way to their neighbours."""
    shown = unit.of(speeds)
    between = np.concatenate((shown[:1], (shown[1:] + shown[:-1]) / 2, shown[-1:]))
    style = {"color": ORANGE, "alpha": 0.3, "linewidth": 0}
    for at, (first, last) in enumerate(runs(unstable).tolist()):
        ends = between[[first, last + 1]].tolist()
        axes.axvspan(*ends, label="" if at else "unstable", **style)


def label_order(
    axes: Axes, unit: ShownUnit, speeds: Array, order: int, frequencies: Array, top: float
) -> None:
    """Name an order on its ray, within the frame that ends at `top` (Hz), clear of the frequencies (P, k) in
    rad/s and of the names of other orders; not at all where there is no such place."""
    clear = _CLEAR * top * 2 * math.pi
    ray = order * speeds
    free = (ray < 2 * math.pi * top - clear) & (np.abs(ray[:, None] - frequencies) > clear).all(axis=1)
    span = np.ptp(speeds)
    free &= np.minimum(speeds - speeds[0], speeds[-1] - speeds) > _ASIDE * span
    for named in axes.texts:
        x, y = named.get_position()
        beside = np.abs(unit.of(speeds) - x) > _BESIDE * unit.of(span)
        free &= beside | (np.abs(ray / (2 * math.pi) - y) > _CLEAR * top)
    if free.any():
        at = speeds[free][-1]
        box = {"boxstyle": "square,pad=0.1", "fc": "white", "ec": "none"}
        place = unit.of(at), order * at / (2 * math.pi)
        axes.text(*place, str(order), color=GREY, fontsize=7, ha="center", va="center", bbox=box, zorder=2)


def legend(axes: Axes) -> None:
    """Above the frame, at its right, where there is something to name."""
    if not axes.get_legend_handles_labels()[0]:
        return
    axes.legend(
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        ncols=5,
        borderaxespad=0.1,
        handlelength=1.4,
        columnspacing=1.1,
    )
