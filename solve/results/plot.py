"""Pictures of one solution: time curves, spectra, multipliers."""

import math
import textwrap
from collections.abc import Callable, Hashable, Mapping, Sequence
from typing import Any, NamedTuple, TypeVar

import numpy as np

from solve.arrays import Array
from solve.errors import ValueOutOfBoundsError
from solve.labels import SPEED
from solve.results.quantities import greek, headed, named, prefixed
from solve.results.style import BLACK, BLUE, GREY, VERMILION, Axes, Figure, SubFigure, page
from solve.system import PeriodicSystem
from solve.units import raised

_ROW_HEIGHTS = (1.55, 1.55, 1.55, 1.35, 1.2, 1.1)
"""Inches, by the number of rows: one page holds them all."""

_CIRCLE_ROW = 2.45
_DB_FLOOR = -120.0
Value = TypeVar("Value", bound=Hashable)

_VISIBLE = 4e-3
"""Part of the largest amplitude below which a linear spectrum shows nothing."""

_CROWDED = 80
"""Orders above which their lines are thin and have no heads."""

_TITLE = 46
"""Characters that fit above a panel."""

_BETWEEN = 16
"""Parts in which a curve is drawn between two of its points."""

_DASHES = ((), (5, 1.5), (1.5, 1.2), (6, 1.5, 1.5, 1.5))
_LIGHTEST = 0.8
"""Place in the colour map beyond which lines fade into the page."""

_FEW = 60
"""Points of a curve up to which they are marked."""

_LABEL = 54
"""Characters a line of a label."""

_CLOSER = 0.4
"""Spectral radius below which multipliers get a second, closer view."""

MOST_SHOWN = len(_ROW_HEIGHTS)
"""Quantities of one picture, and coordinates beside each other in tables and sentences."""

SCALES = ("linear", "dB")


class Motion(NamedTuple):
    """A quantity over one period: values (k,) at evenly spaced phases, both ends included, those of another
    solution where one is drawn beside, and amplitudes (m + 1,) from the mean on."""

    values: Array
    beside: Array | None
    amplitudes: Array


class StabilityPanel(NamedTuple):
    """Floquet multipliers (k,), the verdict, and lines that say how they were found."""

    multipliers: Array
    verdict: str
    lines: Sequence[str]


def orbit_figure(
    system: PeriodicSystem,
    speed: float,
    motions: Mapping[str, Motion],
    panel: StabilityPanel | None,
    scale: str,
    label: str,
    beside: str,
) -> Figure:
    """Time curve over one period and spectrum of each quantity, multipliers unless nothing vibrates; speed in
    rad/s. label and beside name the solution and the one beside it.

    scale of the spectra is "linear" or "dB", 0 dB the largest amplitude; orders up to the last that can
    be seen.
    """
    heights = [0.95 + _ROW_HEIGHTS[len(motions) - 1] * len(motions), _CIRCLE_ROW][: 1 + (panel is not None)]
    with page(sum(heights), titled(system, speed)) as figure:
        grid = figure.add_gridspec(len(heights), 1, height_ratios=heights)
        upper, *lower = (figure.add_subfigure(grid[row]) for row in range(len(heights)))
        axes = upper.subplots(len(motions), 2, sharex="col", squeeze=False, width_ratios=(1.2, 1))
        orders = _orders(motions, scale)
        for (left, right), (name, motion) in zip(axes, motions.items(), strict=True):
            scaled = _draw_curve(left, system, name, motion, (label, beside))
            _draw_spectrum(right, system, scaled, motion.amplitudes[orders], orders, scale)
        _label_columns(axes, system, speed)
        if any(motion.beside is not None for motion in motions.values()):
            low, high = axes[0, 0].get_ylim()
            axes[0, 0].set_ylim(top=high + 0.25 * (high - low))
            axes[0, 0].legend(loc="upper right", ncols=2)
        upper.align_ylabels()
        if panel is not None:
            _draw_stability(lower[0], panel)
    return figure


def stability_figure(system: PeriodicSystem, speed: float, panel: StabilityPanel) -> Figure:
    """Multipliers on the unit circle, and a closer look at small ones."""
    with page(_CIRCLE_ROW + 0.4, titled(system, speed)) as figure:
        _draw_stability(figure, panel)
    return figure


def shown(system: PeriodicSystem, names: Sequence[str] | None) -> list[str]:
    """The names to show: those given, or the first coordinates. Raises UnknownNameError, and
    ValueOutOfBoundsError for more rows than a page holds."""
    if not names:
        return list((system.coordinates or system.outputs)[:MOST_SHOWN])
    known = system.known_quantities(names)
    if len(known) > MOST_SHOWN:
        raise ValueOutOfBoundsError(
            f"{len(known)} quantities to show; allowed: up to {MOST_SHOWN} in one picture"
        )
    return list(known)


def titled(system: PeriodicSystem, speed: float) -> str:
    """Model, case and speed."""
    return f"{title_of(system)}, {system.speed_unit.text(speed)}"


