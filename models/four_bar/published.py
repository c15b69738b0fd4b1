"""Hand-coded element matrices and frequency functions of the thesis (Chapters 4 and 5, Appendices A and B).

These are references for tests, coded by hand in NumPy without computer algebra. Each wrong entry of the
thesis is a named `Misprint` that can be selected individually. Without misprints, the equations are correct;
with `AS_PRINTED`, they are those of the thesis. Lengths are in m. λ and β are the wave numbers (1/m) of
bending and of axial vibration: λ⁴ = ρAω²/EI and β² = ρω²/E.
"""

from collections.abc import Set
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.floating]

CRANK_SECTION = (24.8e-3, 6.35e-3)
"""Width of the crank, and its thickness in the plane of motion, in m (Table 3.2)."""


class Misprint(Enum):
    """Misprint in the thesis: location, printed form and correct form."""

    CRANK_SECOND_MOMENT = (
        "Table 4.1: crank's second moment of area 520.47e-12 m⁴; its section gives 529.17e-12"
    )
    INTERNAL_STIFFNESS = "(A.4): 322 in K(2,2); true: 332, as in K(6,6)"
    CURVATURE_ELEMENT = "(A.5)–(A.8): the same as (A.1)–(A.4); the matrices with end curvatures differ"
    ARGUMENTS = "(B.1)–(B.6), (B.9): functions of λ; true: of λL"
    AXIAL_SIGNS = "(5.15), (B.7), (B.8): −β cot βL and +β/sin βL; true: the opposite signs"
    PRODUCTS = "(B.10)–(B.15): products of two F, and F3 in G1, without L; true: times L"
    RUN_TOGETHER = "(B.11): (F1 F4 + 2 F3)/4λ⁴ for G2, joined to G3 in print; true: (F1² L − F2)/4λ⁴"
    SHEAR_MASS = "(B.14): F5 F4 in G5; true: F3 F4"
    AXIAL_MASS = (
        "(B.16), (B.17): β/(2 sin² βL) − cot βL/2 and 1/(2 sin βL) − β² cos βL/(2 sin² βL); "
        "true: L/(2 sin² βL) − cot βL/(2β) and 1/(2β sin βL) − L cos βL/(2 sin² βL)"
    )


CORRECTED: frozenset[Misprint] = frozenset()
AS_PRINTED = frozenset(Misprint)

_CUBIC_STIFFNESS = "12 6 -12 6 / 4 -6 2 / 12 -6 / 4"
_INTERNAL_SHAPES = (
    (1, 0, -23, 66, -68, 24),
    (0, 1, -6, 13, -12, 4),
    (0, 0, 16, -32, 16, 0),
    (0, 0, -8, 32, -40, 16),
    (0, 0, 7, -34, 52, -24),
    (0, 0, -1, 5, -8, 4),
)
_INTERNAL_CURVATURES = (
    (-46, 396, -816, 480),
    (-12, 78, -144, 80),
    (32, -192, 192, 0),
    (-16, 192, -480, 320),
    (14, -204, 624, -480),
    (-2, 30, -96, 80),
)
_INTERNAL_MASS = (
    "523/3465 19/2310 4/63 -8/693 131/6930 -29/13860 / 2/3465 2/315 -1/1155 29/13860 -1/4620"
    " / 128/315 0 4/63 -2/315 / 32/3465 8/693 -1/1155 / 523/3465 -19/2310 / 2/3465"
)
_INTERNAL_STIFFNESS = (
    "5092/35 1138/35 -512/5 384/7 -1508/35 242/35 / 332/35 -128/5 64/7 -242/35 38/35"
    " / 1024/5 0 -512/5 128/5 / 256/7 -384/7 64/7 / 5092/35 -1138/35 / 332/35"
)
_CURVATURE_MASS = (
    "181/462 311/4620 281/55440 25/231 -151/4620 181/55440"
    " / 52/3465 23/18480 151/4620 -19/1980 13/13860 / 1/9240 181/55440 -13/13860 1/11088"
    " / 181/462 -311/4620 281/55440 / 52/3465 -23/18480 / 1/9240"
)
_CURVATURE_STIFFNESS = (
    "120/7 60/7 3/7 -120/7 60/7 -3/7 / 192/35 11/35 -60/7 108/35 -4/35 / 3/35 -3/7 4/35 1/70"
    " / 120/7 -60/7 3/7 / 192/35 -11/35 / 3/35"
)


def crank_second_moment(misprints: Set[Misprint] = CORRECTED) -> float:
    """Return the second moment of area of the crank in m⁴: from the cross section in Table 3.2, or as printed
    in Table 4.1."""
    width, thickness = CRANK_SECTION
    return 520.47e-12 if Misprint.CRANK_SECOND_MOMENT in misprints else width * thickness**3 / 12


def cubic_stiffness(L: float) -> Array:
    """Return the matrix K/EI of (4.13) for v1, θ1, v2, θ2."""
    return _scaled(_CUBIC_STIFFNESS, (0, 1, 0, 1), L) / L**3


def axial_stiffness(L: float) -> Array:
    """Return the matrix K/EA of (4.12) for u1, u2."""
    return np.array([[1.0, -1.0], [-1.0, 1.0]]) / L


