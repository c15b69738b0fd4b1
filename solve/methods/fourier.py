"""Harmonic balance by collocation with the full periodic matrices (section 6.4 of the thesis; W. L. Cleghorn,
R. G. Fenton, B. Tabarrok, Mech. Mach. Theory 19 (1984) 417-423)."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from solve.arrays import EPS, Array
from solve.errors import MatricesError
from solve.kernel.engines import NUMPY
from solve.methods.method import Method, Solutions, no_orbit, one_by_one
from solve.period.curve import FourierCurve
from solve.period.eigenvalues import balance_matrices
from solve.period.grid import Grid
from solve.period.points import Points, matrices, state_rate, state_size
from solve.threads import interruptible

MOST_UNKNOWNS = 2000
"""Largest permitted size of a dense eigenvalue problem. Chosen by judgement."""

_QUICK = 500
"""Size up to which a dense eigenvalue problem takes less than a second."""

_SINGULAR = 1e14
"""Condition number above which the equations of the harmonic balance count as singular. Chosen by
judgement."""

_DEFECTIVE = 1e4
"""Condition number of the matrix of eigenvectors above which it is not inverted. Chosen by judgement."""

_CLUSTER = 1e-3
"""Largest distance between the parts of a multiple exponent that round-off has split, relative to the
rotation 2π/T. Chosen by judgement."""

_SHIFT, _MOST_ITERATIONS = 0.125, 40
"""Distance of the shift from a cluster of exponents, as a fraction of the distance to the nearest other
exponent; and maximum number of iterations. The nearest other exponent is seven times as far from the shift as
the cluster."""

_CONVERGED = 1e-6
"""Residual of an invariant subspace, relative to the width of the cluster of exponents, below which the
iteration has converged."""


@dataclass(frozen=True)
class Fourier(Method):
    """Trigonometric polynomial that satisfies the equation of motion at m uniform phases, m odd.

    Multipliers are computed by the same collocation, of x = exp(λφ) p(φ) with periodic p. If m/2 exceeds the
    highest relevant harmonic, the error decreases faster than any power of 1/m. The cost is proportional to
    m³."""

    name = "fourier"
    first_order = True
    order = math.inf
    curve_order = math.inf
    spectral = True
    # The Nyquist limit: two samples per cycle of the fastest mode.
    follows = np.pi

    def most_steps(self, n: int, first_order: int = 0) -> int:
        return MOST_UNKNOWNS // (2 * n - first_order)

    def solutions(self, points: Points, grid: Grid, orbit: bool, engine: str = NUMPY) -> Solutions:
        odd = Grid.uniform(grid.steps | 1, grid.period)
        return one_by_one(points, lambda point: self._solution(point, grid, odd, orbit))

    def _solution(self, point: Points, grid: Grid, odd: Grid, orbit: bool) -> Solutions:
        if not grid.smooth:
            raise MatricesError(
                f"{self.name} requires matrices without jumps, and this system has breaks; use radau or gauss"
            )
        if not np.isfinite(state_rate(point, odd.nodes[:-1])).all():
            raise self._no_map(point, odd)
        multiplied = partial(self.multiplied, point, odd)
        long = state_size(point) * odd.steps > _QUICK
        Phi, rounding = interruptible(multiplied) if long else multiplied()
        curve, condition = self.balanced_orbit(point, odd) if orbit else (None, np.nan)
        return Solutions(odd, Phi[None], curve, np.array([condition]), rounding=np.array([rounding]))

    def multiplied(self, point: Points, grid: Grid) -> tuple[Array, float]:
        """Return the monodromy matrix Φ and its round-off error. Φ follows from the solutions exp(λφ) p(φ)
        with p′ = P p - λ p at the samples."""
        P, D = state_rate(point, grid.nodes[:-1])[0, ..., :-1], differentiation(grid)
        m, N = P.shape[:2]
        A = -np.einsum("jk,ab->jakb", D, np.eye(N))
        A[range(m), :, range(m), :] += P
        return from_exponents(A.reshape(m * N, m * N), lambda p: p.reshape(m, N, -1), grid.period)

    def balanced_orbit(self, point: Points, grid: Grid) -> tuple[FourierCurve, float]:
        """Return the curve (1, n, …) of the periodic orbit through m uniform nodes, and the condition number
        of its linear system."""
        q, condition = self.collocated(point, grid.nodes[:-1])
        return FourierCurve.through(grid.nodes, q)[None], condition

    def collocated(self, point: Points, phases: Array) -> tuple[Array, float]:
        """Return the coordinates q (m, n) at the phases, and the condition number of the linear system.

        The unknowns are u = q - q″. With the unknowns q, the condition number would be proportional to m²."""
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
    """Return factors (n,) of the equations and units (n,) of the coordinates. They scale coefficients with
    moduli `sizes` (n, n) to 1 on the diagonal and to similar sizes elsewhere."""
    diagonal = np.where(np.diag(sizes) > 0, np.diag(sizes), 1.0)
    units = balance_matrices(sizes / diagonal[:, None])[1]
    return 1.0 / (diagonal * units), units


def solved_balance(matrix: Array, load: Array) -> tuple[Array, float]:
    """Return the solution of the equations of the harmonic balance, and their condition number. Raises
    ResonanceError."""
    # NumPy 2.0 returns a complex condition number for a complex matrix.
    condition = float(np.real(np.linalg.cond(matrix, 1)))
    if not condition < _SINGULAR:
        raise no_orbit("the balance of forces")
    return np.linalg.solve(matrix, load), condition


def differentiation(grid: Grid) -> Array:
    """Matrix (m, m) that differentiates a trigonometric interpolant with respect to the phase. The
    interpolant passes through m uniform nodes, m odd."""
    m = grid.steps
    offset = np.arange(m)[:, None] - np.arange(m)
    with np.errstate(divide="ignore"):
        D = np.where(offset == 0, 0.0, 0.5 * (-1.0) ** offset / np.sin(np.pi * offset / m))
    return D * (2 * np.pi / grid.period)


def from_exponents(A: Array, samples: Callable[[Array], Array], period: float) -> tuple[Array, float]:
    """Return the monodromy matrix Φ (N, N) and the relative error of its eigenvalues, from the eigenpairs (λ,
    p) of A.

    samples: function that converts columns p to their values (m, N, r) at m uniform phases from 0. Each
    multiplier exp(λT) belongs to a family of eigenpairs with exponents λ + 2πik/T. Truncation affects
    eigenpairs whose p contains the highest harmonics. Therefore, the eigenpair whose p is nearest to harmonic
    0 is used from each family."""
    from scipy.linalg import qr

    exponents, vectors = np.linalg.eig(A)
    p = samples(vectors)
    N = p.shape[1]
    distance = _mean_order(p)
    # All p(0) of a family are parallel. Pivoting selects the p nearest to harmonic 0, then one of another
    # family.
    central = p[0] / np.linalg.norm(p[0], axis=0) * 10.0**-distance
    chosen = qr(central, mode="r", pivoting=True)[-1][:N]
    p = p[..., chosen] / np.linalg.norm(p[0][:, chosen], axis=0)
    size = np.maximum(np.abs(p).max(axis=(0, 2)), math.sqrt(EPS))
    condition = float(np.linalg.cond(p[0] / size[:, None]))
    perturbation = float(EPS * np.abs(exponents).max() * period)
    rounding, rotation = min(perturbation * condition, math.sqrt(perturbation)), 2 * np.pi / period
    if condition > _DEFECTIVE or _alike(exponents[chosen], rotation):
        preferred = np.argsort(distance)
        Z, T = _invariant_subspaces(A, exponents[preferred], vectors[:, preferred], N, rotation)
        if Z.shape[1] == N:
            return _closed(samples(Z)[0], T * period), rounding
        rounding = 1.0
    return _closed(p[0], np.diag(exponents[chosen]) * period), rounding


def _mean_order(p: Array) -> Array:
    """Mean modulus (r,) of the harmonic number in the spectrum of each column p (m, N, r)."""
    weight = (np.abs(np.fft.fft(p, axis=0)) ** 2).sum(axis=1)
    return np.abs(np.fft.fftfreq(len(p), 1.0 / len(p))) @ weight / weight.sum(axis=0)


def _alike(exponents: Array, rotation: float) -> bool:
    """Whether any two of the exponents (N,) differ by nearly a multiple of i·rotation. They may then belong
    to the same solution, with p(0) changed by truncation."""
    return any((~_apart(exponents[at + 1 :] - exponents[at], rotation)).any() for at in range(len(exponents)))


def _apart(differences: Array, rotation: float) -> Array:
    """Whether exponents that have these differences (r,) belong to different solutions."""
    left = differences - 1j * rotation * np.round(np.imag(differences) / rotation)
    return np.abs(left) >= _CLUSTER * rotation


def _closed(X: Array, exponent: Array) -> Array:
    """Monodromy matrix Φ of N solutions p(φ) exp(Tφ) with p(0) = X, where T is a matrix (`exponent`)."""
    from scipy.linalg import expm

    return np.real(X @ expm(exponent) @ np.linalg.inv(X))


def _invariant_subspaces(
    A: Array, exponents: Array, vectors: Array, N: int, rotation: float
) -> tuple[Array, Array]:
    """Matrices Z and T with A Z = Z T, for the first N exponents among which no two differ by a multiple of
    i·rotation.

    Exponents and eigenvectors are in order of preference. Multiple exponents are treated as a cluster, so
    that Z has N columns even with fewer eigenvectors. If truncation has split a multiple exponent, the number
    of columns differs from N."""
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
    """Orthonormal Z, and T, with A Z = Z T for a cluster of exponents, computed by block inverse iteration.
    Both are empty if the iteration does not converge."""
    from scipy.linalg import lu_factor, lu_solve

    centre = exponents.mean()
    # If the shift were too near to the exponents, the iteration would only return their eigenvectors.
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
