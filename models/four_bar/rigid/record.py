"""What the linkage does over a turn, or at one position, as plain data: the keys of `--json`.

SI units and radians; ratios are those to the crank's speed: ω/ω1, and α/ω1² at constant ω1.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from models.four_bar.linkage import ADVISED, Linkage
from models.four_bar.rigid.barker import base_plane, classify, mobility, satisfies_grashof, solution_space
from models.four_bar.rigid.forces import Body, JointForces, inertial_power, joint_forces, kinetic_energy
from models.four_bar.rigid.stresses import LINKS, greatest_stress
from solve import signal_statistics
from solve.arrays import Array, Plane

JOINTS = {"O": "F01", "A": "F12", "B": "F23", "C": "F03"}
"""The joints, and the force that each carries."""

RATIOS = ("omega", "alpha")
TURN = 2 * math.pi
_OUTSIDE = "outside {:g}°–{:g}°".format(*map(math.degrees, ADVISED))
_CURVE_POINTS = 360
_BALANCE_POINTS = 720
_STRESS_POINTS = 65
"""Along a link."""


def linkage_record(
    links: Sequence[Body],
    linkage: Linkage,
    speed: float | None,
    position: float | None,
    points: Sequence[complex],
) -> dict[str, Any]:
    """Everything about a linkage, its crank's speed (rad/s) and angle t1 (rad) where they are given.

    A crank that cannot turn fully has the keys of one position only. Raises LinkageError where neither
    a full turn nor a position can be reported, or the position is out of reach.
    """
    record: dict[str, Any] = {**_kind(linkage), "speed": speed}
    if position is None:
        linkage.require_full_turn()
    if linkage.turns_fully:
        record |= _turn(linkage, links, speed, points)
    if position is not None:
        record["position"] = _position(linkage, links, speed, position, points)
    return {**record, "warnings": [*transmission_warnings(linkage), *_position_warnings(linkage, position)]}


def _kind(linkage: Linkage) -> dict[str, Any]:
    """Class, Grashof's condition, solution space, and what the crank can reach."""
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


def _turn(
    linkage: Linkage, links: Sequence[Body], speed: float | None, points: Sequence[complex]
) -> dict[str, Any]:
    """Over a full turn at constant speed: transmission angle, follower, mechanical advantage, ratios,
    coupler curves, and with a speed joint forces, drive torque and energy balance."""
    gamma = linkage.transmission_extremes()
    ratios = {
        f"{field}{link}": _range(
            lambda t, field=field, link=link: getattr(linkage.motion(t), field)[link - 1]
        )
        for field in RATIOS
        for link in (2, 3)
    }
    fastest = signal_statistics(lambda t: np.abs(linkage.motion(t).omega[2]), TURN)
    record = {
        "transmission_angle": {**gamma._asdict(), "within_advised": _within(gamma.min, gamma.max)},
        "follower": {"dead_points": linkage.dead_points, "swing": _swing(linkage)},
        "mechanical_advantage": {"least": 1.0 / fastest.max, "least_position": fastest.max_phase},
        "ratios": ratios,
        "coupler_curves": [_curve(linkage, point) for point in points],
    }
    return record if speed is None else {**record, **_force_record(linkage, links, speed)}


def _position(
    linkage: Linkage, links: Sequence[Body], speed: float | None, t1: float, points: Sequence[complex]
) -> dict[str, Any]:
    """The same quantities at one crank angle."""
    motion = linkage.motion(t1)
    record = {
        "t": motion.t,
        "transmission_angle": float(linkage.transmission_angle(t1)),
        "mechanical_advantage": float(linkage.mechanical_advantage(t1)),
        "ratios": {
            f"{field}{link}": float(getattr(motion, field)[link - 1]) for field in RATIOS for link in (2, 3)
        },
        "O": _xy(0.0),
        "A": _xy(motion.position(1, linkage.L1)),
        "B": _xy(motion.position(3, linkage.L3)),
        "C": _xy(linkage.L4),
        "coupler_points": [
            {"point": _xy(point), "position": _xy(motion.position(2, point))} for point in points
        ],
    }
    if speed is not None:
        forces = joint_forces(linkage.motion(t1, speed), links)
        record["joint_forces"] = {joint: _xy(getattr(forces, name)) for joint, name in JOINTS.items()}
        record["drive_torque"] = float(forces.torque)
    return record


