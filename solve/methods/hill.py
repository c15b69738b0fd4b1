"""Multipliers and stability boundaries from Hill's truncated infinite determinant (G. W. Hill, Acta Math. 8
(1886) 1-36; V. V. Bolotin, 1964; section 7.2.1 of the thesis)."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np

from solve.arguments import checked_tolerance, conforms, described, matches_annotations
from solve.arrays import Array, uniform_phases
from solve.errors import ValueOutOfBoundsError
from solve.methods.fourier import Fourier, from_exponents, in_balance, solved_balance
from solve.period.curve import FourierCurve
from solve.period.grid import Grid
from solve.period.points import Points, SinglePoint, matrices, state_rate, state_size
from solve.system import PeriodicSystem

_FIRST_ORDERS, _MOST_ORDERS = 8, 128

Problem = Callable[[float], tuple[PeriodicSystem, float]]
"""Type of functions that take the value of a parameter, and return a system and a speed in rad/s."""


@dataclass(frozen=True)
class Hill(Fourier):
    """Hill's method: Galerkin's method with Fourier series of the matrices and of the solution. N harmonics
    correspond to m = 2N+1 steps.

    Multipliers are computed from the eigenvalues of Hill's matrix. The orbit is computed by harmonic balance.
    """

    name = "hill"

    def multiplied(self, point: Points, grid: Grid) -> tuple[Array, float]:
        orders, size = grid.steps, state_size(point)

        def samples(p: Array) -> Array:
            series = p.reshape(orders, size, -1)
            return np.fft.ifft(np.fft.ifftshift(series, axes=0), axis=0) * orders

        return from_exponents(_hill_matrix(point, orders // 2), samples, grid.period)

    def balanced_orbit(self, point: Points, grid: Grid) -> tuple[FourierCurve, float]:
        """Return the periodic orbit and the condition number of its equations, the harmonic balance Σ_k
        [K_{j-k} + iω_k C_{j-k} - ω_k² M_{j-k}] q_k = d_j."""
        N, n = grid.steps // 2, point.n
        orders = np.arange(-N, N + 1)
        rates = 2j * np.pi / point.period * orders
        M, C, K, d = (_spectrum(part[0], 2 * N) for part in matrices(point, _samples(point, 2 * N)))
        smooth, rate = (part[:, None, None] for part in (1.0 / (1.0 - rates**2), rates))
        M, C, K = (toeplitz(part, orders, orders) for part in (M, C, K))
        blocks = (K + rate * C + rate**2 * M) * smooth
        factor, unit = in_balance(np.abs(blocks).max(axis=(0, 1)))
        matrix = together(factor[:, None] * blocks * unit)
        u, condition = solved_balance(matrix, (d[N : 3 * N + 1] * factor).ravel())
        q = (u.reshape(-1, n) * unit * smooth[:, 0])[N:]
        q[1:] *= 2.0
        return FourierCurve(grid.nodes, q.T[None]), condition


def determinant(system: PeriodicSystem, speed: float, orders: int, multiplier: int = 1) -> float:
    """Hill's determinant with the harmonics -orders … orders, for a multiplier +1 or -1.

    It is real, and 0 on a stability boundary with this multiplier. To avoid overflow and underflow, its
    modulus is raised to the power 1/N, where N is the number of rows of the matrix. `boundaries` finds the
    zeros for any parameter. Raises ValueOutOfBoundsError for another multiplier."""
    sign, logarithm, size = _sign_and_logarithm(system, speed, orders, multiplier)
    return sign * float(np.exp(logarithm / size))


def _sign_and_logarithm(
    system: PeriodicSystem, speed: float, orders: int, multiplier: int
) -> tuple[float, float, int]:
    """Return the sign and the logarithm of the modulus of Hill's determinant for a multiplier +1 or -1, and
    the size of the matrix."""
    if multiplier not in (1, -1):
        raise ValueOutOfBoundsError(f"multiplier is {multiplier}; allowed: 1 (period T) or -1 (period 2T)")
    matrix = _hill_matrix(SinglePoint(system, speed), orders, 0.0 if multiplier == 1 else 0.5)
    sign, logarithm = np.linalg.slogdet(matrix)
    return float(np.real(sign)), float(logarithm), len(matrix)


@dataclass(frozen=True)
class Boundary:
    """Value of a parameter on a stability boundary, with its error.

    Attributes
    ----------
    value : float
        Value of the parameter.
    multiplier : int
        Multiplier at the boundary, 1 or -1.
    error : float
        Error of the value, estimated from half as many harmonics.
    """

    value: float
    multiplier: int
    error: float


@matches_annotations
def boundaries(
    problem: Problem, values: Sequence[float], multiplier: int = 1, rtol: float = 1e-10
) -> list[Boundary]:
    """Find values of a parameter at which a Floquet multiplier passes through +1 or -1 (section 7.2.1 of the
    thesis).

    Parameters
    ----------
    problem : callable
        Function of the value of the parameter that returns the system and the speed in rad/s.
    values : sequence of float
        Ascending values between which boundaries are sought. Two boundaries between two neighbouring values
        are found only if the determinant is nearly zero between the boundaries.
    multiplier : int
        Multiplier at the boundary: 1 (period T) or -1 (period 2T).
    rtol : float
        Tolerance of the boundaries, relative to the range of `values`. The number of harmonics is doubled
        until no boundary changes by more than the tolerance.

    Returns
    -------
    list of Boundary
        Boundaries in ascending order of the parameter.

    Raises
    ------
    ValueOutOfBoundsError
        If `values` has fewer than two elements or is not ascending, or if `multiplier` is neither 1 nor -1.

    Notes
    -----
    Boundaries at which a complex pair of multipliers leaves the unit circle are not found.

    Examples
    --------
    >>> import numpy as np
    >>> def mathieu(delta):
    ...     def matrices(phase, speed):
    ...         one, zero = np.ones((len(phase), 1, 1)), np.zeros((len(phase), 1, 1))
    ...         return one, zero, (delta + np.cos(2 * phase))[:, None, None], zero[:, 0]
    ...     return PeriodicSystem(matrices, ["q"], period=np.pi), 1.0
    >>> [round(found.value, 8) for found in boundaries(mathieu, np.linspace(0, 3, 31), multiplier=-1)]
    [0.47065435, 1.46676684]
    """
    grid, rtol = np.asarray(values, dtype=float), checked_tolerance(rtol, "rtol")
    if len(grid) < 2 or not (np.diff(grid) > 0).all():
        raise ValueOutOfBoundsError(f"values are {list(values)[:6]}; give at least two ascending values")
    if not conforms(built := problem(float(grid[0])), tuple[PeriodicSystem, float]):
        raise ValueOutOfBoundsError(
            f"'problem' returns {described(built)}; it must return a PeriodicSystem and a speed in rad/s"
        )
    tolerance = rtol * float(grid[-1] - grid[0])
    orders, before = _FIRST_ORDERS, np.empty(0)
    while True:
        found = _zeros(problem, multiplier, orders, grid, tolerance)
        alike = orders > _FIRST_ORDERS and len(found) == len(before)
        errors = np.maximum(np.abs(found - before), tolerance / 4) if alike else np.full(len(found), np.inf)
        if (alike and (errors <= tolerance).all()) or orders == _MOST_ORDERS:
            pairs = zip(found.tolist(), errors.tolist(), strict=True)
            return [Boundary(value, multiplier, error) for value, error in pairs]
        orders, before = 2 * orders, found


def _zeros(problem: Problem, multiplier: int, orders: int, values: Array, tolerance: float) -> Array:
    """Zeros of Hill's determinant between the values, including pairs of close zeros."""
    from scipy.optimize import brentq, minimize_scalar

    @cache
    def at(value: float) -> tuple[float, float]:
        return _sign_and_logarithm(*problem(value), orders, multiplier)[:2]

    def scaled(value: float, scale: float) -> float:
        sign, logarithm = at(value)
        return sign * float(np.exp(logarithm - scale))

    ends = values.tolist()
    for left, middle, right in zip(values.tolist(), ends[1:], ends[2:], strict=False):
        signs, logarithms = zip(*map(at, (left, middle, right)), strict=True)
        # Two zeros may lie near a minimum of the modulus of the determinant.
        if abs(sum(signs)) == 3 and logarithms[1] == min(logarithms):
            closest: Any = minimize_scalar(
                lambda value, sign=signs[1], scale=logarithms[1]: sign * scaled(value, scale),
                bounds=(left, right),
                method="bounded",
                options={"xatol": tolerance},
            )
            ends.append(float(closest.x))
    zeros = [value for value in ends if at(value)[0] == 0.0]
    for left, right in pairwise(sorted(ends)):
        if at(left)[0] * at(right)[0] < 0:
            scale = max(at(left)[1], at(right)[1])
            zeros.append(brentq(scaled, left, right, (scale,), tolerance / 16))  # type: ignore[arg-type]
    return np.sort(np.array(zeros))


