"""Hand-coded equations of the flexible coupler of a four-bar linkage: Eqs. (22), (24)–(28) and (33)–(37) of
the paper.

These are references for tests, coded by hand in NumPy without computer algebra. Each wrong entry of the paper
is a named `Misprint` that can be selected individually. Without misprints, the equations are correct; with
`AS_PRINTED`, they are those of the paper. Eqs. (23) and (31) are dimensionally wrong, which does not affect
later equations: in (23), f3 and f1 lack the factor x, and in (31), the cosine terms contain the square of
iπ/l.

Conventions. The crank turns counter-clockwise about the origin, phase Ωt from the x0 axis; the ground line
runs from the origin to the follower's pivot C at the angle θ; φ3 is the direction from crank pin A to joint
B, φ4 that from C to B. w is measured from the chord AB, positive at +90° from the chord. Gravity acts along
−y0. The external moment M_e acts on the follower against φ4. The drag c_x, c_y opposes the absolute velocity
of the coupler along and across the chord. s4 and α4 are the distance of the follower's centre of mass from C,
and its angle from the line CB. Branch `open` has B on the left of the line from A to C, so that sin(φ4 − φ3)
> 0; if the crank is the shortest link, B is above the ground line. `crossed` is the mirror image, sin(φ4 −
φ3) < 0.
"""

from collections.abc import Mapping
from enum import Enum
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.floating]

TABLE_1: dict[str, float] = {
    "l1": 1.0,
    "l2": 0.05,
    "l3": 0.8,
    "l4": 0.8,
    "s4": 0.4,
    "m3": 3.74,
    "m4": 15.0,
    "E": 2.1e11,
    "A": 6e-4,
    "rho": 7860.0,
    "I": 45e-10,
    "cx": 0.001,
    "cy": 0.001,
    "JC": 3.35,
    "alpha": 1e-4,
    "alpha4": 0.0,
    "theta": 0.0,
    "g": 9.81,
    "Me": 0.0,
}
"""Paper Table 1 as printed, in SI units (its F is `A` here), with g = 9.81 m/s² and M_e = 0, which the table
omits. The mass per length is ρA; the printed m3 is not used."""

TABLE_2: dict[str, float] = TABLE_1 | {"rho": 7800.0, "I": 45e-9}
"""Parameters that reproduce paper Table 2: a section of 20 × 30 mm, and the density from the printed m3."""

BRANCHES = {"open": 1.0, "crossed": -1.0}


class Misprint(Enum):
    """Misprint in the paper: equation, printed form and correct form."""

    AXIAL_DRAG_SIGN = "(27): + c_x l2 Ω sin(Ωt − φ3)/EI in f3; true: −"
    END_FORCE = "(28): f2 l²/3 in f4; true: f2 l²/2"
    MODE_COUPLING = "(34): 1/(i−j)² − 1/(i+j)²; true: ij [1/(i−j)² + 1/(i+j)²]"
    MATERIAL_DAMPING = "(36): ρ/E before (iπ/l)⁴ in b; true: α"
    LOST_CENTRIFUGAL = "(37): 1/4 + j²π²/6 before f2; true: 5/4 + j²π²/6"
    CENTRIFUGAL_SIGN = "(32): + before the diagonal f2; true, and right in (37): −"
    EVEN_SUM_ODD = "(32): the last sum runs over odd i+j; true, and right in (37): even"


CORRECTED: frozenset[Misprint] = frozenset()
AS_PRINTED = frozenset(Misprint) - {Misprint.CENTRIFUGAL_SIGN, Misprint.EVEN_SUM_ODD}
"""Misprints in the final equations, (24)–(28) and (33)–(37). Those that occur only in (32) are omitted."""


class LinkAngles(NamedTuple):
    """Angles (rad) of coupler and follower, with their first and second time derivatives; all are arrays
    (m,)."""

    phi3: Array
    phi4: Array
    phi3d: Array
    phi4d: Array
    phi3dd: Array
    phi4dd: Array


