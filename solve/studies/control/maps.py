"""Periodic Riccati equations −X′ = AᵀX + XA − XGX + Q on the steps of a grid.

A step maps the state x₀ at its start and the costate λ₁ at its end, where λ = Xx, to the state x₁ at its end
and the costate λ₀ at its start: x₁ = A x₀ − G λ₁ and λ₀ = H x₀ + Aᵀ λ₁. Gauss collocation conserves this
symplectic structure. Two steps are composed without inverses of unstable maps by the structure-preserving
doubling algorithm (E. Chu, H. Fan, W. Lin, C. Wang, Int. J. Control 77 (2004) 767-788)."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from solve.arrays import EPS, Array
from solve.kernel.collocation import Samples
from solve.kernel.stages import factorised
from solve.methods.collocation import Collocation
from solve.methods.gauss import Gauss
from solve.period.grid import Grid

FROZEN_PHASES = 48
"""Number of phases at which frozen modes are computed. Chosen by judgement."""

FIRST_RTOL = 1e-8
"""Tolerance for which the phase advances per step of the first grid are stated. Phase advances are
proportional to the tolerance raised to the power 1/order, where the order is that of the method."""

_MOST_DOUBLINGS = 60
"""Maximum number of doublings of the period. If the iteration does not converge within this number, no
solution exists. With closed-loop multipliers of up to 1 − 1e-17, fewer doublings suffice."""

_CONVERGED = 16 * EPS
"""Relative change or residual of the solution that counts as round-off. Chosen by judgement."""

_CORRECTIONS = 2
"""Maximum number of Newton corrections. Chosen by judgement: the first correction reaches round-off."""

_BYTES = 2**20
"""Memory, in bytes, of the stage equations that are solved together. Chosen by judgement."""

Coefficients = Callable[[Array], tuple[Array, Array, Array]]
"""Type of functions of phases (k,) that return A (k, N, N), E (k, N, r) and Q (k, N, N), where G = sign E Eᵀ.
In the Riccati equation, derivatives are with respect to the phase."""


class Maps(NamedTuple):
    """Maps of m steps: matrices A, G and H (m, N, N). G and H are symmetric."""

    A: Array
    G: Array
    H: Array

    @property
    def halves(self) -> "tuple[Maps, Maps]":
        """Two sets of maps, in which consecutive steps are paired: those of the first step of each pair, and
        those of the second. If the number of steps is odd, the last step is paired with the identity."""
        m, N, _ = self.A.shape
        if m % 2:
            zero = np.zeros((1, N, N))
            self = Maps(*map(np.concatenate, zip(self, (zero + np.eye(N), zero, zero), strict=True)))
        return Maps(*(part[::2] for part in self)), Maps(*(part[1::2] for part in self))

    @property
    def pairs(self) -> "Maps":
        """Maps of pairs of steps."""
        first, second = self.halves
        return first.then(second)

    def then(self, next_: "Maps") -> "Maps":
        """Maps of these steps followed by the steps in `next_`."""
        N, after = self.A.shape[-1], transposed(next_.A)
        right = np.concatenate((self.A, self.G @ after), axis=-1)
        middle = np.linalg.solve(np.eye(N) + self.G @ next_.H, right) if self.G.any() else right
        forward, gramian = middle[..., :N], middle[..., N:]
        return Maps(
            next_.A @ forward,
            symmetric(next_.G + next_.A @ gramian),
            symmetric(self.H + transposed(self.A) @ next_.H @ forward),
        )

    @property
    def period(self) -> "Maps":
        """Map (1, N, N) of all steps together."""
        maps = self
        while len(maps.A) > 1:
            maps = maps.pairs
        return maps

    def closed(self, X: Array) -> Array:
        """Return the maps (m, N, N) of the states of the closed loop, from X (m, N, N) at the ends of the
        steps."""
        return np.linalg.solve(np.eye(self.A.shape[-1]) + self.G @ X, self.A) if self.G.any() else self.A

    def before(self, X: Array) -> Array:
        """Return X (m, N, N) at the starts of the steps, from X (m, N, N) at their ends."""
        return symmetric(self.H + transposed(self.A) @ X @ self.closed(X))


class Stages(NamedTuple):
    """Coefficients and states at the s stages of m steps.

    `A`, `G` and `Q` (m, s, N, N) are the coefficients, multiplied by the lengths of the steps. `states` (m,
    s, N, N + s r) maps the state at the start and the inputs at the stages to the states at the stages.
    `optimal` (m, s r, 2N) maps the state at the start and the costate at the end to the negated inputs.
    `method` contains the weights of the stages."""

    A: Array
    G: Array
    Q: Array
    states: Array
    optimal: Array
    method: Collocation

    def closed(self, X: Array, closed: Array) -> Array:
        """Return matrices (m, s, N, N) that map the state at the start of a step to the states of the closed
        loop at the stages. `X` (m, N, N) is the solution at the ends of the steps; `closed` (m, N, N) are the
        maps of the closed loop."""
        N = X.shape[-1]
        inputs = self.optimal[..., :N] + self.optimal[..., N:] @ X @ closed
        return self.states[..., :N] - self.states[..., N:] @ inputs[:, None]


def transposed(A: Array) -> Array:
    """Return the transposes of matrices (…, N, M)."""
    return np.swapaxes(A, -1, -2)


def symmetric(A: Array) -> Array:
    """Return the symmetric parts of matrices (…, N, N)."""
    return (A + transposed(A)) / 2


def step_maps(coefficients: Coefficients, grid: Grid, order: int, sign: float = 1.0) -> tuple[Maps, Stages]:
    """Return the maps and the stages of the steps by the Gauss method of the given order, for G = sign E Eᵀ.

    Gauss collocation of states and costates is equivalent to Gauss collocation of the states alone, if the
    inputs w at the stages make the sum of xᵀQx + sign wᵀw over the stages stationary (W. W. Hager, Numer.
    Math. 87 (2000) 247-282). Collocation of the states alone has half as many unknowns."""
    method = Gauss(order).stages
    s, phases = len(method.c), grid.stages(np.array(method.c))
    A, E, Q = coefficients(phases.ravel())
    N, r = E.shape[1:]
    response = _mechanical_response if _is_mechanical(A, E) else _response
    h, shape = grid.h[:, None, None, None], (grid.steps, s, N)
    A, E, Q = h * A.reshape(*shape, N), np.sqrt(h) * E.reshape(*shape, r), h * Q.reshape(*shape, N)
    size, parts = max(1, _BYTES // (8 * s * s * N * (N + r))), []
    for first in range(0, grid.steps, size):
        some = slice(first, first + size)
        states = response(A[some], E[some], method)
        parts.append((*_condensed(states, Q[some], method.b, sign), states[:, :-1]))
    *maps, optimal, states = map(np.concatenate, zip(*parts, strict=True))
    return Maps(*maps), Stages(A, sign * E @ transposed(E), Q, states, optimal, method)


def _condensed(states: Array, Q: Array, b: Array, sign: float) -> tuple[Array, Array, Array, Array]:
    """Return A, G and H of the maps of m steps, and `Stages.optimal`. If the sign is negative, the cost is
    maximised; the matrices are NaN if the maximum is not bounded.

    `states` are matrices that `_response` returns. `Q` (m, s, N, N) is multiplied by the lengths of the
    steps."""
    m, s, N, _ = Q.shape
    of_cost = (b[:, None, None] * Q) @ states[:, :-1]
    cost = transposed(states[:, :-1].reshape(m, s * N, -1)) @ of_cost.reshape(m, s * N, -1)
    inputs = range(N, cost.shape[-1])
    cost[:, inputs, inputs] += sign * np.repeat(b, len(inputs) // s)
    forward, along = states[:, -1, :, :N], states[:, -1, :, N:]
    right = np.concatenate((cost[:, N:, :N], transposed(along)), axis=-1)
    optimal = np.linalg.solve(cost[:, N:, N:], right)
    if sign < 0:
        optimal[np.linalg.eigvalsh(cost[:, N:, N:])[:, -1] >= 0] = np.nan
    return (
        forward - along @ optimal[..., :N],
        symmetric(along @ optimal[..., N:]),
        symmetric(cost[:, :N, :N] - cost[:, :N, N:] @ optimal[..., :N]),
        optimal,
    )


def _is_mechanical(A: Array, E: Array) -> bool:
    """Return whether the system is of second order: the states are positions q and velocities v, q′ = T v
    with a constant diagonal T, and the inputs enter only the equations of v′."""
    N = A.shape[-1]
    p = N // 2
    if N % 2 or A[:, :p, :p].any() or E[:, :p].any():
        return False
    rates = A[:, :p, p:]
    return bool((rates == np.diag(np.diagonal(rates[0]))).all())


def _response(A: Array, E: Array, method: Collocation) -> Array:
    """Return matrices (m, s + 1, N, N + s r). They map the state at the start of a step and the inputs at its
    s stages to the states at the s stages and at the end of the step.

    A (m, s, N, N) is multiplied by the lengths of the steps, E (m, s, N, r) by their square roots."""
    m, s, N, _ = A.shape
    implicit = A[:, :, :, None, :] * method.A[:, None, :, None]
    given = np.concatenate((A.reshape(m, s * N, N), _by_inputs(E)), axis=-1)
    rates = np.linalg.solve(np.eye(s * N) - implicit.reshape(m, s * N, s * N), given)
    return np.eye(N, rates.shape[-1]) + summed(np.vstack((method.A, method.b)), rates, N)


def _mechanical_response(A: Array, E: Array, method: Collocation) -> Array:
    """Return the result of `_response` for second-order systems, from equations for the accelerations
    alone."""
    N = A.shape[-1]
    p, weights = N // 2, method.A
    T = np.diagonal(A[:, 0, :p, p:], axis1=1, axis2=2)[:, None, :, None]
    by_q, by_v = T * A[..., p:, :p], T * A[..., p:, p:] / np.swapaxes(T, 2, 3)
    rates = _accelerations(by_q, by_v, _by_inputs(T * E[..., p:, :]), method)
    rows, identity = np.vstack((weights, method.b)), np.eye(p, rates.shape[-1], p)
    velocities = identity + summed(rows, rates, p)
    positions = identity * rows.sum(axis=1)[:, None, None] + summed(rows @ weights, rates, p)
    states = np.concatenate((positions + np.eye(p, rates.shape[-1]), velocities / T), axis=2)
    states[..., p:N] *= np.swapaxes(T, 2, 3)
    return states


def _accelerations(by_q: Array, by_v: Array, loads: Array, method: Collocation) -> Array:
    """Return the accelerations (m, s p, 2p + c) at the stages: for each unit vector q at the start, for each
    unit vector v at the start, and for each column of `loads` (m, s p, c). The equations are v′ = by_q q +
    by_v v, and the steps have length 1."""
    m, s, p, _ = by_q.shape
    every, weights = np.arange(p * p), method.A
    parts = np.ones((m * s, p)), -by_v.reshape(m * s, -1), -by_q.reshape(m * s, -1)
    table, entry = np.hstack(parts), np.concatenate((every[:: p + 1], p * p + every, 2 * p * p + every))
    samples = Samples(table, np.ones((1, len(entry))), entry)
    compiled = factorised(method.weights, np.ones(m), samples, slice(None), p)
    if compiled is not None:
        return np.concatenate((compiled.by_state, compiled.solved(loads)), axis=-1)
    implicit = by_q[:, :, :, None, :] * (weights @ weights)[:, None, :, None]
    implicit += by_v[:, :, :, None, :] * weights[:, None, :, None]
    start = np.concatenate((by_q, by_q * weights.sum(axis=1)[:, None, None] + by_v), axis=-1)
    given = np.concatenate((start.reshape(m, s * p, 2 * p), loads), axis=-1)
    return np.linalg.solve(np.eye(s * p) - implicit.reshape(m, s * p, s * p), given)


def _by_inputs(E: Array) -> Array:
    """Return the loads (m, s p, s r) at the stages due to unit inputs, from E (m, s, p, r). Each unit input
    acts at one stage only."""
    m, s, p, r = E.shape
    loads = np.zeros((m, s, p, s, r))
    loads[:, range(s), :, range(s)] = np.swapaxes(E, 0, 1)
    return loads.reshape(m, s * p, s * r)


def summed(rows: Array, rates: Array, p: int) -> Array:
    """Return sums (m, a, p, c) of `rates` (m, s p, c) over the s stages, weighted by `rows` (a, s)."""
    m = len(rates)
    return (rows @ rates.reshape(m, rows.shape[1], -1)).reshape(m, len(rows), p, -1)


def periodic_solution(maps: Maps, tolerance: float = _CONVERGED) -> Array | None:
    """Return the stabilising periodic solution X (m+1, N, N) at the nodes; None if the doubling algorithm
    does not converge.

    If the relative residual of X exceeds the tolerance, X is corrected by Newton's method, which solves a
    periodic Lyapunov equation: the Riccati equation with G = 0."""
    with np.errstate(all="ignore"):
        X = _doubled(maps)
        if X is None:
            return None
        for _ in range(_CORRECTIONS):
            left = maps.before(X[1:]) - X[:-1]
            if np.abs(left).max() <= max(tolerance, _CONVERGED) * np.abs(X).max():
                break
            closed = maps.closed(X[1:])
            correction = sums_over_steps(closed, left)
            if correction is None:
                break
            corrected = X + correction
            if not np.abs(maps.before(corrected[1:]) - corrected[:-1]).max() < np.abs(left).max():
                break
            X = corrected
    return X


def sums_over_steps(closed: Array, terms: Array) -> Array | None:
    """Return the periodic solution E (m+1, N, N) of E_k = Φ_kᵀ E_{k+1} Φ_k + terms_k, where Φ are the maps
    `closed` (m, N, N) of a stable system; None if the doubling algorithm does not converge."""
    return _doubled(Maps(closed, np.zeros_like(closed), terms))


def bounded(maps: Maps) -> bool:
    """Return whether the maximum of ∫ xᵀQx − wᵀw with respect to the inputs w is finite for any number of
    periods. `maps` are the maps of a stable system for the sign −1.

    The maximum over two successive intervals exists if two conditions hold: it exists over each interval, and
    the eigenvalues of I + G H are positive, where G belongs to the first interval and H to the second."""
    with np.errstate(all="ignore"):
        while len(maps.A) > 1:
            first, second = maps.halves
            if not _joined(first, second):
                return False
            maps = first.then(second)
        for _ in range(_MOST_DOUBLINGS):
            if not _joined(maps, maps):
                return False
            doubled = maps.then(maps)
            change = np.abs(doubled.H - maps.H).max()
            maps = doubled
            if change <= _CONVERGED * np.abs(maps.H).max() and np.abs(maps.A).max() < 1:
                return True
    return False


def _joined(first: Maps, second: Maps) -> bool:
    """Return whether the maximum over two successive intervals exists, provided that it exists over each of
    them."""
    joint = np.eye(first.A.shape[-1]) + first.G @ second.H
    return bool(np.isfinite(joint).all() and (np.linalg.eigvals(joint).real > 0).all())


def _doubled(maps: Maps) -> Array | None:
    """Return the periodic solution, as `periodic_solution` but without corrections: pairs of steps are
    composed until one map remains, whose period is then doubled repeatedly."""
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
    """Return the limit (1, N, N) of H for an increasing number of periods; None if H does not converge."""
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
