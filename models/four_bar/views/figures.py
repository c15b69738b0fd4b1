"""Figures of the rigid linkage and of the design method."""

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from matplotlib.ticker import FixedLocator, MultipleLocator, NullLocator

from models.four_bar.barker import classify
from models.four_bar.forces import JOINTS, Body, joint_forces
from models.four_bar.linkage import ADVISED, TURN, Linkage, Motion
from models.four_bar.outcome import Outcome
from solve.arrays import Array, Plane, uniform_phases
from solve.results.contents import HALF_DEGREES
from solve.results.formatting import prefixed
from solve.units import unit_given
from solve.views.panels import title_of
from solve.views.style import BLACK, BLUE, GREEN, GREY, LIGHT, ORANGE, PURPLE, VERMILION, new_figure, styled

_POSITIONS = 12
"""Number of positions drawn in a pale colour: one for every 30 degrees of the crank."""

_SHOWN = math.radians(120)
"""Default crank angle of the position that is drawn in full."""

_ROWS = 3
"""Number of entries per column in the legend of coupler points."""

_PATHS = (VERMILION, PURPLE, ORANGE, GREEN)
_LINKS = {1: BLACK, 2: BLUE, 3: GREEN}

_LEVELS = (0.0, 0.25, 0.5, 0.75, 0.9, 1.0, 1.1, 1.25, 1.5, 2.0, 3.0, 5.0)
"""Contour levels of the ratio of stress to allowable stress."""

_TICKS = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100)


def linkage_figure(
    linkage: Linkage,
    bodies: Sequence[Body],
    speed: float | None,
    points: Sequence[complex],
    position: float | None = None,
) -> Figure:
    """Figure of positions with coupler curves, of the transmission angle and of ratios; if a speed is given,
    also of the drive torque and the joint forces.

    `speed` is in rad/s; `position` is the crank angle (rad) of the position that is drawn in full. Raises
    LinkageError for a crank that cannot turn fully.
    """
    linkage.require_full_turn()
    shown = _SHOWN if position is None else position
    kind = classify(linkage)
    at_speed = "" if speed is None else f", {unit_given(speed).text(speed)}"
    with styled():
        rows = 2 if speed is None else 3
        heights = [3.6, 1.75 * (rows - 1)]
        figure = new_figure(sum(heights))
        grid = figure.add_gridspec(2, 1, height_ratios=heights)
        top, below = (figure.add_subfigure(grid[row]) for row in range(2))
        title = f"Four-bar linkage {kind.symbol}, {linkage.branch} branch{at_speed}"
        figure.suptitle(title, fontweight="bold")
        left, right = top.subplots(1, 2, width_ratios=(2.2, 1))
        _draw_positions(left, linkage, points, shown)
        _write_summary(right, left, linkage, shown)
        axes = below.subplots(rows - 1, 2, sharex=True, squeeze=False)
        t1 = np.linspace(0.0, TURN, HALF_DEGREES)
        _draw_transmission(axes[0, 0], linkage, t1)
        _draw_ratios(axes[0, 1], linkage.motion(t1))
        if speed is not None:
            _draw_forces(axes[1], linkage.motion(t1, speed), bodies)
        for panel in axes.flat:
            panel.axvline(math.degrees(shown % TURN), color=GREY, linewidth=0.7, linestyle=":")
        for panel in axes[-1]:
            panel.set_xlim(0, 360)
            panel.xaxis.set_major_locator(MultipleLocator(60))
            panel.set_xlabel("crank angle $t_1$ (°)")
        below.align_ylabels()
    return figure


