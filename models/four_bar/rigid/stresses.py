"""Stresses that the links bear as rigid beams: the preliminary check of thesis 3.7.

Each link is in equilibrium under the forces of its joints, the torque that drives it and its own inertia,
spread along it as that of a uniform bar.
"""

from collections.abc import Mapping

import numpy as np

from models.four_bar.linkage import Motion
from models.four_bar.rigid.forces import JointForces
from solve.arrays import Array, Plane

LINKS = ("crank", "coupler", "follower")


def internal_forces(
    motion: Motion, forces: JointForces, link: int, density: float, at: Array
) -> tuple[Plane, Array]:
    """Axial force and shear N + iQ (N, tension positive) and bending moment (N m), (k, …) each, which the
    rest of a link exerts on its part from its first joint to the distances `at` (k,) in m; density: kg/m."""
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
    """|N|/A + |M| h/(2I) (k, …) in Pa, the larger of both surfaces, at the distances `at` (k,) in m."""
    A, I, h = (parameters[f"{name}{link}"] for name in "AIh")  # noqa: E741 - the second moment of area
    through, moment = internal_forces(motion, forces, link, parameters["rho"] * A, at)
    return np.abs(through.real) / A + np.abs(moment) * h / (2 * I)
