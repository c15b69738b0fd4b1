"""Rigid motion of the linkage over a revolution, or at one position: record, columns and command.

Values are in SI units and radians. Angular velocities and accelerations are given as ratios to the speed of
the crank: ω/ω1, and α/ω1² at constant ω1.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any

import numpy as np

from models.four_bar.barker import base_plane, classify, mobility, satisfies_grashof, solution_space
from models.four_bar.forces import (
    JOINTS,
    Body,
    JointForces,
    bodies,
    inertial_power,
    joint_forces,
    kinetic_energy,
    preliminary_stresses,
)
from models.four_bar.linkage import (
    OUTSIDE_ADVISED,
    TURN,
    Linkage,
    Motion,
    transmission_warnings,
    within_advised,
)
from models.four_bar.views.tables import linkage_report
from solve import signal_statistics
from solve.arrays import Array, Plane, uniform_phases
from solve.commands.deliver import deliver_result
from solve.commands.groups import CaseNumbers, Flag, Results
from solve.errors import ValueOutOfBoundsError
from solve.results.contents import Column, Columns, to_json
from solve.results.result import Result
from solve.results.serialization import serializable, stored_property
from solve.units import LARGEST, speed_in_si, with_unit
from solve.views.show import printout
from solve.views.style import Figure
from solve.views.tables import RenderableType

_CURVE_POINTS = 360
"""Number of positions per revolution in files and coupler curves: one per degree."""

_BALANCE_POINTS = 720
"""Number of positions per revolution at which the energy balance is evaluated."""

serializable(Linkage)


@dataclass(frozen=True)
class RigidMotion(Result):
    """Motion and forces of a rigid linkage.

    `speed` is the speed of the crank (rad/s); if it is None, forces are not computed. `position` is the crank
    angle t1 (rad) to report; None for a full revolution. `points` are the coupler points X + iY (m) whose
    paths are traced. Raises LinkageError if the crank cannot rotate fully and no position is given, or if the
    linkage cannot reach the position.
    """

    case: str | None
    parameters: Mapping[str, float]
    linkage: Linkage
    speed: float | None
    position: float | None
    points: Sequence[complex]

    def __post_init__(self) -> None:
        self.summary_values  # noqa: B018 - raises LinkageError

    @property
    def model_info(self) -> dict[str, Any]:
        return {"model": "four_bar", "case": self.case, "parameters": dict(self.parameters)}

    @cached_property
    def summary_values(self) -> dict[str, Any]:  # type: ignore[override]
        """Values of the result; if the crank cannot rotate fully, only those at the position."""
        linkage = self.linkage
        record: dict[str, Any] = {**_classification(linkage), "speed": self.speed}
        if self.position is None:
            linkage.require_full_turn()
        if linkage.turns_fully:
            record |= self._over_turn()
        if self.position is not None:
            record["position"] = self._at_position(self.position)
        record["warnings"] = [*transmission_warnings(linkage), *self._position_warnings()]
        if self.speed is not None and linkage.turns_fully:
            record["preliminary_stress"] = preliminary_stresses(
                self.bodies, linkage, self.parameters, self.speed
            )
        return record

    @stored_property
    def warnings(self) -> list[str]:
        return self.summary_values["warnings"]

    @property
    def bodies(self) -> Sequence[Body]:
        return bodies(self.parameters)

    @property
    def columns(self) -> Columns:
        """Columns with one row per degree of the revolution; if the crank cannot rotate fully, only one row
        for the position."""
        turns = self.linkage.turns_fully
        t1 = np.linspace(0.0, TURN, _CURVE_POINTS + 1) if turns else np.array([self.position])
        motion = self.linkage.motion(t1)
        columns = {
            "t1": (t1, "rad", "angle of the crank"),
            "transmission_angle": (
                self.linkage.transmission_angle(t1), "rad", "between coupler and follower"
            ),
        }  # fmt: skip
        for name, ratio in _ratios(motion).items():
            power = "ω/ω1" if name.startswith("omega") else "α/ω1²"
            columns[name] = ratio, "1", f"{power} of the {'coupler' if name.endswith('2') else 'follower'}"
        for number, point in enumerate(self.points, 1):
            where = f"of the coupler's point ({point.real:g}, {point.imag:g}) m"
            path = motion.position(2, point)
            columns[f"point{number}_x"] = path.real, "m", f"x {where}"
            columns[f"point{number}_y"] = path.imag, "m", f"y {where}"
        if self.speed is not None:
            forces = joint_forces(self.linkage.motion(t1, self.speed), self.bodies)
            columns["drive_torque"] = forces.torque, "N m", "on the crank"
            for joint, name in JOINTS.items():
                force = getattr(forces, name)
                columns[f"{joint}_x"] = force.real, "N", f"{name} along x"
                columns[f"{joint}_y"] = force.imag, "N", f"{name} along y"
        return {name: Column(*column, axes=("t1",)) for name, column in columns.items()}

    def record(self) -> dict[str, Any]:
        return to_json({**self.model_info, **self.summary_values})

    def plot(self) -> Figure:
        """Figure of positions with coupler curves, and of quantities versus crank angle.

        Raises LinkageError for a crank that cannot turn fully.
        """
        from models.four_bar.views.figures import linkage_figure

        return linkage_figure(self.linkage, self.bodies, self.speed, self.points, self.position)

    def base_planes(self) -> Figure:
        """Figure of Barker's base planes that shows the linkage."""
        from models.four_bar.views.base_planes import base_planes_figure

        return base_planes_figure(self.linkage)

    def _over_turn(self) -> dict[str, Any]:
        """Quantities over a full revolution at constant speed."""
        linkage, gamma = self.linkage, self.linkage.transmission_extremes()
        fastest = signal_statistics(lambda t: np.abs(linkage.motion(t).omega[2]), TURN)
        record = {
            "transmission_angle": {**gamma._asdict(), "within_advised": within_advised(gamma.min, gamma.max)},
            "follower": {"dead_points": linkage.dead_points, "swing": _swing(linkage)},
            "mechanical_advantage": {"least": 1.0 / fastest.max, "least_position": fastest.max_phase},
            "ratios": {
                name: _extremes(lambda t, name=name: _ratios(linkage.motion(t))[name])
                for name in _ratios(linkage.motion(0.0))
            },
            "coupler_curves": [_path(linkage, point) for point in self.points],
        }
        return record if self.speed is None else {**record, **self._forces_over_turn(self.speed)}

    def _forces_over_turn(self, speed: float) -> dict[str, Any]:
        def forces(t1: Array) -> JointForces:
            return joint_forces(self.linkage.motion(t1, speed), self.bodies)

        peaks = {
            joint: signal_statistics(lambda t, name=name: np.abs(getattr(forces(t), name)), TURN)
            for joint, name in JOINTS.items()
        }
        energy = signal_statistics(lambda t: kinetic_energy(self.linkage.motion(t, speed), self.bodies), TURN)
        motion = self.linkage.motion(uniform_phases(_BALANCE_POINTS, TURN), speed)
        rate = inertial_power(motion, self.bodies)
        residual = np.abs(joint_forces(motion, self.bodies).torque * speed - rate).max() / np.abs(rate).max()
        return {
            "joint_forces": {
                joint: {"peak": peak.max, "position": peak.max_phase} for joint, peak in peaks.items()
            },
            "drive_torque": _extremes(lambda t: forces(t).torque),
            # Energy that a flywheel without a motor stores and releases in a revolution (section 3.7 of the
            # thesis).
            "energy_swing": energy.max - energy.min,
            "energy_residual": float(residual),
        }

    def _at_position(self, t1: float) -> dict[str, Any]:
        """Quantities of `_over_turn` at one crank angle."""
        linkage, motion = self.linkage, self.linkage.motion(t1)
        record = {
            "t": motion.t,
            "transmission_angle": float(linkage.transmission_angle(t1)),
            "mechanical_advantage": float(linkage.mechanical_advantage(t1)),
            "ratios": {name: float(ratio) for name, ratio in _ratios(motion).items()},
            "O": _xy(0.0),
            "A": _xy(motion.position(1, linkage.L1)),
            "B": _xy(motion.position(3, linkage.L3)),
            "C": _xy(linkage.L4),
            "coupler_points": [
                {"point": _xy(point), "position": _xy(motion.position(2, point))} for point in self.points
            ],
        }
        if self.speed is not None:
            forces = joint_forces(linkage.motion(t1, self.speed), self.bodies)
            record["joint_forces"] = {joint: _xy(getattr(forces, name)) for joint, name in JOINTS.items()}
            record["drive_torque"] = float(forces.torque)
        return record

    def _position_warnings(self) -> list[str]:
        if self.position is None:
            return []
        gamma, degrees = float(self.linkage.transmission_angle(self.position)), math.degrees(self.position)
        if within_advised(gamma, gamma):
            return []
        return [f"at {degrees:.4g}° the transmission angle is {math.degrees(gamma):.4g}°, {OUTSIDE_ADVISED}"]


