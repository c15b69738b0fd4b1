"""Figures and tables of a periodic controller: gains over the period, vibration without and with feedback,
and the closed loop."""

from collections.abc import Sequence

import numpy as np

from solve.results.contents import HALF_DEGREES, MOST_SHOWN
from solve.results.controller import Controller, StabilityMargin
from solve.results.formatting import prefixed
from solve.views.panels import MOST_DRAWN, label_phases, omission, titled
from solve.views.show import brief, figure, heading_of, tables
from solve.views.stability import CIRCLE_ROW, draw_stability, stability_tables
from solve.views.style import GREY, Axes, Figure, page
from solve.views.tables import MOST_LISTED, RenderableType, stacked, table, text

_SHOWN = 4
"""Number of harmonics in the table of gains. Chosen by judgement."""


@figure.register(Controller)
def controller_figure(result: Controller) -> Figure:
    """Figure of the gains versus phase, with one panel per signal, and of the multipliers. Each gain is
    divided by its largest absolute value."""
    phase = np.linspace(0.0, result.system.period, HALF_DEGREES)
    gains = np.moveaxis(result.gain(phase), 0, -1)
    gains = gains.swapaxes(0, 1) if result.kind == "kalman" else gains
    rows = min(len(gains), MOST_SHOWN)
    title = titled(result.system, result.speed) + omission(len(gains), MOST_SHOWN, "signals")
    heights = [0.7 + 1.6 * rows, CIRCLE_ROW]
    with page(sum(heights), title) as sheet:
        grid = sheet.add_gridspec(2, 1, height_ratios=heights)
        upper, lower = (sheet.add_subfigure(grid[row]) for row in range(2))
        panels = upper.subplots(rows, 1, squeeze=False, sharex=True)[:, 0]
        for axes, name, curves in zip(panels, result.signals, gains, strict=False):
            _draw_gains(axes, result, name, np.degrees(phase), curves)
        label_phases(panels[-1], result.system.period)
        draw_stability(lower, result.stability)
    return sheet


def _draw_gains(axes: Axes, result: Controller, name: str, degrees: np.ndarray, curves: np.ndarray) -> None:
    """Draw the gains of one signal for all states, each divided by its largest absolute value."""
    sizes = np.abs(curves).max(axis=1)
    for state, curve, size in list(zip(result.states, curves, sizes, strict=True))[:MOST_DRAWN]:
        axes.plot(degrees, curve / (size or 1.0), label=f"{state} ({size:.3g})")
    axes.axhline(0.0, color=GREY, linewidth=0.5)
    axes.set_ylim(-1.1, 1.1)
    axes.set_ylabel("gain / largest")
    title = f"gain of {name} by state (its largest absolute value, SI)"
    title += omission(len(result.states), MOST_DRAWN, "states")
    axes.set_title(title, loc="left", color=GREY)
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))


@tables.register(Controller)
def controller_tables(result: Controller) -> Sequence[RenderableType]:
    """Tables of verdict, vibration, gains and multipliers."""
    shown = [text(f"\n{result.summary}", "bold")]
    if result.vibration:
        shown.append(_vibration_table(result))
    if result.norms:
        shown.append(_norm_table(result))
    if (sampled := result.sampled) is not None:
        drive = f"With {sampled.rate} and one sample of delay it is {sampled.verdict}"
        shown.append(text(f"\n{drive}: spectral radius {sampled.spectral_radius:.6g}."))
    if result.margin is not None:
        shown.append(text(f"\n{_margin_sentence(result.margin)}"))
    return [*shown, _gain_table(result), *stability_tables(result.stability)]


@brief.register(Controller)
def controller_in_brief(result: Controller) -> RenderableType:
    """Short form of the result, with its heading and verdict."""
    return stacked(heading_of(result), text(f"\n{result.summary}", "bold"))


def _vibration_table(result: Controller) -> RenderableType:
    rows = []
    for name, each in result.vibration.items():
        factor, unit = prefixed(result.system.labels.units.get(name, ""), max(each.without, each.controlled))
        values = (f"{factor * value:.5g}" for value in each)
        rows.append((name, unit, *values))
    title = "Periodic vibration: largest absolute values, and root mean square with feedback"
    return table(title, "", "unit", "without", "with", "rms with", left=2, rows=rows)


def _norm_table(result: Controller) -> RenderableType:
    rows = []
    for name, each in result.norms.items():
        values = each.h2_without, each.h2, each.hinf_without, each.hinf, each.frequency
        rows.append((name, *("" if value is None else f"{value:.5g}" for value in values)))
    title = "Norms from the disturbances at the inputs (SI units; frequencies in rad/s)"
    headings = "H2 without", "H2 with", "H∞ without", "H∞ with", "frequency"
    return table(title, "", *headings, left=1, rows=rows)


def _margin_sentence(margin: StabilityMargin) -> str:
    """Return a sentence on the smallest change of parameters that makes the closed loop unstable."""
    if not np.isfinite(margin.distance):
        return "Changes of up to 100 % of these parameters leave the closed loop stable."
    changes = ", ".join(f"{name} {100 * change:+.3g} %" for name, change in margin.changes.items())
    return f"The smallest change that makes the closed loop unstable is {margin.distance:.4g}: {changes}."


def _gain_table(result: Controller) -> RenderableType:
    """Return a table of the means and the amplitudes of harmonics of the gains, in SI units."""
    harmonics = np.moveaxis(result.harmonics, 0, -1)
    entries = list(zip(result.gain_names, harmonics.reshape(-1, harmonics.shape[-1]), strict=True))
    rows = [
        (name.replace("_by_", " by "), f"{row[0].real:.5g}", *(f"{abs(a):.4g}" for a in row[1 : _SHOWN + 1]))
        for name, row in entries[:MOST_LISTED]
    ]
    more = len(entries) - MOST_LISTED
    headings = ("gain", "mean", *(f"harmonic {k}" for k in range(1, _SHOWN + 1)))
    return table(
        "Gains, SI units", *headings, left=1, rows=rows, caption=f"and {more} more" if more > 0 else None
    )
