"""Elements of figures: panels versus speed, curves, colours, labels and titles."""

import math
import textwrap
from collections.abc import Callable, Hashable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, TypeVar

import numpy as np

from solve.arrays import Array, Plane
from solve.errors import ValueOutOfBoundsError
from solve.labels import SPEED, known_quantities, unit_of
from solve.results.contents import MOST_SHOWN
from solve.results.formatting import greek, headed, named, prefixed
from solve.system import PeriodicSystem
from solve.views.style import BLACK, GREY, Axes, Figure, page

Value = TypeVar("Value", bound=Hashable)


_BETWEEN = 16
"""Number of line segments that are drawn between two computed points of a curve."""

_ALIKE = 1e-6
"""Difference between a spectral radius and 1 that counts as round-off. The axis does not resolve smaller
differences."""

_DASHES = ((), (5, 1.5), (1.5, 1.2), (6, 1.5, 1.5, 1.5))
_FEW = 60
"""Maximum number of points for which the points of a curve are marked."""

MOST_CURVES = 12
"""Maximum number of curves that can be distinguished in one figure."""

MOST_DRAWN = 8
"""Maximum number of panels in a figure, and maximum number of labelled curves or bars in a panel: as many as
fit."""

DRAWN_RTOL = 1e-6
"""Relative tolerance of results for curves and tables, in which further digits would not be visible."""

HEADROOM = 1.15
"""Ratio of the upper limit of a Campbell diagram to the highest frequency."""

DEFLECTION = 0.1
"""Largest displacement in figures, relative to the size of the structure or path, at which displacements are
visible and do not overlap."""


def shown(system: PeriodicSystem, names: Sequence[str] | None) -> list[str]:
    """Return the names of the quantities to show, by default the first coordinates. Raises UnknownNameError,
    and ValueOutOfBoundsError for more quantities than fit on a page."""
    if names is None or len(names) == 0:
        return list((system.coordinates or system.outputs)[:MOST_SHOWN])
    quantities = known_quantities(system, names)
    if len(quantities) > MOST_SHOWN:
        raise ValueOutOfBoundsError(
            f"{len(quantities)} quantities to show; allowed: up to {MOST_SHOWN} in one picture"
        )
    return list(quantities)


def titled(system: PeriodicSystem, speed: float) -> str:
    """Return a title with the model, the case and the speed."""
    return f"{title_of(system)}, {system.labels.speed_unit.text(speed)}"


def omission(count: int, most: int, things: str) -> str:
    """Return the end of a title if only the first `most` of `count` things are drawn.

    >>> omission(8, 6, "inputs")
    '; the first 6 of 8 inputs'
    """
    return f"; the first {most} of {count} {things}" if count > most else ""


def distinct_labels(values: Sequence[Value], text: Callable[[Value, str], str]) -> Sequence[str]:
    """Return labels of values, with as few digits as are needed to distinguish different values.

    >>> distinct_labels([1.0, 1.00000002], lambda value, form: f"{value:{form}}")
    ['1', '1.00000002']
    """
    labels: list[str] = []
    for form in (".6g", ".10g", ".17g"):
        labels = [text(value, form) for value in values]
        if len(set(labels)) >= len(set(values)):
            break
    return labels


def title_of(system: PeriodicSystem) -> str:
    """Return a title with the model and the case."""
    case = f", case {system.labels.case}" if system.labels.case else ""
    return f"{system.labels.name.replace('_', ' ')}{case}"


def draw_map(figure: Figure, axes: Axes, x: Array, y: Array, z: Array, label: str, **colours: Any) -> None:
    """Draw values z (ny, nx) as colours in the plane of x and y, with a colour bar."""
    mesh = axes.pcolormesh(x, y, z, shading="nearest", rasterized=True, **colours)
    bar = figure.colorbar(mesh, ax=axes, pad=0.02, fraction=0.05)
    bar.set_label(label, color=GREY)
    axes.ticklabel_format(scilimits=(-3, 6))
    axes.grid(visible=False)


def axis_label(system: PeriodicSystem, name: str) -> str:
    """Return a label with the name, unit and meaning of a parameter or of the speed."""
    label = headed(name, unit_of(system, name).name)
    _, meaning = system.labels.parameter_labels.get(name, ("", ""))
    return "\n".join(textwrap.wrap(f"{label}: {meaning}" if meaning else label, 54))


def label_speeds(axes: Axes, system: PeriodicSystem, values: Array, name: str = SPEED) -> None:
    """Label the horizontal axis with ascending speeds (k,) in rad/s, or with values of a parameter."""
    shown = unit_of(system, name).from_si(values)
    if shown[0] < shown[-1]:
        axes.set_xlim(shown[0], shown[-1])
    axes.set_xlabel(axis_label(system, name))
    axes.ticklabel_format(axis="x", scilimits=(-3, 6))


@contextmanager
def panels_over(
    system: PeriodicSystem,
    values: Array,
    title: str,
    height: float,
    count: int,
    name: str = SPEED,
    ratios: Sequence[float] | None = None,
    align: bool = True,
) -> Iterator[tuple[Figure, Any]]:
    """Context manager that provides a figure with `count` panels, one below the other, versus speeds (k,) in
    rad/s or versus the values of a parameter.

    `title` is the text after the model's name, `height` the height of the figure in inches, and `ratios` the
    ratios of the heights of the panels. At the end of the block, the horizontal axis is labelled, and the
    vertical labels are aligned.
    """
    with page(height, f"{title_of(system)}: {title}") as figure:
        panels = figure.subplots(count, 1, sharex=True, squeeze=False, height_ratios=ratios)[:, 0]
        yield figure, panels
        label_speeds(panels[-1], system, np.sort(values), name)
        if align:
            figure.align_ylabels(panels)


