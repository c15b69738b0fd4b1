"""Work–precision pictures: what accuracy costs, in steps and in time."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from solve.arrays import Array
from solve.output.style import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, SKY, VERMILION, new_figure, styled

_COLORS = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, BLACK)
_MARKERS = "osD^vPh"
_LINES = ("-", "--", ":")
"""Past the last colour the next kind of line begins."""
_WORST = 10.0
"""Relative error above which a result is no result; drawn no higher."""


class Work(NamedTuple):
    """Points of one method, rising in steps: steps, relative error, time in seconds; (k,) each."""

    steps: Array
    error: Array
    time: Array


def work_precision_figure(title: str, methods: Mapping[str, Work], targets: Sequence[float]) -> Figure:
    """Error over steps, error over time and time over steps, a line a method; targets dashed."""
    with styled():
        figure = new_figure(5.6)
        figure.suptitle(title, fontweight="bold")
        (by_steps, by_time), (cost, key) = figure.subplots(2, 2)
        for index, (name, work) in enumerate(methods.items()):
            style = {
                "color": _COLORS[index % len(_COLORS)],
                "marker": _MARKERS[index % len(_MARKERS)],
                "linestyle": _LINES[index // len(_COLORS) % len(_LINES)],
                "markeredgecolor": "white",
                "markeredgewidth": 0.4,
                "markersize": 5,
                "label": name,
            }
            error = np.minimum(work.error, _WORST)
            for axes, x, y in (
                (by_steps, work.steps, error),
                (by_time, 1e3 * work.time, error),
                (cost, work.steps, 1e3 * work.time),
            ):
                axes.loglog(x, y, **style)
        _label(by_steps, "steps a period", "relative error of the orbit")
        _label(by_time, "time (ms)", "relative error of the orbit")
        _label(cost, "steps a period", "time (ms)")
        for axes in (by_steps, by_time):
            for target in targets:
                axes.axhline(target, color=GREY, linewidth=0.8, linestyle="--", zorder=1)
        key.axis("off")
        key.legend(*by_steps.get_legend_handles_labels(), loc="center", ncols=2, handlelength=4)
    return figure


def _label(axes: Axes, x: str, y: str) -> None:
    axes.set_xlabel(x)
    axes.set_ylabel(y)
