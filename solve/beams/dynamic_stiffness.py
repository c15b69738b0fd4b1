"""Exact dynamic stiffness of a slender beam (chapter 5 and Appendix B of the thesis, with misprints
corrected).

With l = λL, λ⁴ = ρAω²/EI, and b = βL, β² = ρω²/E, the end forces of a beam vibrating at ω are D times its end
displacements, with D = K − ω²M and M = −∂D/∂(ω²). All functions are dimensionless. Their arguments are arrays
of any shape."""

import math

import numpy as np

from solve.arrays import Array

_BENDING = (
    {(1, 3): 1},
    {(1, 1): 1, (3, 3): 1},
    {(0, 3): 1, (1, 2): -1},
    {(0, 1): -1, (2, 3): 1},
    {(0, 2): 1},
    {(0, 0): 1, (2, 2): 1},
)
"""Positions and signs of F1 … F6 in the upper triangle of the matrix for v1, θ1, v2, θ2 (thesis, Eq.
(5.18))."""

_AXIAL = ({(0, 0): 1, (1, 1): 1}, {(0, 1): 1})
"""Positions and signs of F7 and F8 in the upper triangle of the matrix for u1, u2."""

BENDING_POWERS = np.array([1, 1, 2, 2, 3, 3])
"""Powers of L by which f1 … f6 are divided in F1 … F6."""

_LARGEST = 300.0
"""Largest argument of sinh and cosh. For larger arguments, ratios of these functions equal their limits;
cosh² does not overflow."""

_SMALLEST = 0.05
"""Value of λL below which the bending mass functions are replaced by constants. The error is below 4e-8, and
smaller than the round-off of the formulas."""

_POSITIVE = 1e-30
"""Smallest argument of functions with a removable singularity at 0. With this argument, their values in
float64 are exactly the limits."""


def patterns() -> Array:
    """Coefficients (8, 6, 6), each 0, 1 or −1, of EI F1 … EI F6, EA F7, EA F8 in D. The degrees of freedom
    are u1, u2, v1, θ1, v2, θ2."""
    tables = np.zeros((8, 6, 6))
    for table, entries, first in zip(tables, (*_BENDING, *_AXIAL), (2,) * 6 + (0,) * 2, strict=True):
        for (i, j), sign in entries.items():
            table[first + i, first + j] = table[first + j, first + i] = sign
    return tables


def bending(l: Array) -> Array:  # noqa: E741 - λL
    """Functions f1 … f6 as the last axis of an array, with F1 = f1/L, F2 = f2/L, F3 = f3/L², …, F6 = f6/L³
    (thesis, Eqs. (B.1)–(B.6), (B.9)).

    At l = 0, they are 2, 4, 6, −6, −12, 12, as in the static stiffness of a beam."""
    l = np.maximum(np.asarray(l, dtype=float), _POSITIVE)  # noqa: E741
    hyperbolic = np.minimum(l, _LARGEST)
    S, C, s, c = np.sinh(hyperbolic), np.cosh(hyperbolic), np.sin(l), np.cos(l)
    delta = clamped(l)
    small = _sinh_minus_sin(hyperbolic, s)
    twist = 2 * s * np.sinh(hyperbolic / 2) ** 2 + 2 * S * np.sin(l / 2) ** 2 - small
    f = (
        -l * small,
        -l * twist,
        -(l**2) * 2 * (np.sinh(hyperbolic / 2) ** 2 + np.sin(l / 2) ** 2),
        l**2 * S * s,
        l**3 * (S + s),
        -(l**3) * (C * s + S * c),
    )
    return np.stack(f, axis=-1) / delta[..., None]


def axial(b: Array) -> Array:
    """Functions f7, f8 as the last axis of an array, with EA F7 = (EA/L) f7 (thesis, Eqs. (B.7), (B.8)). At b
    = 0, they are 1 and −1."""
    b = np.maximum(np.asarray(b, dtype=float), _POSITIVE)
    return np.stack((b / np.tan(b), -b / np.sin(b)), axis=-1)


def bending_mass(l: Array) -> Array:  # noqa: E741
    """Functions g1 … g6 = −∂f/∂(l⁴) as the last axis of an array. M contains ρA L² g1, …, ρA L g6 at the
    positions of F1 … F6 (thesis, Eqs. (B.10)–(B.15))."""
    l = np.maximum(np.asarray(l, dtype=float), _SMALLEST)  # noqa: E741
    f1, f2, f3, f4, f5, f6 = np.moveaxis(bending(l), -1, 0)
    g = (
        f1 * f2 - f1 - f3,
        f1**2 - f2,
        -(f1 * f4 + 2 * f3),
        -(f1 * f3 + 2 * f4),
        f3 * f4 - 3 * f5,
        f3**2 - 3 * f6,
    )
    return np.stack(g, axis=-1) / (4 * l**4)[..., None]