def told_apart(values: Sequence[Value], words: Callable[[Value, str], str]) -> Sequence[str]:
    """Each of the values in words, in the shortest of a few forms of numbers in which different ones differ.

    >>> told_apart([1.0, 1.00000002], lambda value, form: f"{value:{form}}")
    ['1', '1.00000002']
    """
    different, found = len(set(values)), []
    for form in (".6g", ".10g", ".17g"):
        found = [words(value, form) for value in values]
        if len(set(found)) >= different:
            break
    return found


def title_of(system: PeriodicSystem) -> str:
    """Model and case."""
    case = f", case {system.case}" if system.case else ""
    return f"{system.name.replace('_', ' ')}{case}"


def _draw_curve(
    axes: Axes, system: PeriodicSystem, name: str, motion: Motion, labels: tuple[str, str]
) -> tuple[float, str]:
    """Draw it; the factor and the unit, which its spectrum shares."""
    degrees = np.linspace(0.0, math.degrees(system.period), len(motion.values))
    curves: list[tuple[Array, dict[str, Any]]] = [(motion.values, {"color": BLUE, "label": labels[0]})]
    if motion.beside is not None:
        style = {"color": VERMILION, "linestyle": (0, (4, 2)), "linewidth": 1.0, "label": labels[1]}
        curves.append((motion.beside, style))
    factor, unit = prefixed(system.units.get(name, ""), max(np.abs(y).max() for y, _ in curves))
    for values, style in curves:
        axes.plot(degrees, factor * values, **style)
    axes.set_xlim(0.0, math.degrees(system.period))
    axes.margins(y=0.08)
    axes.set_ylabel(labelled(name, unit))
    meaning = textwrap.shorten(system.meanings.get(name, ""), _TITLE, placeholder=" …")
    axes.set_title(meaning, loc="left", color=GREY)
    return factor, unit


def draw_map(figure: Figure, axes: Axes, x: Array, y: Array, z: Array, label: str, **colours: Any) -> None:
    """Values z (ny, nx) as colours over x and y, and their scale beside."""
    mesh = axes.pcolormesh(x, y, z, shading="nearest", rasterized=True, **colours)
    bar = figure.colorbar(mesh, ax=axes, pad=0.02, fraction=0.05)
    bar.set_label(label, color=GREY)
    axes.ticklabel_format(scilimits=(-3, 6))
    axes.grid(visible=False)


def axis_label(system: PeriodicSystem, name: str) -> str:
    """A parameter or the speed with its unit and meaning."""
    label = headed(name, system.unit_of(name).name)
    _, meaning = system.parameter_labels.get(name, ("", ""))
    return "\n".join(textwrap.wrap(f"{label}: {meaning}" if meaning else label, _LABEL))


def label_speeds(axes: Axes, system: PeriodicSystem, values: Array, name: str = SPEED) -> None:
    """The horizontal axis of rising speeds (k,) in rad/s, or of values of a parameter."""
    shown = system.unit_of(name).of(values)
    if shown[0] < shown[-1]:
        axes.set_xlim(shown[0], shown[-1])
    axes.set_xlabel(axis_label(system, name))
    axes.ticklabel_format(axis="x", scilimits=(-3, 6))


def label_phases(axes: Axes, period: float) -> None:
    """The horizontal axis of phases in degrees over a period in rad."""
    from matplotlib.ticker import MultipleLocator

    axes.set_xlim(0.0, math.degrees(period))
    axes.xaxis.set_major_locator(MultipleLocator(math.degrees(period) / 12))
    axes.set_xlabel("phase (°)")


def through(x: Array, y: Array) -> tuple[Array, Array]:
    """Further points of a curve over x (k,), in any order, between its own: monotone cubics (F. Fritsch, R.
    Carlson, SIAM J. Numer. Anal. 17 (1980) 238-246), which make no extreme that is not a point; gaps of NaN
    stay."""
    from scipy.interpolate import PchipInterpolator

    parts, (x, first) = [], np.unique(x, return_index=True)
    y = np.where(np.isfinite(y), y, np.nan)[first]
    for part in np.split(np.arange(len(x)), np.flatnonzero(np.diff(np.isfinite(y))) + 1):
        at, values = x[part], y[part]
        if np.isfinite(values).all() and len(part) > 1:
            fine = np.interp(
                np.linspace(0, len(part) - 1, _BETWEEN * (len(part) - 1) + 1), part - part[0], at
            )
            at, values = fine, PchipInterpolator(at, values)(fine)
        parts.append((at, values))
    return np.concatenate([at for at, _ in parts]), np.concatenate([values for _, values in parts])


def draw_through(axes: Axes, x: Array, y: Array, by_logarithm: bool = False, **style: Any) -> None:
    """A curve over x (k,) `through` its points, or `by_logarithm` of positive ones; where these are few they
    are marked."""
    with np.errstate(divide="ignore"):
        fine, values = through(x, np.log(y) if by_logarithm else y)
    axes.plot(fine, np.exp(values) if by_logarithm else values, **style)
    if len(x) <= _FEW:
        dots = {"color": style.get("color"), "markersize": 3.5, "zorder": 3}
        axes.plot(x, y, ".", **dots)


