"""The rigid linkage over a turn, or at one position."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from models.four_bar.linkage import Linkage
from models.four_bar.rigid.forces import Body, bodies, joint_forces
from models.four_bar.rigid.record import JOINTS, RATIOS, TURN, linkage_record, preliminary_stresses
from solve.results.contents import Column, Columns, to_json
from solve.results.result import Result
from solve.results.serialization import serializable, stored_property
from solve.views.show import printout
from solve.views.style import Figure
from solve.views.tables import RenderableType

_SAMPLES = 361

serializable(Linkage)


@dataclass(frozen=True)
class RigidMotion(Result):
    """Of a linkage: speed of its crank (rad/s) and position t1 (rad), where they are given; points of its
    coupler X + iY (m), whose paths are traced. Raises LinkageError where neither a full turn nor the position
    is determined."""

    case: str | None
    parameters: Mapping[str, float]
    linkage: Linkage
    speed: float | None
    position: float | None
    points: Sequence[complex]

    def __post_init__(self) -> None:
        self.summary_values  # noqa: B018 - what is not determined is refused here

    @property
    def model_info(self) -> dict[str, Any]:
        return {"model": "four_bar", "case": self.case, "parameters": dict(self.parameters)}

    @cached_property
    def summary_values(self) -> dict[str, Any]:  # type: ignore[override]
        record = linkage_record(self._bodies, self.linkage, self.speed, self.position, self.points)
        if self.speed is not None and self.linkage.turns_fully:
            given = self._bodies, self.linkage, self.parameters, self.speed
            record["preliminary_stress"] = preliminary_stresses(*given)
        return record

    @stored_property
    def warnings(self) -> list[str]:
        return self.summary_values["warnings"]

    @property
    def _bodies(self) -> Sequence[Body]:
        return bodies(self.parameters)

    @property
    def columns(self) -> Columns:
        """The turn, degree by degree, or where the crank cannot turn fully, the position."""
        turns = self.linkage.turns_fully
        t1 = np.linspace(0.0, TURN, _SAMPLES) if turns else np.array([self.position])
        motion = self.linkage.motion(t1)
        found = {"t1": (t1, "rad", "angle of the crank")}
        gamma = self.linkage.transmission_angle(t1)
        found["transmission_angle"] = gamma, "rad", "between coupler and follower"
        for field in RATIOS:
            power = {"omega": "ω/ω1", "alpha": "α/ω1²"}[field]
            for number, link in ((2, "coupler"), (3, "follower")):
                found[f"{field}{number}"] = getattr(motion, field)[number - 1], "1", f"{power} of the {link}"
        for number, point in enumerate(self.points, 1):
            path, where = (
                motion.position(2, point),
                f"of the coupler's point ({point.real:g}, {point.imag:g}) m",
            )
            found[f"point{number}_x"] = path.real, "m", f"x {where}"
            found[f"point{number}_y"] = path.imag, "m", f"y {where}"
        if self.speed is not None:
            forces = joint_forces(self.linkage.motion(t1, self.speed), self._bodies)
            found["drive_torque"] = forces.torque, "N m", "on the crank"
            for joint, name in JOINTS.items():
                for axis, part in (("x", np.real), ("y", np.imag)):
                    found[f"{joint}_{axis}"] = part(getattr(forces, name)), "N", f"{name} along {axis}"
        return {name: Column(*column, axes=("t1",)) for name, column in found.items()}

    def record(self) -> dict[str, Any]:
        return to_json({**self.model_info, **self.summary_values})

    def plot(self) -> Figure:
        """Positions with coupler curves, and the turn. Raises LinkageError for a crank that cannot turn."""
        from models.four_bar.rigid.draw import linkage_figure

        return linkage_figure(self.linkage, self._bodies, self.speed, self.points, self.position)

    def base_planes(self) -> Figure:
        """Barker's base planes with the linkage in them."""
        from models.four_bar.rigid.base_planes import base_planes_figure

        return base_planes_figure(self.linkage)


@printout.register(RigidMotion)
def rigid_motion_printout(result: RigidMotion, choices: Sequence[str] = ()) -> RenderableType:
    """Class, transmission angle, mechanical advantage, curves and forces; angles in degrees."""
    from models.four_bar.rigid.report import linkage_report

    return linkage_report({**result.model_info, **result.summary_values})


def rigid_motion(
    case: str | None,
    parameters: Mapping[str, float],
    branch: str = "open",
    speed: float | None = None,
    position: float | None = None,
    points: Sequence[complex] = (),
) -> RigidMotion:
    """Of the linkage with these numbers, by default with the path of its coupler's middle. Raises SolveError
    subclasses."""
    linkage = Linkage.of(parameters, branch)
    return RigidMotion(case, parameters, linkage, speed, position, points or [complex(linkage.L2 / 2)])
