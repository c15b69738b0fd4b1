"""The design method in one picture: the map with the plan, what each speed needs, the simulation."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullLocator

from models.four_bar.results.outcome import Outcome
from solve.views.panels import title_of
from solve.views.style import BLACK, BLUE, GREEN, GREY, ORANGE, VERMILION, new_figure, styled

_LEVELS = (0.0, 0.25, 0.5, 0.75, 0.9, 1.0, 1.1, 1.25, 1.5, 2.0, 3.0, 5.0)
"""Stress over allowable stress."""

_TICKS = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100)
_COLORS = (BLUE, GREEN, VERMILION)


def outcome_figure(result: Outcome) -> Figure:
    """The map of stress over allowable stress; below it the stress that reaching a speed needs; below this
    the simulated stress of each link during the slowest run-up."""
    rows = 3 if result.trials else 2
    with styled():
        figure = new_figure(3.3 + 1.9 * (rows - 1))
        figure.suptitle(f"{title_of(result.design.map.model)}: run-up below a stress", fontweight="bold")
        axes = figure.subplots(rows, 1, height_ratios=[1.75, *[1.0] * (rows - 1)], squeeze=False)[:, 0]
        _draw_map(figure, axes[0], result)
        _draw_needed(axes[1], result)
        axes[1].set_xlim(axes[0].get_xlim())
        if result.trials:
            _draw_simulated(axes[2], result)
        figure.align_ylabels()
    return figure


def _draw_map(figure: Figure, axes: Axes, result: Outcome) -> None:
    design, stresses = result.design, result.design.map
    unit = stresses.model.speed_unit
    across = unit.of(stresses.speeds)
    norm = BoundaryNorm(_LEVELS, 256, extend="max")
    millimetres, ratio = stresses.L4 * 1e3, np.nan_to_num(stresses.ratio, posinf=1e9)
    filled = axes.contourf(
        across, millimetres, ratio.T, levels=_LEVELS, cmap="RdYlBu_r", norm=norm, extend="max"
    )
    axes.contour(across, millimetres, ratio.T, levels=[1.0], colors=BLACK, linewidths=1.3)
    for column, L4 in zip(ratio.T, millimetres, strict=True):
        top = np.flatnonzero((column[1:-1] > column[:-2]) & (column[1:-1] >= column[2:])) + 1
        axes.plot(across[top], np.full(len(top), L4), ".", color=GREY, markersize=2)
    axes.axhline(stresses.own_L4 * 1e3, color=GREY, linewidth=0.8, linestyle=":")
    for band in design.quiet:
        axes.plot(
            [max(unit.of(band.start), across[0]), unit.of(band.end)],
            [stresses.own_L4 * 1e3] * 2,
            color=GREEN,
            lw=2.5,
        )
    if result.plan is not None:
        speeds, target = np.linspace(stresses.speeds[0], result.target, 600), unit.of(result.target)
        axes.plot(unit.of(speeds), result.plan.rounded(speeds)[0] * 1e3, color="white", linewidth=3.2)
        axes.plot(unit.of(speeds), result.plan.rounded(speeds)[0] * 1e3, color=BLACK, linewidth=1.6)
        axes.plot(target, result.plan.L4[-1] * 1e3, "o", color=BLACK)
        if result.returns:
            ends = [result.plan.L4[-1] * 1e3, stresses.own_L4 * 1e3]
            axes.annotate(
                "", (target, ends[1]), (target, ends[0]), arrowprops={"arrowstyle": "->", "lw": 1.6}
            )
    axes.set_xlabel(f"speed ({unit.name})")
    axes.set_ylabel("$L_4$ (mm)")
    axes.grid(False)
    bar = figure.colorbar(filled, ax=axes, ticks=_LEVELS, pad=0.01)
    bar.set_label("stress / allowable")
    axes.set_title(
        "steady, worst link; thin line: 1; dots: critical speeds; thick: plan; green: quiet at its own $L_4$",
        loc="left",
    )


def _draw_needed(axes: Axes, result: Outcome) -> None:
    design, stresses = result.design, result.design.map
    unit = stresses.model.speed_unit
    across = unit.of(stresses.speeds)
    axes.plot(across, stresses.own_ratio, color=GREY, linewidth=0.8, label="steady, $L_4$ fixed")
    axes.plot(across, design.needed.fixed, color=VERMILION, label="run-up, $L_4$ fixed")
    axes.plot(across, design.needed.returning, color=BLUE, label="$L_4$ moves and returns")
    axes.plot(across, design.needed.moving, color=GREEN, label="$L_4$ moves")
    axes.axhline(1.0, color=BLACK, linewidth=0.9)
    axes.axvline(unit.of(result.target), color=GREY, linewidth=0.8, linestyle="--")
    axes.set_yscale("log")
    axes.set_ylim(bottom=min(0.1, 0.1 * float(design.needed.fixed[-1])))
    axes.yaxis.set_major_locator(FixedLocator(_TICKS))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_locator(NullLocator())
    axes.set_ylabel("stress / allowable\nneeded to reach")
    axes.set_xlabel(f"speed ({unit.name})")
    axes.legend(ncols=4, loc="lower right", bbox_to_anchor=(1.0, 0.98))


def _draw_simulated(axes: Axes, result: Outcome) -> None:
    first = result.trials[0]
    simulated, unit = first.simulated, result.design.map.model.speed_unit
    for number, (link, color) in enumerate(zip(result.design.map.links, _COLORS, strict=True)):
        axes.plot(simulated.time, first.ratio[:, number], color=color, label=link)
    steady = (result.until.speeds - first.run_up.start) / first.run_up.acceleration
    axes.plot(steady, result.steady.max(axis=1), color=GREY, linestyle=":", label="steady, worst")
    axes.axhline(1.0, color=BLACK, linewidth=0.9)
    axes.set_xlim(0, simulated.time[-1])
    axes.set_ylim(0, max(1.25, 1.05 * first.worst))
    axes.set_xlabel(f"time (s) at {unit.per_second.text(first.run_up.acceleration, '.3g')}")
    axes.set_ylabel("simulated stress\n/ allowable, a turn")
    right = axes.twinx()
    right.plot(simulated.time, unit.of(simulated.speed), color=GREY, linestyle="--", linewidth=1.0)
    right.set_ylabel(f"speed ({unit.name}), dashed")
    right.grid(False)
    right.set_ylim(bottom=0)
    if result.returns:
        axes.axvspan(first.run_up.duration, simulated.time[-1], color=ORANGE, alpha=0.12, linewidth=0)
    axes.legend(loc="upper left", ncols=4)
