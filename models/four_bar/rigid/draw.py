"""Pictures: the linkage in several positions with its coupler curves, and what it does over a turn."""

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from matplotlib.ticker import MultipleLocator

from models.four_bar.linkage import ADVISED, Linkage, Motion
from models.four_bar.rigid.barker import classify
from models.four_bar.rigid.forces import Body, joint_forces
from models.four_bar.rigid.record import JOINTS, TURN
from solve.arrays import Array, Plane
from solve.results.formatting import prefixed
from solve.units import unit_given
from solve.views.style import BLACK, BLUE, GREEN, GREY, LIGHT, ORANGE, PURPLE, VERMILION, new_figure, styled

_POSITIONS = 12
_SAMPLES = 721
_SHOWN = math.radians(120)
"""Crank angle of the position that is drawn in full where none is asked for."""

_COLUMN = 3
_PATHS = (VERMILION, PURPLE, ORANGE, GREEN)
_LINKS = ((1, BLACK), (2, BLUE), (3, GREEN))


def linkage_figure(
    linkage: Linkage,
    bodies: Sequence[Body],
    speed: float | None,
    points: Sequence[complex],
    position: float | None = None,
) -> Figure:
    """Positions with coupler curves, transmission angle, ratios, and with a speed (rad/s) the torque
    and the joint forces. Raises LinkageError for a crank that does not turn fully."""
    linkage.require_full_turn()
    shown = _SHOWN if position is None else position
    with styled():
        rows = 2 if speed is None else 3
        heights = [3.6, 1.75 * (rows - 1)]
        figure = new_figure(sum(heights))
        grid = figure.add_gridspec(2, 1, height_ratios=heights)
        top, below = (figure.add_subfigure(grid[row]) for row in range(2))
        figure.suptitle(_title(linkage, speed), fontweight="bold")
        left, right = top.subplots(1, 2, width_ratios=(2.2, 1))
        _draw_positions(left, linkage, points, shown)
        _write_summary(right, left, linkage, shown)
        axes = below.subplots(rows - 1, 2, sharex=True, squeeze=False)
        t1 = np.linspace(0.0, TURN, _SAMPLES)
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


def _title(linkage: Linkage, speed: float | None) -> str:
    kind = classify(linkage)
    at = "" if speed is None else f", {unit_given(speed).text(speed)}"
    return f"Four-bar linkage {kind.symbol}, {linkage.branch} branch{at}"


def _draw_positions(axes: Axes, linkage: Linkage, points: Sequence[complex], shown: float) -> None:
    turn = linkage.motion(np.linspace(0.0, TURN, _SAMPLES))
    _draw_paths(axes, turn, points)
    several = linkage.motion(np.arange(_POSITIONS) * (TURN / _POSITIONS))
    for vertices in np.transpose(_skeleton(several)):
        axes.plot(vertices.real, vertices.imag, "-o", color=GREY, alpha=0.28, linewidth=0.9, markersize=2)
    _draw_linkage(axes, linkage.motion(shown), points)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.1)
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")


def _write_summary(axes: Axes, pictured: Axes, linkage: Linkage, shown: float) -> None:
    """Class, lengths and merits in words, then the legend of the picture beside it."""
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
        handles,
        labels,
        title="paths of coupler points",
        alignment="left",
        ncols=1 + (len(handles) > _COLUMN),
        loc="lower left",
        bbox_to_anchor=(-0.03, 0.0),
        borderaxespad=0.0,
        handlelength=1.4,
        columnspacing=1.0,
    )


def _skeleton(motion: Motion) -> Plane:
    """O, A, B, C (4, …)."""
    A, B = motion.position(1, motion.linkage.L1), motion.position(3, motion.linkage.L3)
    return np.stack((0 * A, A, B, 0 * A + motion.linkage.L4))


def _draw_paths(axes: Axes, turn: Motion, points: Sequence[complex]) -> None:
    _, A, B, _ = _skeleton(turn)
    for path in (A, B):
        axes.plot(path.real, path.imag, color=GREY, linewidth=0.7)
    for k, point in enumerate(points):
        path = turn.position(2, point)
        label = f"({point.real:g}, {point.imag:g}) m"
        axes.plot(path.real, path.imag, color=_PATHS[k % len(_PATHS)], linewidth=1.8, label=label, zorder=3)


