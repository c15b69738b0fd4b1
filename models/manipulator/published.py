"""Hand-coded equations of the manipulator, from section 4.3 of the chapter (see docs/literature.md). Eq. (77)
has no misprint.

Parameters are given as a mapping from names to floats in SI units; a1 …, b1 … are the coefficients of U′.
`phase` is an array (m,) in rad, and `speed` is a float in rad/s.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
HARMONICS = 12


def transmission(angle: Array, p: Mapping[str, float]) -> tuple[Array, Array, Array]:
    """Return the derivatives U′, U″, U‴ of Eq. (78) at an array of angles (rad), summed term by term."""
    first, second, third = np.zeros_like(angle), np.zeros_like(angle), np.zeros_like(angle)
    for k in range(1, HARMONICS + 1):
        a, b = p[f"a{k}"], p[f"b{k}"]
        cosine, sine = np.cos(k * angle), np.sin(k * angle)
        first += a * cosine + b * sine
        second += k * (b * cosine - a * sine)
        third -= k**2 * (a * cosine + b * sine)
    return first, second, third


def matrices(phase: Array, speed: float, p: Mapping[str, float]) -> tuple[Array, Array, Array, Array]:
    """Return M, C, K (m, 2, 2) and d (m, 2) of Eq. (77)."""
    U1, U2, U3 = transmission(phase, p)
    F, m2 = p["F"], p["m2"]
    M, C, K = (np.zeros((phase.size, 2, 2)) for _ in range(3))
    M[:, 0, 0] = p["I1"] + m2 * U1**2
    M[:, 0, 1] = M[:, 1, 0] = m2 * U1
    M[:, 1, 1] = m2
    C[:, 0, 0] = p["c1"] + 2 * m2 * speed * U1 * U2
    C[:, 1, 0] = 2 * m2 * speed * U2
    C[:, 1, 1] = p["c2"]
    K[:, 0, 0] = p["k1"] + F * U2 + m2 * speed**2 * (U1 * U3 + U2**2)
    K[:, 1, 0] = m2 * speed**2 * U3
    K[:, 1, 1] = p["k2"]
    d = np.stack([-F * U1 - m2 * speed**2 * U1 * U2, -F - m2 * speed**2 * U2], axis=1)
    return M, C, K, d
