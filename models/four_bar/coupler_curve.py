"""How far the curve of a point of the coupler is from its rigid one (thesis Figs. 8.3, 8.4)."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from solve.arrays import Array
from solve.errors import ValueOutOfBoundsError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from solve.beams.structure import StructureModel
    from solve.results.orbit import Turn


@dataclass(frozen=True)
class CouplerCurve:
    """Places x + iy (m) of a point, (k,) at phases (k,): of the rigid linkage, and of the flexible one."""

    phase: Array
    rigid: Array
    elastic: Array

    @property
    def deviation(self) -> Array:
        """Displacement x + iy (m) from the rigid curve."""
        return self.elastic - self.rigid


def coupler_curve(
    model: "StructureModel", turn: "Turn", along: float, across: float, phase: Array
) -> CouplerCurve:
    """Of the point at a fraction `along` (0 … 1) of the coupler from A, `across` (m) beside its axis.

    Raises ValueOutOfBoundsError.
    """
    if not np.isfinite(across):
        raise ValueOutOfBoundsError(f"distance beside the coupler is {across} m; allowed: finite numbers")
    q, _, _ = turn.state(phase)
    return CouplerCurve(phase, *model.path("coupler", along, across, phase, q))


def curve_figure(title: str, curve: CouplerCurve) -> "Figure":
    """Both curves, and the distance between them over the turn."""
    from matplotlib.ticker import MultipleLocator

    from solve.results.quantities import prefixed
    from solve.results.style import BLACK, BLUE, GREY, VERMILION, new_figure, styled

    deviation = curve.deviation
    factor, unit = prefixed("m", float(np.abs(deviation).max()))
    with styled():
        figure = new_figure(3.4)
        figure.suptitle(title, fontweight="bold")
        left, right = figure.subplots(1, 2)
        left.plot(1e3 * np.real(curve.rigid), 1e3 * np.imag(curve.rigid), color=BLACK, label="rigid")
        path = 1e3 * curve.elastic
        left.plot(np.real(path), np.imag(path), color=VERMILION, linewidth=1.0, label="flexible")
        left.plot(
            *(part(1e3 * curve.rigid[:1]) for part in (np.real, np.imag)),
            "o",
            color=BLACK,
            label="crank at 0°",
        )
        left.set_aspect("equal", adjustable="datalim")
        left.set_xlabel("x (mm)")
        left.set_ylabel("y (mm)")
        left.legend(loc="best")
        for part, name, colour in ((np.real, "along x", BLUE), (np.imag, "along y", VERMILION)):
            right.plot(np.degrees(curve.phase), factor * part(deviation), color=colour, label=name)
        right.plot(np.degrees(curve.phase), factor * np.abs(deviation), color=GREY, label="distance")
        right.set_xlim(0.0, 360.0)
        right.xaxis.set_major_locator(MultipleLocator(60))
        right.set_xlabel("crank angle (°)")
        right.set_ylabel(f"deviation ({unit})")
        right.legend(loc="best")
    return figure
