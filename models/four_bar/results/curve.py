"""How far the curve of a point of the coupler is from its rigid one (thesis Figs. 8.3, 8.4)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import solve
from models.four_bar.results.at_one_speed import AtOneSpeed
from solve.arrays import Array
from solve.beams.structure import StructureModel
from solve.errors import ValueOutOfBoundsError
from solve.results.contents import Column, Columns, sized, to_json
from solve.results.formatting import prefixed, round_magnification
from solve.results.periodic_motion import PeriodicMotion
from solve.results.serialization import serializable
from solve.views.show import tables
from solve.views.style import BLACK, BLUE, GREY, VERMILION, Axes, Figure, page
from solve.views.tables import RenderableType, table_of

_SAMPLES = 721
_DRAWN = 0.1
"""Part of the curve's size up to which an automatic magnification may draw the deviation."""


@serializable
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


@dataclass(frozen=True)
class CurveOfPoint(AtOneSpeed):
    """The curve of the point at a fraction `along` of the coupler, `across` (m) beside its axis."""

    along: float
    across: float
    quasi_static: bool
    curve: CouplerCurve

    @property
    def summary_values(self) -> dict[str, Any]:
        distance = np.abs(self.curve.deviation)
        return {
            **super().summary_values,
            "along": self.along,
            "across": self.across,
            "quasi_static": self.quasi_static,
            "max_deviation": distance.max(),
            "at": self.curve.phase[distance.argmax()],
            "rms_deviation": _rms(distance),
        }

    @property
    def columns(self) -> Columns:
        """The places over the turn."""
        columns = {"phase": Column(self.curve.phase, "rad", "phase of the drive", axes=("phase",))}
        for name, places in (("rigid", self.curve.rigid), ("flexible", self.curve.elastic)):
            for axis, part in (("x", np.real), ("y", np.imag)):
                meaning = f"{axis} of the point of the {name} linkage"
                columns[f"{name}_{axis}"] = Column(part(places), "m", meaning, axes=("phase",))
        return columns

    def record(self) -> dict[str, Any]:
        curve = {name: column.values for name, column in self.columns.items()}
        return {**super().record(), "curve": to_json(curve)}

    def plot(self) -> Figure:
        """Both curves, and the distance between them over the turn."""
        speed = self.system.speed_unit.text(self.orbit.speed)
        title = f"Coupler curve at {speed}" + ", quasi-static" * self.quasi_static
        return curve_figure(title, self.curve)


@tables.register(CurveOfPoint)
def curve_tables(result: CurveOfPoint) -> Sequence[RenderableType]:
    """Largest and mean deviation, and its parts along x and y."""
    deviation = result.curve.deviation
    parts = {"distance": np.abs(deviation), "along x": np.real(deviation), "along y": np.imag(deviation)}
    sizes = [np.abs(values) for values in parts.values()]
    largest = [float(size.max()) for size in sizes]
    at = np.degrees([result.curve.phase[size.argmax()] for size in sizes])
    columns = {
        "part": Column([*parts], heading=" "),
        "max": sized(largest, "m", "", "max|…|", 5),
        "at": Column(at, heading="at", text="{:.1f}°".format),
        "rms": sized([_rms(size) for size in sizes], "m", "", "rms", 5, largest[0]),
    }
    return [table_of("Deviation from the rigid curve", columns, left=1)]


def _rms(values: Array) -> float:
    """Over a turn, of which the first value is the last again."""
    return float(np.sqrt((values[:-1] ** 2).mean()))


def coupler_curve(
    model: StructureModel, motion: PeriodicMotion, along: float, across: float, phase: Array
) -> CouplerCurve:
    """Of the point at a fraction `along` (0 … 1) of the coupler from A, `across` (m) beside its axis.

    Raises ValueOutOfBoundsError.
    """
    if not np.isfinite(across):
        raise ValueOutOfBoundsError(f"distance beside the coupler is {across} m; allowed: finite numbers")
    q, _, _ = motion.state(phase)
    return CouplerCurve(phase, *model.path("coupler", along, across, phase, q))


def curve_of_point(
    model: StructureModel,
    speed: float | str,
    along: float,
    across: float,
    quasi_static: bool = False,
    rtol: float = 1e-6,
) -> CurveOfPoint:
    """The same of the periodic solution at a speed, or of the kinetostatic one."""
    orbit = solve.periodic(model, speed, rtol=rtol)
    turn = orbit.quasi_static if quasi_static else orbit
    phase = np.linspace(0.0, model.period, _SAMPLES)
    found = coupler_curve(model, turn, along, across, phase)
    return CurveOfPoint(orbit, along, across, quasi_static, found)


def _magnification(curve: CouplerCurve) -> float:
    """By which the deviation stays within a tenth of the curve's size."""
    size = max(float(np.ptp(part(curve.rigid))) for part in (np.real, np.imag))
    return round_magnification(_DRAWN * size / (float(np.abs(curve.deviation).max()) or np.inf))


def curve_figure(title: str, curve: CouplerCurve) -> Figure:
    """Both curves, the deviation magnified, and its size over the turn."""
    from matplotlib.ticker import MultipleLocator

    deviation = curve.deviation
    factor, unit = prefixed("m", float(np.abs(deviation).max()))
    with page(3.4, title) as figure:
        left, right = figure.subplots(1, 2)
        left.plot(1e3 * np.real(curve.rigid), 1e3 * np.imag(curve.rigid), color=BLACK, label="rigid")
        times = _magnification(curve)
        path = 1e3 * (curve.rigid + times * deviation)
        label = "flexible" if times == 1 else f"flexible, deviation × {times:g}"
        left.plot(np.real(path), np.imag(path), color=VERMILION, linewidth=1.0, label=label)
        left.plot(
            *(part(1e3 * curve.rigid[:1]) for part in (np.real, np.imag)),
            "o",
            color=BLACK,
            label="crank at 0°",
        )
        left.set_aspect("equal", adjustable="datalim")
        left.set_xlabel("x (mm)")
        left.set_ylabel("y (mm)")
        _legend(left)
        for part, name, colour in ((np.real, "along x", BLUE), (np.imag, "along y", VERMILION)):
            right.plot(np.degrees(curve.phase), factor * part(deviation), color=colour, label=name)
        right.plot(np.degrees(curve.phase), factor * np.abs(deviation), color=GREY, label="distance")
        right.set_xlim(0.0, 360.0)
        right.xaxis.set_major_locator(MultipleLocator(60))
        right.set_xlabel("crank angle (°)")
        right.set_ylabel(f"deviation ({unit})")
        _legend(right)
    return figure


def _legend(axes: Axes) -> None:
    """Above the frame."""
    place = {"loc": "lower center", "bbox_to_anchor": (0.5, 1.0), "borderaxespad": 0.2}
    axes.legend(ncols=3, columnspacing=1.0, handlelength=1.4, **place)
