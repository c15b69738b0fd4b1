"""Path of a coupler point, compared with its path on the rigid linkage (Figs. 8.3 and 8.4 of the thesis)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

import solve
from models.four_bar.studies.shared import AtOneSpeed, FourBar, SpeedText, Tolerance
from solve.arrays import Array
from solve.beams.structure import StructureModel
from solve.commands.deliver import deliver_result
from solve.commands.groups import Flag, Results
from solve.errors import ValueOutOfBoundsError
from solve.results.contents import HALF_DEGREES, Column, Columns, sized, to_json
from solve.results.formatting import prefixed, round_magnification
from solve.results.periodic_motion import PeriodicMotion
from solve.results.serialization import serializable
from solve.views.panels import DEFLECTION
from solve.views.show import tables
from solve.views.style import BLACK, BLUE, GREY, VERMILION, Axes, Figure, page
from solve.views.tables import RenderableType, table_of


@serializable
@dataclass(frozen=True)
class CouplerCurve:
    """Positions x + iy (m) of a point at phases (k,): on the rigid linkage (k,) and on the flexible linkage
    (k,)."""

    phase: Array
    rigid: Array
    elastic: Array

    @property
    def deviation(self) -> Array:
        """Displacement x + iy (m) of the point from its position on the rigid linkage."""
        return self.elastic - self.rigid


@dataclass(frozen=True)
class CurveOfPoint(AtOneSpeed):
    """Path of the point at the fraction `along` of the coupler's length and the distance `across` (m) from
    the coupler's axis."""

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
        """Columns of the table: phases, and positions at these phases, over a revolution."""
        columns = {"phase": Column(self.curve.phase, "rad", "phase of the drive", axes=("phase",))}
        for name, path in (("rigid", self.curve.rigid), ("flexible", self.curve.elastic)):
            for axis, values in (("x", np.real(path)), ("y", np.imag(path))):
                meaning = f"{axis} of the point of the {name} linkage"
                columns[f"{name}_{axis}"] = Column(values, "m", meaning, axes=("phase",))
        return columns

    def record(self) -> dict[str, Any]:
        curve = {name: column.values for name, column in self.columns.items()}
        return {**super().record(), "curve": to_json(curve)}

    def plot(self) -> Figure:
        """Figure of both paths, and of the deviation versus crank angle."""
        speed = self.system.labels.speed_unit.text(self.orbit.speed)
        title = f"Coupler curve at {speed}" + ", quasi-static" * self.quasi_static
        return curve_figure(title, self.curve)


@tables.register(CurveOfPoint)
def curve_tables(result: CurveOfPoint) -> Sequence[RenderableType]:
    """Table of the maximum and the root mean square of the deviation and of its components."""
    components = _components(result.curve.deviation)
    moduli = [np.abs(values) for values in components.values()]
    maxima = [float(modulus.max()) for modulus in moduli]
    positions = np.degrees([result.curve.phase[modulus.argmax()] for modulus in moduli])
    columns = {
        "part": Column([*components], heading=" "),
        "max": sized(maxima, "m", "", "max|…|", 5),
        "at": Column(positions, heading="at", text="{:.1f}°".format),
        "rms": sized([_rms(modulus) for modulus in moduli], "m", "", "rms", 5, maxima[0]),
    }
    return [table_of("Deviation from the rigid curve", columns, left=1)]


def _components(deviation: Array) -> dict[str, Array]:
    return {"distance": np.abs(deviation), "along x": np.real(deviation), "along y": np.imag(deviation)}


def _rms(values: Array) -> float:
    """Return the root mean square over a revolution, whose last sample repeats the first."""
    return float(np.sqrt((values[:-1] ** 2).mean()))


def coupler_curve(
    model: StructureModel, motion: PeriodicMotion, along: float, across: float, phase: Array
) -> CouplerCurve:
    """Compute the path of the point at the fraction `along` (0 … 1) of the coupler's length from A, and at
    the distance `across` (m) from its axis.

    Raises ValueOutOfBoundsError.
    """
    if not np.isfinite(across):
        raise ValueOutOfBoundsError(
            f"distance from the axis of the coupler is {across} m; allowed: finite numbers"
        )
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
    """Compute the path of a coupler point at a speed, from the periodic or the quasi-static solution."""
    orbit = solve.periodic(model, speed, rtol=rtol)
    phase = np.linspace(0.0, model.period, HALF_DEGREES)
    path = coupler_curve(model, orbit.quasi_static if quasi_static else orbit, along, across, phase)
    return CurveOfPoint(orbit, along, across, quasi_static, path)


def _magnification(curve: CouplerCurve) -> float:
    """Return the magnification with which the deviation in the figure is at most the fraction `DEFLECTION` of
    the larger extent of the path."""
    size = max(float(np.ptp(np.real(curve.rigid))), float(np.ptp(np.imag(curve.rigid))))
    return round_magnification(DEFLECTION * size / (float(np.abs(curve.deviation).max()) or np.inf))


def curve_figure(title: str, curve: CouplerCurve) -> Figure:
    """Figure of both paths, with the deviation magnified, and of the deviation versus crank angle."""
    with page(3.4, title) as figure:
        left, right = figure.subplots(1, 2)
        _draw_paths(left, curve)
        _draw_deviation(right, curve)
        for axes in (left, right):
            axes.legend(
                ncols=3, columnspacing=1.0, handlelength=1.4, loc="lower center", bbox_to_anchor=(0.5, 1.0),
                borderaxespad=0.2,
            )  # fmt: skip
    return figure


def _draw_paths(axes: Axes, curve: CouplerCurve) -> None:
    factor = _magnification(curve)
    label = "flexible" if factor == 1 else f"flexible, deviation × {factor:g}"
    rigid, magnified = 1e3 * curve.rigid, 1e3 * (curve.rigid + factor * curve.deviation)
    axes.plot(np.real(rigid), np.imag(rigid), color=BLACK, label="rigid")
    axes.plot(np.real(magnified), np.imag(magnified), color=VERMILION, linewidth=1.0, label=label)
    axes.plot(np.real(rigid[:1]), np.imag(rigid[:1]), "o", color=BLACK, label="crank at 0°")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x (mm)")
    axes.set_ylabel("y (mm)")


def _draw_deviation(axes: Axes, curve: CouplerCurve) -> None:
    components = _components(curve.deviation)
    factor, unit = prefixed("m", float(components["distance"].max()))
    for name, colour in (("along x", BLUE), ("along y", VERMILION), ("distance", GREY)):
        axes.plot(np.degrees(curve.phase), factor * components[name], color=colour, label=name)
    axes.set_xlim(0.0, 360.0)
    axes.set_xticks(range(0, 361, 60))
    axes.set_xlabel("crank angle (°)")
    axes.set_ylabel(f"deviation ({unit})")


def curve(
    four_bar: FourBar,
    results: Results,
    speed: SpeedText = "30 rad/s",
    along: Annotated[float, Flag("Position on the coupler, from 0 at A to 1 at B.", "S")] = 0.5,
    across: Annotated[float, Flag("Distance from the axis of the coupler, in m.", "M")] = 0.0,
    quasi_static: Annotated[bool, Flag("Use the quasi-static path instead of the dynamic one.")] = False,
    rtol: Tolerance = 1e-6,
) -> None:
    """Path of a coupler point, compared with that of the rigid linkage."""
    result = curve_of_point(four_bar.loaded(), speed, along, across, quasi_static, rtol)
    deliver_result(results, result, four_bar.choices)
