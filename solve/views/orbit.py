"""Figures and tables of orbits and their stability: time histories, spectra, multipliers."""

import math
import textwrap
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from solve.arrays import ROUND_OFF, Array
from solve.errors import require_name
from solve.labels import known_quantities
from solve.results.formatting import fixed, prefixed
from solve.results.orbit import Orbit
from solve.results.periodic_motion import PeriodicMotion
from solve.results.special_orbits import NonlinearOrbit, RigidOrbit
from solve.system import PeriodicSystem
from solve.views.panels import labelled, shown, titled
from solve.views.show import brief, figure, printout, tables
from solve.views.stability import CIRCLE_ROW, draw_stability, stability_tables
from solve.views.style import BLUE, GREY, VERMILION, Axes, Figure, page
from solve.views.tables import RenderableType, Table, table

_ROW_HEIGHTS = (1.55, 1.55, 1.55, 1.35, 1.2, 1.1)
"""Mapping from the number of rows to the height of a row in inches, so that all rows fit on a page."""

FLOOR = 1e-6
"""Smallest amplitude that logarithmic scales show, relative to the largest: -120 dB. Chosen by judgement."""

VISIBLE = 4e-3
"""Fraction of the largest amplitude below which a harmonic is invisible on a linear scale, because it is
below about one pixel."""


_RANKS = ("strongest", "second", "third")
_LONGEST_NAME = 26

SCALES = ("linear", "dB")


class Motion(NamedTuple):
    """Quantity over one period: values (k,) at equidistant phases, including both ends; values (k,) of a
    second solution for comparison, if there is one; and amplitudes (m + 1,), beginning with the mean."""

    values: Array
    beside: Array | None
    amplitudes: Array


@figure.register(Orbit)
def orbit_figure(
    orbit: Orbit,
    names: Sequence[str] | None = None,
    quasi_static: bool = False,
    scale: str = "linear",
    harmonics: int | None = None,
) -> Figure:
    """Figure with the time history and the spectrum of each quantity, and with the multipliers if the system
    has coordinates; see `Orbit.plot`."""
    require_name("scale", scale, SCALES)
    system, vibrates = orbit.system, orbit.system.labels.vibrates
    motions = {name: _motion(orbit, name, quasi_static, harmonics) for name in shown(system, names)}
    heights = [0.95 + _ROW_HEIGHTS[len(motions) - 1] * len(motions), CIRCLE_ROW][: 1 + vibrates]
    labels = ("nonlinear", "linear") if isinstance(orbit, NonlinearOrbit) else ("dynamic", "quasi-static")
    with page(sum(heights), titled(system, orbit.speed)) as figure:
        grid = figure.add_gridspec(len(heights), 1, height_ratios=heights)
        upper, *lower = (figure.add_subfigure(grid[row]) for row in range(len(heights)))
        axes = upper.subplots(len(motions), 2, sharex="col", squeeze=False, width_ratios=(1.2, 1))
        orders = _orders(motions, scale)
        for (left, right), (name, motion) in zip(axes, motions.items(), strict=True):
            scaled = _draw_curve(left, system, name, motion, labels)
            _draw_spectrum(right, system, scaled, motion.amplitudes[orders], orders, scale)
        _label_columns(axes, system, orbit.speed)
        if any(motion.beside is not None for motion in motions.values()):
            low, high = axes[0, 0].get_ylim()
            axes[0, 0].set_ylim(top=high + 0.25 * (high - low))
            axes[0, 0].legend(loc="upper right", ncols=2)
        upper.align_ylabels()
        for place in lower:
            draw_stability(place, orbit)
    return figure


