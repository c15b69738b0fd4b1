"""Figures and tables that compare methods: error and processor time; stability regions of Newmark's
method."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from solve.errors import counted
from solve.methods.newmark import stability_limit
from solve.results.comparison import MULTIPLIERS, ORBIT, Comparison, Row, grouped
from solve.results.contents import Column, digits
from solve.views.panels import titled
from solve.views.show import figure, tables
from solve.views.style import (
    BLACK,
    BLUE,
    GREY,
    LIGHT,
    MANY,
    ORANGE,
    VERMILION,
    Figure,
    new_figure,
    page,
    styled,
)
from solve.views.tables import RenderableType, table_of, text

_UNRESOLVED, _OTHER_VERDICT = "*", "≠"
_LEGEND = {
    _UNRESOLVED: "ω_max h is beyond what the method resolves or damps: multipliers may be wrong",
    _OTHER_VERDICT: "verdict differs from the reference",
}

_MARKERS = "osD^vPXph*<>"
_DOTS: dict[str, Any] = {"markeredgecolor": "white", "markeredgewidth": 0.4, "markersize": 5.5}
_LINES = ("-", "--", ":")
"""Line styles. Each style is used with all colours before the next one is used."""

_WORST = 3.0
"""Largest relative error that is drawn: a result with a larger error is not accurate to even one digit."""


@figure.register(Comparison)
def comparison_figure(comparison: Comparison) -> Figure:
    """Figure of the error versus processor time, with one line per method."""
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
    """Figure of the error versus processor time, with one panel per kind of error and one line per method.
    The points of a line are in ascending order of the number of steps; targets are dashed.

    `known_to` maps each kind of error to the error of the reference; below it, in the shaded area, errors
    cannot be measured. Errors above 3, or below a tenth of the error of the reference, are not drawn.
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
    """Tables, one per number of steps and one per target."""
    groups = grouped((f"At {row.at}: {_goal(comparison, row)}", row) for row in comparison.rows)
    return [item for group in groups.items() for item in _group_tables(comparison, *group)]


def _goal(comparison: Comparison, row: Row) -> str:
    if row.target is None:
        return f"{counted(row.asked, 'step')} per period"
    return f"{comparison.judged_by} accurate to {row.target:g}"


def _group_tables(comparison: Comparison, title: str, rows: Sequence[Row]) -> list[RenderableType]:
    """Return a table of the rows with a result, and notes on the rows without a result."""
    done = [row for row in rows if row.reason is None]
    if rows[0].target is not None:
        done.sort(key=lambda row: row.time)
    fastest, columns = min((row.time for row in done), default=0.0), comparison.columns_of(done)
    ratios = [row.time / fastest if fastest else None for row in done]
    verdicts, reference = columns.pop("verdict"), comparison.reference.verdict
    marks = [_UNRESOLVED * (not row.followed) + _OTHER_VERDICT * (row.verdict != reference) for row in done]
    columns["ratio"] = Column(ratios, heading="ratio", text=digits(".2f"))
    columns |= {"verdict": verdicts, "mark": Column(marks, heading=" ")}
    notes = [f"{mark} {meaning}" for mark, meaning in _LEGEND.items() if any(mark in text for text in marks)]
    dim = (text(note, "dim") for note in (*notes, *_reasons(rows)))
    return [table_of(title, columns, left=1), *dim]


def _reasons(rows: Sequence[Row]) -> list[str]:
    """Return the warnings and the reasons why methods have no result. Each text is followed by the names of
    the methods concerned."""
    # For a method that does not resolve the fastest mode, a mark in the table replaces the last warning.
    texts = [(row.warnings if row.followed else row.warnings[:-1], row) for row in rows]
    reasons = grouped(
        (reason, row.method)
        for warnings, row in texts
        for reason in (warnings if row.reason is None else [row.reason])
    )
    return [f"{', '.join(names)}: {reason}" for reason, names in reasons.items()]


_POINTS = {
    "average acceleration": (0.5, 1 / 4),
    "linear acceleration": (0.5, 1 / 6),
    "Fox–Goodwin": (0.5, 1 / 12),
    "central differences": (0.5, 0.0),
}

_LEVELS = (1.5, 2.0, 2.5, 3.0, 4.0, 6.0)


def newmark_region_figure() -> Figure:
    """Figure of the stability regions in the (γ, β) plane: unstable for γ < 1/2, stable up to a limit of ω h
    (contours), stable for any step (after Fig. 6.1 of the thesis)."""
    with styled():
        figure = new_figure(4.3)
        axes = figure.add_subplot()
        gamma = np.linspace(0.5, 1.0, 201)
        axes.axvspan(0.18, 0.5, color=LIGHT, lw=0)
        axes.fill_between(gamma, gamma / 2, (gamma + 0.5) ** 2 / 4, color=ORANGE, alpha=0.35, lw=0)
        axes.fill_between(gamma, (gamma + 0.5) ** 2 / 4, 0.7, color=BLUE, alpha=0.22, lw=0)
        axes.plot(gamma, gamma / 2, color=BLACK)
        axes.plot(gamma, (gamma + 0.5) ** 2 / 4, color=BLACK, ls="--")
        axes.axvline(0.5, color=BLACK)
        coarse, beta = np.linspace(0.5, 1.0, 151), np.linspace(0.0, 0.5, 151)
        limit = np.array([[stability_limit(g, b) for g in coarse] for b in beta])
        lines = axes.contour(coarse, beta, limit, levels=_LEVELS, colors=GREY, linewidths=0.7)
        label_points = [(0.86, 0.86 / 2 - 1 / level**2) for level in _LEVELS]
        axes.clabel(lines, fmt="%g", fontsize=7.5, manual=label_points)
        offset: dict[str, Any] = {"textcoords": "offset fontsize"}
        for name, place in _POINTS.items():
            axes.plot(*place, "o", color=BLACK, clip_on=False, zorder=3)
            axes.annotate(name, place, (-0.7, 0.0), ha="right", va="center", **offset)
        axes.plot(0.25, 1 / 6, "o", color=VERMILION)
        axes.annotate("γ = 1/4, β = 1/6", (0.25, 1 / 6), (0, 0.8), ha="center", color=VERMILION, **offset)
        axes.annotate("unstable at any step: energy grows", (0.34, 0.48), ha="center")
        axes.annotate("stable at any step", (0.62, 0.48), ha="center")
        white = {"boxstyle": "square,pad=0.15", "color": "white"}
        axes.annotate("stable up to the ω h on the line", (0.75, 0.015), ha="center", bbox=white)
        line = {"arrowstyle": "-", "color": GREY, "lw": 0.7}
        damped = "stable at any step;\nlong steps decay without oscillating"
        axes.annotate(damped, (0.93, 0.49), (0.8, 0.60), ha="center", va="center", arrowprops=line)
        axes.set(xlim=(0.18, 1.0), ylim=(-0.02, 0.65), xlabel="γ", ylabel="β")
        axes.grid(False)
        axes.set_title("Newmark's method on an undamped oscillator")
    return figure