def _classification(linkage: Linkage) -> dict[str, Any]:
    """Return the class, Grashof's condition, the coordinates in the solution space, and the range of the
    crank, as values of the record."""
    return {
        "branch": linkage.branch,
        "mobility": mobility(),
        "class": vars(classify(linkage)),
        "grashof": satisfies_grashof(linkage),
        "solution_space": dict(
            zip(("lambda2", "lambda3", "lambda4"), solution_space(linkage), strict=True),
            base_plane=base_plane(linkage),
        ),
        "turns_fully": linkage.turns_fully,
        "crank_range": linkage.crank_range,
    }


def _ratios(motion: Motion) -> dict[str, Array]:
    """Return a mapping from names to the angular velocities and accelerations of coupler and follower."""
    return {
        f"{field}{link}": getattr(motion, field)[link - 1] for field in ("omega", "alpha") for link in (2, 3)
    }


def _extremes(signal: Callable[[Array], Array]) -> dict[str, float]:
    statistics = signal_statistics(signal, TURN)
    return {
        "max": statistics.max,
        "max_position": statistics.max_phase,
        "min": statistics.min,
        "min_position": statistics.min_phase,
        "mean": statistics.mean,
    }


def _swing(linkage: Linkage) -> float | None:
    """Return the angle between the dead points of the follower; None if the follower rotates fully."""
    if not linkage.dead_points:
        return None
    t3 = linkage.motion(linkage.dead_points).t[2]
    return float(abs(np.angle(np.exp(1j * (t3[0] - t3[1])))))


