"""Harmonic balance by collocation on the full periodic matrices (thesis 6.4; W. L. Cleghorn,
R. G. Fenton, B. Tabarrok, Mech. Mach. Theory 19 (1984) 417-423)."""

from dataclasses import dataclass

import numpy as np

from solve.arrays import Array
from solve.curve import FourierCurve
from solve.errors import MatricesError
from solve.methods.grid import Grid
from solve.methods.method import OneStep, Solution
from solve.system import PeriodicSystem

MOST_UNKNOWNS = 2000
"""Largest order of a dense eigenvalue problem that is still worth waiting for."""


@dataclass(frozen=True)
class Fourier(OneStep):
    """The orbit as the trigonometric polynomial that satisfies the equation of motion at m uniform
    phases, m odd; the multipliers from the same collocation of x = exp(λφ) p(φ), p periodic.

    Converges faster than any power of m while m/2 exceeds the highest order that matters. Cost m³.
    """

    name = "fourier"
    order = 16
    curve_order = 16
    l_stable = False

    @property
    def follows(self) -> float:
        """Two phases a wave of the fastest mode, the limit of sampling."""
        return np.pi

    def most_steps(self, n: int) -> int:
        return MOST_UNKNOWNS // (2 * n)

    def solution(self, system: PeriodicSystem, speed: float, grid: Grid, orbit: bool) -> Solution:
        if not grid.smooth:
            raise MatricesError(
                f"{self.name} needs matrices without jumps, and this system has breaks; use radau or gauss"
            )
        odd = Grid.uniform(grid.steps | 1, grid.period)
        phases = odd.nodes[:-1]
        D = differentiation(odd)
        Phi, rounding = _monodromy(system.state_rate(phases, speed)[..., :-1], D, grid.period)
        if not orbit:
            return Solution(odd, Phi, rounding=rounding)
        q, condition = self.collocated(system, speed, phases)
        curve = FourierCurve.through(odd.nodes, q)
        return Solution(odd, Phi, curve, condition=condition, rounding=rounding)

    def collocated(self, system: PeriodicSystem, speed: float, phases: Array) -> tuple[Array, float]:
        """q (m, n) at the phases, and the condition number of the linear system.

        Solved for u = q - q″, in units in which the coordinates have inertias alike: the harmonics of q
        alone would make the condition grow with m².
        """
        m, n = len(phases), system.n
        M, C, K, d = system.in_phase(phases, speed)
        rates = 2j * np.pi / system.period * np.fft.fftfreq(m, 1.0 / m)
        smooth = 1.0 / (1.0 - rates**2)
        parts = zip((M, C, K), (rates**2 * smooth, rates * smooth, smooth), strict=True)
        A = sum(np.einsum("jab,jk->jakb", part, _circulant(symbol)) for part, symbol in parts)
        unit = 1.0 / np.sqrt(np.abs(np.einsum("jaa->ja", M)).mean(axis=0))
        matrix = (unit[:, None, None] * A * unit).reshape(m * n, m * n)
        u = np.linalg.solve(matrix, (d * unit).ravel()).reshape(m, n)
        q = np.real(np.fft.ifft(smooth[:, None] * np.fft.fft(u, axis=0), axis=0)) * unit
        return q, float(np.linalg.cond(matrix, 1))


def _circulant(symbol: Array) -> Array:
    """The real matrix (m, m) that multiplies the harmonics of m samples by the symbol (m,)."""
    m = len(symbol)
    return np.real(np.fft.ifft(symbol))[np.arange(m)[:, None] - np.arange(m)]


def differentiation(grid: Grid) -> Array:
    """d/dphase (m, m) of the trigonometric interpolant through m uniform nodes, m odd."""
    m = grid.steps
    offset = np.arange(m)[:, None] - np.arange(m)
    with np.errstate(divide="ignore"):
        D = np.where(offset == 0, 0.0, 0.5 * (-1.0) ** offset / np.sin(np.pi * offset / m))
    return D * (2 * np.pi / grid.period)


def _monodromy(P: Array, D: Array, period: float) -> tuple[Array, float]:
    """Φ, and its rounding error, from the eigenpairs (λ, p) of p′ = P p - λ p whose p has its weight at
    the lowest orders.

    Each multiplier exp(λT) belongs to a family λ + ik of such pairs; truncation spoils those whose
    p lies at the edge of the orders.
    """
    m, N = P.shape[:2]
    A = -np.einsum("jk,ab->jakb", D, np.eye(N))
    A[range(m), :, range(m), :] += P
    exponents, vectors = np.linalg.eig(A.reshape(m * N, m * N))
    return from_exponents(exponents, vectors.reshape(m, N, -1), period)


def from_exponents(exponents: Array, p: Array, period: float) -> tuple[Array, float]:
    """Φ (N, N) from exponents λ (r,) and periodic vectors p (m, N, r) at m uniform phases from 0, and the
    relative error eps max|λ| T that eigenvalues of a matrix with such a spectrum have."""
    from scipy.linalg import qr

    N = p.shape[1]
    weight = (np.abs(np.fft.fft(p, axis=0)) ** 2).sum(axis=1)
    orders = np.fft.fftfreq(len(p), 1.0 / len(p))
    distance = np.abs(orders) @ weight / weight.sum(axis=0)
    # Of a family all p(0) are alike; pivots take its most central one, and then another family's.
    central = p[0] / np.linalg.norm(p[0], axis=0) * 10.0**-distance
    chosen = qr(central, mode="r", pivoting=True)[-1][:N]
    X = p[0][:, chosen]
    Phi = np.real(X * np.exp(exponents[chosen] * period) @ np.linalg.inv(X))
    return Phi, float(np.finfo(float).eps * np.abs(exponents).max() * period)
