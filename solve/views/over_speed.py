"""Curves over speed: sweeps side by side, branches, validity, elasticities."""

import math
from collections.abc import Sequence
from itertools import groupby, pairwise
from typing import Any

import numpy as np

from solve.arguments import unique_names
from solve.arrays import Array
from solve.results.branch import STABLE, UNDETERMINED, UNSTABLE, Branch
from solve.results.contents import MOST_SHOWN
from solve.results.quantities import fixed, named, prefixed
from solve.results.sensitivities_over import SensitivitiesOver
from solve.results.sweeps import Sweeps
from solve.results.validity import Validity
from solve.views.panels import draw_through, label_quantity, label_speeds, shades, title_of
from solve.views.show import figure, tables
from solve.views.style import BLACK, BLUE, GREY, VERMILION, Axes, Figure, page
from solve.views.tables import RenderableType, table, table_of, text

_MOST_ROWS = 40
"""Of the table; of more points every k-th is shown."""

_LINES = {STABLE: (BLUE, "-"), UNSTABLE: (VERMILION, "--"), UNDETERMINED: (GREY, "-")}


@figure.register(Sweeps)
def sweeps_figure(
    sweeps: Sweeps, quantities: Sequence[str] | None = None, figure: str | None = None
) -> Figure:
    """A panel a quantity, a curve a system; see `Sweeps.plot`."""
    responses = {name: sweeps.figures(name, figure) for name in unique_names(quantities or sweeps.quantities)}
    order = np.argsort(sweeps.speeds)
    speeds = sweeps.system.speed_unit.of(sweeps.speeds[order])
    with page(1.1 + 1.9 * len(responses), f"{title_of(sweeps.system)}: response over speed") as made:
        axes = made.subplots(len(responses), 1, sharex=True, squeeze=False)[:, 0]
        for place, (name, values) in zip(axes, responses.items(), strict=True):
            factor = label_quantity(place, sweeps.system, name, values, figure or sweeps.figure)
            for label, row, shade in zip(sweeps.sweeps, values, shades(len(sweeps.sweeps)), strict=True):
                draw_through(place, speeds, row[order] * factor, label=label, **shade)
            if np.nanmin(values, initial=0.0) >= 0:
                place.set_ylim(bottom=0.0)
        label_speeds(axes[-1], sweeps.system, sweeps.speeds[order])
        made.align_ylabels(axes)
        handles, names = axes[0].get_legend_handles_labels()
        made.legend(handles, names, title=sweeps.title, loc="outside right center", handlelength=2.4)
    return made


@figure.register(Branch)
def branch_figure(branch: Branch) -> Figure:
    """Largest moduli and the spectral radius over the continuation parameter, dashed where the branch is
    unstable."""
    names = branch.system.coordinates[: MOST_SHOWN - 1]
    title = f"{title_of(branch.system)}: branch of nonlinear orbits"
    with page(1.4 + 1.5 * (len(names) + 1), title) as figure:
        axes = figure.subplots(len(names) + 1, 1, sharex=True, squeeze=False)[:, 0]
        for place, name, values in zip(axes, names, branch.peaks.T, strict=False):
            _draw_branch(
                place, branch, label_quantity(place, branch.system, name, values, "max_abs") * values
            )
        axes[-1].axhline(1.0, color=BLACK, linewidth=0.9)
        axes[-1].set_yscale("log")
        axes[-1].set_ylabel("spectral\nradius |ρ|")
        _draw_branch(axes[-1], branch, branch.radius)
        label_speeds(axes[-1], branch.system, np.sort(branch.values), branch.over)
        axes[0].legend(loc="best")
        figure.align_ylabels(axes)
    return figure


def _draw_branch(axes: Axes, branch: Branch, values: Array) -> None:
    """Pieces of one verdict after another, and the turning points."""
    places, back, first = branch.system.unit_of(branch.over).of(branch.values), branch.turns.astype(bool), 0
    named: set[str] = set()
    for verdict, pieces in groupby(_verdicts_between(branch)):
        last = first + len([*pieces])
        color, line = _LINES[verdict]
        style = {"color": color, "linestyle": line, "marker": ".", "markersize": 4}
        style["label"] = None if verdict in named else verdict
        axes.plot(places[first : last + 1], values[first : last + 1], **style)
        named.add(verdict)
        first = last
    if back.any():
        axes.plot(
            places[back],
            values[back],
            "o",
            color=BLACK,
            markersize=4.5,
            label="turns back",
            clip_on=False,
        )


def _verdicts_between(branch: Branch) -> list[str]:
    """Verdicts between one point and the next: open where theirs differ, but for points where the branch
    turns back, which are on the verge of either."""
    known = [None if turns else verdict for turns, verdict in zip(branch.turns, branch.verdicts, strict=True)]
    both = ({each for each in pair if each is not None} for pair in pairwise(known))
    return [each.pop() if len(each) == 1 else UNDETERMINED for each in both]


