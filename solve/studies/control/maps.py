"""Periodic Riccati equations −X′ = AᵀX + XA − XGX + Q on the steps of a grid.

A step relates the state x at its start and the costate λ = Xx at its end to those at the other ends:
x₁ = A x₀ − G λ₁ and λ₀ = H x₀ + Aᵀ λ₁. Gauss collocation conserves this symplectic structure. Two steps
are composed without inverses of unstable maps, which is the structure-preserving doubling algorithm
(E. Chu, H. Fan, W. Lin, C. Wang, Int. J. Control 77 (2004) 767-788)."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from solve.arrays import EPS, Array
from solve.methods.gauss import Gauss
from solve.period.grid import Grid

_MOST_DOUBLINGS = 60
"""Doublings of the period after which the solution counts as nonexistent: closed-loop multipliers up to
1 − 1e-17 converge before."""

_CONVERGED = 16 * EPS
"""Relative change or residual of the solution that counts as round-off. A choice."""

_CORRECTIONS = 2
"""Largest number of Newton corrections. The first one reaches round-off; a choice."""

_BYTES = 2**20
"""Bytes of the stage systems that are solved at a time. A choice."""

Coefficients = Callable[[Array], tuple[Array, Array, Array]]
"""Function of phases (k,) that returns A, G and Q (k, N, N); derivatives are by the phase."""


class Maps(NamedTuple):
    """Steps as matrices A, G and H (m, N, N); G and H are symmetric."""

    A: Array
    G: Array
    H: Array

    @property
    def pairs(self) -> "Maps":
        """Maps of two steps each; an odd last step is followed by an empty one."""
        m, N, _ = self.A.shape
        if m % 2:
            zero = np.zeros((1, N, N))
            self = Maps(*map(np.concatenate, zip(self, (zero + np.eye(N), zero, zero), strict=True)))
        return Maps(*(part[::2] for part in self)).then(Maps(*(part[1::2] for part in self)))

    def then(self, next_: "Maps") -> "Maps":
        """Maps of these steps followed by others."""
        N, after = self.A.shape[-1], transposed(next_.A)
        right = np.concatenate((self.A, self.G @ after), axis=-1)
        middle = np.linalg.solve(np.eye(N) + self.G @ next_.H, right)
        forward, gramian = middle[..., :N], middle[..., N:]
        return Maps(
            next_.A @ forward,
            symmetric(next_.G + next_.A @ gramian),
            symmetric(self.H + transposed(self.A) @ next_.H @ forward),
        )

    @property
    def dual(self) -> "Maps":
        """Maps of the filter, whose solution at the starts, in reverse order, is that at the nodes."""
        return Maps(transposed(self.A)[::-1], self.H[::-1], self.G[::-1])

    def closed(self, X: Array) -> Array:
        """Maps (m, N, N) of the closed loop, for X (m, N, N) at the ends of the steps."""
        return np.linalg.solve(np.eye(self.A.shape[-1]) + self.G @ X, self.A)

    def before(self, X: Array) -> Array:
        """X at the starts of the steps, for X (m, N, N) at their ends."""
        return symmetric(self.H + transposed(self.A) @ X @ self.closed(X))


def transposed(A: Array) -> Array:
    """Transposes of matrices (…, N, M)."""
    return np.swapaxes(A, -1, -2)


def symmetric(A: Array) -> Array:
    """Symmetric parts of matrices (…, N, N)."""
    return (A + transposed(A)) / 2


def step_maps(coefficients: Coefficients, grid: Grid, order: int) -> Maps:
    """Maps of the steps by the Gauss method of an order, from collocation with x₀ and λ₁ given."""
    method = Gauss(order).collocation
    s, phases = len(method.c), grid.stages(np.array(method.c))
    sampled = coefficients(phases.ravel())
    N = sampled[0].shape[-1]
    size = max(1, _BYTES // (8 * (2 * N * s) ** 2))
    parts = []
    for first in range(0, grid.steps, size):
        A, G, Q = (each[s * first : s * (first + size)] for each in sampled)
        parts.append(_maps_of((A, G, Q), grid.h[first : first + size], method.A, method.b))
    return Maps(*map(np.concatenate, zip(*parts, strict=True)))


def _maps_of(sampled: tuple[Array, Array, Array], h: Array, weights: Array, b: Array) -> Maps:
    """Maps of steps h (m,) from A, G and Q (m s, N, N) at their stages."""
    m, s = len(h), len(b)
    A, G, Q = (h[:, None, None, None] * part.reshape(m, s, *part.shape[1:]) for part in sampled)
    N = A.shape[-1]
    rates = np.concatenate(
        (np.concatenate((A, -G), axis=-1), np.concatenate((Q, transposed(A)), axis=-1)), axis=-2
    )
    # States are integrated from the start, costates from the end.
    fractions = np.repeat(np.stack((weights, b - weights), axis=-1), N, axis=-1)
    system = -rates[:, :, :, None, :] * fractions[:, None]
    system[:, range(s), :, range(s)] += np.eye(2 * N)
    stages = np.linalg.solve(
        system.reshape(m, 2 * N * s, 2 * N * s), rates.reshape(m, 2 * N * s, 2 * N)
    ).reshape(m, s, 2 * N, 2 * N)
    ends = np.eye(2 * N) + np.einsum("s,msij->mij", b, stages)
    along = (ends[:, :N, :N] + transposed(ends[:, N:, N:])) / 2
    return Maps(along, symmetric(-ends[:, :N, N:]), symmetric(ends[:, N:, :N]))


def periodic_solution(maps: Maps) -> Array | None:
    """Stabilising periodic solution X (m+1, N, N) at the nodes; None if the doubling does not converge.

    The solution is corrected by Newton's method, whose periodic Lyapunov equation is the case G = 0."""
    with np.errstate(all="ignore"):
        X = _doubled(maps)
        if X is None:
            return None
        for _ in range(_CORRECTIONS):
            left = maps.before(X[1:]) - X[:-1]
            if np.abs(left).max() <= _CONVERGED * np.abs(X).max():
                break
            closed = maps.closed(X[1:])
            correction = _doubled(Maps(closed, np.zeros_like(closed), left))
            if correction is None:
                break
            corrected = X + correction
            if not np.abs(maps.before(corrected[1:]) - corrected[:-1]).max() < np.abs(left).max():
                break
            X = corrected
    return X


def _doubled(maps: Maps) -> Array | None:
    """`periodic_solution` without corrections: products of steps in pairs, then doubling of the period."""
    levels = [maps]
    while len(levels[-1].A) > 1:
        levels.append(levels[-1].pairs)
    X = _after_many_periods(levels[-1])
    if X is None:
        return None
    X = np.concatenate((X, X))
    for level in reversed(levels[:-1]):
        m, finer = len(level.A), np.empty((len(level.A) + 1, *X.shape[1:]))
        finer[::2] = X[: m // 2 + 1]
        finer[1:m:2] = Maps(*(part[1::2] for part in level)).before(X[1 : m // 2 + 1])
        finer[m] = X[-1]
        X = finer
    return X


def _after_many_periods(period: Maps) -> Array | None:
    """Limit (1, N, N) of H for a growing number of periods; None without convergence."""
    for _ in range(_MOST_DOUBLINGS):
        try:
            doubled = period.then(period)
        except np.linalg.LinAlgError:
            return None
        if not all(np.isfinite(part).all() for part in doubled):
            return None
        change = np.abs(doubled.H - period.H).max()
        period = doubled
        if change <= _CONVERGED * np.abs(period.H).max() and np.abs(period.A).max() < 1:
            return period.H
    return None
