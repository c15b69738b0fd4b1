"""Pictures of critical speeds: response, dominant multiplier, Campbell diagram."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from solve.arrays import Array
from solve.results.plot import labelled, title_of
from solve.results.quantities import prefixed
from solve.results.style import BLACK, BLUE, GREEN, GREY, LIGHT, ORANGE, VERMILION, new_figure, styled
from solve.system import PeriodicSystem

_RPM = 30 / math.pi
_MOST_DECADES = 1e3
"""Ratio of a response over speed from which its axis is logarithmic."""

_HEADROOM = 1.15


class Curves(NamedTuple):
    """Over speeds (P,), rising, in rad/s: the response and its label, the dominant multiplier's real part
    and modulus, whether it is unstable, mean frequencies (P, n)."""

    speeds: Array
    response: Array
    quantity: str
    figure: str
    real_part: Array
    radius: Array
    unstable: Array
    frequencies: Array


class Marks(NamedTuple):
    """Critical speeds (rad/s): maxima of the response and of the multiplier, with their heights, and
    integer divisions with mode and order."""

    responses: Sequence[tuple[float, float]]
    multipliers: Sequence[tuple[float, float]]
    divisions: Sequence[tuple[float, int, int]]


def critical_figure(system: PeriodicSystem, curves: Curves, marks: Marks) -> Figure:
    """Response with its maxima, the dominant multiplier with its maxima, and the Campbell diagram."""
    with styled():
        figure = new_figure(7.6)
        figure.suptitle(f"{title_of(system)}: critical speeds", fontweight="bold")
        response, multiplier, campbell = figure.subplots(3, 1, sharex=True, height_ratios=(1.1, 0.9, 1.3))
        _draw_response(response, system, curves, marks)
        _draw_multiplier(multiplier, curves, marks)
        _draw_campbell(campbell, curves, marks)
        for axes in (response, multiplier):
            _shade(axes, curves)
        campbell.set_xlabel("speed (rpm)")
        campbell.set_xlim(curves.speeds[0] * _RPM, curves.speeds[-1] * _RPM)
        campbell.ticklabel_format(axis="x", scilimits=(-3, 6))
        figure.align_ylabels()
    return figure


def campbell_figure(system: PeriodicSystem, curves: Curves, marks: Marks) -> Figure:
    """The Campbell diagram alone."""
    with styled():
        figure = new_figure(3.8)
        figure.suptitle(f"{title_of(system)}: Campbell diagram", fontweight="bold")
        axes = figure.subplots()
        _draw_campbell(axes, curves, marks)
        axes.set_xlabel("speed (rpm)")
        axes.set_xlim(curves.speeds[0] * _RPM, curves.speeds[-1] * _RPM)
    return figure


def _draw_response(axes: Axes, system: PeriodicSystem, curves: Curves, marks: Marks) -> None:
    known = np.abs(curves.response[np.isfinite(curves.response)])
    largest = float(known.max(initial=0.0))
    factor, unit = prefixed(system.units.get(curves.quantity, ""), largest)
    speeds, response = _through(curves.speeds, curves.response, marks.responses)
    axes.plot(speeds * _RPM, response * factor, color=BLUE)
    if largest > _MOST_DECADES * float(known.min(initial=largest)) > 0:
        axes.set_yscale("log")
    _draw_marks(axes, marks.responses, factor, BLUE)
    name = curves.quantity
    axes.set_ylabel(
        labelled(f"max|{name}|" if curves.figure == "max_abs" else f"{curves.figure} {name}", unit)
    )
    axes.set_title(system.meanings.get(name, ""), loc="left", color=GREY)


def _draw_multiplier(axes: Axes, curves: Curves, marks: Marks) -> None:
    """Real part of the dominant multiplier on a scale of sign and root, which shows small ones too."""
    power = 0.25

    def rooted(values: Array) -> Array:
        return np.sign(values) * np.abs(values) ** power

    speeds, real_part = _through(curves.speeds, curves.real_part, marks.multipliers)
    axes.plot(speeds * _RPM, rooted(real_part), color=VERMILION, linewidth=0.9)
    for sign in (1, -1):
        axes.plot(
            curves.speeds * _RPM, sign * rooted(curves.radius), color=GREY, linewidth=0.7, linestyle=":"
        )
    _draw_marks(
        axes, [(speed, float(rooted(np.array(height)))) for speed, height in marks.multipliers], 1, VERMILION
    )
    reach = float(np.nanmax(curves.radius, initial=1e-12))
    ticks = [size for size in 10.0 ** np.arange(-12, 4) if 1e-4 * reach < size <= 1.3 * reach][-3:]
    places = [0.0, *ticks, *(-size for size in ticks)]
    axes.set_yticks([float(rooted(np.array(place))) for place in places], [f"{place:g}" for place in places])
    axes.set_ylabel("Re ρ, and\n±|ρ| (dots)")
    axes.set_title("dominant Floquet multiplier", loc="left", color=GREY)


def _draw_campbell(axes: Axes, curves: Curves, marks: Marks) -> None:
    rpm = curves.speeds * _RPM
    orders = sorted({order for *_, order in marks.divisions})
    shown = sorted({mode for _, mode, _ in marks.divisions}) or [1]
    top = _HEADROOM * float(np.nanmax(curves.frequencies[:, [mode - 1 for mode in shown]])) / (2 * math.pi)
    for order in orders:
        rays = order * curves.speeds / (2 * math.pi)
        axes.plot(rpm, rays, color=LIGHT if order % 5 else GREY, linewidth=0.7, zorder=1)
        at = min(rpm[-1], top * 60 / order)
        if order <= 12 or order % 5 == 0:
            axes.annotate(
                str(order),
                (at, at * order / 60),
                color=GREY,
                fontsize=7,
                ha="right",
                va="top",
                annotation_clip=True,
            )
    for mode in shown:
        axes.plot(rpm, curves.frequencies[:, mode - 1] / (2 * math.pi), color=BLACK, zorder=3)
    for speed, _, order in marks.divisions:
        axes.plot(speed * _RPM, order * speed / (2 * math.pi), "o", color=GREEN, zorder=4)
    axes.set_ylim(0.0, top)
    axes.yaxis.set_major_locator(MaxNLocator(6))
    axes.set_ylabel("mean natural\nfrequency (Hz)")
    axes.set_title("Campbell diagram: orders of rotation, integer divisions", loc="left", color=GREY)


def _through(speeds: Array, values: Array, marks: Sequence[tuple[float, float]]) -> tuple[Array, Array]:
    """The curve's points and the maxima between them, by rising speed."""
    at, heights = np.array([*zip(speeds, values, strict=True), *marks]).T
    order = np.argsort(at)
    return at[order], heights[order]


def _draw_marks(axes: Axes, marks: Sequence[tuple[float, float]], factor: float, color: str) -> None:
    for speed, height in marks:
        axes.plot(speed * _RPM, height * factor, "v", color=color, markersize=4.5, zorder=4)


def _shade(axes: Axes, curves: Curves) -> None:
    """Unstable speeds."""
    if not curves.unstable.any():
        return
    rpm = curves.speeds * _RPM
    axes.fill_between(
        rpm,
        0,
        1,
        where=curves.unstable.tolist(),
        transform=axes.get_xaxis_transform(),
        color=ORANGE,
        alpha=0.3,
        linewidth=0,
    )
    axes.legend(
        handles=[Line2D([], [], color=ORANGE, linewidth=6, alpha=0.3, label="unstable")], loc="upper left"
    )
