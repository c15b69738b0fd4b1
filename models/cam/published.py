"""Hand-coded equations of the cam, from section 4.1 of the chapter, with the misprints in (52) and (61).

Parameters are given as a mapping from names to floats in SI units; a1 …, b1 … are the coefficients of U′.
`phase` is an array (m,) in rad, and `speed` is a float in rad/s.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
HARMONICS = 12


def transmission(angle: Array, p: Mapping[str, float]) -> tuple[Array, Array, Array]:
    """Return the derivatives U′, U″, U‴ of Eq. (65) at an array of angles (rad), summed term by term."""
    first, second, third = np.zeros_like(angle), np.zeros_like(angle), np.zeros_like(angle)
    for k in range(1, HARMONICS + 1):
        a, b = p[f"a{k}"], p[f"b{k}"]
        cosine, sine = np.cos(k * angle), np.sin(k * angle)
        first += a * cosine + b * sine
        second += k * (b * cosine - a * sine)
        third -= k**2 * (a * cosine + b * sine)
    return first, second, third


def force(phase: Array, p: Mapping[str, float]) -> Array:
    """Return the load F at an array of phases: a mean and six harmonics. In the chapter, F is constant."""
    total = np.full_like(phase, p["F"])
    for k in range(1, 7):
        total += p[f"Fa{k}"] * np.cos(k * phase) + p[f"Fb{k}"] * np.sin(k * phase)
    return total


def matrices(phase: Array, speed: float, p: Mapping[str, float]) -> tuple[Array, Array, Array, Array]:
    """Return M, C, K (m, 3, 3) and d (m, 3) of Eq. (64), which is printed correctly."""
    U1, U2, U3 = transmission(phase, p)
    F = force(phase, p)
    m3, m = p["m3"], p["m2"] + p["m3"]
    M, C, K = (np.zeros((phase.size, 3, 3)) for _ in range(3))
    M[:, 0, 0] = p["I1"] + m * U1**2
    M[:, 0, 1] = M[:, 1, 0] = m * U1
    M[:, 0, 2] = M[:, 2, 0] = m3 * U1
    M[:, 1, 1] = m
    M[:, 1, 2] = M[:, 2, 1] = M[:, 2, 2] = m3
    C[:, 0, 0] = p["c1"] + 2 * m * speed * U1 * U2
    C[:, 1, 0] = 2 * m * speed * U2
    C[:, 2, 0] = 2 * m3 * speed * U2
    C[:, 1, 1] = p["c2"]
    C[:, 2, 2] = p["c3"]
    K[:, 0, 0] = p["k1"] + F * U2 + m * speed**2 * (U1 * U3 + U2**2)
    K[:, 1, 0] = m * speed**2 * U3
    K[:, 2, 0] = m3 * speed**2 * U3
    K[:, 1, 1] = p["k2"]
    K[:, 2, 2] = p["k3"]
    d = np.stack(
        [-F * U1 - m * speed**2 * U1 * U2, -F - m * speed**2 * U2, -F - m3 * speed**2 * U2],
        axis=1,
    )
    return M, C, K, d


def mass_as_printed_61(phase: Array, p: Mapping[str, float]) -> Array:
    """Return M (m, 3, 3) of Eqs. (61)–(63) as printed. In (61), the factors of q̈2 and q̈3 are U″ and U‴
    instead of U′."""
    _, U2, U3 = transmission(phase, p)
    M = matrices(phase, 0.0, p)[0]
    M[:, 0, 1] = (p["m2"] + p["m3"]) * U2
    M[:, 0, 2] = p["m3"] * U3
    return M


def residual(
    phase: Array,
    speed: float,
    q: Array,
    qd: Array,
    qdd: Array,
    p: Mapping[str, float],
    as_printed: bool = False,
) -> Array:
    """Return the left-hand side minus the right-hand side (m, 3) of Eqs. (52)–(54), with φ1 = φ + q1, for q,
    qd and qdd (m, 3).

    If `as_printed` is True, (52) has U″ instead of U′ before q̈2 and q̈3.
    """
    U1, U2, _ = transmission(phase + q[:, 0], p)
    F = force(phase, p)
    m3, m = p["m3"], p["m2"] + p["m3"]
    turning = speed + qd[:, 0]
    coupling = U2 if as_printed else U1
    first = (p["I1"] + m * U1**2) * qdd[:, 0] + m * coupling * qdd[:, 1] + m3 * coupling * qdd[:, 2]
    first += m * U1 * U2 * turning**2 + p["c1"] * qd[:, 0] + p["k1"] * q[:, 0] + F * U1
    second = m * U1 * qdd[:, 0] + m * qdd[:, 1] + m3 * qdd[:, 2]
    second += m * U2 * turning**2 + p["c2"] * qd[:, 1] + p["k2"] * q[:, 1] + F
    third = m3 * (U1 * qdd[:, 0] + qdd[:, 1] + qdd[:, 2])
    third += m3 * U2 * turning**2 + p["c3"] * qd[:, 2] + p["k3"] * q[:, 2] + F
    return np.stack([first, second, third], axis=1)
