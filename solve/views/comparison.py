"""Methods side by side: work and precision."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from solve.results.comparison import MULTIPLIERS, ORBIT, Comparison, Row, grouped
from solve.results.contents import Column, digits
from solve.views.panels import titled
from solve.views.show import figure, tables
from solve.views.style import GREY, LIGHT, MANY, Figure, page
from solve.views.tables import RenderableType, table_of, text

_UNRESOLVED, _OTHER_VERDICT = "*", "≠"
_LEGEND = {
    _UNRESOLVED: "ω_max h is beyond what the method follows or damps: multipliers may be false",
    _OTHER_VERDICT: "not the truth's verdict",
}

_MARKERS = "osD^vPXph*<>"
_DOTS: dict[str, Any] = {"markeredgecolor": "white", "markeredgewidth": 0.4, "markersize": 5.5}
_LINES = ("-", "--", ":")
"""Past the last colour the next kind of line begins."""

_WORST = 3.0
"""Relative error above which a result is no result; not drawn."""


@figure.register(Comparison)
def comparison_figure(comparison: Comparison) -> Figure:
    """Error over time, a line a method."""
    methods = grouped((row.method, row) for row in comparison.measured if row.reason is None)
    kinds = [ORBIT, MULTIPLIERS] if comparison.judged_by == ORBIT else [MULTIPLIERS]
    known_to = {kind: getattr(comparison.reference.error_estimate, kind) for kind in kinds}
    title = f"{titled(comparison.reference.system, comparison.reference.speed)}: work and precision"
    return work_precision_figure(title, methods, known_to, {comparison.judged_by: comparison.targets})


def work_precision_figure(
    title: str,
    methods: Mapping[str, Sequence[Row]],
    known_to: Mapping[str, float],
    targets: Mapping[str, Sequence[float]],
) -> Figure:
    """Error over time, a panel a kind of error, a line a method, its points rising in steps; targets dashed.

    known_to: the reference's own error of each kind, shaded, as nothing below it can be seen. Errors
    above 3 and below a tenth of the reference's are not drawn.
    """
    from cycler import cycler
    from matplotlib.ticker import LogLocator

    with page(4.2, title) as figure:
        panels = figure.subplots(1, len(known_to), sharey=True, sharex=True, squeeze=False)[0]
        floor = min(*known_to.values(), _WORST)
        for axes, (kind, error) in zip(panels, known_to.items(), strict=True):
            axes.set_prop_cycle(cycler(linestyle=_LINES) * (cycler(color=MANY) + cycler(marker=_MARKERS)))
            for name, rows in methods.items():
                shown = [
                    (1e3 * row.time, row.error(kind))
                    for row in rows
                    if floor / 10 <= row.error(kind) <= _WORST
                ]
                axes.loglog(*np.reshape(shown, (-1, 2)).T, label=name, **_DOTS)
            for target in targets.get(kind, ()):
                axes.axhline(target, color=GREY, linewidth=0.8, linestyle="--", zorder=1)
            axes.set_ylim(floor / 10, _WORST)
            axes.axhspan(floor / 10, min(error, _WORST), color=LIGHT, zorder=0.5, linewidth=0)
            below = "below the reference's own error"
            axes.annotate(below, (0.02, 0.02), xycoords="axes fraction", color=GREY)
            axes.yaxis.set_major_locator(LogLocator(numticks=9))
            axes.set_xlabel("processor time of a solution (ms)")
            axes.set_title(kind)
        panels[0].set_ylabel("relative error")
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=5, handlelength=3)
    return figure


@tables.register(Comparison)
def comparison_tables(comparison: Comparison) -> Sequence[RenderableType]:
    """One for each number of steps and each target."""
    groups = grouped((f"At {row.at}: {_goal(comparison, row)}", row) for row in comparison.rows)
    return [part for group in groups.items() for part in _parts(comparison, *group)]


def _goal(comparison: Comparison, row: Row) -> str:
    if row.target is None:
        return f"{row.asked} steps a period"
    return f"{comparison.judged_by} right to {row.target:g}"


def _parts(comparison: Comparison, title: str, rows: Sequence[Row]) -> list[RenderableType]:
    """A table of the rows that have a result, and what is to be said of them."""
    done = [row for row in rows if row.reason is None]
    if rows[0].target is not None:
        done.sort(key=lambda row: row.time)
    quickest, columns = min((row.time for row in done), default=0.0), comparison.columns_of(done)
    ratios = [row.time / quickest if quickest else None for row in done]
    other, truth = columns.pop("verdict"), comparison.reference.verdict
    marks = [_UNRESOLVED * (not row.followed) + _OTHER_VERDICT * (row.verdict != truth) for row in done]
    columns["ratio"] = Column(ratios, heading="ratio", text=digits(".2f"))
    columns |= {"verdict": other, "mark": Column(marks, heading=" ")}
    notes = [f"{mark} {meaning}" for mark, meaning in _LEGEND.items() if any(mark in each for each in marks)]
    dim = (text(note, "dim") for note in (*notes, *_reasons(rows)))
    return [table_of(title, columns, left=1), *dim]


def _reasons(rows: Sequence[Row]) -> list[str]:
    """Why methods have no result, or what is doubtful about their own settings; methods of one kind
    together."""
    # The last warning of a method that does not follow is said by its mark.
    said = [(row.warnings if row.followed else row.warnings[:-1], row) for row in rows]
    reasons = grouped(
        (reason, row.method)
        for warnings, row in said
        for reason in (warnings if row.reason is None else [row.reason])
    )
    return [f"{', '.join(names)}: {reason}" for reason, names in reasons.items()]
