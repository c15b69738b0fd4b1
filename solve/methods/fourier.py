"""Harmonic balance by collocation on the full periodic matrices (thesis 6.4; W. L. Cleghorn,
R. G. Fenton, B. Tabarrok, Mech. Mach. Theory 19 (1984) 417-423)."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from solve.arrays import Array
from solve.errors import MatricesError
from solve.kernel.engines import NUMPY
from solve.methods.method import Method, Solutions, no_orbit, one_by_one
from solve.period.curve import FourierCurve
from solve.period.eigenvalues import balance_matrices
from solve.period.grid import Grid
from solve.period.points import Points, matrices, state_rate
from solve.threads import interruptible

MOST_UNKNOWNS = 2000
"""Largest order of a dense eigenvalue problem that is still worth waiting for."""

_QUICK = 500
"""Order of a dense eigenvalue problem that takes less than a second."""

_EPS = float(np.finfo(float).eps)

_SINGULAR = 1e14
"""Condition number of the balance from which on it counts as singular."""

_DEFECTIVE = 1e4
"""Condition number of eigenvectors above which they are not to be divided by."""

_CLUSTER = 1e-3
"""How far, relative to the rotation, rounding may separate the exponents of a multiple one."""

_SHIFT, _MOST_ITERATIONS = 0.125, 40
"""Of the way from a cluster to the nearest other exponent, then seven times as far from the shift."""

_CONVERGED = 1e-6
"""Residual of an invariant subspace, relative to the width of a cluster, that shows it found."""


@dataclass(frozen=True)
class Fourier(Method):
    """The orbit as the trigonometric polynomial that satisfies the equation of motion at m uniform
    phases, m odd; the multipliers from the same collocation of x = exp(λφ) p(φ), p periodic.

    Converges faster than any power of m while m/2 exceeds the highest order that matters. Cost m³.
    """

    name = "fourier"
    order = math.inf
    curve_order = math.inf
    spectral = True
    # Two phases a wave of the fastest mode, the limit of sampling.
    follows = np.pi

    def most_steps(self, n: int) -> int:
        return MOST_UNKNOWNS // (2 * n)

    def solutions(self, points: Points, grid: Grid, orbit: bool, engine: str = NUMPY) -> Solutions:
        odd = Grid.uniform(grid.steps | 1, grid.period)
        return one_by_one(points, lambda point: self._solution(point, grid, odd, orbit))

    def _solution(self, point: Points, grid: Grid, odd: Grid, orbit: bool) -> Solutions:
        if not grid.smooth:
            raise MatricesError(
                f"{self.name} needs matrices without jumps, and this system has breaks; use radau or gauss"
            )
        if not np.isfinite(state_rate(point, odd.nodes[:-1])).all():
            raise self._no_map(point, odd)
        multiplied = partial(self.multiplied, point, odd)
        long = 2 * point.n * odd.steps > _QUICK
        Phi, rounding = interruptible(multiplied) if long else multiplied()
        curve, condition = self.balanced_orbit(point, odd) if orbit else (None, np.nan)
        return Solutions(odd, Phi[None], curve, np.array([condition]), rounding=np.array([rounding]))

    def multiplied(self, point: Points, grid: Grid) -> tuple[Array, float]:
        """Φ, and its rounding error, from the solutions exp(λφ) p(φ) with p′ = P p - λ p at the samples."""
        P, D = state_rate(point, grid.nodes[:-1])[0, ..., :-1], differentiation(grid)
        m, N = P.shape[:2]
        A = -np.einsum("jk,ab->jakb", D, np.eye(N))
        A[range(m), :, range(m), :] += P
        return from_exponents(A.reshape(m * N, m * N), lambda p: p.reshape(m, N, -1), grid.period)

    def balanced_orbit(self, point: Points, grid: Grid) -> tuple[FourierCurve, float]:
        """The curve (1, n, …) through m uniform nodes, and the condition number of the linear system."""
        q, condition = self.collocated(point, grid.nodes[:-1])
        return FourierCurve.through(grid.nodes, q)[None], condition

    def collocated(self, point: Points, phases: Array) -> tuple[Array, float]:
        """q (m, n) at the phases, and the condition number of the linear system.

        Solved for u = q - q″: the harmonics of q alone would make the condition grow with m².
        """
        from scipy.linalg import circulant

        m, n = len(phases), point.n
        M, C, K, d = (part[0] for part in matrices(point, phases))
        rates = 2j * np.pi / point.period * np.fft.fftfreq(m, 1.0 / m)
        smooth = 1.0 / (1.0 - rates**2)
        parts = zip((M, C, K), (rates**2 * smooth, rates * smooth, smooth), strict=True)
        # Circulant matrices multiply the harmonics of the samples.
        circulants = ((part, circulant(np.real(np.fft.ifft(symbol)))) for part, symbol in parts)
        A = sum(np.einsum("jab,jk->jakb", *each) for each in circulants)
        factor, unit = in_balance(np.abs(A).max(axis=(0, 2)))
        matrix = (factor[:, None, None] * A * unit).reshape(m * n, m * n)
        u, condition = solved_balance(matrix, (d * factor).ravel())
        u = u.reshape(m, n)
        q = np.real(np.fft.ifft(smooth[:, None] * np.fft.fft(u, axis=0), axis=0)) * unit
        return q, condition


def in_balance(sizes: Array) -> tuple[Array, Array]:
    """Factors of equations and units of coordinates (n,) in which the coefficients, of such sizes (n, n), are
    1 on the diagonal and alike beside it."""
    own = np.where(np.diag(sizes) > 0, np.diag(sizes), 1.0)
    units = balance_matrices(sizes / own[:, None])[1]
    return 1.0 / (own * units), units


def solved_balance(matrix: Array, load: Array) -> tuple[Array, float]:
    """The solution of the balance, and its condition number. Raises ResonanceError."""
    # NumPy 2.0 gives that of a complex matrix as a complex number.
    condition = float(np.real(np.linalg.cond(matrix, 1)))
    if not condition < _SINGULAR:
        raise no_orbit("the balance of forces")
    return np.linalg.solve(matrix, load), condition


def differentiation(grid: Grid) -> Array:
    """d/dphase (m, m) of the trigonometric interpolant through m uniform nodes, m odd."""
    m = grid.steps
    offset = np.arange(m)[:, None] - np.arange(m)
    with np.errstate(divide="ignore"):
        D = np.where(offset == 0, 0.0, 0.5 * (-1.0) ** offset / np.sin(np.pi * offset / m))
    return D * (2 * np.pi / grid.period)


def from_exponents(A: Array, samples: Callable[[Array], Array], period: float) -> tuple[Array, float]:
    """Φ (N, N) and the relative error of its eigenvalues, from the eigenpairs (λ, p) of A.

    samples: from columns p to their values (m, N, r) at m uniform phases from 0. Each multiplier exp(λT)
    belongs to a family λ + 2πik/T of such pairs; truncation spoils those whose p lies at the edge of the
    orders, so that of each family the pair with p nearest order 0 is taken.
    """
    from scipy.linalg import qr

    exponents, vectors = np.linalg.eig(A)
    p = samples(vectors)
    N = p.shape[1]
    distance = _mean_order(p)
    # Of a family all p(0) are alike; pivots take its most central one, and then another family's.
    central = p[0] / np.linalg.norm(p[0], axis=0) * 10.0**-distance
    chosen = qr(central, mode="r", pivoting=True)[-1][:N]
    p = p[..., chosen] / np.linalg.norm(p[0][:, chosen], axis=0)
    size = np.maximum(np.abs(p).max(axis=(0, 2)), math.sqrt(_EPS))
    condition = float(np.linalg.cond(p[0] / size[:, None]))
    perturbation = float(_EPS * np.abs(exponents).max() * period)
    rounding, rotation = min(perturbation * condition, math.sqrt(perturbation)), 2 * np.pi / period
    if condition > _DEFECTIVE or _alike(exponents[chosen], rotation):
        preferred = np.argsort(distance)
        Z, T = _invariant_subspaces(A, exponents[preferred], vectors[:, preferred], N, rotation)
        if Z.shape[1] == N:
            return _closed(samples(Z)[0], T * period), rounding
        rounding = 1.0
    return _closed(p[0], np.diag(exponents[chosen]) * period), rounding


def _mean_order(p: Array) -> Array:
    """Mean distance (r,) of the weight of p (m, N, r) from order 0."""
    weight = (np.abs(np.fft.fft(p, axis=0)) ** 2).sum(axis=1)
    return np.abs(np.fft.fftfreq(len(p), 1.0 / len(p))) @ weight / weight.sum(axis=0)


def _alike(exponents: Array, rotation: float) -> bool:
    """Whether two of the exponents (N,) differ by little more than a multiple of i·rotation: they may be of
    one family, of which truncation has changed p(0)."""
    return any((~_apart(exponents[at + 1 :] - exponents[at], rotation)).any() for at in range(len(exponents)))


def _apart(differences: Array, rotation: float) -> Array:
    """Whether exponents with such differences (r,) are of two families."""
    left = differences - 1j * rotation * np.round(np.imag(differences) / rotation)
    return np.abs(left) >= _CLUSTER * rotation


def _closed(X: Array, exponent: Array) -> Array:
    """Φ of the solutions p(φ) exp(Tφ) with p(0) = X, one exponent T of all."""
    from scipy.linalg import expm

    return np.real(X @ expm(exponent) @ np.linalg.inv(X))


def _invariant_subspaces(
    A: Array, exponents: Array, vectors: Array, N: int, rotation: float
) -> tuple[Array, Array]:
    """Z and T with A Z = Z T for the first N exponents, given with their eigenvectors in the order of
    preference, of which no two differ by a multiple of i·rotation: multiple ones together, so that Z has N
    columns even where eigenvectors are fewer; or another number, where truncation has split a multiple
    one."""
    from scipy.linalg import block_diag

    near = _CLUSTER * rotation
    every, bases, blocks, count = exponents, [], [], 0
    while count < N and len(exponents):
        differences = exponents - exponents[0]
        cluster = np.abs(differences) < near
        Z, T = vectors[:, cluster], np.diag(exponents[cluster])
        if len(T) > 1:
            Z, T = _invariant_subspace(A, exponents[cluster], every, near)
        bases.append(Z)
        blocks.append(T)
        count += int(cluster.sum())
        others = _apart(differences, rotation)
        exponents, vectors = exponents[others], vectors[:, others]
    return np.hstack(bases), np.asarray(block_diag(*blocks))


def _invariant_subspace(A: Array, exponents: Array, every: Array, near: float) -> tuple[Array, Array]:
    """Z, orthonormal, and T with A Z = Z T for exponents that lie together among every one, by inverse
    iteration of a block; without columns where it does not converge."""
    from scipy.linalg import lu_factor, lu_solve

    centre = exponents.mean()
    # A shift as near as the exponents themselves would leave nothing but their eigenvectors.
    shift = _SHIFT * min(np.abs(np.setdiff1d(every, exponents) - centre), default=8 * near)
    factors = lu_factor(A - (centre + shift) * np.eye(len(A)))
    Z = np.random.default_rng(0).standard_normal((len(A), len(exponents)))
    T: Array = np.diag(exponents)
    residual, before = np.inf, np.inf
    for _ in range(_MOST_ITERATIONS):
        Z = np.linalg.qr(lu_solve(factors, Z))[0]
        T = Z.conj().T @ A @ Z
        residual = float(np.linalg.norm(A @ Z - Z @ T))
        if residual < _CONVERGED * near and residual > 0.5 * before:
            break
        before = residual
    kept = len(T) if residual < _CONVERGED * near else 0
    return Z[:, :kept], T[:kept, :kept]