class LoadFunctions(NamedTuple):
    """Functions f0 … f4 of the paper; all are arrays (m,). The load is f0 + f1 x, and the axial force is EI
    (f4 + f3 x − f2 x²/2)."""

    f0: Array
    f1: Array
    f2: Array
    f3: Array
    f4: Array


class LinkageCannotTurnError(ValueError):
    """Raised if the crank of the four-bar linkage cannot make a full turn."""


def link_angles(
    phase: ArrayLike, speed: float, parameters: Mapping[str, float], branch: str = "open"
) -> LinkAngles:
    """Return the angles of the rigid linkage at phases (m,) in rad, for a constant speed in rad/s, from the
    closed-form solution of the loop equation (22).

    Raises `LinkageCannotTurnError` if the loop cannot be closed at some crank angle.
    """
    l1, l2, l3, l4, theta = (parameters[name] for name in ("l1", "l2", "l3", "l4", "theta"))
    _check_full_turn(l1, l2, l3, l4)
    crank = np.asarray(phase, dtype=float)
    dx = l1 * np.cos(theta) - l2 * np.cos(crank)
    dy = l1 * np.sin(theta) - l2 * np.sin(crank)
    distance = np.hypot(dx, dy)
    direction = np.arctan2(dy, dx)
    side = BRANCHES[branch]
    phi3 = direction + side * np.arccos((distance**2 + l3**2 - l4**2) / (2 * distance * l3))
    phi4 = direction + np.pi - side * np.arccos((distance**2 + l4**2 - l3**2) / (2 * distance * l4))
    sine, cosine = np.sin(phi4 - phi3), np.cos(phi4 - phi3)
    phi3d = l2 * speed * np.sin(crank - phi4) / (l3 * sine)
    phi4d = l2 * speed * np.sin(crank - phi3) / (l4 * sine)
    normal3, normal4, normal_crank = l3 * phi3d**2, l4 * phi4d**2, l2 * speed**2
    phi3dd = (normal_crank * np.cos(crank - phi4) + normal3 * cosine - normal4) / (l3 * sine)
    phi4dd = (normal_crank * np.cos(crank - phi3) + normal3 - normal4 * cosine) / (l4 * sine)
    return LinkAngles(phi3, phi4, phi3d, phi4d, phi3dd, phi4dd)


def _check_full_turn(l1: float, l2: float, l3: float, l4: float) -> None:
    if not (l1 + l2 < l3 + l4 and abs(l1 - l2) > abs(l3 - l4)):
        raise LinkageCannotTurnError(
            f"a crank of l2 = {l2} m cannot turn fully with l1 = {l1}, l3 = {l3}, l4 = {l4} m; "
            "choose lengths with l1 + l2 < l3 + l4 and |l1 − l2| > |l3 − l4|"
        )


def load_functions(
    phase: ArrayLike,
    speed: float,
    parameters: Mapping[str, float],
    branch: str = "open",
    misprints: frozenset[Misprint] = CORRECTED,
) -> LoadFunctions:
    """Return the functions f0 … f4 of (24)–(28), in 1/m³, 1/m⁴, 1/m⁴, 1/m³ and 1/m². EI f4 is the axial force
    at A, tension positive."""
    p, length, EI = parameters, parameters["l3"], parameters["E"] * parameters["I"]
    mu, rim = p["rho"] * p["A"], p["l2"] * speed
    motion = link_angles(phase, speed, p, branch)
    lead, angle = np.asarray(phase) - motion.phi3, motion.phi4 - motion.phi3
    drag_sign = +1 if Misprint.AXIAL_DRAG_SIGN in misprints else -1
    end_share = 1 / 3 if Misprint.END_FORCE in misprints else 1 / 2

    across = p["g"] * np.cos(motion.phi3) - rim * speed * np.sin(lead)
    along = p["g"] * np.sin(motion.phi3) - rim * speed * np.cos(lead)
    f0 = (mu * across + p["cy"] * rim * np.cos(lead)) / EI
    f1 = (mu * motion.phi3dd + p["cy"] * motion.phi3d) / EI
    f2 = mu * motion.phi3d**2 / EI
    f3 = (mu * along + drag_sign * p["cx"] * rim * np.sin(lead)) / EI
    weight = p["m4"] * p["g"] * p["s4"] * np.cos(motion.phi4 + p["alpha4"])
    follower = (p["JC"] * motion.phi4dd + weight + p["Me"]) / (EI * p["l4"] * np.sin(angle))
    end_shear = p["rho"] / p["E"] * motion.phi3dd + f0 * length / 2 + f1 * length**2 / 3
    f4 = follower + end_shear / np.tan(angle) + f2 * length**2 * end_share - f3 * length
    return LoadFunctions(f0, f1, f2, f3, f4)


