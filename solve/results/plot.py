"""Pictures of one solution: time curves, spectra, multipliers."""

import math
import textwrap
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.patches import Circle
from matplotlib.ticker import MaxNLocator, MultipleLocator

from solve.arrays import Array
from solve.loading import Model
from solve.results.orbit import Orbit, Turn
from solve.results.quantities import prefixed
from solve.results.rows import checked_scale, shown
from solve.results.stability import Stability
from solve.results.style import BLACK, BLUE, GREY, VERMILION, new_figure, styled
from solve.system import PeriodicSystem

_ROW_HEIGHTS = (1.55, 1.55, 1.55, 1.35, 1.2, 1.1)
"""Inches, by the number of rows: one page holds them all."""

_CIRCLE_ROW = 2.45
_DB_FLOOR = -120.0
_VISIBLE = 4e-3
"""Part of the largest amplitude below which a linear spectrum shows nothing."""

_CROWDED = 80
"""Orders above which their lines are thin and have no heads."""

_TITLE = 46
"""Characters that fit above a panel."""

_CLOSER = 0.4
"""Spectral radius below which multipliers get a second, closer view."""


def orbit_figure(
    orbit: Orbit,
    names: Sequence[str] | None = None,
    quasi_static: bool = False,
    scale: str = "linear",
    harmonics: int | None = None,
) -> Figure:
    """Time curve over one period and spectrum of each name (by default the coordinates), multipliers.

    quasi_static draws the kinetostatic solution beside. scale of the spectra is "linear" or "dB", 0 dB
    the largest amplitude; up to `harmonics` orders, by default all that can be seen. Raises
    UnknownNameError, ValueOutOfBoundsError.
    """
    checked_scale(scale)
    rows = shown(orbit.system, names)
    heights = [0.95 + _ROW_HEIGHTS[len(rows) - 1] * len(rows), _CIRCLE_ROW]
    with styled():
        figure = new_figure(sum(heights))
        grid = figure.add_gridspec(2, 1, height_ratios=heights)
        upper, lower = figure.add_subfigure(grid[0]), figure.add_subfigure(grid[1])
        figure.suptitle(titled(orbit), fontweight="bold")
        axes = upper.subplots(len(rows), 2, sharex="col", squeeze=False, width_ratios=(1.2, 1))
        orders = _orders(orbit, rows, harmonics, scale)
        for (left, right), name in zip(axes, rows, strict=True):
            _draw_curve(left, orbit, name, quasi_static)
            _draw_spectrum(right, orbit, name, orders, scale)
        _label_columns(axes, orbit, quasi_static)
        upper.align_ylabels()
        _draw_stability(lower, orbit)
    return figure


def stability_figure(result: Stability) -> Figure:
    """Multipliers on the unit circle, and a closer look at small ones."""
    with styled():
        figure = new_figure(_CIRCLE_ROW + 0.4)
        figure.suptitle(titled(result), fontweight="bold")
        _draw_stability(figure, result)
    return figure


def titled(result: Stability) -> str:
    """Model, case and speed."""
    return f"{title_of(result.system)}, {result.speed * 30 / math.pi:.6g} rpm"


def title_of(system: PeriodicSystem) -> str:
    """Model and case."""
    case = f", case {system.case}" if isinstance(system, Model) and system.case else ""
    return f"{system.name.replace('_', ' ')}{case}"


def _draw_curve(axes: Axes, orbit: Orbit, name: str, quasi_static: bool) -> None:
    period = orbit.system.period
    phase = np.linspace(0.0, period, orbit.samples + 1)
    curves: list[tuple[Array, dict[str, Any]]] = [
        (orbit.signal(name)(phase), {"color": BLUE, "label": "dynamic"})
    ]
    if quasi_static:
        style = {"color": VERMILION, "linestyle": (0, (4, 2)), "linewidth": 1.0, "label": "quasi-static"}
        curves.append((orbit.quasi_static.signal(name)(phase), style))
    factor, unit = prefixed(orbit.system.units.get(name, ""), max(np.abs(y).max() for y, _ in curves))
    for values, style in curves:
        axes.plot(np.degrees(phase), factor * values, **style)
    axes.set_xlim(0.0, math.degrees(period))
    axes.margins(y=0.08)
    axes.set_ylabel(labelled(name, unit))
    meaning = textwrap.shorten(orbit.system.meanings.get(name, ""), _TITLE, placeholder=" …")
    axes.set_title(meaning, loc="left", color=GREY)


def labelled(name: str, unit: str) -> str:
    """A label of few characters a line, the unit in brackets."""
    lines = textwrap.wrap(name.replace("_", " "), 12)
    if unit and len(lines) == 1 and len(lines[0] + unit) < 9:
        return f"{lines[0]} ({unit})"
    return "\n".join([*lines, f"({unit})"] if unit else lines)


def _orders(turn: Turn, names: Sequence[str], most: int | None, scale: str) -> Array:
    """Harmonics to draw: up to the last that can be seen in any of the spectra."""
    least = 10 ** (_DB_FLOOR / 20) if scale == "dB" else _VISIBLE
    most = most or turn.samples // 8
    last = 0
    for name in names:
        amplitudes = turn.harmonics(name, most)[0][1:]
        last = max(last, *np.flatnonzero(amplitudes > least * amplitudes.max()), 0)
    return np.arange(1, min(most, max(10, last + 2)) + 1)