def _draw_positions(axes: Axes, linkage: Linkage, points: Sequence[complex], shown: float) -> None:
    """Draw the paths of the joints and the coupler points, several positions in a pale colour, and one in
    full colour."""
    motion = linkage.motion(np.linspace(0.0, TURN, HALF_DEGREES))
    for path in _joints(motion)[1:3]:
        axes.plot(path.real, path.imag, color=GREY, linewidth=0.7)
    for k, point in enumerate(points):
        path, label = motion.position(2, point), f"({point.real:g}, {point.imag:g}) m"
        axes.plot(path.real, path.imag, color=_PATHS[k % len(_PATHS)], linewidth=1.8, label=label, zorder=3)
    pale = linkage.motion(uniform_phases(_POSITIONS, TURN))
    for joints in np.transpose(_joints(pale)):
        axes.plot(joints.real, joints.imag, "-o", color=GREY, alpha=0.28, linewidth=0.9, markersize=2)
    _draw_linkage(axes, linkage.motion(shown), points)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.1)
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")


def _write_summary(axes: Axes, pictured: Axes, linkage: Linkage, shown: float) -> None:
    """Write the class, the lengths and the transmission angle as text, beside the legend of the positions."""
    kind, gamma = classify(linkage), linkage.transmission_extremes()
    lines = [
        kind.name,
        f"({kind.mark})",
        "",
        *(f"$L_{k}$ = {length:g} m" for k, length in enumerate(linkage.lengths, start=1)),
        "",
        f"γ = {math.degrees(gamma.min):.1f}° … {math.degrees(gamma.max):.1f}°",
        *(f"follower's dead point: {math.degrees(angle):.1f}°" for angle in linkage.dead_points),
        "",
        f"drawn in full: $t_1$ = {math.degrees(shown):g}°",
    ]
    axes.axis("off")
    axes.text(0.0, 1.0, "\n".join(lines), va="top", linespacing=1.5, transform=axes.transAxes)
    handles, labels = pictured.get_legend_handles_labels()
    axes.legend(
        handles, labels, title="paths of coupler points", alignment="left", ncols=1 + (len(handles) > _ROWS),
        loc="lower left", bbox_to_anchor=(-0.03, 0.0), borderaxespad=0.0, handlelength=1.4, columnspacing=1.0,
    )  # fmt: skip


def _joints(motion: Motion) -> Plane:
    """Return the positions (4, …) of the joints O, A, B, C."""
    A, B = motion.position(1, motion.linkage.L1), motion.position(3, motion.linkage.L3)
    return np.stack((0 * A, A, B, 0 * A + motion.linkage.L4))


def _draw_linkage(axes: Axes, motion: Motion, points: Sequence[complex]) -> None:
    """Draw one position in full colour: links, joints with their letters, ground and coupler points."""
    joints = _joints(motion)
    for k, point in enumerate(points):
        place = motion.position(2, point)
        corners = np.array([joints[1], place, joints[2]])
        axes.add_patch(Polygon(_xy(corners), color=BLUE, alpha=0.15, linewidth=0, zorder=4))
        axes.plot(place.real, place.imag, "o", color=_PATHS[k % len(_PATHS)], markersize=5, zorder=7)
    for link, colour in _LINKS.items():
        axes.plot(*_xy(joints[link - 1 : link + 1]).T, color=colour, linewidth=2.6, zorder=5)
    for letter, place in zip(JOINTS, joints, strict=True):
        axes.plot(place.real, place.imag, "o", color="white", markeredgecolor=BLACK, markersize=5, zorder=6)
        offset = (-7, 4) if letter in "AB" else (-9, -12)
        axes.annotate(letter, (place.real, place.imag), offset, textcoords="offset points", ha="right")
    size = max(motion.linkage.lengths)
    half, depth = 0.035 * size, 0.055 * size
    for pivot in (joints[0], joints[3]):
        corners = pivot + np.array([0, -half - 1j * depth, half - 1j * depth])
        axes.add_patch(Polygon(_xy(corners), facecolor=LIGHT, edgecolor=BLACK, linewidth=0.8, zorder=4))


def _xy(points: Plane) -> Array:
    return np.column_stack((points.real, points.imag))


def _draw_transmission(axes: Axes, linkage: Linkage, t1: Array) -> None:
    axes.axhspan(*np.degrees(ADVISED), color=GREEN, alpha=0.10, linewidth=0)
    axes.plot(np.degrees(t1), np.degrees(linkage.transmission_angle(t1)), color=GREEN)
    axes.set_ylim(0, 180)
    axes.yaxis.set_major_locator(MultipleLocator(45))
    _label(axes, "transmission angle; advised range shaded", "γ (°)")