def axial_mass(b: Array) -> Array:
    """Functions g7, g8 = −∂f/∂(b²) as the last axis of an array. M contains ρA L g7 and ρA L g8 (thesis, Eqs.
    (B.16), (B.17))."""
    b = np.maximum(np.asarray(b, dtype=float), _POSITIVE)
    sine = np.sin(b)
    g = (_minus_sine(2 * b) / 2, 2 * b * np.sin(b / 2) ** 2 - _minus_sine(b))
    return np.stack(g, axis=-1) / (2 * b * sine**2)[..., None]


def bending_shapes(l: Array, xi: Array, order: int = 0) -> Array:  # noqa: E741
    """Transverse displacements (..., points, 4) at ξ = x/L for unit v1, Lθ1, v2, Lθ2, or their derivatives of
    order `order` with respect to ξ (thesis, Eq. (5.5))."""
    l = np.maximum(np.asarray(l, dtype=float), _SMALLEST)  # noqa: E741
    ends = np.array([0.0, 1.0])
    values, slopes = _waves(l, ends, 0), _waves(l, ends, 1)
    unit = np.stack((values, slopes), axis=-2).reshape(*l.shape, 4, 4)
    return _waves(l, xi, order) @ np.linalg.inv(unit)


def axial_shapes(b: Array, xi: Array, order: int = 0) -> Array:
    """Axial displacements (..., points, 2) at ξ = x/L for unit u1, u2, or their derivatives of order `order`
    with respect to ξ (thesis, Eq. (5.10)). At b = 0, they are linear in ξ."""
    b = np.maximum(np.asarray(b, dtype=float), _POSITIVE)[..., None, None]
    ends = np.stack((1 - xi, xi), axis=-1)
    return (b * np.array([-1, 1])) ** order * np.sin(b * ends + order * math.pi / 2) / np.sin(b)


def _waves(l: Array, xi: Array, order: int) -> Array:  # noqa: E741
    """Fundamental solutions of the bending equation, as an array (..., points, 4), or their derivatives with
    respect to ξ.

    Instead of cosh and sinh, which are nearly equal for large l, exponentials are used that decay from either
    end."""
    l, shift = l[..., None], order * math.pi / 2  # noqa: E741
    parts = (
        np.sin(l * xi + shift),
        np.cos(l * xi + shift),
        (-1) ** order * np.exp(-l * xi),
        np.exp(-l * (1 - xi)),
    )
    return l[..., None] ** order * np.stack(parts, axis=-1)


def clamped(l: Array) -> Array:  # noqa: E741
    """Function δ = cosh l cos l − 1. It is zero at the natural frequencies of the beam with clamped ends."""
    half, hyperbolic = l / 2, np.minimum(l, _LARGEST) / 2
    s, S = np.sin(half), np.sinh(hyperbolic)
    return 2 * _sinh_minus_sin(hyperbolic, s) * (S + s) - 4 * (S * s) ** 2


def interior_count(l: Array, b: Array | None = None) -> Array:  # noqa: E741
    """Number J0 of natural frequencies below a limit, for the beam with clamped ends. The limit is given by l
    for bending and by b for axial vibration (Wittrick and Williams; thesis, Eq. (5.21))."""
    order = np.floor(l / math.pi)
    flexural = order - (1 + (-1) ** order * np.sign(clamped(l))) / 2
    return (flexural if b is None else flexural + np.floor(b / math.pi)).astype(int)


def _minus_sine(x: Array) -> Array:
    """Difference x − sin x with full relative precision."""
    series = np.zeros_like(x)
    for order in (17, 15, 13, 11, 9, 7, 5, 3):
        series = 1 / math.factorial(order) - series * x**2
    return np.where(x < 1.0, series * x**3, x - np.sin(x))


def _sinh_minus_sin(x: Array, sine: Array) -> Array:
    """Difference sinh x − sin x with full relative precision; `sine` is sin x."""
    series = np.zeros_like(x)
    for order in (19, 15, 11, 7, 3):
        series = series * x**4 + 2 / math.factorial(order)
    return np.where(x < 1.0, series * x**3, np.sinh(x) - sine)
