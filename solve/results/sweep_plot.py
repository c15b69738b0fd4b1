"""Pictures over speed: response, spectral radius and unstable bands."""

import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from solve.arrays import Array
from solve.results.plot import label_speeds, labelled, title_of
from solve.results.quantities import named, prefixed
from solve.results.style import BLACK, BLUE, GREEN, GREY, PURPLE, VERMILION, Axes, Figure, new_figure, styled
from solve.system import PeriodicSystem

KIND_COLORS = {"+1": VERMILION, "-1": PURPLE, "complex": GREEN}
"""Of unstable bands and boundaries by the multiplier that leaves the unit circle."""

KIND_NAMES = {"+1": "ρ = +1: period T", "-1": "ρ = −1: period 2T", "complex": "complex pair"}

_RPM = 30 / math.pi
_FLOOR = -80.0
"""Decibels at and below which a spectrum shows nothing."""

Edges = Iterable[tuple[float, float, str]]
"""Unstable bands: from, to (rad/s), kind."""


def sweep_figure(
    system: PeriodicSystem,
    speeds: Array,
    responses: Mapping[str, Array],
    radius: Array,
    figure: str = "max_abs",
    bands: Edges = (),
) -> Figure:
    """A row a quantity: its figure over speed with the maxima marked; below them the spectral radius.
    Bands are shaded."""
    order = np.argsort(speeds)
    rpm, bands = speeds[order] * _RPM, list(bands)
    with styled():
        made = new_figure(1.4 + 1.35 * (len(responses) + 1))
        made.suptitle(f"{title_of(system)}: response over speed", fontweight="bold")
        axes = made.subplots(len(responses) + 1, 1, sharex=True, squeeze=False)[:, 0]
        for place, (name, values) in zip(axes, responses.items(), strict=False):
            _draw_response(place, system, name, figure, rpm, values[order])
            _shade(place, bands)
        _draw_radius(axes[-1], rpm, radius[order], bands)
        made.align_ylabels(axes)
    return made


def waterfall_figure(system: PeriodicSystem, speeds: Array, name: str, amplitudes: Array) -> Figure:
    """Amplitudes (P, orders + 1) of a quantity over speed and order of rotation, 0 dB the largest."""
    order = np.argsort(speeds)
    rpm, heights = speeds[order] * _RPM, amplitudes[order, 1:].T
    rotation = 2 * math.pi / system.period
    largest = float(np.nanmax(heights, initial=0.0)) or 1.0
    factor, unit = prefixed(system.units.get(name, ""), largest)
    with np.errstate(divide="ignore"):
        decibels = 20 * np.log10(heights / largest)
    with styled():
        made = new_figure(4.4)
        made.suptitle(f"{title_of(system)}: spectrum of {name} over speed", fontweight="bold")
        axes = made.subplots()
        mesh = axes.pcolormesh(
            rpm,
            np.arange(1, len(heights) + 1) * rotation,
            np.where(decibels > _FLOOR, decibels, np.nan),
            cmap="magma_r",
            vmin=_FLOOR,
            vmax=0.0,
            shading="nearest",
            rasterized=True,
        )
        bar = made.colorbar(mesh, ax=axes, pad=0.02, fraction=0.05)
        bar.set_label(f"amplitude (dB re {largest * factor:.3g} {unit})", color=GREY)
        axes.set_title(system.meanings.get(name, ""), loc="left", color=GREY)
        axes.set_xlabel("speed (rpm)")
        axes.set_ylabel("order of rotation")
        axes.ticklabel_format(scilimits=(-3, 6))
        axes.grid(visible=False)
    return made


def _draw_response(
    axes: Axes, system: PeriodicSystem, name: str, figure: str, rpm: Array, values: Array
) -> None:
    factor, unit = prefixed(system.units.get(name, ""), float(np.nanmax(np.abs(values), initial=0.0)))
    axes.plot(rpm, values * factor, color=BLUE)
    known = np.where(np.isfinite(values), values, -np.inf)
    inner = known[1:-1]
    top = 1 + np.flatnonzero((inner > known[:-2]) & (inner >= known[2:]) & np.isfinite(inner))
    axes.plot(rpm[top], values[top] * factor, "v", color=BLUE)
    axes.set_ylabel(labelled(named(figure, name), unit))
    axes.set_title(system.meanings.get(name, ""), loc="left", color=GREY)


def radius_figure(system: PeriodicSystem, speeds: Array, radius: Array, bands: Edges) -> Figure:
    """The spectral radius over speed with the unstable bands shaded by their kind."""
    order, bands = np.argsort(speeds), list(bands)
    with styled():
        made = new_figure(2.9)
        made.suptitle(f"{title_of(system)}: unstable bands", fontweight="bold")
        _draw_radius(made.subplots(), speeds[order] * _RPM, radius[order], bands)
    return made


def _draw_radius(axes: Axes, rpm: Array, radius: Array, bands: list[tuple[float, float, str]]) -> None:
    axes.axhline(1.0, color=BLACK, linewidth=0.9)
    positive = np.where(radius > 0, radius, np.nan)
    axes.semilogy(rpm, positive, color=BLUE)
    if np.nanmin(positive, initial=1.0) > 0.1 and np.nanmax(positive, initial=1.0) < 10:
        axes.set_yscale("linear")
    axes.set_ylabel("spectral\nradius |ρ|")
    label_speeds(axes, rpm)
    _shade(axes, bands)
    if bands:
        axes.legend(loc="best")


def _shade(axes: Axes, bands: list[tuple[float, float, str]]) -> None:
    seen: set[str] = set()
    for low, high, kind in bands:
        style: dict[str, Any] = {"color": KIND_COLORS[kind], "alpha": 0.3, "linewidth": 0.8}
        if kind not in seen:
            style["label"] = KIND_NAMES[kind]
        seen.add(kind)
        axes.axvspan(low * _RPM, high * _RPM, **style)