def _draw_spectrum(axes: Axes, orbit: Orbit, name: str, k: Array, scale: str) -> None:
    amplitudes = orbit.harmonics(name, int(k[-1]))[0][k]
    largest = amplitudes.max()
    factor, unit = prefixed(orbit.system.units.get(name, ""), largest)
    order = k * (2 * math.pi / orbit.system.period)
    if scale == "dB":
        with np.errstate(divide="ignore"):
            heights, foot = 20 * np.log10(amplitudes / largest if largest else amplitudes), _DB_FLOOR
        axes.set_ylim(_DB_FLOOR, 8.0)
        axes.set_ylabel(f"dB re {largest * factor:.3g} {unit}")
        axes.yaxis.set_major_locator(MultipleLocator(40))
    else:
        heights, foot = amplitudes * factor, 0.0
        axes.set_ylim(0.0, 1.12 * largest * factor or 1.0)
        axes.set_ylabel(labelled("amplitude", unit))
    seen = heights > foot + (0.0 if scale == "dB" else _VISIBLE * largest * factor)
    crowded = len(k) > _CROWDED
    axes.vlines(order[seen], foot, heights[seen], color=BLUE, linewidth=0.6 if crowded else 1.0)
    if not crowded:
        axes.plot(order[seen], heights[seen], "o", color=BLUE, markersize=2.5)
    axes.set_xlim(0.0, order[-1] + order[0] / 2)
    axes.grid(visible=False, axis="x")


def _label_columns(axes: Any, orbit: Orbit, quasi_static: bool) -> None:
    """Phase and order below, time and hertz above."""
    left, right = axes[-1]
    turn = math.degrees(orbit.system.period)
    left.xaxis.set_major_locator(MultipleLocator(45.0 if math.isclose(turn, 360.0) else turn / 6))
    left.xaxis.set_major_formatter("{x:g}")
    left.set_xlabel("phase (°)")
    right.xaxis.set_major_locator(MaxNLocator(8, integer=True))
    right.set_xlabel("order of rotation")
    factor, unit = prefixed("s", orbit.period)
    degrees = math.radians(1.0) / orbit.speed * factor
    hertz = orbit.speed / (2 * math.pi)
    for top, scale, label in ((axes[0, 0], degrees, f"time ({unit})"), (axes[0, 1], hertz, "frequency (Hz)")):
        second = top.secondary_xaxis("top", functions=(lambda x, s=scale: x * s, lambda x, s=scale: x / s))
        second.set_xlabel(label, loc="right")
    if quasi_static:
        upper = axes[0, 0].get_ylim()[1]
        axes[0, 0].set_ylim(top=upper + 0.25 * (upper - axes[0, 0].get_ylim()[0]))
        axes[0, 0].legend(loc="upper right", ncols=2)


def _draw_stability(place: Figure | SubFigure, result: Stability) -> None:
    rho, radius = result.multipliers, result.spectral_radius
    closer = 0.0 < radius < _CLOSER
    panels = place.subplots(1, 3 if closer else 2, width_ratios=(1, 1, 0.75) if closer else (1, 1.75))
    _draw_multipliers(panels[0], rho, max(1.0, radius))
    panels[0].add_patch(Circle((0, 0), 1.0, fill=False, color=BLACK, linewidth=0.9))
    panels[0].set_title("Floquet multipliers", loc="left", color=GREY)
    if closer:
        power = math.floor(math.log10(radius)) if radius < 0.1 else 0
        unit = f" ($10^{{{power}}}$)" if power else ""
        _draw_multipliers(panels[1], rho / 10.0**power, radius / 10.0**power, unit)
        panels[1].add_patch(
            Circle((0, 0), radius / 10.0**power, fill=False, color=GREY, linewidth=0.8, linestyle="--")
        )
        panels[1].set_title("closer, within the largest", loc="left", color=GREY)
    _write_summary(panels[-1], result)


def _draw_multipliers(axes: Axes, rho: Array, reach: float, unit: str = "") -> None:
    axes.axhline(0.0, color=GREY, linewidth=0.5)
    axes.axvline(0.0, color=GREY, linewidth=0.5)
    dots = {"color": BLUE, "markersize": 4.5, "markeredgecolor": "white", "markeredgewidth": 0.5}
    axes.plot(np.real(rho), np.imag(rho), "o", **dots)
    for axis, set_limits in ((axes.xaxis, axes.set_xlim), (axes.yaxis, axes.set_ylim)):
        set_limits(-1.15 * reach, 1.15 * reach)
        axis.set_major_locator(MaxNLocator(5, symmetric=True))
    axes.set_aspect("equal")
    axes.set_xlabel(f"Re ρ{unit}")
    axes.set_ylabel(f"Im ρ{unit}")


def _write_summary(axes: Axes, result: Stability) -> None:
    orbit, multipliers = result.error_estimate
    lines = [
        f"|ρ| max = {result.spectral_radius:.6g}",
        f"{result.method}, {result.steps} steps",
        f"error of multipliers {multipliers:.0e}",
    ]
    if isinstance(result, Orbit):
        lines.append(f"error of orbit {orbit:.0e}")
    place: dict[str, Any] = {"va": "top", "transform": axes.transAxes}
    axes.axis("off")
    axes.text(
        0.0, 1.0, result.verdict, fontweight="bold", color=BLACK if result.stable else VERMILION, **place
    )
    axes.text(0.0, 0.88, "\n".join(lines), linespacing=1.6, **place)
