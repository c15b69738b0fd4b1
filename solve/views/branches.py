"""Figures and tables of branches of nonlinear orbits, and of curves of folds and doublings."""

from collections.abc import Sequence
from itertools import groupby, pairwise

import numpy as np

from solve.arrays import Array
from solve.labels import unit_of
from solve.results.branch import (
    BRANCHING,
    DOUBLING,
    FOLD,
    GRAZING,
    KINDS,
    STABLE,
    TORUS,
    UNDETERMINED,
    UNSTABLE,
    Branch,
)
from solve.results.contents import MOST_SHOWN
from solve.results.formatting import headed
from solve.results.scatter import Scatter
from solve.results.special_curves import SpecialCurves
from solve.views.panels import (
    axis_label,
    label_quantity,
    label_radius,
    label_speeds,
    omission,
    panels_over,
    shades,
    title_of,
)
from solve.views.show import figure, tables
from solve.views.style import BLACK, BLUE, GREY, MANY, VERMILION, Axes, Figure, page
from solve.views.tables import MOST_ROWS, RenderableType, table_of, text

_LINES = {STABLE: (BLUE, "-"), UNSTABLE: (VERMILION, "--"), UNDETERMINED: (GREY, "-")}

_MARKS = {
    FOLD: ("o", "turns back"),
    DOUBLING: ("^", "period doubles"),
    TORUS: ("s", "torus"),
    GRAZING: ("x", "grazes"),
    BRANCHING: ("D", "branches cross"),
}
"""Markers and labels of special points."""


_SIGNS = "o", "^", "s", "D", "v"
"""Markers of initial states, one for each orbit on which motions settle."""


@figure.register(Branch)
def branch_figure(branch: Branch) -> Figure:
    """Figure of the largest absolute values of the coordinates and the spectral radius versus the varied
    quantity. Curves are dashed where the branch is unstable. For unforced modes, the energy is drawn instead
    of the spectral radius."""
    names = branch.system.coordinates[: MOST_SHOWN - 1]
    count = len(names) + 1
    title = "unforced nonlinear modes" if len(branch.energies) else "branch of nonlinear orbits"
    title += omission(len(branch.system.coordinates), MOST_SHOWN - 1, "coordinates")
    with panels_over(branch.system, branch.values, title, 1.4 + 1.5 * count, count, branch.over) as (
        sheet,
        panels,
    ):
        for axes, name, values in zip(panels, names, branch.peaks.T, strict=False):
            factor = label_quantity(axes, branch.system, name, values, "max_abs")
            _draw_branch(axes, branch, factor * values)
        if len(branch.energies):
            panels[-1].set_yscale("log")
            panels[-1].set_ylabel(f"energy ({branch.energy_unit})" if branch.energy_unit else "energy")
            _draw_branch(panels[-1], branch, branch.energies)
        else:
            label_radius(panels[-1], branch.radius)
            _draw_branch(panels[-1], branch, branch.radius)
        sheet.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=6)
    return sheet


def _draw_branch(axes: Axes, branch: Branch, values: Array) -> None:
    """Draw a branch as sections of constant verdict, and mark its special points."""
    x, labelled = unit_of(branch.system, branch.over).from_si(branch.values), set[str]()
    for number in range(int(branch.numbers.max()) + 1):
        in_branch = np.flatnonzero(branch.numbers == number)
        first = 0
        for verdict, section in groupby(_verdicts_between(branch, in_branch)):
            last = first + len([*section])
            color, line = _LINES[verdict]
            style = {"color": color, "linestyle": line, "marker": ".", "markersize": 4}
            style["label"] = None if verdict in labelled else verdict
            axes.plot(x[in_branch[first : last + 1]], values[in_branch[first : last + 1]], **style)
            labelled.add(verdict)
            first = last
    for kind, (marker, label) in _MARKS.items():
        special = branch.kinds == KINDS.index(kind)
        if special.any():
            style = {"color": BLACK, "markersize": 4.5, "label": label, "clip_on": False}
            axes.plot(x[special], values[special], marker, linestyle="none", **style)