def _draw_ratios(axes: Axes, motion: Motion) -> None:
    t1 = np.degrees(motion.t[0])
    for link in (2, 3):
        omega, alpha = motion.omega[link - 1], motion.alpha[link - 1]
        axes.plot(t1, omega, color=_LINKS[link], label=f"$ω_{link}/ω_1$")
        axes.plot(t1, alpha, color=_LINKS[link], linestyle=(0, (4, 2)), label=f"$α_{link}/ω_1^2$")
    _label(axes, "coupler (2) and follower (3)", "ratio to the crank")
    _legend_on_top(axes)


def _draw_forces(panels: Sequence[Axes], motion: Motion, bodies: Sequence[Body]) -> None:
    t1, forces = np.degrees(motion.t[0]), joint_forces(motion, bodies)
    factor, unit = prefixed("N m", float(np.abs(forces.torque).max()))
    panels[0].axhline(0, color=GREY, linewidth=0.6)
    panels[0].plot(t1, factor * forces.torque, color=VERMILION)
    _label(panels[0], "drive torque", f"torque ({unit})")
    moduli = {joint: np.abs(getattr(forces, name)) for joint, name in JOINTS.items()}
    factor, unit = prefixed("N", float(max(modulus.max() for modulus in moduli.values())))
    for (joint, modulus), colour in zip(moduli.items(), (BLACK, BLUE, GREEN, PURPLE), strict=True):
        panels[1].plot(t1, factor * modulus, color=colour, label=joint)
    panels[1].set_ylim(bottom=0)
    _label(panels[1], "joint forces", f"force ({unit})")
    _legend_on_top(panels[1])


def _label(axes: Axes, title: str, quantity: str) -> None:
    axes.set_ylabel(quantity)
    axes.set_title(title, loc="left", color=GREY)


def _legend_on_top(axes: Axes) -> None:
    """Add a legend in one row inside the frame, above all curves."""
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + 0.34 * (high - low))
    axes.legend(
        ncols=4, loc="upper center", handlelength=1.6, columnspacing=1.2, frameon=True, edgecolor="none",
        framealpha=0.9,
    )  # fmt: skip


def design_figure(result: Outcome) -> Figure:
    """Figure of the map of stress ratios, of the stress ratio that is needed to reach each speed, and of
    simulated stresses."""
    rows = 3 if result.trials else 2
    with styled():
        figure = new_figure(3.3 + 1.9 * (rows - 1))
        figure.suptitle(f"{title_of(result.map.model)}: run-up below a stress", fontweight="bold")
        axes = figure.subplots(rows, 1, height_ratios=[1.75, *[1.0] * (rows - 1)], squeeze=False)[:, 0]
        _draw_map(figure, axes[0], result)
        _draw_needed(axes[1], result)
        axes[1].set_xlim(axes[0].get_xlim())
        if result.trials:
            _draw_simulated(axes[2], result)
        figure.align_ylabels()
    return figure