def _draw_linkage(axes: Axes, motion: Motion, points: Sequence[complex]) -> None:
    """One position in full: links, joints with their letters, ground, coupler points."""
    joints = _skeleton(motion)
    for k, point in enumerate(points):
        place = motion.position(2, point)
        corners = np.array([joints[1], place, joints[2]])
        axes.add_patch(Polygon(_plane(corners), color=BLUE, alpha=0.15, linewidth=0, zorder=4))
        axes.plot(place.real, place.imag, "o", color=_PATHS[k % len(_PATHS)], markersize=5, zorder=7)
    for (_, colour), first, second in zip(_LINKS, joints[:-1], joints[1:], strict=True):
        axes.plot(*_plane(np.array([first, second])).T, color=colour, linewidth=2.6, zorder=5)
    for letter, place in zip(JOINTS, joints, strict=True):
        axes.plot(place.real, place.imag, "o", color="white", markeredgecolor=BLACK, markersize=5, zorder=6)
        offset = (-7, 4) if letter in "AB" else (-9, -12)
        axes.annotate(letter, (place.real, place.imag), offset, textcoords="offset points", ha="right")
    for pivot in (joints[0], joints[3]):
        _draw_ground(axes, pivot, max(motion.linkage.lengths))


def _draw_ground(axes: Axes, pivot: complex, size: float) -> None:
    half, depth = 0.035 * size, 0.055 * size
    corners = pivot + np.array([0, -half - 1j * depth, half - 1j * depth])
    axes.add_patch(Polygon(_plane(corners), facecolor=LIGHT, edgecolor=BLACK, linewidth=0.8, zorder=4))


def _plane(places: Plane) -> Array:
    return np.column_stack((places.real, places.imag))


def _draw_transmission(axes: Axes, linkage: Linkage, t1: Array) -> None:
    low, high = np.degrees(ADVISED)
    axes.axhspan(low, high, color=GREEN, alpha=0.10, linewidth=0)
    axes.plot(np.degrees(t1), np.degrees(linkage.transmission_angle(t1)), color=GREEN)
    axes.set_ylim(0, 180)
    axes.yaxis.set_major_locator(MultipleLocator(45))
    axes.set_ylabel("γ (°)")
    axes.set_title("transmission angle; advised range shaded", loc="left", color=GREY)


def _draw_ratios(axes: Axes, motion: Motion) -> None:
    t1 = np.degrees(motion.t[0])
    for link, colour in _LINKS[1:]:
        axes.plot(t1, motion.omega[link - 1], color=colour, label=f"$ω_{link}/ω_1$")
        axes.plot(t1, motion.alpha[link - 1], color=colour, linestyle=(0, (4, 2)), label=f"$α_{link}/ω_1^2$")
    axes.set_ylabel("ratio to the crank")
    axes.set_title("coupler (2) and follower (3)", loc="left", color=GREY)
    _legend_on_top(axes)


def _draw_forces(axes: Sequence[Axes], motion: Motion, bodies: Sequence[Body]) -> None:
    t1 = np.degrees(motion.t[0])
    forces = joint_forces(motion, bodies)
    factor, unit = prefixed("N m", float(np.abs(forces.torque).max()))
    axes[0].axhline(0, color=GREY, linewidth=0.6)
    axes[0].plot(t1, factor * forces.torque, color=VERMILION)
    axes[0].set_ylabel(f"torque ({unit})")
    axes[0].set_title("drive torque", loc="left", color=GREY)
    sizes = {joint: np.abs(getattr(forces, name)) for joint, name in JOINTS.items()}
    factor, unit = prefixed("N", float(max(size.max() for size in sizes.values())))
    for (joint, size), colour in zip(sizes.items(), (BLACK, BLUE, GREEN, PURPLE), strict=True):
        axes[1].plot(t1, factor * size, color=colour, label=joint)
    axes[1].set_ylim(bottom=0)
    axes[1].set_ylabel(f"force ({unit})")
    axes[1].set_title("joint forces", loc="left", color=GREY)
    _legend_on_top(axes[1])


def _legend_on_top(axes: Axes) -> None:
    """One row inside the frame, above all curves."""
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + 0.34 * (high - low))
    axes.legend(
        ncols=4,
        loc="upper center",
        handlelength=1.6,
        columnspacing=1.2,
        frameon=True,
        edgecolor="none",
        framealpha=0.9,
    )