def shades(count: int) -> list[dict[str, Any]]:
    """Colours and dashes of several curves, the first darkest, that differ on a black and white print too."""
    import matplotlib

    colours = matplotlib.colormaps["viridis"](np.linspace(0.0, _LIGHTEST, count))
    return [{"color": colour, "dashes": _DASHES[k % len(_DASHES)]} for k, colour in enumerate(colours)]


def label_quantity(axes: Axes, system: PeriodicSystem, name: str, values: Array, figure: str = "") -> float:
    """Name the vertical axis for these values of a quantity, or of a figure of it, and say its meaning above;
    the factor from SI units to those shown."""
    factor, unit = prefixed(system.units.get(name, ""), float(np.nanmax(np.abs(values), initial=0.0)))
    axes.set_ylabel(labelled(named(figure, name) if figure else name, unit))
    axes.set_title(system.meanings.get(name, ""), loc="left", color=GREY)
    return factor


def labelled(name: str, unit: str) -> str:
    """A label of few characters a line, Greek names as letters, the unit in brackets."""
    lines = textwrap.wrap(greek(name).replace("_", " "), 12)
    if unit and len(lines) == 1 and len(lines[0] + unit) < 9:
        return f"{lines[0]} ({unit})"
    return "\n".join([*lines, f"({unit})"] if unit else lines)


def _orders(motions: Mapping[str, Motion], scale: str) -> Array:
    """Harmonics to draw: up to the last that can be seen in any of the spectra."""
    least = 10 ** (_DB_FLOOR / 20) if scale == "dB" else _VISIBLE
    spectra = [motion.amplitudes[1:] for motion in motions.values()]
    last = max((int(at) for each in spectra for at in np.flatnonzero(each > least * each.max())), default=0)
    return np.arange(1, min(len(spectra[0]), max(10, last + 2)) + 1)


def _draw_spectrum(
    axes: Axes, system: PeriodicSystem, scaled: tuple[float, str], amplitudes: Array, k: Array, scale: str
) -> None:
    from matplotlib.ticker import MultipleLocator

    largest, (factor, unit) = np.nan_to_num(amplitudes).max(), scaled
    order = k * (2 * math.pi / system.period)
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


def _label_columns(axes: Any, system: PeriodicSystem, speed: float) -> None:
    """Phase and order below, time and hertz above."""
    from matplotlib.ticker import MaxNLocator, MultipleLocator

    left, right = axes[-1]
    turn = math.degrees(system.period)
    left.xaxis.set_major_locator(MultipleLocator(45.0 if math.isclose(turn, 360.0) else turn / 6))
    left.xaxis.set_major_formatter("{x:g}")
    left.set_xlabel("phase (°)")
    right.xaxis.set_major_locator(MaxNLocator(8, integer=True))
    right.set_xlabel("order of rotation")
    factor, unit = prefixed("s", system.period / speed)
    degrees = math.radians(1.0) / speed * factor
    hertz = speed / (2 * math.pi)
    for top, scale, label in ((axes[0, 0], degrees, f"time ({unit})"), (axes[0, 1], hertz, "frequency (Hz)")):
        second = top.secondary_xaxis("top", functions=(lambda x, s=scale: x * s, lambda x, s=scale: x / s))
        second.set_xlabel(label, loc="right")


def _draw_stability(place: Figure | SubFigure, panel: StabilityPanel) -> None:
    from matplotlib.patches import Circle

    rho, radius = panel.multipliers, float(np.abs(panel.multipliers).max(initial=0.0))
    closer = 0.0 < radius < _CLOSER
    panels = place.subplots(1, 3 if closer else 2, width_ratios=(1, 1, 0.75) if closer else (1, 1.75))
    _draw_multipliers(panels[0], rho, max(1.0, radius))
    panels[0].add_patch(Circle((0, 0), 1.0, fill=False, color=BLACK, linewidth=0.9))
    panels[0].set_title("Floquet multipliers", loc="left", color=GREY)
    if closer:
        power = math.floor(math.log10(radius)) if radius < 0.1 else 0
        unit = f" ({raised(f'10^{power}')})" if power else ""
        _draw_multipliers(panels[1], rho / 10.0**power, radius / 10.0**power, unit)
        panels[1].add_patch(
            Circle((0, 0), radius / 10.0**power, fill=False, color=GREY, linewidth=0.8, linestyle="--")
        )
        panels[1].set_title("closer, within the largest", loc="left", color=GREY)
    _write_summary(panels[-1], panel)


def _draw_multipliers(axes: Axes, rho: Array, reach: float, unit: str = "") -> None:
    from matplotlib.ticker import MaxNLocator

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


def _write_summary(axes: Axes, panel: StabilityPanel) -> None:
    place: dict[str, Any] = {"va": "top", "transform": axes.transAxes}
    color = VERMILION if panel.verdict == "unstable" else BLACK
    axes.axis("off")
    axes.text(0.0, 1.0, panel.verdict, fontweight="bold", color=color, **place)
    axes.text(0.0, 0.88, "\n".join(panel.lines), linespacing=1.6, **place)