def _draw_map(figure: Figure, axes: Axes, result: Outcome) -> None:
    stresses, unit = result.map, result.map.model.labels.speed_unit
    speeds, lengths, own_L4 = unit.from_si(stresses.speeds), stresses.L4 * 1e3, stresses.own_L4 * 1e3
    ratio, norm = np.nan_to_num(stresses.ratio, posinf=1e9), BoundaryNorm(_LEVELS, 256, extend="max")
    filled = axes.contourf(speeds, lengths, ratio.T, levels=_LEVELS, cmap="RdYlBu_r", norm=norm, extend="max")
    axes.contour(speeds, lengths, ratio.T, levels=[1.0], colors=BLACK, linewidths=1.3)
    peaks, columns = np.nonzero((ratio[1:-1] > ratio[:-2]) & (ratio[1:-1] >= ratio[2:]))
    axes.plot(speeds[peaks + 1], lengths[columns], ".", color=GREY, markersize=2)
    axes.axhline(own_L4, color=GREY, linewidth=0.8, linestyle=":")
    for band in result.design.quiet:
        axes.plot(
            [max(unit.from_si(band.start), speeds[0]), unit.from_si(band.end)],
            [own_L4, own_L4],
            color=GREEN,
            lw=2.5,
        )
    if result.plan is not None:
        along, target = np.linspace(stresses.speeds[0], result.target, 600), unit.from_si(result.target)
        last = result.plan.L4[-1] * 1e3
        for color, width in (("white", 3.2), (BLACK, 1.6)):
            axes.plot(unit.from_si(along), result.plan.rounded(along)[0] * 1e3, color=color, linewidth=width)
        axes.plot(target, last, "o", color=BLACK)
        if result.returns:
            axes.annotate("", (target, own_L4), (target, last), arrowprops={"arrowstyle": "->", "lw": 1.6})
    axes.set_xlabel(f"speed ({unit.name})")
    axes.set_ylabel("$L_4$ (mm)")
    axes.grid(False)
    figure.colorbar(filled, ax=axes, ticks=_LEVELS, pad=0.01).set_label("stress / allowable")
    axes.set_title(
        "steady, worst link; thin line: 1; dots: critical speeds; thick: plan; green: quiet at its own $L_4$",
        loc="left",
    )


def _draw_needed(axes: Axes, result: Outcome) -> None:
    needed, unit = result.design.needed, result.map.model.labels.speed_unit
    speeds = unit.from_si(result.map.speeds)
    axes.plot(speeds, result.map.own_ratio, color=GREY, linewidth=0.8, label="steady, $L_4$ fixed")
    axes.plot(speeds, needed.fixed, color=VERMILION, label="run-up, $L_4$ fixed")
    axes.plot(speeds, needed.returning, color=BLUE, label="$L_4$ moves and returns")
    axes.plot(speeds, needed.moving, color=GREEN, label="$L_4$ moves")
    axes.axhline(1.0, color=BLACK, linewidth=0.9)
    axes.axvline(unit.from_si(result.target), color=GREY, linewidth=0.8, linestyle="--")
    axes.set_yscale("log")
    axes.set_ylim(bottom=min(0.1, 0.1 * float(needed.fixed[-1])))
    axes.yaxis.set_major_locator(FixedLocator(_TICKS))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_locator(NullLocator())
    axes.set_ylabel("stress / allowable\nneeded to reach")
    axes.set_xlabel(f"speed ({unit.name})")
    axes.legend(ncols=4, loc="lower right", bbox_to_anchor=(1.0, 0.98))


def _draw_simulated(axes: Axes, result: Outcome) -> None:
    first, unit = result.trials[0], result.map.model.labels.speed_unit
    run_up, simulated = first.run_up, first.simulated
    for ratio, link, color in zip(first.ratio.T, result.map.links, (BLUE, GREEN, VERMILION), strict=True):
        axes.plot(simulated.time, ratio, color=color, label=link)
    steady = (result.until.speeds - run_up.start) / run_up.acceleration
    axes.plot(steady, result.steady.max(axis=1), color=GREY, linestyle=":", label="steady, worst")
    axes.axhline(1.0, color=BLACK, linewidth=0.9)
    axes.set_xlim(0, simulated.time[-1])
    axes.set_ylim(0, max(1.25, 1.05 * first.worst))
    axes.set_xlabel(f"time (s) at {unit.per_second.text(run_up.acceleration, '.3g')}")
    axes.set_ylabel("simulated stress\n/ allowable, per revolution")
    right = axes.twinx()
    right.plot(simulated.time, unit.from_si(simulated.speed), color=GREY, linestyle="--", linewidth=1.0)
    right.set_ylabel(f"speed ({unit.name}), dashed")
    right.grid(False)
    right.set_ylim(bottom=0)
    if result.returns:
        axes.axvspan(run_up.duration, simulated.time[-1], color=ORANGE, alpha=0.12, linewidth=0)
    axes.legend(loc="upper left", ncols=4)
