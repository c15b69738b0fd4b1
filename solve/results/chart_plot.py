"""Stability charts: the spectral radius over two quantities, with named boundaries."""

import textwrap
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, TwoSlopeNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from solve.arrays import Array
from solve.loading import Model
from solve.results.plot import title_of
from solve.results.style import BLACK, GREY, new_figure, styled
from solve.results.sweep_plot import KIND_NAMES
from solve.system import PeriodicSystem

_LINES = {"+1": "-", "-1": (0, (5, 2)), "complex": (0, (1, 1.2))}
_COLORS = LinearSegmentedColormap.from_list(
    "stability", ["#1F4E79", "#5B9BD5", "#C9DFF2", "#FFFFFF", "#FBCDB0", "#DD6B20", "#8A2A06"]
)
_MOST_DECAY = 4.0
"""Growth exponents a period below minus this, and above it, look alike."""

_LABEL = 48
"""Characters a line of a label."""

_RPM = 30 / np.pi


class Axis(NamedTuple):
    """A quantity of a chart: its name, and values in SI units."""

    name: str
    values: Array


class Curve(NamedTuple):
    """A boundary: which multiplier leaves the unit circle, and points (k, 2)."""

    kind: str
    points: Array


def chart_figure(
    system: PeriodicSystem, x: Axis, y: Axis, radius: Array, boundaries: Sequence[Curve]
) -> Figure:
    """Growth ln|ρ| a period over x and y, radius (ny, nx), and the boundaries between stable and unstable;
    speeds in rpm."""
    with styled():
        figure = new_figure(4.6)
        figure.suptitle(f"{title_of(system)}: stability", fontweight="bold")
        axes = figure.subplots()
        _draw_growth(figure, axes, x, y, radius)
        for kind, points in boundaries:
            scaled = points * [_factor(x), _factor(y)]
            axes.plot(*scaled.T, color=BLACK, linestyle=_LINES[kind], linewidth=1.1)
        kinds = [kind for kind in KIND_NAMES if any(curve.kind == kind for curve in boundaries)]
        if kinds:
            keys = [Line2D([], [], color=BLACK, linestyle=_LINES[kind], linewidth=1.1) for kind in kinds]
            names = [f"boundary {KIND_NAMES[kind]}" for kind in kinds]
            figure.legend(keys, names, loc="outside lower center", ncols=len(keys), handlelength=3)
        for axis, set_label, set_limits in (
            (x, axes.set_xlabel, axes.set_xlim),
            (y, axes.set_ylabel, axes.set_ylim),
        ):
            set_label(_label(system, axis))
            set_limits(axis.values[0] * _factor(axis), axis.values[-1] * _factor(axis))
        axes.ticklabel_format(scilimits=(-3, 6))
        axes.grid(visible=False)
    return figure


def _draw_growth(figure: Figure, axes: Axes, x: Axis, y: Axis, radius: Array) -> None:
    with np.errstate(divide="ignore"):
        growth = np.clip(np.log(radius), -_MOST_DECAY, _MOST_DECAY)
    low, high = min(np.nanmin(growth), -1e-3), max(np.nanmax(growth), 1e-3)
    axes.set_facecolor("#EEEEEE")
    mesh = axes.pcolormesh(
        x.values * _factor(x),
        y.values * _factor(y),
        growth,
        cmap=_COLORS,
        norm=TwoSlopeNorm(0.0, low if low < -1e-2 else -high, high),
        shading="nearest",
        rasterized=True,
    )
    bar = figure.colorbar(mesh, ax=axes, pad=0.02, fraction=0.05)
    if low >= -1e-2:
        bar.ax.set_ylim(0.0, high)
    else:
        bar.set_ticks([*_ticks(low)[:-1], *_ticks(high)])
    bar.set_label("growth a period, ln |ρ|", color=GREY)
    bar.outline.set_linewidth(0.5)  # type: ignore[operator]


def _ticks(end: float) -> list[float]:
    """Round values between 0 and the end of one side of the colours, rising."""
    values = MaxNLocator(4, steps=[1, 2, 5, 10]).tick_values(min(end, 0.0), max(end, 0.0))
    return [float(value) for value in values if min(end, 0.0) <= value <= max(end, 0.0)]


def _factor(axis: Axis) -> float:
    return _RPM if axis.name == "speed" else 1.0


def _label(system: PeriodicSystem, axis: Axis) -> str:
    if axis.name == "speed":
        return "speed (rpm)"
    if isinstance(system, Model):
        for name, unit, meaning, _ in system.module.PARAMETERS:
            if name == axis.name:
                label = f"{name} ({unit.replace('^2', '²')})" if unit != "1" else name
                return "\n".join(textwrap.wrap(f"{label}: {meaning}", _LABEL))
    return axis.name