@figure.register(Validity)
def validity_figure(validity: Validity) -> Figure:
    """The errors over speed."""
    unit, names = validity.system.speed_unit, validity.system.coordinates[:MOST_SHOWN]
    with page(3.4, f"{title_of(validity.system)}: error of the linear orbit") as figure:
        axes = figure.subplots()
        for name, row, shade in zip(names, validity.errors.T, shades(len(names)), strict=False):
            draw_through(axes, unit.of(validity.speeds), 100 * row, True, label=name, **shade)
        limit = {"color": GREY, "linewidth": 0.8}
        axes.axhline(100 * validity.allowed, linestyle="--", label=f"{100 * validity.allowed:g} %", **limit)
        if validity.trusted_to is not None:
            axes.axvline(unit.of(validity.trusted_to), linestyle=":", label="trusted to here", **limit)
        axes.set_yscale("log")
        label_speeds(axes, validity.system, validity.speeds)
        axes.set_ylabel("max|difference| / max|q| (%)")
        axes.legend()
    return figure


@figure.register(SensitivitiesOver)
def sensitivities_over_figure(found: SensitivitiesOver) -> Figure:
    """Elasticities over speed, a panel a quantity, of what matters most; moduli of complex ones."""
    count, shown = len(found.quantities), found.system.speed_unit.of(found.speeds)
    with page(0.7 + 2.2 * count, f"{title_of(found.system)}: what matters most") as figure:
        panels = figure.subplots(count, 1, squeeze=False, sharex=True)[:, 0]
        for place, axes in enumerate(panels):
            chosen = found.ranked(place)
            for k, shade in zip(chosen, shades(len(chosen)), strict=True):
                elasticities = found.elasticities[:, place, k]
                sizes = np.abs(elasticities) if np.any(np.imag(elasticities)) else np.real(elasticities)
                axes.plot(shown, sizes, marker=".", label=found.by[k], **shade)
            axes.axhline(0.0, color="black", linewidth=0.7)
            axes.set_title(found.quantities[place], loc="left")
            axes.set_ylabel("elasticity")
            axes.legend(ncols=3, fontsize="small")
        label_speeds(panels[-1], found.system, found.speeds)
    return figure


@tables.register(Sweeps)
def sweeps_tables(sweeps: Sweeps) -> Sequence[RenderableType]:
    """Peaks and quiet speeds of each quantity, and its largest figures."""
    return [_extremes_table(sweeps, name) for name in sweeps.quantities]


def _extremes_table(sweeps: Sweeps, name: str) -> RenderableType:
    values = sweeps.figures(name)
    largest = float(np.nanmax(np.abs(values), initial=0.0))
    factor, unit = prefixed(sweeps.system.units.get(name, ""), largest)
    title = f"{named(sweeps.figure, name)} in {unit}, for {sweeps.title or 'each'}"
    speed_unit = sweeps.system.speed_unit
    made = table(title, speed_unit.name, "", *sweeps.sweeps, left=2)
    for speed, kind, responses in sweeps.extremes(name):
        cells = (fixed(each * factor, each * factor, 4) for each in responses)
        made.add_row(f"{speed_unit.of(speed):.2f}", kind, *cells)
    made.add_row("largest", "", *(fixed(each, each, 4) for each in np.nanmax(values, axis=1) * factor))
    made.caption = "peaks and quiet speeds of the first, among the speeds given"
    return made


@tables.register(Branch)
def branch_tables(branch: Branch) -> Sequence[RenderableType]:
    """A row a point."""
    made = table_of("Orbits along the branch", branch.columns, most=_MOST_ROWS)
    return [made, text("\n" + branch.summary)]


@tables.register(Validity)
def validity_tables(validity: Validity) -> Sequence[RenderableType]:
    """A row a speed."""
    return [table_of("Linearisation error, %", validity.columns), text("\n" + validity.limit)]


@tables.register(SensitivitiesOver)
def sensitivities_over_tables(found: SensitivitiesOver) -> Sequence[RenderableType]:
    """A table a quantity, a row a speed: elasticities by what matters most."""
    unit, parts = found.system.speed_unit, []
    for place, quantity in enumerate(found.quantities):
        chosen = found.ranked(place)
        names = [found.by[k] for k in chosen]
        made = table(f"Elasticities of {quantity}", unit.name, quantity, *names, left=0)
        for speed, value, row in zip(
            found.speeds, found.values[:, place], found.elasticities[:, place][:, chosen], strict=True
        ):
            made.add_row(f"{unit.of(speed):.6g}", _size(value), *map(_size, row))
        parts.append(made)
    return parts


def _size(value: Any) -> str:
    """The value, or the modulus of a complex one."""
    size = abs(value) if value.imag else value.real
    return f"{size:.4g}" if math.isfinite(size) else "–"