def preliminary_stresses(
    links: Sequence[Body], linkage: Linkage, parameters: Mapping[str, float], speed: float
) -> dict[str, dict[str, float]]:
    """The largest stress (Pa) of each rigid link over the turn, at which angle of the crank and where on it,
    as a fraction of its length (thesis 3.7)."""

    def stress(t1: Array, link: int) -> Array:
        motion = linkage.motion(t1, speed)
        at = np.linspace(0.0, linkage.lengths[link - 1], _STRESS_POINTS)
        return greatest_stress(motion, joint_forces(motion, links), parameters, link, at)

    found = {}
    for link, name in enumerate(LINKS, start=1):
        peak = signal_statistics(lambda t, link=link: stress(t, link).max(axis=0), TURN)
        place = stress(np.array([peak.max_phase]), link)[:, 0].argmax() / (_STRESS_POINTS - 1)
        found[name] = {"peak": peak.max, "position": peak.max_phase, "fraction": float(place)}
    return found


def transmission_warnings(linkage: Linkage) -> list[str]:
    """Warnings: a transmission angle outside the advised range, which is certain where the crank does
    not turn fully, for coupler and follower are in line at its ends."""
    if not linkage.turns_fully:
        return ["the crank cannot turn fully: the transmission angle reaches 0° or 180° where it turns back"]
    gamma = linkage.transmission_extremes()
    if _within(gamma.min, gamma.max):
        return []
    return [
        f"the transmission angle goes from {math.degrees(gamma.min):.4g}° to {math.degrees(gamma.max):.4g}°, "
        f"{_OUTSIDE}: forces pass badly from coupler to follower, and small errors of the "
        "lengths move the follower much"
    ]


def _position_warnings(linkage: Linkage, t1: float | None) -> list[str]:
    """Warnings of one position: its transmission angle."""
    if t1 is None:
        return []
    gamma = float(linkage.transmission_angle(t1))
    if _within(gamma, gamma):
        return []
    return [f"at {math.degrees(t1):.4g}° the transmission angle is {math.degrees(gamma):.4g}°, {_OUTSIDE}"]


def _force_record(linkage: Linkage, links: Sequence[Body], speed: float) -> dict[str, Any]:
    def forces(t1: Array) -> JointForces:
        return joint_forces(linkage.motion(t1, speed), links)

    peaks = {
        joint: signal_statistics(lambda t, name=name: np.abs(getattr(forces(t), name)), TURN)
        for joint, name in JOINTS.items()
    }
    energy = signal_statistics(lambda t: kinetic_energy(linkage.motion(t, speed), links), TURN)
    return {
        "joint_forces": {
            joint: {"peak": peak.max, "position": peak.max_phase} for joint, peak in peaks.items()
        },
        "drive_torque": _range(lambda t: forces(t).torque),
        # What a flywheel takes and gives back in a turn (thesis 3.7): the drive's work without the motor's.
        "energy_swing": energy.max - energy.min,
        "energy_residual": _energy_residual(linkage, links, speed),
    }


def _energy_residual(linkage: Linkage, links: Sequence[Body], speed: float) -> float:
    """Largest |torque ω1 - dT/dt| over the turn, over the largest |dT/dt|."""
    motion = linkage.motion(np.arange(_BALANCE_POINTS) * (TURN / _BALANCE_POINTS), speed)
    rate = inertial_power(motion, links)
    return float(np.abs(joint_forces(motion, links).torque * speed - rate).max() / np.abs(rate).max())


def _range(signal: Callable[[Array], Array]) -> dict[str, float]:
    extremes = signal_statistics(signal, TURN)
    return {
        "max": extremes.max,
        "max_position": extremes.max_phase,
        "min": extremes.min,
        "min_position": extremes.min_phase,
        "mean": extremes.mean,
    }


def _swing(linkage: Linkage) -> float | None:
    """Angle between the follower's dead points, or None for a follower that turns fully."""
    if not linkage.dead_points:
        return None
    t3 = linkage.motion(linkage.dead_points).t[2]
    return float(abs(np.angle(np.exp(1j * (t3[0] - t3[1])))))


def _curve(linkage: Linkage, point: complex) -> dict[str, Any]:
    """Path of a coupler point, at every degree of the crank."""
    path = linkage.motion(np.arange(_CURVE_POINTS) * (TURN / _CURVE_POINTS)).position(2, point)
    return {"point": _xy(point), "x": path.real, "y": path.imag}


def _xy(value: complex | Plane) -> list[float]:
    return [float(np.real(value)), float(np.imag(value))]


def _within(least: float, greatest: float) -> bool:
    return ADVISED[0] <= least and greatest <= ADVISED[1]
