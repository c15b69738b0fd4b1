"""Systems with a unique periodic solution, made from free machines by anchoring their rigid-body modes.

Let s = l q be the amplitude of a rigid-body mode e (K e = 0) in the motion. The coordinate σ with s′ = σ′ + α
σ replaces s. Then q̃ = q - e (s - σ) satisfies M q̃″ + (C + α M e l) q̃′ + (K + α C e l) q̃ = d. The
multiplier +1 of the mode becomes exp(-α T), for any T-periodic M, C and K; all other multipliers are
unchanged. If C e = 0, the new system again has a multiplier +1 in the direction e, which the same shift with
β in place of α removes."""

from typing import TypeVar

import numpy as np

from solve.arrays import Array
from solve.period.curve import PeriodicCurve
from solve.period.points import DerivedPoints, Points, Tables, state_size
from solve.period.rigid_body import RigidBodyModes

_RATES = 1.0, 3.0
"""α T and β T. Chosen by judgement: exp(-α T) is far from 1, and both values are far below 2π, the phase
advance of the first harmonic per period."""

_STEP = 0.37
"""Increment of α T and β T from one mode to the next, so that no two exponents coincide. Chosen by
judgement."""


Kind = TypeVar("Kind", bound=PeriodicCurve)


class Anchored(DerivedPoints):
    """Points whose rigid-body modes `modes` are anchored, as described in the docstring of this module.

    drift (P, n): prescribed steady velocity w along e, as a derivative with respect to the phase. The drag C
    w is subtracted from the load. weights (P, r, n): rows l that replace `modes.measures`."""

    def __init__(
        self,
        points: Points,
        modes: RigidBodyModes,
        drift: Array | None = None,
        weights: Array | None = None,
    ):
        super().__init__(points)
        self.modes, self.drift, self.weights = modes, drift, weights

    def __getitem__(self, positions: Array) -> "Anchored":
        drift, weights = (None if each is None else each[positions] for each in (self.drift, self.weights))
        return Anchored(self.points[positions], self.modes[positions], drift, weights)

    def drifting(self, drift: Array | None) -> "Anchored":
        """Return the same points with the prescribed velocity `drift`."""
        return Anchored(self.points, self.modes, drift, self.weights)

    @property
    def measures(self) -> Array:
        """Rows l (P, r, n). The product l q is the amplitude of a mode."""
        return self.modes.measures if self.weights is None else self.weights

    def tables(self, phase: Array) -> Tables:
        """Tables of the anchored equations. Multiples of M are added to C, and multiples of C and M to K."""
        n, tables, modes = self.n, self.points.tables(phase), self.modes
        (alpha, beta), along = self._rates, modes.vectors
        twice = beta * ~modes.damped
        measures = self.measures
        by_first = np.einsum("pjr,pr,prk->pjk", along, alpha + twice, measures)
        of_damping = np.einsum("pjr,pr,prk->pjk", along, alpha * modes.damped, measures)
        by_second = np.einsum("pjr,pr,prk->pjk", along, alpha * twice, measures)
        substitutions = (0, n**2, by_first), (n**2, 2 * n**2, of_damping), (0, 2 * n**2, by_second)
        changes = [_moved(tables, first, target, factors, n) for first, target, factors in substitutions]
        if self.drift is not None:
            changes.append(_moved(tables, n**2, 3 * n**2, -self.drift[..., None], n))
        terms = np.concatenate([np.arange(len(tables.entry)), *(each[0] for each in changes)])
        entry = np.concatenate([tables.entry, *(each[1] for each in changes)])
        parts = [tables.coefficients, *(each[2] for each in changes)]
        order = np.argsort(entry, kind="stable")
        coefficients = np.concatenate(parts, axis=1)[:, order]
        return Tables(tables.table[..., terms[order]], coefficients, entry[order], n, tables.first_order)

    @property
    def _rates(self) -> tuple[Array, Array]:
        """Rates α and β (P, r); zero in columns without a mode."""
        shift = 1 + _STEP * np.arange(self.modes.references.shape[1])
        first, second = (rate * shift / self.period * self.modes.present for rate in _RATES)
        return first, second

    def quotient(self, Phi: Array) -> Array:
        """Return the monodromy matrices (P, N, N) of the motion relative to the modes.

        `Phi` (P, N, N): monodromy matrices of the anchored points. For a mode with C e ≠ 0 and without
        conserved momentum, the velocity along the mode is stored as the rate of the reference coordinate. All
        other rows and columns of reference coordinates are zero."""
        left, right = self._projection(whole=True)
        return left @ Phi @ right

    def steps(self, A: Array) -> Array:
        """Return the one-step maps (P, m, N, N) in the coordinates of `quotient`.

        `A`: one-step maps of the anchored points. Where a row and its column are zero, the diagonal entry is
        set to 1; the multipliers of rigid-body modes are then exactly 1."""
        left, right = self._projection(whole=False)
        maps = left[:, None] @ A @ right[:, None]
        ones = 1.0 - (right != 0).any(axis=-2)
        return maps + ones[:, None, :, None] * np.eye(A.shape[-1])

    def _projection(self, whole: bool) -> tuple[Array, Array]:
        """Return two matrices (P, N, N): the projection of states onto the motion relative to the modes, and
        the embedding of this motion in the states.

        whole: whether the matrices are for the map of the whole period. They then also exclude the velocity
        of a mode with conserved momentum."""
        n, modes, (alpha, _) = self.n, self.modes, self._rates
        relative, kept = modes.relative
        N, p = state_size(self), n - self.first_order
        left, right = np.zeros((2, len(self), N, N))
        left[:, :n, :n] = kept[..., None] * relative
        left[:, n:, n:] = left[:, :p, :p]
        right[:, range(n), range(n)], right[:, range(n, N), range(n, N)] = kept, kept[:, :p]
        # First-order coordinates have no rates.
        damped = modes.damped & modes.present & (modes.references < p)
        for point, mode in np.argwhere(damped).tolist():
            at = n + modes.references[point, mode]
            measure = modes.measures[point, mode]
            left[point, at, n:] = measure[:p]
            left[point, at, :n] = alpha[point, mode] * measure
            right[point, n:, at] = modes.vectors[point, :p, mode]
            if whole and modes.momentum is not None and modes.conserving[point]:
                along = modes.momentum[point, n:] @ modes.vectors[point, :, mode]
                left[point, at], right[point, n:, at] = 0.0, 0.0
                gained = modes.momentum[point] @ right[point] / along
                right[point, n:] -= np.outer(modes.vectors[point, :, mode], gained)
        return left, right

    def momentum(self) -> tuple[Array, Array]:
        """Return rows and states of the conserved momenta. Every point must have a conserved momentum.

        The rows (P, 2n) map a state of the anchored points at phase 0 to the momentum. The states (P, 2n) are
        rigid-body velocities with momentum 1."""
        n, modes, (alpha, _) = self.n, self.modes, self._rates
        assert modes.momentum is not None
        rates = modes.momentum[:, None, n:] @ modes.vectors
        rows = modes.momentum.copy()
        rows[:, :n] += np.squeeze((rates * alpha[:, None]) @ modes.measures, 1)
        units = np.zeros(rows.shape)
        units[:, n:] = modes.vectors.sum(axis=2) / rates.sum(axis=(1, 2))[:, None]
        return rows, units

    def motion(self, curve: Kind, mass: Array) -> tuple[Kind, Array]:
        """Return the motion q of the points and the secular motion (P, r) along each mode. The secular motion
        is a derivative with respect to the phase.

        `curve`: q̃ of the anchored points. The mean of q along the modes is zero in the norm of the mass
        matrix `mass` (P, n, n). If C e ≠ 0, the secular motion is a steady velocity, which the returned curve
        contains as `drift`. Otherwise it is an acceleration, which the curve does not contain."""
        modes, (alpha, beta) = self.modes, self._rates
        amplitudes = curve.combined(self.measures)
        first = amplitudes.antiderivative()
        second = first.antiderivative()
        undamped = ~modes.damped & modes.present
        secular = np.where(undamped, alpha * beta, alpha) * amplitudes.mean
        for integral, factors in ((first, alpha + beta * undamped), (second, alpha * beta * undamped)):
            curve = curve.plus(integral.combined(modes.vectors * factors[:, None]))
        drift = np.einsum("pjr,pr->pj", modes.vectors, np.where(undamped, 0.0, secular))
        if self.drift is not None:
            drift = drift + self.drift
            secular = secular + np.where(undamped, 0.0, np.squeeze(self.measures @ self.drift[..., None], -1))
        mean = curve.combined(modes.weighted(mass)).mean
        level = np.einsum("pjr,pr->pj", modes.vectors, mean)
        return curve.shifted(-level, drift if drift.any() else None), secular


def _moved(tables: Tables, source: int, target: int, factors: Array, n: int) -> tuple[Array, Array, Array]:
    """Return terms (t,), entries (t,) and coefficients (P, t) for a product of a matrix and factors.

    The matrix with entries from index `source` is multiplied by `factors` (P, n, c). The product is to be
    added to the matrix with entries from index `target`."""
    of_matrix = np.flatnonzero((tables.entry >= source) & (tables.entry < source + n**2))
    row, column = np.divmod(tables.entry[of_matrix] - source, n)
    terms, entry, coefficients = [], [], []
    for other in np.flatnonzero(factors.any(axis=(0, 1))).tolist():
        used = np.asarray(factors[:, :, other].any(axis=0))[column]
        terms.append(of_matrix[used])
        entry.append(target + factors.shape[-1] * row[used] + other)
        coefficients.append(tables.coefficients[:, of_matrix[used]] * factors[:, column[used], other])
    if not terms:
        return of_matrix[:0], of_matrix[:0], tables.coefficients[:, :0]
    return np.concatenate(terms), np.concatenate(entry), np.concatenate(coefficients, axis=1)
