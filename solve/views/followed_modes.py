"""Figures and tables of followed modes, including a Campbell diagram with damping."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from solve.arrays import Array
from solve.labels import SPEED, unit_of
from solve.results.contents import MOST_SHOWN
from solve.results.followed_modes import CROSSING, FollowedModes, damping_ratios
from solve.views.panels import HEADROOM, MOST_CURVES, legend_above, panels_over, shades
from solve.views.show import figure, tables
from solve.views.style import BLACK, GREY, LIGHT, MANY, VERMILION, Axes, Figure
from solve.views.tables import MOST_ROWS, WIDEST, RenderableType, Table, table

_SIDEBAND = 0.1
"""Participation above which a side harmonic of a mode is drawn, as a thin line. Chosen by judgement."""

_LEAST_NAMED = 0.01
"""Participation above which tables list a harmonic. Chosen by judgement."""

_MOST_HARMONICS = 3
"""Maximum number of harmonics that tables name. Chosen by judgement."""


@figure.register(FollowedModes)
def followed_modes_figure(followed: FollowedModes) -> Figure:
    """Figure with the Campbell diagram of the unfolded frequencies, and with the damping ratios."""
    title, heights = "followed modes", (1.5, 1.0)
    with panels_over(followed.system, followed.values, title, 6.2, 2, followed.over, heights) as (
        page,
        (above, below),
    ):
        _draw_frequencies(above, followed)
        _draw_damping(below, followed)
        legend_above(above, 6)
    return page


def _draw_frequencies(axes: Axes, followed: FollowedModes) -> None:
    x, hertz = _places(followed, followed.path), np.abs(np.imag(followed.path_exponents)) / (2 * math.pi)
    top = HEADROOM * float(np.nanmax(hertz, initial=0.0))
    _draw_rays(axes, followed, top)
    for column, (label, style) in enumerate(zip(followed.labels, _styles(followed), strict=True)):
        _draw_sidebands(axes, followed, column, style)
        axes.plot(x, hertz[:, column], label=label, zorder=3, **style)
    for pair in followed.ambiguous:
        ends = _places(followed, np.array([pair.low, pair.high]))
        axes.axvspan(*ends, color=VERMILION, alpha=0.4)
    for meeting in followed.meetings:
        at = int(np.abs(followed.path - meeting.value).argmin())
        column = followed.mode(meeting.modes[0])
        face = "white" if meeting.kind == CROSSING else BLACK
        axes.plot(
            _places(followed, np.array([meeting.value])),
            hertz[at, column],
            "o",
            color=BLACK,
            markerfacecolor=face,
            zorder=4,
        )
    axes.set_ylim(0.0, top or 1.0)
    axes.set_ylabel("frequency (Hz)")
    axes.set_title("Campbell diagram", loc="left", color=GREY)


def _draw_sidebands(axes: Axes, followed: FollowedModes, column: int, style: dict[str, Any]) -> None:
    """Draw the other harmonics of a mode where their participation exceeds `_SIDEBAND`."""
    x, rotation = _places(followed, followed.values), followed.speeds * 2 * math.pi / followed.system.period
    shares = followed.participation[:, column].sum(axis=1)
    for number, harmonic in enumerate(followed.harmonics.tolist()):
        if harmonic:
            angular = np.abs(np.imag(followed.exponents[:, column]) + harmonic * rotation)
            seen = np.where(shares[:, number] >= _SIDEBAND, angular, np.nan) / (2 * math.pi)
            axes.plot(x, seen, **{**style, "linewidth": 0.6, "alpha": 0.7})


def _draw_rays(axes: Axes, followed: FollowedModes, top: float) -> None:
    """Draw the multiples of the speed as rays, up to the frequency `top`."""
    if followed.over != SPEED:
        return
    x = _places(followed, followed.values)
    turns = followed.speeds / followed.system.period
    most = int(top / turns.max()) if turns.max() > 0 else 0
    step = math.ceil(most / MOST_CURVES) or 1
    for order in range(step, most + 1, step):
        axes.plot(x, order * turns, color=LIGHT, linewidth=0.7, zorder=1)
        axes.annotate(str(order), (x[-1], order * turns[-1]), color=GREY, fontsize=7, va="center")


def _draw_damping(axes: Axes, followed: FollowedModes) -> None:
    x, ratios = (
        _places(followed, followed.path),
        100 * damping_ratios(followed.path_exponents, followed.resolution),
    )
    for column, style in enumerate(_styles(followed)):
        axes.plot(x, ratios[:, column], **style)
    axes.axhline(0.0, color=BLACK, linewidth=0.8)
    axes.set_ylabel("damping ratio (%)")


def _places(followed: FollowedModes, values: Array) -> Array:
    """Values of the varied quantity in the displayed unit."""
    return unit_of(followed.system, followed.over).from_si(values)


def _styles(followed: FollowedModes) -> Sequence[dict[str, Any]]:
    """Return the line style of each mode."""
    count = len(followed.labels)
    return [{"color": color} for color in MANY[:count]] if count <= len(MANY) else shades(count)


@tables.register(FollowedModes)
def followed_modes_tables(followed: FollowedModes) -> Sequence[RenderableType]:
    """Tables of frequencies and damping versus the varied quantity; of the strongest harmonics; and of
    crossings, veerings and ambiguous pairs."""
    printed: list[RenderableType] = [_frequency_table(followed), _mode_table(followed)]
    if followed.meetings or followed.ambiguous:
        printed.append(_meeting_table(followed))
    return printed


def _frequency_table(followed: FollowedModes) -> Table:
    """Return a table of the frequencies and damping ratios of the first modes, with one row per value."""
    shown = range(min(len(followed.labels), MOST_SHOWN - 1))
    unit = unit_of(followed.system, followed.over)
    step = math.ceil(len(followed.values) / MOST_ROWS)
    hertz = followed.frequencies / (2 * math.pi)
    rows = [
        [f"{unit.from_si(float(followed.values[row])):.6g}"]
        + [
            "–" if np.isnan(hertz[row, k]) else f"{hertz[row, k]:.5g}  {100 * followed.damping[row, k]:.3f}"
            for k in shown
        ]
        for row in range(0, len(followed.values), step)
    ]
    headings = [unit.name if followed.over == SPEED else followed.over]
    headings += [f"mode {followed.labels[k]}" for k in shown]
    more = len(followed.labels) - len(shown)
    caption = f"and {more} further modes" if more else None
    return table("Frequency in Hz and damping ratio in %", *headings, left=0, rows=rows, caption=caption)


def _mode_table(followed: FollowedModes) -> Table:
    """Return a table with one row per mode: its least damping ratio, and its largest harmonics at the first
    value with a result."""
    unit, rows, coordinates = unit_of(followed.system, followed.over), [], followed.system.coordinates
    for column, label in enumerate(followed.labels):
        ratios = followed.damping[:, column]
        if np.isnan(ratios).all():
            continue
        least, first = int(np.nanargmin(ratios)), int(np.argmin(np.isnan(ratios)))
        parts = followed.participation[first, column]
        largest = np.argsort(-parts, axis=None, kind="stable")[:_MOST_HARMONICS]
        names = [
            f"{coordinates[row]}[{followed.harmonics[number]:+d}] {100 * parts[row, number]:.0f} %"
            for row, number in zip(*np.unravel_index(largest, parts.shape), strict=True)
            if parts[row, number] >= _LEAST_NAMED
        ]
        place = f"{unit.from_si(float(followed.values[least])):.6g}"
        while len(", ".join(names)) > WIDEST and len(names) > 1:
            names.pop()
        rows.append((label, f"{100 * ratios[least]:.3f}", place, ", ".join(names)))
    headings = "mode", "least ζ (%)", "at", "participation"
    caption = (
        f"at: {unit.name or followed.over} of the least damping ratio ζ\n"
        "participation at the first value: coordinate[harmonic of the mode]"
    )
    return table("Modes", *headings, rows=rows, caption=caption)


def _meeting_table(followed: FollowedModes) -> Table:
    """Return a table with one row per crossing, veering or ambiguous pair."""
    unit = unit_of(followed.system, followed.over)
    rows = [
        (
            meeting.kind,
            " and ".join(meeting.modes),
            f"{unit.from_si(meeting.value):.8g}",
            f"{meeting.gap:.4g}",
        )
        for meeting in followed.meetings
    ]
    rows += [
        (f"ambiguous: {pair.kind}", " and ".join(pair.modes), f"{unit.from_si(pair.low):.8g}", "–")
        for pair in followed.ambiguous
    ]
    shown = rows[:MOST_ROWS]
    caption = f"veerings narrower than {followed.resolution:.1e} rad/s appear as crossings"
    if len(rows) > len(shown):
        caption = f"and {len(rows) - len(shown)} more; {caption}"
    headings = "", "modes", unit.name or followed.over, "gap (rad/s)"
    return table("Crossings and veerings", *headings, left=2, rows=shown, caption=caption)