def legend_above(axes: Axes, columns: int = 2) -> None:
    """Add a legend above the frame, on the right, if a curve has a label."""
    if axes.get_legend_handles_labels()[0]:
        spacing = {"borderaxespad": 0.1, "handlelength": 1.4, "columnspacing": 1.1}
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=columns, **spacing)


def label_phases(axes: Axes, period: float) -> None:
    """Label the horizontal axis with phases in degrees, from 0 to the period, which is given in rad."""
    from matplotlib.ticker import MultipleLocator

    axes.set_xlim(0.0, math.degrees(period))
    axes.xaxis.set_major_locator(MultipleLocator(math.degrees(period) / 12))
    axes.set_xlabel("phase (°)")


def through(x: Array, y: Array) -> tuple[Array, Array]:
    """Return an interpolated curve through points with abscissas x (k,), in any order, with gaps where y is
    NaN.

    The interpolation by monotone cubics (F. Fritsch, R. Carlson, SIAM J. Numer. Anal. 17 (1980) 238-246) adds
    no extrema.
    """
    from scipy.interpolate import PchipInterpolator

    curves, (x, first) = [], np.unique(x, return_index=True)
    y = np.where(np.isfinite(y), y, np.nan)[first]
    for section in np.split(np.arange(len(x)), np.flatnonzero(np.diff(np.isfinite(y))) + 1):
        points, values, last = x[section], y[section], len(section) - 1
        if np.isfinite(values).all() and last:
            fine = np.interp(np.linspace(0, last, _BETWEEN * last + 1), np.arange(last + 1), points)
            points, values = fine, PchipInterpolator(points, values)(fine)
        curves.append((points, values))
    x_curves, y_curves = zip(*curves, strict=True)
    return np.concatenate(x_curves), np.concatenate(y_curves)


def draw_through(axes: Axes, x: Array, y: Array, by_logarithm: bool = False, **style: Any) -> None:
    """Draw an interpolated curve versus x (k,); see `through`. If `by_logarithm` is True, the logarithms of
    positive values are interpolated. If there are few points, they are marked."""
    with np.errstate(divide="ignore"):
        fine, values = through(x, np.log(y) if by_logarithm else y)
    axes.plot(fine, np.exp(values) if by_logarithm else values, **style)
    if len(x) <= _FEW:
        dots = {"color": style.get("color"), "markersize": 3.5, "zorder": 3}
        axes.plot(x, y, ".", **dots)


def shades(count: int) -> list[dict[str, Any]]:
    """Return colours and dash patterns for several curves. The first colour is the darkest. The dash patterns
    distinguish the curves in black and white."""
    import matplotlib

    # Colours beyond 0.8 are too light for a white page.
    colours = matplotlib.colormaps["viridis"](np.linspace(0.0, 0.8, count))
    return [{"color": colour, "dashes": _DASHES[k % len(_DASHES)]} for k, colour in enumerate(colours)]


def frame_of(points: Plane) -> tuple[complex, complex]:
    """Return the lower left and the upper right corner of a frame around points x + iy, with a margin."""
    low = complex(points.real.min(), points.imag.min())
    high = complex(points.real.max(), points.imag.max())
    room = 0.07 * (max((high - low).real, (high - low).imag) or 1.0) * (1 + 1j)
    return low - room, high + room


def label_radius(axes: Axes, radius: Array) -> None:
    """Label the axis of spectral radii, and draw a line at 1. The axis is logarithmic if the radii span more
    than a factor of ten."""
    axes.axhline(1.0, color=BLACK, linewidth=0.9)
    if np.nanmin(radius, initial=1.0) <= 0.1 or np.nanmax(radius, initial=1.0) >= 10:
        axes.set_yscale("log")
    elif np.nanmax(np.abs(radius - 1), initial=0.0) < _ALIKE:
        # The axis must not resolve round-off.
        axes.set_ylim(0.99, 1.01)
    axes.set_ylabel("spectral\nradius |ρ|")


def label_quantity(axes: Axes, system: PeriodicSystem, name: str, values: Array, figure: str = "") -> float:
    """Label the vertical axis for values of a quantity, and write the meaning of the quantity above the
    panel. Return the conversion factor from SI units to the displayed unit."""
    factor, unit = prefixed(system.labels.units.get(name, ""), float(np.nanmax(np.abs(values), initial=0.0)))
    axes.set_ylabel(labelled(named(figure, name) if figure else name, unit))
    axes.set_title(system.labels.meanings.get(name, ""), loc="left", color=GREY)
    return factor


def labelled(name: str, unit: str) -> str:
    """Return the label of a quantity, with a few characters per line, Greek letters, and the unit in
    brackets."""
    lines = textwrap.wrap(greek(name).replace("_", " "), 12)
    if unit and len(lines) == 1 and len(lines[0] + unit) < 9:
        return f"{lines[0]} ({unit})"
    return "\n".join([*lines, f"({unit})"] if unit else lines)
