"""Work–precision pictures: what accuracy costs in time."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from solve.arrays import Array
from solve.results.style import GREY, LIGHT, MANY, Figure, new_figure, styled

_MARKERS = "osD^vPXph*<>"
_LINES = ("-", "--", ":")
"""Past the last colour the next kind of line begins."""

_WORST = 3.0
"""Relative error above which a result is no result; not drawn."""


class Work(NamedTuple):
    """Points of one method, rising in steps: time in seconds (k,), relative errors (k,) by their kind."""

    time: Array
    errors: Mapping[str, Array]


def work_precision_figure(
    title: str,
    methods: Mapping[str, Work],
    known_to: Mapping[str, float],
    targets: Mapping[str, Sequence[float]],
) -> Figure:
    """Error over time, a panel a kind of error, a line a method; targets dashed.

    known_to: the reference's own error of each kind, shaded, as nothing below it can be seen. Errors
    above 3 and below a tenth of the reference's are not drawn.
    """
    from matplotlib.ticker import LogLocator

    with styled():
        figure = new_figure(4.2)
        figure.suptitle(title, fontweight="bold")
        panels = figure.subplots(1, len(known_to), sharey=True, sharex=True, squeeze=False)[0]
        floor = min(known_to.values())
        for axes, (kind, error) in zip(panels, known_to.items(), strict=True):
            for index, (name, work) in enumerate(methods.items()):
                shown = (work.errors[kind] <= _WORST) & (work.errors[kind] >= floor / 10)
                axes.loglog(
                    work.time[shown] * 1e3, work.errors[kind][shown], label=name, **_line_style(index)
                )
            for target in targets.get(kind, ()):
                axes.axhline(target, color=GREY, linewidth=0.8, linestyle="--", zorder=1)
            axes.set_ylim(floor / 10, _WORST)
            axes.axhspan(floor / 10, error, color=LIGHT, zorder=0.5, linewidth=0)
            axes.annotate(
                "below the reference's own error", (0.02, 0.02), xycoords="axes fraction", color=GREY
            )
            axes.yaxis.set_major_locator(LogLocator(numticks=9))
            axes.set_xlabel("processor time of a solution (ms)")
            axes.set_title(kind)
        panels[0].set_ylabel("relative error")
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=5, handlelength=3)
    return figure


def _line_style(index: int) -> dict[str, Any]:
    return {
        "color": MANY[index % len(MANY)],
        "marker": _MARKERS[index % len(_MARKERS)],
        "linestyle": _LINES[index // len(MANY) % len(_LINES)],
        "markeredgecolor": "white",
        "markeredgewidth": 0.4,
        "markersize": 5.5,
    }
