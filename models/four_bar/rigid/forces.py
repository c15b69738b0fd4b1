"""Joint forces, drive torque and energy of the moving rigid linkage (thesis 3.7).

Forces are complex numbers Fx + iFy in N; F_ij acts from link i on link j, 0 is the ground. There is
neither gravity nor friction, as in the thesis.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from models.four_bar.linkage import Motion
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
"""Where the unknowns F01, F12, F23, F03 act, links counted from 0; F_ji = -F_ij."""


@dataclass(frozen=True)
class Body:
    """Mass (kg), centre of mass X + iY (m) in the link's frame, moment of inertia J about it (kg m²)."""

    mass: float
    centre: complex
    J: float

    @classmethod
    def bar(cls, mass: float, length: float) -> "Body":
        """A uniform slender bar along its link."""
        return cls(mass, length / 2, mass * length**2 / 12)

    def with_mass(self, mass: float, point: complex) -> "Body":
        """With a point mass on it at X + iY."""
        total = self.mass + mass
        return Body(
            total,
            (self.mass * self.centre + mass * point) / total,
            self.J + self.mass * mass / total * abs(point - self.centre) ** 2,
        )


@dataclass(frozen=True)
class JointForces:
    """Forces (N, complex) in the joints O, A, B, C and the torque (N m) that drives the crank."""

    F01: Plane
    F12: Plane
    F23: Plane
    F03: Plane
    torque: Array


def bodies(parameters: Mapping[str, float]) -> tuple[Body, Body, Body]:
    """Crank, coupler and follower as uniform bars of mass rho A L. The joint masses mA and mB are fixed
    to crank and follower, so that F12 and F23 are the forces on the coupler alone."""
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
    """Joint forces and drive torque from Newton's laws for each link, nine equations with nine
    unknowns (thesis (3.12)).

    load (N m), which broadcasts with the crank angles, is a torque that opposes positive rotation of
    the follower.
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
    """T (J) of all links."""
    energy = np.zeros(motion.t.shape[1:])
    for link, body in enumerate(bodies, start=1):
        velocity = np.abs(motion.velocity(link, body.centre))
        energy += (body.mass * velocity**2 + body.J * motion.omega[link - 1] ** 2) / 2
    return energy


def inertial_power(motion: Motion, bodies: Sequence[Body]) -> Array:
    """dT/dt (W): what drive and load together must supply."""
    power = np.zeros(motion.t.shape[1:])
    for link, body in enumerate(bodies, start=1):
        velocity = motion.velocity(link, body.centre)
        acceleration = motion.acceleration(link, body.centre)
        power += body.mass * np.real(np.conj(velocity) * acceleration)
        power += body.J * motion.omega[link - 1] * motion.alpha[link - 1]
    return power
