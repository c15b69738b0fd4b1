"""Figures and tables of tolerance studies: distributions of quantities, limits, Sobol indices, probabilities
and worst cases."""

import math
from collections.abc import Sequence
from functools import partial

import numpy as np

from solve import labels
from solve.arrays import Array
from solve.results.contents import MOST_SHOWN
from solve.results.formatting import greek, measured, prefixed
from solve.results.tolerances import UNSTABLE, Tolerances
from solve.views.panels import MOST_DRAWN, legend_above, omission, title_of
from solve.views.show import figure, tables
from solve.views.style import BLUE, GREY, VERMILION, Axes, Figure, page
from solve.views.tables import RenderableType, table, text

_OUTSIDE = 5e-4
"""Fraction of a distribution that histograms omit at each end. Chosen by judgement."""


@figure.register(Tolerances)
def tolerances_figure(result: Tolerances) -> Figure:
    """Figure with one row per quantity. Each row shows the distribution of the quantity, with its limits, and
    the Sobol indices."""
    varying = _varying(result)
    names = varying[:MOST_SHOWN]
    title = f"{title_of(result.system)}: tolerances{omission(len(varying), MOST_SHOWN, 'quantities')}"
    columns = 2 if result.sobol else 1
    bars = min(len(result.spreads), MOST_DRAWN)
    with page(0.7 + len(names) * max(2.0, 0.7 + 0.28 * bars), title) as sheet:
        panels = sheet.subplots(len(names), columns, squeeze=False)
        for row, name in zip(panels, names, strict=True):
            _draw_distribution(row[0], result, name)
            if result.sobol:
                _draw_indices(row[1], result, name)
        legend_above(panels[0, 0])
        if result.sobol:
            largest = f", the {bars} largest" if len(result.spreads) > bars else ""
            panels[0, 1].set_title(f"Sobol indices{largest}", loc="left", color=GREY)
            legend_above(panels[0, 1])
    return sheet


def _varying(result: Tolerances) -> list[str]:
    """Return the quantities that vary with the parameters or have limits. The spectral radius comes last."""
    varying = [
        name
        for name, column in zip(result.units, result.values.T, strict=True)
        if _spread(column) and (name in result.bounds or _is_influenced(result, name))
    ]
    ordered = [*varying[1:], *varying[:1]] if varying[:1] == ["spectral_radius"] else varying
    return ordered or list(result.units)[:1]


def _is_influenced(result: Tolerances, name: str) -> bool:
    """Return whether a quantity has Sobol indices. Return True if no Sobol indices were computed for any
    quantity."""
    indices = result.sobol.get(name, {}).values()
    return not indices or any(np.isfinite(each.total) for each in indices)


def _spread(values: Array) -> bool:
    known = values[np.isfinite(values)]
    return len(known) > 0 and float(np.ptp(known)) > 1e-9 * float(np.abs(known).max())


def _draw_distribution(axes: Axes, result: Tolerances, name: str) -> None:
    """Draw the distribution of the worst value of a quantity at any speed, with its limits and its nominal
    value."""
    values, unit = result.values[:, list(result.units).index(name)], result.units[name]
    known = np.isfinite(values)
    factor, shown = prefixed(unit, float(np.abs(values[known]).max(initial=0.0)))
    values, weights = factor * values[known], result.weights[known]
    if _spread(values):
        order = np.argsort(values)
        mass = np.cumsum(weights[order]) / weights.sum()
        low, high = np.interp([_OUTSIDE, 1 - _OUTSIDE], mass, values[order])
        axes.hist(values, 40, range=(low, high), weights=weights, density=True, color=BLUE, alpha=0.6)
    axes.axvline(factor * result.worst[name].nominal, color=GREY, linewidth=1.0, label="nominal")
    # Files of earlier versions contain a number for each name.
    for number, limit in enumerate(np.atleast_1d(result.bounds.get(name, ()))):
        label = "limit" if number == 0 else None
        axes.axvline(factor * limit, color=VERMILION, linewidth=1.2, label=label)
    axes.set_xlabel(f"{greek(name)} ({shown})" if shown else greek(name).replace("_", " "))
    axes.set_yticks([])
    axes.set_ylabel("density")


def _draw_indices(axes: Axes, result: Tolerances, name: str) -> None:
    """Draw the first-order and total indices of the parameters, the largest at the top."""
    indices = result.sobol[name]
    ranked = sorted(indices, key=lambda parameter: -indices[parameter].total)[:MOST_DRAWN]
    rows = np.arange(len(ranked))
    for shift, field, colour, label in ((-0.2, "total", GREY, "total"), (0.2, "first", BLUE, "first order")):
        sizes = [max(0.0, np.nan_to_num(getattr(indices[parameter], field))) for parameter in ranked]
        known = [np.isfinite(getattr(indices[parameter], field)) for parameter in ranked]
        errors = [
            getattr(indices[parameter], f"{field}_error") if is_known else 0.0
            for parameter, is_known in zip(ranked, known, strict=True)
        ]
        axes.barh(rows + shift, sizes, 0.4, xerr=errors, color=colour, label=label, error_kw={"lw": 0.8})
    axes.set_yticks(rows, ranked)
    axes.invert_yaxis()
    axes.set_xlim(left=0.0)


@tables.register(Tolerances)
def tolerances_tables(result: Tolerances) -> Sequence[RenderableType]:
    """Tables of spreads, probabilities, Sobol indices and worst cases."""
    unit_of = partial(labels.unit_of, result.system)
    spreads = table(
        "Parameters",
        *("parameter", "unit", "nominal", "spread"),
        left=2,
        rows=[
            (name, unit_of(name).name, f"{each.nominal:.6g}", each.text)
            for name, each in result.spreads.items()
        ],
    )
    probabilities = table(
        "Probabilities, with 95 % intervals",
        *("event", "probability", "low", "high", "undetermined", "failed"),
        rows=[
            (
                name if name == UNSTABLE else f"violated: {name}",
                *(f"{number:.3g}" for number in each[:3]),
                *map(str, each[4:]),
            )
            for name, each in result.probability.items()
        ],
    )
    shown = [text(f"\n{result.summary}", "bold"), spreads, probabilities]
    if result.sobol:
        shown.append(_indices_table(result))
    return [*shown, _worst_table(result)]


def _indices_table(result: Tolerances) -> RenderableType:
    rows = [
        (
            quantity,
            parameter,
            _with_error(each.first, each.first_error),
            _with_error(each.total, each.total_error),
        )
        for quantity, indices in result.sobol.items()
        for parameter, each in sorted(indices.items(), key=lambda item: -item[1].total)
    ]
    return table("Sobol indices", "quantity", "parameter", "first order", "total", left=2, rows=rows)


def _with_error(value: float, error: float) -> str:
    return f"{value:z.3f} ± {error:.3f}" if math.isfinite(value) else "–"


def _worst_table(result: Tolerances) -> RenderableType:
    """Return a table with one column per quantity: its nominal value, its worst value, and the speed and the
    parameters of the worst case."""
    worst, unit = result.worst, result.system.labels.speed_unit
    rows = [
        ("nominal", *(measured(each.nominal, result.units[name]) for name, each in worst.items())),
        ("worst", *(measured(each.value, result.units[name]) for name, each in worst.items())),
        ("at", *(unit.text(each.speed) for each in worst.values())),
    ]
    for name in result.spreads:
        rows.append((name, *(f"{each.parameters[name]:.5g}" for each in worst.values())))
    return table("Worst points", "", *worst, rows=rows)