def _path(linkage: Linkage, point: complex) -> dict[str, Any]:
    path = linkage.motion(uniform_phases(_CURVE_POINTS, TURN)).position(2, point)
    return {"point": _xy(point), "x": path.real, "y": path.imag}


def _xy(value: complex | Plane) -> list[float]:
    return [float(np.real(value)), float(np.imag(value))]


@printout.register(RigidMotion)
def rigid_motion_printout(result: RigidMotion, choices: Sequence[str] = ()) -> RenderableType:
    """Tables of the class, the transmission angle, the mechanical advantage, the curves and the forces.
    Angles are in degrees."""
    return linkage_report({**result.model_info, **result.summary_values})


def rigid_motion(
    case: str | None,
    parameters: Mapping[str, float],
    branch: str = "open",
    speed: float | None = None,
    position: float | None = None,
    points: Sequence[complex] = (),
) -> RigidMotion:
    """Compute the rigid motion of the linkage with these parameters. By default, the only coupler point is
    the middle of the coupler.

    Raises SolveError subclasses.
    """
    linkage = Linkage.from_parameters(parameters, branch)
    return RigidMotion(case, parameters, linkage, speed, position, points or [complex(linkage.L2 / 2)])


def linkage(
    numbers: CaseNumbers,
    results: Results,
    speed: Annotated[str | None, Flag("Crank speed with unit, for forces and torque.", '"300 rpm"')] = None,
    branch: Annotated[str, Flag("Branch of assembly.", "open|crossed")] = "open",
    position: Annotated[
        str | None,
        Flag("Crank angle t1 to report, with unit; also for a crank that cannot turn fully.", '"70 deg"'),
    ] = None,
    coupler_point: Annotated[
        list[str] | None,
        Flag(
            "Coupler point to trace: metres from A, along AB and at +90°; repeatable; by default the "
            "middle of the coupler.",
            "X,Y",
        ),
    ] = None,
    base_planes: Annotated[
        str | None, Flag("File for a plot of Barker's base planes with the linkage.", "FILE")
    ] = None,
) -> None:
    """Rigid motion: class, transmission angle, mechanical advantage, coupler curves, joint forces."""
    (planes_file, *_) = Results(plot=base_planes).files()
    case = numbers.case_of("four_bar")
    speed = case.speed if speed is None else speed
    omega = None if speed is None else speed_in_si(speed)
    t1 = None if position is None else with_unit(position, "rad")
    if t1 is not None and math.isinf(t1):
        raise ValueOutOfBoundsError(f"--position is '{position}'; allowed: finite angles, such as '70 deg'")
    points = [_point(text) for text in coupler_point or ()]
    result = rigid_motion(case.name, case.parameters, branch, omega, t1, points)
    beside = {} if planes_file is None else {planes_file: result.base_planes}
    deliver_result(results, result, (), beside=beside)


def _point(text: str) -> complex:
    """Return the coupler point X + iY from a string "X,Y"."""
    try:
        x, y = (float(coordinate) for coordinate in text.split(","))
    except ValueError:
        x = y = math.nan
    if not abs(x) + abs(y) <= LARGEST:
        raise ValueOutOfBoundsError(
            f"--coupler-point is '{text}'; write two numbers X,Y in metres, "
            "such as --coupler-point 0.164,0.05"
        )
    return complex(x, y)
