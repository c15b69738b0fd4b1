"""Hand-coded equation of the gear pair, from section 4.2 of the chapter.

Parameters are given as a mapping from names to floats in SI units. `phase` (m,) is the angle of the pinion in
rad, and `speed` is a float in rad/s.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def mesh_stiffness(phase: Array, p: Mapping[str, float]) -> Array:
    """Return the mesh stiffness k_z of Eq. (73) in N/m. The frequencies of its harmonics are multiples of the
    meshing frequency, which is z1 times the rotational frequency of the pinion."""
    terms = (p[f"k{n}"] * np.cos(n * p["z1"] * phase + p[f"gamma{n}"]) for n in range(1, 11))
    return p["k0"] + sum(terms, np.zeros_like(phase))


def tooth_error(phase: Array, p: Mapping[str, float]) -> tuple[Array, Array]:
    """Return the tooth error e of Eq. (74) in m, and its derivative with respect to the phase."""
    error, slope = np.zeros_like(phase), np.zeros_like(phase)
    for i in range(1, 7):
        angle = i * phase + p[f"alpha{i}"]
        error += p[f"e{i}"] * np.cos(angle)
        slope -= i * p[f"e{i}"] * np.sin(angle)
    return error, slope


def reduced_mass(p: Mapping[str, float]) -> float:
    """Return the reduced mass m_red of Eq. (70) in kg."""
    return p["J1"] * p["J2"] / (p["J1"] * p["rb2"] ** 2 + p["J2"] * p["rb1"] ** 2)


def matrices(
    phase: Array, speed: float, p: Mapping[str, float], load: str = "tracking"
) -> tuple[Array, Array, Array, Array]:
    """Return M, C, K (m, 1, 1) and d (m, 1) of Eq. (72), with c_z = 2 ω0 ζ m_red.

    If `load` is "tracking", d is f(t), which is stated below (72), with F(t) from (71). If it is "constant",
    F = k0 q0 in (69).
    """
    m_red = reduced_mass(p)
    natural = np.sqrt(p["k0"] / m_red)
    c_z = 2 * natural * p["zeta"] * m_red
    k_z = mesh_stiffness(phase, p)
    error, slope = tooth_error(phase, p)
    kept = p["k0"] if load == "tracking" else 0.0
    d = p["k0"] * p["q0"] - (k_z - kept) * error - c_z * speed * slope
    ones = np.ones((phase.size, 1, 1))
    return m_red * ones, c_z * ones, k_z[:, None, None], d[:, None]
