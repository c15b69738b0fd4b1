"""Figures and tables of motion versus time: transients, curves over a period, and contributions of modes."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np

from solve.arrays import Array
from solve.beams.observations import Contributions
from solve.errors import NoResultError, ValueOutOfBoundsError, counted
from solve.labels import SPEED, known_quantities
from solve.model.model import Model
from solve.results.contents import HALF_DEGREES, MOST_SHOWN, Column, digits, sized, speeds_of
from solve.results.formatting import measured
from solve.results.orbit import Orbit
from solve.results.transient import Transient
from solve.system import PeriodicSystem
from solve.views.panels import (
    MOST_CURVES,
    axis_label,
    distinct_labels,
    label_phases,
    label_quantity,
    shades,
    shown,
    title_of,
    titled,
)
from solve.views.show import figure, tables
from solve.views.style import BLACK, BLUE, GREY, VERMILION, Axes, Figure, page
from solve.views.tables import MOST_ROWS, RenderableType, table, table_of, text


@figure.register(Transient)
def transient_figure(transient: Transient, names: Sequence[str] | None = None) -> Figure:
    """Figure of each quantity versus time, with the extrema of the orbit; see `Transient.plot`."""
    names = shown(transient.system, names)
    turns = transient.time if transient.ramp else transient.phase / transient.system.period
    kind = "nonlinear" if transient.nonlinear else "linear"
    title = f"{titled(transient.system, transient.speed)}: {kind} transient"
    if transient.ramp:
        title = f"{title_of(transient.system)}, {transient.ramp_in_words}: {kind} transient"
    with page(1.1 + 1.5 * len(names) + 0.5 * transient.ramp, title) as figure:
        axes = figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
        for place, name in zip(axes, names, strict=True):
            values = transient.values(name)
            factor = label_quantity(place, transient.system, name, values)
            place.plot(turns, factor * values, color=BLUE, linewidth=0.8)
            if transient.orbit is not None:
                statistics = transient.orbit.statistics(name)
                for level in (statistics.max, statistics.min):
                    place.axhline(factor * level, color=VERMILION, linewidth=0.8, linestyle="--")
        axes[-1].set_xlim(0, turns[-1])
        dashed = " (dashed: extrema of the orbit)" if transient.orbit is not None else ""
        axes[-1].set_xlabel("time (s)" if transient.ramp else "turns" + dashed)
        if transient.ramp:
            _add_speeds(axes[0], transient)
        figure.align_ylabels(axes)
    return figure


def _add_speeds(axes: Axes, transient: Transient) -> None:
    """Add a speed axis at the top. The speed is linear in time."""
    first, last = transient.system.labels.speed_unit.from_si(transient.ends[[0, -1]])
    slope = (last - first) / transient.time[-1]
    above = axes.secondary_xaxis(
        "top", functions=(lambda t: first + slope * t, lambda speed: (speed - first) / slope)
    )
    above.set_xlabel(axis_label(transient.system, SPEED))


@tables.register(Transient)
def transient_tables(transient: Transient) -> Sequence[RenderableType]:
    """Table of the largest absolute values and of the distances from the orbit, with one row per period; and
    table of the extrema of outputs."""
    columns = {"": Column(range(1, transient.turns + 1), heading="turn")}
    for name, peaks in zip(transient.system.coordinates[:MOST_SHOWN], transient.peaks.T, strict=False):
        columns[name] = sized(peaks, transient.system.labels.units.get(name, ""), "", name, 6)
    distances = Column(transient.distances.max(axis=1), heading="from orbit", text=digits(".1e"))
    speeds = speeds_of(transient.system, transient.ends[1:], heading="to {}")
    columns["end"] = speeds if transient.ramp else distances
    printed = [
        table_of("Largest absolute values, turn by turn", columns, most=MOST_ROWS),
        *_output_tables(transient),
    ]
    if transient.ramp:
        return printed
    words = (
        f"the motion does not approach the orbit to a relative distance of {transient.rtol:g} within "
        f"{counted(transient.turns, 'turn')}"
    )
    if transient.reached is not None:
        words = (
            f"the relative distance from the orbit is at most {transient.rtol:g} after "
            f"{transient.reached} of {counted(transient.turns, 'turn')}"
        )
    return [*printed, text("\n" + words)]


def _output_tables(transient: Transient) -> list[RenderableType]:
    rows = []
    for name in transient.outputs:
        unit, extremes = transient.system.labels.units.get(name, ""), transient.extremes[name]
        rows.append((name, measured(extremes.max, unit), measured(extremes.min, unit)))
    return [table("Outputs over all turns", "output", "max", "min", rows=rows)] if rows else []


BEHIND = {"color": "#C8C8C8", "linewidth": 5.0, "solid_capstyle": "round"}
"""Style of a reference curve drawn behind other curves."""


def require_turn(system: PeriodicSystem, name: str, curves: int) -> None:
    """Raise UnknownNameError for an unknown name, and ValueOutOfBoundsError for more curves than can be
    distinguished."""
    known_quantities(system, [name])
    if curves > MOST_CURVES:
        raise ValueOutOfBoundsError(
            f"{curves} curves to draw in one picture; allowed: up to {MOST_CURVES}, such as "
            '--speeds "600 900 1200 rpm"'
        )


def turn_figure(orbits: Sequence[Orbit], name: str) -> Figure:
    """Figure of a coordinate or output over one period, with one curve for each orbit of a system at several
    speeds. The curve of the lowest speed is the darkest.

    Raises UnknownNameError and ValueOutOfBoundsError.
    """
    require_turn(orbits[0].system, name, len(orbits))
    ordered = sorted(orbits, key=lambda orbit: orbit.speed)
    unit = orbits[0].system.labels.speed_unit
    speeds = [orbit.speed for orbit in ordered]
    labels = distinct_labels(speeds, lambda speed, form: f"{unit.from_si(speed):{form}}")
    by_speed = dict(zip(labels, ordered, strict=True))
    return turns_figure(by_speed, name, axis_label(orbits[0].system, SPEED), reverse=True)


def turns_figure(orbits: Mapping[str, Orbit], name: str, title: str, reverse: bool = False) -> Figure:
    """Figure of a coordinate or output over one period, with one labelled curve per orbit."""
    system = next(iter(orbits.values())).system
    phase = np.linspace(0.0, system.period, max(orbit.samples for orbit in orbits.values()) + 1)
    curves = {label: orbit.signal(name)(phase) for label, orbit in orbits.items()}
    return curves_figure(system, phase, curves, name, title, reverse)


def curves_figure(
    system: PeriodicSystem,
    phase: Array,
    curves: Mapping[str, Array],
    name: str,
    title: str | None,
    reverse: bool = False,
    styles: Mapping[str, Mapping[str, Any]] = MappingProxyType({}),
    about: str = "",
) -> Figure:
    """Figure of curves of a coordinate or output over one period. `curves` maps labels to values (k,) at
    phases (k,), and `styles` maps labels to line styles. `about` is the subject in the title, by default the
    quantity."""
    shown = about or f"{name.replace('_', ' ')} over one period"
    with page(3.3, f"{title_of(system)}: {shown}") as figure:
        axes = figure.subplots()
        factor = label_quantity(axes, system, name, np.array([*curves.values()]))
        axes.axhline(0.0, color=GREY, linewidth=0.7)
        unstyled = [label for label in curves if label not in styles]
        styled = {**styles, **dict(zip(unstyled, shades(len(unstyled)), strict=True))}
        for label, values in curves.items():
            axes.plot(np.degrees(phase), values * factor, label=label, **styled[label])
        label_phases(axes, system.period)
        figure.legend(title=title, loc="outside right center", handlelength=2.4, reverse=reverse)
    return figure


def contributions_figure(
    model: PeriodicSystem, found: Contributions, speed: float, uncoupled: Array | None = None
) -> Figure:
    """Figure of an output over the period at a speed in rad/s, with the contribution of each mode to the
    output. `uncoupled` (k,) are the values of the output without coupling of the modes."""
    curves = {"all modes": found.total}
    curves |= {f"mode {number}": values for number, values in enumerate(found.values, 1)}
    if uncoupled is not None:
        curves["uncoupled"] = uncoupled
    styles = {"all modes": {"color": BLACK, "linewidth": 2.0}, "uncoupled": {"color": VERMILION}}
    about = f"modes at {model.labels.speed_unit.text(speed)}"
    return curves_figure(model, found.phase, curves, found.output, None, styles=styles, about=about)


def fits_figure(model: Model) -> Figure:
    """Figure of the series fitted to the tables of the model's case, with one panel per table. Raises
    NoResultError for a case without tables."""
    if not model.fits:
        raise NoResultError(
            f"{title_of(model)} has no series from a table that --fits could draw; omit --fits"
        )
    offsets = np.linspace(0.0, 2 * np.pi, HALF_DEGREES)
    with page(0.8 + 2.4 * len(model.fits), f"{title_of(model)}: series fitted to tables") as figure:
        panels = figure.subplots(len(model.fits), squeeze=False)[:, 0]
        for axes, fit in zip(panels, model.fits.values(), strict=True):
            angles = offsets + fit.angles.min()
            axes.plot(np.degrees(fit.angles), fit.values, ".", color=GREY, label=fit.table)
            axes.plot(
                np.degrees(angles),
                fit.at(angles),
                color=VERMILION,
                label=counted(fit.harmonics, "harmonic"),
            )
            axes.set_title(fit.sentence, loc="left", color=GREY, wrap=True)
            axes.set_ylabel(f"{fit.name} ({fit.unit})")
            axes.legend()
        panels[-1].set_xlabel("angle (deg)")
    return figure