def _verdicts_between(branch: Branch, points: Array) -> list[str]:
    """Return the verdict on each segment between neighbouring points of one branch; "undetermined" if the
    verdicts at its ends differ. Special points are ignored, because they lie on the stability boundary."""
    verdicts = [
        None if branch.kinds[at] else verdict
        for at, verdict in zip(points.tolist(), np.array(branch.verdicts)[points].tolist(), strict=True)
    ]
    both = ({verdict for verdict in pair if verdict is not None} for pair in pairwise(verdicts))
    return [pair.pop() if len(pair) == 1 else UNDETERMINED for pair in both]


@figure.register(SpecialCurves)
def special_curves_figure(curves: SpecialCurves) -> Figure:
    """Figure of the curves in the plane of the two parameters, with their cusps."""
    first, second = curves.names
    with page(4.2, f"{title_of(curves.system)}: {curves.kind}s in two parameters") as sheet:
        axes, count = sheet.subplots(), int(curves.numbers.max(initial=-1)) + 1
        units = [unit_of(curves.system, name) for name in curves.names]
        x, y = (unit.from_si(values) for unit, values in zip(units, curves.values.T, strict=True))
        for number, shade in enumerate(shades(count)):
            in_curve = curves.numbers == number
            axes.plot(
                x[in_curve], y[in_curve], marker=".", label=f"{curves.kind}s, curve {number + 1}", **shade
            )
        if curves.cusps.any():
            axes.plot(x[curves.cusps], y[curves.cusps], "D", color=BLACK, label="cusp")
        if count:
            label_speeds(axes, curves.system, np.sort(curves.values[:, 0]), first)
            axes.margins(x=0.05)
            axes.autoscale(axis="x")
            axes.legend()
        axes.set_ylabel(axis_label(curves.system, second))
    return sheet


@figure.register(Scatter)
def scatter_figure(scatter: Scatter) -> Figure:
    """Figure of the initial states in the plane of the first coordinate and its velocity, coloured by the
    orbit on which the motion settles."""
    system, n = scatter.system, scatter.system.n
    name = system.coordinates[0]
    with page(4.6, f"{title_of(system)}: orbits reached from {len(scatter.leads)} initial states") as sheet:
        axes = sheet.subplots()
        for number, share in enumerate(scatter.shares):
            leads_here = scatter.leads == number
            peak = scatter.orbits[number].statistics(name).max_abs
            label = f"{100 * share:.3g} % to max|{name}| = {peak:.4g}"
            x, y = scatter.starts[leads_here, 0], scatter.starts[leads_here, n]
            axes.plot(x, y, _SIGNS[number % len(_SIGNS)], color=MANY[number % len(MANY)], label=label)
        lost = scatter.leads < 0
        if lost.any():
            axes.plot(
                scatter.starts[lost, 0], scatter.starts[lost, n], "x", color=GREY, label="do not settle"
            )
        unit = system.labels.units.get(name, "")
        axes.set_xlabel(headed(f"initial {name}", unit))
        axes.set_ylabel(headed(f"initial velocity of {name}", f"{unit}/s" if unit else ""))
        sheet.legend(loc="outside lower center", ncols=2)
    return sheet


@tables.register(Branch)
def branch_tables(branch: Branch) -> Sequence[RenderableType]:
    """Table with one row per point."""
    points = table_of("Orbits along the branch", branch.columns, most=MOST_ROWS)
    return [points, text("\n" + branch.summary)]


@tables.register(SpecialCurves)
def special_curves_tables(curves: SpecialCurves) -> Sequence[RenderableType]:
    """Table with one row per point."""
    points = table_of(f"{curves.kind.capitalize()}s in two parameters", curves.columns, most=MOST_ROWS)
    return [points, text("\n" + curves.summary)]