def internal_shapes() -> tuple[Array, Array]:
    """Return the coefficients of ζ⁰ … ζ⁵ in N (A.1) and of ζ⁰ … ζ³ in L²B (A.2). The rows are v and θ of the
    three nodes, where the rows of θ are divided by L. The printed coefficients are correct."""
    return np.array(_INTERNAL_SHAPES, dtype=float), np.array(_INTERNAL_CURVATURES, dtype=float)


def internal_matrices(L: float, misprints: Set[Misprint] = CORRECTED) -> tuple[Array, Array]:
    """Return the matrices M/ρA (A.3) and K/EI (A.4) of the element with an internal node, for v and θ at 0,
    L/2 and L."""
    orders = (0, 1, 0, 1, 0, 1)
    M, K = _scaled(_INTERNAL_MASS, orders, L) * L, _scaled(_INTERNAL_STIFFNESS, orders, L) / L**3
    if Misprint.INTERNAL_STIFFNESS in misprints:
        K[1, 1] *= 322 / 332
    return M, K


def curvature_matrices(L: float, misprints: Set[Misprint] = CORRECTED) -> tuple[Array, Array]:
    """Return the matrices M/ρA and K/EI of the element with end curvatures, for v, θ and κ at 0 and L. In
    place of these matrices, the thesis repeats (A.1)–(A.4)."""
    if Misprint.CURVATURE_ELEMENT in misprints:
        return internal_matrices(L, misprints)
    orders = (0, 1, 2, 0, 1, 2)
    return _scaled(_CURVATURE_MASS, orders, L) * L, _scaled(_CURVATURE_STIFFNESS, orders, L) / L**3


def stiffness_functions(
    wave: ArrayLike, axial: ArrayLike, L: float, misprints: Set[Misprint] = CORRECTED
) -> Array:
    """Return the functions F1 … F8 of (B.1)–(B.9), along a new first axis, for the wave numbers λ (`wave`)
    and β (`axial`)."""
    lam, beta = np.asarray(wave, dtype=float), np.asarray(axial, dtype=float)
    argument = lam if Misprint.ARGUMENTS in misprints else lam * L
    S, C, s, c = np.sinh(argument), np.cosh(argument), np.sin(argument), np.cos(argument)
    delta = C * c - 1
    sign = -1.0 if Misprint.AXIAL_SIGNS in misprints else 1.0
    return np.stack(
        (
            -lam / delta * (S - s),
            -lam / delta * (C * s - S * c),
            -(lam**2) / delta * (C - c),
            lam**2 / delta * S * s,
            lam**3 / delta * (S + s),
            -(lam**3) / delta * (C * s + S * c),
            sign * beta / np.tan(beta * L),
            -sign * beta / np.sin(beta * L),
        )
    )


def mass_functions(
    wave: ArrayLike, axial: ArrayLike, L: float, misprints: Set[Misprint] = CORRECTED
) -> Array:
    """Return the functions G1 … G8 of (B.10)–(B.17), along a new first axis, for the wave numbers λ (`wave`)
    and β (`axial`). Entries of the mass matrix are ρA times these functions."""
    lam, beta = np.asarray(wave, dtype=float), np.asarray(axial, dtype=float)
    F1, F2, F3, F4, F5, F6 = stiffness_functions(lam, beta, L, misprints)[:6]
    a = 1.0 if Misprint.PRODUCTS in misprints else L
    bending = (
        F1 * F2 * a - F1 - F3 * a,
        F1 * F4 * a + 2 * F3 if Misprint.RUN_TOGETHER in misprints else F1**2 * a - F2,
        -(F1 * F4 * a + 2 * F3),
        -(F1 * F3 * a + 2 * F4),
        (F5 if Misprint.SHEAR_MASS in misprints else F3) * F4 * a - 3 * F5,
        F3**2 * a - 3 * F6,
    )
    s, c = np.sin(beta * L), np.cos(beta * L)
    along = (L / (2 * s**2) - c / (2 * beta * s), 1 / (2 * beta * s) - L * c / (2 * s**2))
    if Misprint.AXIAL_MASS in misprints:
        along = (beta / (2 * s**2) - c / (2 * s), -(beta**2) * c / (2 * s**2) + 1 / (2 * s))
    return np.stack((*(each / (4 * lam**4) for each in bending), *along))


def dynamic_stiffness(F: Array, EI: float, EA: float) -> Array:
    """Return the matrix D of (5.18), from F1 … F8, for u1, u2, v1, θ1, v2, θ2."""
    F1, F2, F3, F4, F5, F6, F7, F8 = F
    D = np.zeros((6, 6))
    D[:2, :2] = EA * np.array([[F7, F8], [F8, F7]])
    D[2:, 2:] = EI * np.array([[F6, -F4, F5, F3], [-F4, F2, -F3, F1], [F5, -F3, F6, F4], [F3, F1, F4, F2]])
    return D


def _scaled(upper: str, orders: tuple[int, ...], L: float) -> Array:
    """Return a symmetric matrix from the rows of its upper triangle. Each entry is multiplied by L to the sum
    of the `orders` of its two degrees of freedom."""
    n = len(orders)
    matrix = np.zeros((n, n))
    for i, row in enumerate(upper.split(" / ")):
        entries = [_ratio(text) for text in row.split()]
        matrix[i, i:] = matrix[i:, i] = entries
    powers = L ** np.array(orders, dtype=float)
    return matrix * np.outer(powers, powers)


def _ratio(text: str) -> float:
    above, _, below = text.partition("/")
    return float(above) / float(below or 1)