def paper_matrices(
    phase: ArrayLike,
    speed: float,
    parameters: Mapping[str, float],
    modes: int = 3,
    branch: str = "open",
    misprints: frozenset[Misprint] = CORRECTED,
) -> tuple[Array, Array, Array, Array]:
    """Return M, B, C (m, n, n) and h (m, n) of (33)–(37) in M q″ + B q′ + C q = h, all divided by EI as in
    the paper.

    `phase` (m,) is in rad, `speed` in rad/s and q in m; `modes` is n. Derivatives are with respect to time.
    """
    p, length, EI = parameters, parameters["l3"], parameters["E"] * parameters["I"]
    loads = load_functions(phase, speed, p, branch, misprints)
    mode = np.arange(1, modes + 1)
    wavenumber = mode * np.pi / length
    damping = p["rho"] / p["E"] if Misprint.MATERIAL_DAMPING in misprints else p["alpha"]
    M = np.diag(p["rho"] / p["E"] * wavenumber**2 + p["rho"] * p["A"] / EI)
    B = np.diag(damping * wavenumber**4 + p["cy"] / EI)
    C = _stiffness(loads, modes, length, misprints)
    f0, f1 = loads.f0[:, None], loads.f1[:, None]
    h = np.where(mode % 2 == 1, -(4 * f0 + 2 * length * f1), 2 * length * f1) / (mode * np.pi)
    return np.broadcast_to(M, C.shape), np.broadcast_to(B, C.shape), C, h


def _stiffness(loads: LoadFunctions, modes: int, length: float, misprints: frozenset[Misprint]) -> Array:
    """Return the matrix C (m, n, n) of (37) with (34)."""
    f2, f3, f4 = (f[:, None, None] for f in loads[2:])
    j, i = np.ogrid[1 : modes + 1, 1 : modes + 1]
    gap = np.where(i == j, 1, i - j)
    if Misprint.MODE_COUPLING in misprints:
        a = 1 / gap**2 - 1 / (i + j) ** 2
    else:
        a = i * j * (1 / gap**2 + 1 / (i + j) ** 2)
    even_share = 0 if Misprint.EVEN_SUM_ODD in misprints else 1
    odd = -a * (2 / length * f3 - even_share * f2)
    even = -a * even_share * f2
    quarter = 1 / 4 if Misprint.LOST_CENTRIFUGAL in misprints else 5 / 4
    sign = +1 if Misprint.CENTRIFUGAL_SIGN in misprints else -1
    wavenumber = j * np.pi / length
    centrifugal = sign * (quarter + (j * np.pi) ** 2 / 6) * f2
    diagonal = wavenumber**4 + wavenumber**2 * (f4 + length / 2 * f3) + centrifugal
    return np.where(i == j, diagonal, np.where((i + j) % 2 == 1, odd, even))


def matrices(
    phase: ArrayLike,
    speed: float,
    parameters: Mapping[str, float],
    modes: int = 3,
    branch: str = "open",
    misprints: frozenset[Misprint] = CORRECTED,
) -> tuple[Array, Array, Array, Array]:
    """Return the matrices of `paper_matrices` multiplied by EI l/2. The equations are then those of modal
    forces, and the units are kg, N s/m, N/m and N."""
    scale = parameters["E"] * parameters["I"] * parameters["l3"] / 2
    M, B, C, h = paper_matrices(phase, speed, parameters, modes, branch, misprints)
    return scale * M, scale * B, scale * C, scale * h
