"""Figure of the deformed coupler at several crank positions, with magnified deflection."""

import math
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from solve import Model
from solve.arrays import Array, Plane
from solve.equations import sketched
from solve.errors import ValueOutOfBoundsError
from solve.results.contents import HALF_DEGREES
from solve.results.formatting import fixed, prefixed
from solve.results.formatting import round_magnification as rounded
from solve.results.orbit import Orbit
from solve.views.panels import frame_of, titled
from solve.views.style import BLACK, BLUE, GREY, LIGHT, PAGE_WIDTH, VERMILION, new_figure, styled

MOST_POSITIONS = 12
"""Maximum number of positions that fit on a page. Chosen by judgement."""

_COLUMNS = 4
_DRAWN = 0.2
"""Largest deflection in the figure with automatic magnification, as a fraction of the coupler's length.
Chosen by judgement."""

_LABELS = 0.8
"""Width of the labels of the axes, in inches."""


class BentCoupler(NamedTuple):
    """Positions x + iy (m) of the mechanism at k crank angles.

    `phase` (k,) is in rad. `joints` (4, k) are the crank pivot, the crank pin, the joint B and the follower
    pivot. `deflection` (stations, k) is in m. `line` (stations, k) is the coupler with magnified deflection.
    """

    phase: Array
    joints: Plane
    deflection: Array
    line: Plane


def checked_positions(positions: int) -> int:
    """Return the number of positions. Raises ValueOutOfBoundsError."""
    if not 1 <= positions <= MOST_POSITIONS:
        raise ValueOutOfBoundsError(
            f"--positions is {positions}; allowed: 1 … {MOST_POSITIONS} crank positions, such as 8"
        )
    return positions


def checked_magnification(magnification: float) -> float:
    """Return the magnification. Raises ValueOutOfBoundsError."""
    if not (math.isfinite(magnification) and magnification > 0):
        raise ValueOutOfBoundsError(
            f"--magnification is {magnification:g}; allowed: a number > 0, such as 100; omit "
            "--magnification for automatic selection"
        )
    return magnification


def bent(model: Model, orbit: Orbit, phase: Array, magnification: float) -> BentCoupler:
    """Return the mechanism with the deflected coupler at crank angles (k,).

    The joints are in the positions of the rigid linkage, because the shortening of the chord is of second
    order.
    """
    q = orbit.at(phase)
    lines = sketched(model, phase, orbit.speed, magnification * q)
    joints = [lines["crank"][0], lines["crank"][-1], lines["follower"][-1], lines["follower"][0]]
    line = lines["coupler"]
    deflection = model.field("w", np.linspace(0.0, 1.0, len(line))) @ q
    return BentCoupler(phase, np.stack(joints), deflection, line)


def round_magnification(model: Model, orbit: Orbit) -> float:
    """Return the largest of the numbers 1, 2, 5, 10, 20, … with which the deflection in the figure is at most
    a fifth of the coupler's length; at least 1."""
    turn = np.linspace(0.0, orbit.system.period, HALF_DEGREES)
    largest = float(np.abs(bent(model, orbit, turn, 1.0).deflection).max())
    return rounded(_DRAWN * model.parameters["l3"] / largest if largest else 1.0)


def coupler_figure(model: Model, orbit: Orbit, positions: int, magnification: float | None = None) -> Figure:
    """Figure with one panel for each of several equidistant crank positions.

    Rigid links are drawn thin, the deformed coupler is thick, and its chord is dashed. The titles of the
    panels state the crank angle and the deflection w at midspan. The main title states the magnification,
    which is automatic by default. Raises ValueOutOfBoundsError.
    """
    if magnification is None:
        magnification = round_magnification(model, orbit)
    factor = checked_magnification(magnification)
    phase = np.arange(checked_positions(positions)) * (orbit.system.period / positions)
    deformed = bent(model, orbit, phase, factor)
    low, high = frame_of(np.concatenate((deformed.joints.ravel(), deformed.line.ravel())))
    columns = min(_COLUMNS, positions)
    rows = math.ceil(positions / columns)
    panel = (PAGE_WIDTH - _LABELS) / columns * (high - low).imag / (high - low).real
    with styled():
        figure = new_figure(1.05 + rows * (panel + 0.3))
        figure.suptitle(
            f"{titled(orbit.system, orbit.speed)}: deflection magnified {factor:g} times", fontweight="bold"
        )
        axes = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
        for k, place in enumerate(axes.flat):
            if k < positions:
                _draw_position(place, deformed, k)
            else:
                place.axis("off")
            if positions - columns <= k < positions:
                place.tick_params(labelbottom=True)
                place.set_xlabel("x (m)")
        for first in axes[:, 0]:
            first.set_ylabel("y (m)")
        axes[0, 0].set_xlim(low.real, high.real)
        axes[0, 0].set_ylim(low.imag, high.imag)
        figure.legend(
            *axes[0, 0].get_legend_handles_labels(),
            title="at each crank angle, $w$ is the true deflection at midspan",
            loc="outside lower center",
            ncols=3,
        )
    return figure


def _draw_position(axes: Axes, deformed: BentCoupler, k: int) -> None:
    joints, line = deformed.joints[:, k], deformed.line[:, k]
    middle = float(deformed.deflection[len(deformed.deflection) // 2, k])
    size = float(np.abs(deformed.deflection).max())
    factor, unit = prefixed("m", size)
    axes.plot(*_xy(joints[[0, 3]]), color=LIGHT, linewidth=0.9, zorder=1)
    axes.plot(*_xy(joints[:2]), color=BLACK, linewidth=1.1, label="crank and follower, rigid")
    axes.plot(*_xy(joints[2:]), color=BLACK, linewidth=1.1)
    axes.plot(*_xy(joints[1:3]), color=GREY, linewidth=0.8, dashes=(4, 2), label="chord of the coupler")
    axes.plot(*_xy(line), color=BLUE, linewidth=2.2, label="coupler, deflection magnified", zorder=3)
    axes.plot(*_xy(joints[1:3]), "o", color="white", markeredgecolor=BLACK, markersize=2.8, zorder=4)
    axes.plot(*_xy(joints[[0, 3]]), "^", color=VERMILION, markersize=4, zorder=4)
    height = fixed(middle * factor, size * factor, 3).replace("-", "−")
    axes.set_title(f"{math.degrees(deformed.phase[k]):.4g}°: $w$ = {height} {unit}")
    axes.set_aspect("equal")
    axes.grid(visible=False)


def _xy(points: NDArray[np.complex128]) -> tuple[Array, Array]:
    return points.real, points.imag
