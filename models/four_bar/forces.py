"""Joint forces, drive torque, energy and stresses of the moving rigid linkage (section 3.7 of the thesis).

Forces are complex numbers Fx + iFy in N; F_ij acts from link i on link j, where 0 is the ground. Gravity and
friction are neglected, as in the thesis.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from models.four_bar.linkage import TURN, Linkage, Motion
from solve import signal_statistics
from solve.arrays import Array, Plane

_ACTING = (
    # link, unknown, sign, joint: at its first joint (0) or its second (1)
    (0, 0, +1, 0),
    (0, 1, -1, 1),
    (1, 1, +1, 0),
    (1, 2, -1, 1),
    (2, 3, +1, 0),
    (2, 2, +1, 1),
)
"""Links and joints, counted from 0, at which the unknown forces F01, F12, F23, F03 act, with their signs;
F_ji = -F_ij."""

JOINTS = {"O": "F01", "A": "F12", "B": "F23", "C": "F03"}
"""Mapping from joints to the names of the forces that they transmit."""

LINKS = ("crank", "coupler", "follower")
_STRESS_POINTS = 65
"""Number of equidistant points along a link at which the stress is evaluated; their spacing is 1/64 of the
length. Chosen by judgement."""


@dataclass(frozen=True)
class Body:
    """Mass (kg), centre of mass X + iY (m) in the frame of the link, and moment of inertia J (kg m²) about
    the centre of mass."""

    mass: float
    centre: complex
    J: float

    @classmethod
    def bar(cls, mass: float, length: float) -> "Body":
        """Uniform slender bar along a link."""
        return cls(mass, length / 2, mass * length**2 / 12)

    def with_mass(self, mass: float, point: complex) -> "Body":
        """Body with a point mass attached at X + iY."""
        total = self.mass + mass
        return Body(
            total,
            (self.mass * self.centre + mass * point) / total,
            self.J + self.mass * mass / total * abs(point - self.centre) ** 2,
        )


@dataclass(frozen=True)
class JointForces:
    """Complex forces (N) in the joints O, A, B, C, and drive torque (N m) on the crank."""

    F01: Plane
    F12: Plane
    F23: Plane
    F03: Plane
    torque: Array


def bodies(parameters: Mapping[str, float]) -> tuple[Body, Body, Body]:
    """Return crank, coupler and follower as uniform bars of mass rho A L.

    The joint masses mA and mB are attached to crank and follower, so that F12 and F23 act only on the
    coupler.
    """
    crank, coupler, follower = (
        Body.bar(parameters["rho"] * parameters[f"A{i}"] * parameters[f"L{i}"], parameters[f"L{i}"])
        for i in (1, 2, 3)
    )
    return (
        crank.with_mass(parameters["mA"], parameters["L1"]),
        coupler,
        follower.with_mass(parameters["mB"], parameters["L3"]),
    )


def joint_forces(motion: Motion, bodies: Sequence[Body], load: ArrayLike = 0.0) -> JointForces:
    """Compute joint forces and drive torque from Newton's laws for the three links: nine equations (Eq.
    (3.12) of the thesis).

    `load` is a torque (N m) that opposes positive rotation of the follower; it broadcasts with the crank
    angles.
    """
    shape = motion.t.shape[1:]
    A, b = np.zeros((*shape, 9, 9)), np.zeros((*shape, 9))
    for k, unknown, sign, joint in _ACTING:
        arm = (joint * motion.linkage.lengths[k] - bodies[k].centre) * motion.direction(k + 1)
        x, y = 2 * unknown, 2 * unknown + 1
        A[..., 3 * k, x] = A[..., 3 * k + 1, y] = sign
        A[..., 3 * k + 2, x], A[..., 3 * k + 2, y] = -sign * arm.imag, sign * arm.real
    A[..., 2, 8] = 1.0
    for k, body in enumerate(bodies):
        inertia = body.mass * motion.acceleration(k + 1, body.centre)
        b[..., 3 * k], b[..., 3 * k + 1] = inertia.real, inertia.imag
        b[..., 3 * k + 2] = body.J * motion.alpha[k]
    b[..., 8] += np.asarray(load, dtype=float)
    solved = np.linalg.solve(A, b[..., None])[..., 0]
    F01, F12, F23, F03 = (solved[..., 2 * u] + 1j * solved[..., 2 * u + 1] for u in range(4))
    return JointForces(F01, F12, F23, F03, solved[..., 8])


def kinetic_energy(motion: Motion, bodies: Sequence[Body]) -> Array:
    """Return the kinetic energy T (J) of all moving links."""
    energy = np.zeros(motion.t.shape[1:])
    for link, body in enumerate(bodies, start=1):
        velocity = np.abs(motion.velocity(link, body.centre))
        energy += (body.mass * velocity**2 + body.J * motion.omega[link - 1] ** 2) / 2
    return energy


def inertial_power(motion: Motion, bodies: Sequence[Body]) -> Array:
    """Return the rate of change dT/dt (W) of the kinetic energy, which equals the total power of drive and
    load."""
    power = np.zeros(motion.t.shape[1:])
    for link, body in enumerate(bodies, start=1):
        velocity = motion.velocity(link, body.centre)
        acceleration = motion.acceleration(link, body.centre)
        power += body.mass * np.real(np.conj(velocity) * acceleration)
        power += body.J * motion.omega[link - 1] * motion.alpha[link - 1]
    return power


def internal_forces(
    motion: Motion, forces: JointForces, link: int, density: float, at: Array
) -> tuple[Plane, Array]:
    """Compute the internal forces of a link, which are in equilibrium with its joint forces, torque and
    inertia forces (section 3.7 of the thesis).

    Return N + iQ, which is the axial force (tension positive) and the shear force in N, and the bending
    moment in N m, both (k, …), at the distances `at` (k,) in m from the first joint. They act on the segment
    between this joint and the section. `density` is the mass per unit length, in kg/m.
    """
    length = motion.linkage.lengths[link - 1]
    along = np.conj(motion.direction(link))
    first, last = (motion.acceleration(link, end) * along for end in (0.0, length))
    start = {1: forces.F01, 2: forces.F12, 3: forces.F03}[link] * along
    torque = forces.torque if link == 1 else 0.0
    x = at.reshape(-1, *(1,) * first.ndim)
    growth = (last - first) / length
    through = density * (first * x + growth * x**2 / 2) - start
    moment = x * start.imag - torque - density * (first * x**2 / 2 + growth * x**3 / 6).imag
    return through, moment


def greatest_stress(
    motion: Motion, forces: JointForces, parameters: Mapping[str, float], link: int, at: Array
) -> Array:
    """Return the larger modulus of the axial stresses at the two surfaces, |N|/A + |M| h/(2I), (k, …) in Pa.

    `at` (k,) are distances in m from the first joint.
    """
    A, I, h = (parameters[f"{name}{link}"] for name in "AIh")  # noqa: E741 - the second moment of area
    through, moment = internal_forces(motion, forces, link, parameters["rho"] * A, at)
    return np.abs(through.real) / A + np.abs(moment) * h / (2 * I)


def preliminary_stresses(
    links: Sequence[Body], linkage: Linkage, parameters: Mapping[str, float], speed: float
) -> dict[str, dict[str, float]]:
    """Return the largest stress of each rigid link over the revolution (section 3.7 of the thesis).

    For each link, the keys are "peak" (stress in Pa), "position" (crank angle in rad) and "fraction" (of the
    link's length).
    """

    def stress(t1: Array, link: int) -> Array:
        motion = linkage.motion(t1, speed)
        at = np.linspace(0.0, linkage.lengths[link - 1], _STRESS_POINTS)
        return greatest_stress(motion, joint_forces(motion, links), parameters, link, at)

    stresses = {}
    for link, name in enumerate(LINKS, start=1):
        peak = signal_statistics(lambda t, link=link: stress(t, link).max(axis=0), TURN)
        place = stress(np.array([peak.max_phase]), link)[:, 0].argmax() / (_STRESS_POINTS - 1)
        stresses[name] = {"peak": peak.max, "position": peak.max_phase, "fraction": float(place)}
    return stresses
