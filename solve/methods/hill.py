"""Hill's infinite determinant, truncated: multipliers and stability boundaries (G. W. Hill, Acta Math.
8 (1886) 1-36; V. V. Bolotin, 1964; thesis 7.2.1)."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from solve.arrays import Array
from solve.curve import FourierCurve
from solve.errors import MatricesError, ValueOutOfBoundsError
from solve.methods.fourier import Fourier, from_exponents
from solve.methods.grid import Grid
from solve.methods.method import Solution
from solve.system import PeriodicSystem


@dataclass(frozen=True)
class Hill(Fourier):
    """Fourier series of matrices and solution balanced order by order (Galerkin), with m = 2N+1
    steps standing for N orders: multipliers from the eigenvalues of Hill's matrix, the orbit from
    the forced balance."""

    name = "hill"

    def solution(self, system: PeriodicSystem, speed: float, grid: Grid, orbit: bool) -> Solution:
        if not grid.smooth:
            raise MatricesError(f"{self.name} needs matrices without jumps, and this system has breaks")
        odd = Grid.uniform(grid.steps | 1, grid.period)
        N = odd.steps // 2
        exponents, vectors = np.linalg.eig(_hill_matrix(system, speed, N))
        series = vectors.reshape(2 * N + 1, 2 * system.n, -1)
        p = np.fft.ifft(np.fft.ifftshift(series, axes=0), axis=0) * odd.steps
        Phi, rounding = from_exponents(exponents, p, grid.period)
        if not orbit:
            return Solution(odd, Phi, rounding=rounding)
        curve, condition = _forced(system, speed, odd, N)
        return Solution(odd, Phi, curve, condition=condition, rounding=rounding)


def determinant(system: PeriodicSystem, speed: float, orders: int, multiplier: int = 1) -> float:
    """Hill's determinant with 2·orders + 1 orders at ρ = multiplier (+1 or -1): real, 0 on a stability
    boundary of that kind, its modulus raised to the power 1/size so that it neither over- nor
    underflows. Zeros over any parameter are stability boundaries.

    Raises ValueOutOfBoundsError for another multiplier.
    """
    if multiplier not in (1, -1):
        raise ValueOutOfBoundsError(f"multiplier is {multiplier}; allowed: 1 (period T) or -1 (period 2T)")
    matrix = _hill_matrix(system, speed, orders, 0.0 if multiplier == 1 else 0.5)
    sign, logarithm = np.linalg.slogdet(matrix)
    return float(np.real(sign) * np.exp(logarithm / len(matrix)))


def _hill_matrix(system: PeriodicSystem, speed: float, N: int, shift: float = 0.0) -> Array:
    """Blocks P_{j-k} - i(j + shift)ω0 δ_jk of x′ = P x over the orders j, k = -N … N; with the shift
    1/2 over -N … N-1, so that they stay symmetric about 0."""
    orders = np.arange(-N, N + 1) if shift == 0.0 else np.arange(-N, N)
    P = _spectrum(lambda phase: system.state_rate(phase, speed)[..., :-1], system.period, 2 * N)
    size = P.shape[-1]
    blocks = P[2 * N + orders[:, None] - orders]
    blocks[range(len(orders)), range(len(orders))] -= (
        2j * np.pi / system.period * (orders + shift)[:, None, None] * np.eye(size)
    )
    return np.swapaxes(blocks, 1, 2).reshape(len(orders) * size, len(orders) * size)


def _forced(system: PeriodicSystem, speed: float, grid: Grid, N: int) -> tuple[FourierCurve, float]:
    """The forced balance Σ_k [K_{j-k} + iω_k C_{j-k} - ω_k² M_{j-k}] q_k = d_j."""
    n, orders = system.n, np.arange(-N, N + 1)
    rates = 2j * np.pi / system.period * orders
    M, C, K, d = (
        _spectrum(lambda phase, part=part: system.in_phase(phase, speed)[part], system.period, 2 * N)
        for part in range(4)
    )
    index = 2 * N + orders[:, None] - orders
    smooth = 1.0 / (1.0 - rates**2)[:, None, None]
    blocks = (
        K[index] * smooth
        + C[index] * (rates[:, None, None] * smooth)
        + M[index] * (rates[:, None, None] ** 2 * smooth)
    )
    unit = 1.0 / np.sqrt(np.abs(np.diag(M[2 * N])))
    blocks = unit[:, None] * blocks * unit
    matrix = np.swapaxes(blocks, 1, 2).reshape(len(orders) * n, len(orders) * n)
    u = np.linalg.solve(matrix, (d[N : 3 * N + 1] * unit).ravel()).reshape(-1, n)
    q = (u * unit * smooth[:, 0])[N:]
    q[1:] *= 2.0
    return FourierCurve(grid.nodes, q), float(np.linalg.cond(matrix, 1))


def _spectrum(sampled: Callable[[Array], Array], period: float, orders: int) -> Array:
    """Complex Fourier coefficients of orders -orders … orders, from samples twice as dense as needed."""
    count = 4 * orders + 4
    coefficients = np.fft.fft(sampled(np.arange(count) * (period / count)), axis=0) / count
    return (
        np.concatenate((coefficients[-orders:], coefficients[: orders + 1])) if orders else coefficients[:1]
    )
