"""Transients: the motion over the revolutions."""

from collections.abc import Sequence

from solve.labels import SPEED
from solve.results.contents import MOST_SHOWN, Column, digits, sized, speeds_of
from solve.results.formatting import measured
from solve.results.transient import Transient
from solve.views.panels import axis_label, label_quantity, shown, title_of, titled
from solve.views.show import figure, tables
from solve.views.style import BLUE, VERMILION, Axes, Figure, page
from solve.views.tables import RenderableType, table, table_of, text

_MOST_TURNS = 40
"""Rows of the table; of more turns every k-th is shown."""


@figure.register(Transient)
def transient_figure(transient: Transient, names: Sequence[str] | None = None) -> Figure:
    """Each name over the turns, the orbit beside; see `Transient.plot`."""
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
                found = transient.orbit.statistics(name)
                for level in (found.max, found.min):
                    place.axhline(factor * level, color=VERMILION, linewidth=0.8, linestyle="--")
        axes[-1].set_xlim(0, turns[-1])
        dashed = " (dashed: extrema of the orbit)" if transient.orbit is not None else ""
        axes[-1].set_xlabel("time (s)" if transient.ramp else "turns" + dashed)
        if transient.ramp:
            _add_speeds(axes[0], transient)
        figure.align_ylabels(axes)
    return figure


def _add_speeds(axes: Axes, transient: Transient) -> None:
    """The speed, which is linear in time, along the upper edge."""
    first, last = transient.system.speed_unit.of(transient.ends[[0, -1]])
    slope = (last - first) / transient.time[-1]
    above = axes.secondary_xaxis(
        "top", functions=(lambda t: first + slope * t, lambda speed: (speed - first) / slope)
    )
    above.set_xlabel(axis_label(transient.system, SPEED))


@tables.register(Transient)
def transient_tables(transient: Transient) -> Sequence[RenderableType]:
    """A row a turn: the largest modulus of each coordinate, and the distance to the orbit. A row an
    output: its extrema."""
    columns = {"": Column(range(1, transient.turns + 1), heading="turn")}
    for name, peaks in zip(transient.system.coordinates[:MOST_SHOWN], transient.peaks.T, strict=False):
        columns[name] = sized(peaks, transient.system.units.get(name, ""), "", name, 6)
    distances = Column(transient.distances.max(axis=1), heading="from orbit", text=digits(".1e"))
    speeds = speeds_of(transient.system, transient.ends[1:], heading="to {}")
    columns["end"] = speeds if transient.ramp else distances
    made = [table_of("Largest moduli, turn by turn", columns, most=_MOST_TURNS), *_output_tables(transient)]
    if transient.ramp:
        return made
    words = f"the orbit is not reached to {transient.rtol:g} within {transient.turns} turns"
    if transient.reached is not None:
        words = (
            f"the orbit is reached to {transient.rtol:g} after {transient.reached} of {transient.turns} turns"
        )
    return [*made, text("\n" + words)]


def _output_tables(transient: Transient) -> list[RenderableType]:
    if not transient.outputs:
        return []
    made = table("Outputs over all turns", "output", "max", "min")
    for name in transient.outputs:
        unit, found = transient.system.units.get(name, ""), transient.extremes[name]
        made.add_row(name, measured(found.max, unit), measured(found.min, unit))
    return [made]