def _motion(orbit: Orbit, name: str, quasi_static: bool, harmonics: int | None) -> Motion:
    """Return a quantity of the orbit with a second solution for comparison: the quasi-static solution if
    requested, or, for a nonlinear orbit, the linear one."""
    phase, beside = np.linspace(0.0, orbit.system.period, orbit.samples + 1), None
    if quasi_static:
        beside = orbit.quasi_static.signal(name)(phase)
    elif isinstance(orbit, NonlinearOrbit):
        beside = orbit.linear_values(name, phase)
    amplitudes, _ = orbit.harmonics(name, harmonics or orbit.samples // 8)
    return Motion(orbit.signal(name)(phase), beside, amplitudes)


def _draw_curve(
    axes: Axes, system: PeriodicSystem, name: str, motion: Motion, labels: tuple[str, str]
) -> tuple[float, str]:
    """Draw a time history. Return the conversion factor and the unit, which apply to the spectrum too."""
    degrees = np.linspace(0.0, math.degrees(system.period), len(motion.values))
    curves: list[tuple[Array, dict[str, Any]]] = [(motion.values, {"color": BLUE, "label": labels[0]})]
    if motion.beside is not None:
        style = {"color": VERMILION, "linestyle": (0, (4, 2)), "linewidth": 1.0, "label": labels[1]}
        curves.append((motion.beside, style))
    factor, unit = prefixed(system.labels.units.get(name, ""), max(np.abs(y).max() for y, _ in curves))
    for values, style in curves:
        axes.plot(degrees, factor * values, **style)
    axes.set_xlim(0.0, math.degrees(system.period))
    axes.margins(y=0.08)
    axes.set_ylabel(labelled(name, unit))
    # A line above a panel has space for 46 characters.
    meaning = textwrap.fill(system.labels.meanings.get(name, ""), 46, max_lines=3, placeholder=" …")
    axes.set_title(meaning, loc="left", color=GREY)
    return factor, unit


def _orders(motions: Mapping[str, Motion], scale: str) -> Array:
    """Return the harmonics to draw: all harmonics up to the highest one that is visible in any spectrum."""
    least = FLOOR if scale == "dB" else VISIBLE
    spectra = [motion.amplitudes[1:] for motion in motions.values()]
    visible = (np.flatnonzero(spectrum > least * spectrum.max()) for spectrum in spectra)
    last = max((int(order) for orders in visible for order in orders), default=0)
    return np.arange(1, min(len(spectra[0]), max(10, last + 2)) + 1)


def _draw_spectrum(
    axes: Axes, system: PeriodicSystem, scaled: tuple[float, str], amplitudes: Array, k: Array, scale: str
) -> None:
    from matplotlib.ticker import MultipleLocator

    largest, (factor, unit) = np.nan_to_num(amplitudes).max(), scaled
    order = k * (2 * math.pi / system.period)
    if scale == "dB":
        with np.errstate(divide="ignore"):
            heights = 20 * np.log10(amplitudes / largest if largest else amplitudes)
        foot = 20 * np.log10(FLOOR)
        axes.set_ylim(foot, 8.0)
        axes.set_ylabel(f"dB re {largest * factor:.3g} {unit}")
        axes.yaxis.set_major_locator(MultipleLocator(40))
    else:
        heights, foot = amplitudes * factor, 0.0
        axes.set_ylim(0.0, 1.12 * largest * factor or 1.0)
        axes.set_ylabel(labelled("amplitude", unit))
    seen = heights > foot + (0.0 if scale == "dB" else VISIBLE * largest * factor)
    crowded = len(k) > 80
    axes.vlines(order[seen], foot, heights[seen], color=BLUE, linewidth=0.6 if crowded else 1.0)
    if not crowded:
        axes.plot(order[seen], heights[seen], "o", color=BLUE, markersize=2.5)
    axes.set_xlim(0.0, order[-1] + order[0] / 2)
    axes.grid(visible=False, axis="x")


def _label_columns(axes: Any, system: PeriodicSystem, speed: float) -> None:
    """Label the columns: phase and order at the bottom, time and frequency at the top."""
    from matplotlib.ticker import MaxNLocator, MultipleLocator

    left, right = axes[-1]
    period = math.degrees(system.period)
    left.xaxis.set_major_locator(MultipleLocator(45.0 if math.isclose(period, 360.0) else period / 6))
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


@tables.register(Orbit)
def orbit_tables(orbit: Orbit, quasi_static: bool = False) -> Sequence[RenderableType]:
    """Tables of the extrema, the strongest harmonics, the stability and, if requested, the extrema of the
    quasi-static solution."""
    motion = [_extrema_table(orbit, "Motion over one period"), _order_table(orbit)]
    if quasi_static:
        motion.append(_extrema_table(orbit.quasi_static, "Quasi-static, without inertia and damping"))
    return [*motion, *(stability_tables(orbit) if orbit.system.labels.vibrates else [])]


@brief.register(RigidOrbit)
def rigid_orbit_in_brief(orbit: RigidOrbit) -> RenderableType:
    """Complete tables of the orbit of a mechanism without coordinates. They replace the short form, which
    would state a verdict that does not exist."""
    return printout(orbit)


def _extrema_table(motion: PeriodicMotion, title: str) -> Table:
    """Return a table of the extrema, with their phases, and of the means. No phases are shown for constant
    quantities."""
    motion.evaluate_outputs()
    period, rows = motion.system.period, []
    for name in known_quantities(motion.system):
        values = motion.statistics(name)
        factor, unit = prefixed(motion.system.labels.units.get(name, ""), values.max_abs)
        high, low, mean = (
            fixed(value * factor, values.max_abs * factor) for value in (values.max, values.min, values.mean)
        )
        if values.max - values.min <= ROUND_OFF * values.max_abs:
            high_at = low_at = "–"
        else:
            high_at, low_at = _degrees(period, values.max_phase), _degrees(period, values.min_phase)
        rows.append((_broken(name), unit, high, high_at, low, low_at, mean))
    return table(title, "quantity", "unit", "max", "at", "min", "at", "mean", left=2, rows=rows)


def _degrees(period: float, phase: float) -> str:
    """Format a phase in degrees; the end of the period is written as 0."""
    rounded = round(math.degrees(phase), 1)
    return f"{rounded if rounded < round(math.degrees(period), 1) else 0.0:.1f}°"


def _order_table(orbit: Orbit) -> Table:
    """Return a table of the amplitudes and phase angles of the strongest harmonics, with "–" for harmonics
    below the error of the orbit."""
    rotation, rows = 2 * math.pi / orbit.system.period, []
    for name in known_quantities(orbit.system):
        amplitudes, angles = orbit.harmonics(name, orbit.samples // 8)
        largest = orbit.statistics(name).max_abs
        factor, _ = prefixed(orbit.system.labels.units.get(name, ""), largest)
        error, cells = orbit.error_estimate.orbit * largest, []
        for k in 1 + np.argsort(-amplitudes[1:], kind="stable")[: len(_RANKS)]:
            size = float(amplitudes[k]) * factor
            text = f"{k * rotation:g}: {fixed(size, size, 4)} ∠{round(math.degrees(angles[k])):4d}°"
            cells.append(text if error < amplitudes[k] < math.inf else "–")
        rows.append((_broken(name), *cells))
    return table(
        "Strongest harmonics: order, amplitude in that unit, phase angle", "quantity", *_RANKS, rows=rows
    )


def _broken(name: str) -> str:
    """Return a name, with a line break after an underscore if it is too long for a table of 80 columns."""
    place = name.rfind("_", 0, _LONGEST_NAME) + 1
    return name if len(name) <= _LONGEST_NAME or not place else f"{name[:place]}\n{name[place:]}"