def _hill_matrix(point: Points, N: int, shift: float = 0.0) -> Array:
    """Blocks P_{j-k} - i(j + shift)ω0 δ_jk of x′ = P x for harmonics j, k = -N … N. With the shift 1/2, the
    harmonics are -N … N-1, and j + 1/2 is symmetric about 0."""
    orders = np.arange(-N, N + 1) if shift == 0.0 else np.arange(-N, N)
    P = _spectrum(state_rate(point, _samples(point, 2 * N))[0, ..., :-1], 2 * N)
    size = P.shape[-1]
    blocks = toeplitz(P, orders, orders)
    blocks[range(len(orders)), range(len(orders))] -= (
        2j * np.pi / point.period * (orders + shift)[:, None, None] * np.eye(size)
    )
    return together(blocks)


def toeplitz(spectrum: Array, rows: Array, columns: Array) -> Array:
    """Blocks P_{row - column}, as an array (j, k, …), for the harmonics `rows` (j,) and `columns` (k,). In
    `spectrum`, P_0 is in the middle."""
    return spectrum[len(spectrum) // 2 + rows[:, None] - columns]


def together(blocks: Array) -> Array:
    """Join blocks (j, k, a, b) to a matrix (j a, k b)."""
    j, k, a, b = blocks.shape
    return np.swapaxes(blocks, 1, 2).reshape(j * a, k * b)


def _samples(point: Points, orders: int) -> Array:
    """Phases (k,) at which coefficients are sampled: twice as many as the harmonics require."""
    count = 4 * orders + 4
    return uniform_phases(count, point.period)


def _spectrum(samples: Array, orders: int) -> Array:
    """Complex Fourier coefficients of the harmonics -orders … orders."""
    coefficients = np.fft.fft(samples, axis=0) / len(samples)
    return (
        np.concatenate((coefficients[-orders:], coefficients[: orders + 1])) if orders else coefficients[:1]
    )
