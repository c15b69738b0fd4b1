"""Periodic Riccati equations −X′ = AᵀX + XA − XGX + Q on the steps of a grid.

A step relates the state x at its start and the costate λ = Xx at its end to the state at its end and the
costate at its start: x₁ = A x₀ − G λ₁ and λ₀ = H x₀ + Aᵀ λ₁. Gauss collocation conserves this symplectic
structure. Two steps are composed without inverses of unstable maps, which is the structure-preserving
doubling algorithm (E. Chu, H. Fan, W. Lin, C. Wang, Int. J. Control 77 (2004) 767-788)."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from solve.arrays import EPS, Array
from solve.methods.gauss import Gauss
from solve.period.grid import Grid

_MOST_DOUBLINGS = 60
"""Number of doublings of the period after which no solution exists: with closed-loop multipliers of up to 1 −
1e-17, the iteration converges earlier."""

_CONVERGED = 16 * EPS
"""Relative change or residual of the solution that counts as round-off. A choice."""

_CORRECTIONS = 2
"""Largest number of Newton corrections. The first one reaches round-off; a choice."""

_BYTES = 2**20
"""Memory, in bytes, of the stage systems that are solved at a time. A choice."""

Coefficients = Callable[[Array], tuple[Array, Array, Array]]
"""Function of phases (k,) that returns A, G and Q (k, N, N); derivatives are with respect to the phase."""


class Maps(NamedTuple):
    """Maps of steps: matrices A, G and H (m, N, N); G and H are symmetric."""

    A: Array
    G: Array
    H: Array

    @property
    def pairs(self) -> "Maps":
        """Maps of pairs of steps; the last step of an odd number is paired with the identity."""
        m, N, _ = self.A.shape
        if m % 2:
            zero = np.zeros((1, N, N))
            self = Maps(*map(np.concatenate, zip(self, (zero + np.eye(N), zero, zero), strict=True)))
        return Maps(*(part[::2] for part in self)).then(Maps(*(part[1::2] for part in self)))

    def then(self, next_: "Maps") -> "Maps":
        """Maps of these steps followed by the steps in `next_`."""
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
    def period(self) -> "Maps":
        """The map (1, N, N) of all steps."""
        maps = self
        while len(maps.A) > 1:
            maps = maps.pairs
        return maps

    @property
    def dual(self) -> "Maps":
        """Maps of the filter equation, which is a regulator equation in reversed time. Its solution at the
        starts of these steps, in reverse order, is the solution of the filter at the nodes."""
        return Maps(transposed(self.A)[::-1], self.H[::-1], self.G[::-1])

    def closed(self, X: Array) -> Array:
        """Maps (m, N, N) of the closed loop, from X (m, N, N) at the ends of the steps."""
        return np.linalg.solve(np.eye(self.A.shape[-1]) + self.G @ X, self.A)

    def before(self, X: Array) -> Array:
        """Solution X at the starts of the steps, from X (m, N, N) at their ends."""
        return symmetric(self.H + transposed(self.A) @ X @ self.closed(X))


def transposed(A: Array) -> Array:
    """Transposes of matrices (…, N, M)."""
    return np.swapaxes(A, -1, -2)


def symmetric(A: Array) -> Array:
    """Symmetric parts of matrices (…, N, N)."""
    return (A + transposed(A)) / 2


def step_maps(coefficients: Coefficients, grid: Grid, order: int) -> Maps:
    """Maps of the steps by the Gauss method of the given order: collocation with x₀ and λ₁ as given
    values."""
    method = Gauss(order).collocation
    s, phases = len(method.c), grid.stages(np.array(method.c))
    sampled = coefficients(phases.ravel())
    mechanical, N = _is_mechanical(*sampled[:2]), sampled[0].shape[-1]
    size = max(1, _BYTES // (8 * ((1 if mechanical else 2) * N * s) ** 2))
    ends_of, parts = _mechanical_ends if mechanical else _ends, []
    for first in range(0, grid.steps, size):
        h = grid.h[first : first + size, None, None, None]
        some = slice(s * first, s * (first + len(h)))
        A, G, Q = (h * each[some].reshape(len(h), s, N, N) for each in sampled)
        parts.append(ends_of(A, G, Q, method.A, method.b))
    ends = np.concatenate(parts)
    along = (ends[:, :N, :N] + transposed(ends[:, N:, N:])) / 2
    return Maps(along, symmetric(-ends[:, :N, N:]), symmetric(ends[:, N:, :N]))


def _is_mechanical(A: Array, G: Array) -> bool:
    """Whether the states are positions q and velocities v with q′ = T v and a constant diagonal T, and inputs
    enter the equations of v′ only."""
    N = A.shape[-1]
    p = N // 2
    if N % 2 or A[:, :p, :p].any() or G[:, :p].any():
        return False
    rates = A[:, :p, p:]
    return bool((rates == np.diag(np.diagonal(rates[0]))).all())


def _ends(A: Array, G: Array, Q: Array, weights: Array, b: Array) -> Array:
    """Matrices (m, 2N, 2N) that give the state at the end and the costate at the start of m steps, from the
    state at the start and the costate at the end.

    A, G and Q (m, s, N, N) at the stages are multiplied by the lengths of the steps."""
    m, s, N, _ = A.shape
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
    return np.eye(2 * N) + np.einsum("s,msij->mij", b, stages)


def _mechanical_ends(A: Array, G: Array, Q: Array, weights: Array, b: Array) -> Array:
    """Matrices as from `_ends`, for second-order systems, from equations of half the size. The rates of the
    positions follow from the velocities, and the rates of the positions' costates from the other costates.
    Unknowns are the rates w of v, and those μ of its costate backwards, at the stages. Given are the state at
    the start and the costate at the end."""
    m, s, N, _ = A.shape
    p, back, T = N // 2, b - weights, np.diagonal(A[:, 0, : N // 2, N // 2 :], axis1=1, axis2=2)
    square, sums = (weights @ weights)[:, None, :, None], weights.sum(axis=1)[:, None, None]

    def combined(by_q: Array, by_v: Array, by_costate: Array) -> tuple[Array, Array]:
        """Linear combination of q, v and the costate of v at each stage, in terms of the unknowns and the
        given values."""
        moved, each = by_q * T[:, None, None, :], np.s_[:, :, :, None, :]
        unknown = np.empty((m, s, p, s, 2, p))
        unknown[..., 0, :] = moved[each] * square + by_v[each] * weights[:, None, :, None]
        unknown[..., 1, :] = by_costate[each] * back[:, None, :, None]
        given = np.stack((by_q, moved * sums + by_v, np.zeros_like(by_q), by_costate), axis=3)
        return unknown.reshape(m, s, p, 2 * s * p), given.reshape(m, s, p, 4 * p)

    low, high = np.s_[..., p:, :p], np.s_[..., p:, p:]
    w = combined(A[low], A[high], -G[high])
    k = combined(Q[..., :p, :p], Q[..., :p, p:], transposed(A[low]))
    mu = combined(Q[low], Q[high], transposed(A[high]))
    for part, inner in zip(mu, k, strict=True):
        part += T[:, None, :, None] * (back @ inner.reshape(m, s, -1)).reshape(part.shape)
    mu[1][..., range(p), range(2 * p, 3 * p)] += T[:, None]
    system, right = (np.stack(pair, axis=2).reshape(m, 2 * s * p, -1) for pair in zip(w, mu, strict=True))
    rates = np.linalg.solve(np.eye(2 * s * p) - system, right)
    k_rates = (k[0].reshape(m, s * p, -1) @ rates + k[1].reshape(m, s * p, -1)).reshape(m, s, p, 4 * p)
    rates = rates.reshape(m, s, 2, p, 4 * p)
    ends = np.broadcast_to(np.eye(2 * N), (m, 2 * N, 2 * N)).copy()
    ends[:, range(p), range(p, N)] += T
    ends[:, :p] += T[:, :, None] * np.einsum("s,msij->mij", b @ weights, rates[:, :, 0])
    for rows, of in (
        (np.s_[p:N], rates[:, :, 0]),
        (np.s_[N : N + p], k_rates),
        (np.s_[N + p :], rates[:, :, 1]),
    ):
        ends[:, rows] += np.einsum("s,msij->mij", b, of)
    return ends


def periodic_solution(maps: Maps) -> Array | None:
    """Stabilising periodic solution X (m+1, N, N) at the nodes; None if the doubling algorithm does not
    converge.

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
    """Periodic solution as from `periodic_solution`, without corrections: products of pairs of steps, then
    doubling of the period."""
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
    """Limit (1, N, N) of H for an increasing number of periods; None if it does not converge."""
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
