"""Conversion of free machines, whose rigid-body modes are anchored, to systems with a unique periodic
solution.

Let s = l q be the amplitude of a rigid-body mode e (K e = 0) in the motion. The coordinate σ with s′ = σ′ + α
σ replaces s, and q̃ = q - e (s - σ) satisfies M q̃″ + (C + α M e l) q̃′ + (K + α C e l) q̃ = d. The
multiplier +1 of the mode becomes exp(-α T), for any T-periodic M, C and K, and all others are unchanged. If C
e = 0, the new system again has a multiplier +1 in the direction e; the same shift with β in place of α
removes it too."""

from dataclasses import dataclass

import numpy as np

from solve.arrays import Array
from solve.period.curve import Curve, FourierCurve, PeriodicCurve
from solve.period.points import Points, Tables, state_size
from solve.period.rigid_body import RigidBodyModes

_RATES = 1.0, 3.0
"""α T and β T. Chosen by judgement: exp(-α T) is far from 1, and the rates are far below 2π, the rate of the
first harmonic."""

_STEP = 0.37
"""Increment of α T and β T from one mode to the next, so that no two exponents coincide. Chosen by
judgement."""


@dataclass(frozen=True)
class Anchored:
    """Points with anchored rigid-body modes `modes`, as described in the docstring of this module.

    drift (P, n): given steady velocity w along e, with respect to the phase; its drag C w is subtracted from
    the load. weights (P, r, n): rows l that replace those of the reference coordinates."""

    points: Points
    modes: RigidBodyModes
    drift: Array | None = None
    weights: Array | None = None

    @property
    def n(self) -> int:
        return self.points.n

    @property
    def first_order(self) -> int:
        return self.points.first_order

    @property
    def period(self) -> float:
        return self.points.period

    @property
    def breaks(self) -> tuple[float, ...]:
        return self.points.breaks

    @property
    def bytes_a_phase(self) -> int:
        return self.points.bytes_a_phase

    @property
    def alone(self) -> bool:
        return self.points.alone

    def __len__(self) -> int:
        return len(self.points)

    def __getitem__(self, positions: Array) -> "Anchored":
        drift, weights = (None if each is None else each[positions] for each in (self.drift, self.weights))
        return Anchored(self.points[positions], self.modes[positions], drift, weights)

    @property
    def measures(self) -> Array:
        """Rows l (P, r, n) that measure the amplitudes of the modes."""
        return self.modes.measures if self.weights is None else self.weights

    def tables(self, phase: Array) -> Tables:
        """Tables of the anchored equations. C has additional terms with M, and K has additional terms with C
        and M."""
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
        """Monodromy matrices (P, N, N) of the motion relative to the modes, from the monodromy matrices of
        the anchored points. For modes with C e ≠ 0, the velocity along the mode is stored in the rate of the
        reference coordinate; all other entries of reference coordinates are zero."""
        left, right = self._projection(whole=True)
        return left @ Phi @ right

    def steps(self, A: Array) -> Array:
        """One-step maps (P, m, N, N) in the coordinates of `quotient`, with 1 on the diagonal where
        `quotient` has zeros. The multipliers of rigid-body modes are then exactly 1."""
        left, right = self._projection(whole=False)
        maps = left[:, None] @ A @ right[:, None]
        ones = 1.0 - (right != 0).any(axis=-2)
        return maps + ones[:, None, :, None] * np.eye(A.shape[-1])

    def _projection(self, whole: bool) -> tuple[Array, Array]:
        """Projection of states (P, N, N) onto the motion relative to the modes, and the embedding back.
        whole: whether the velocity of a mode with conserved momentum is also excluded, as for the map of the
        period."""
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
        """Conserved momenta, for points that have one: rows (P, 2n) that map states of the anchored points at
        phase 0 to the momentum, and the states (P, 2n) of rigid-body velocities with momentum 1."""
        n, modes, (alpha, _) = self.n, self.modes, self._rates
        assert modes.momentum is not None
        rates = modes.momentum[:, None, n:] @ modes.vectors
        rows = modes.momentum.copy()
        rows[:, :n] += np.squeeze((rates * alpha[:, None]) @ modes.measures, 1)
        units = np.zeros(rows.shape)
        units[:, n:] = modes.vectors.sum(axis=2) / rates.sum(axis=(1, 2))[:, None]
        return rows, units

    def motion(self, curve: PeriodicCurve, mass: Array) -> tuple[PeriodicCurve, Array]:
        """Motion q of the points from curves q̃ of the anchored points, and the secular motion (P, r) of each
        mode with respect to the phase.

        The mean along the modes is zero in the norm of a mass matrix (P, n, n). The secular motion is a
        steady velocity, included in the `drift` of the curve, if C e ≠ 0. Otherwise it is an acceleration,
        which the curve excludes."""
        modes, (alpha, beta) = self.modes, self._rates
        shares = _Shares.from_curve(curve, self.measures)
        first = shares.integrated()
        second = first.integrated()
        undamped = ~modes.damped & modes.present
        secular = np.where(undamped, alpha * beta, alpha) * shares.means
        by_first, by_second = alpha + beta * undamped, alpha * beta * undamped
        raised = shares.sum(curve, modes.vectors, (first, by_first), (second, by_second))
        drift = np.einsum("pjr,pr->pj", modes.vectors, np.where(undamped, 0.0, secular))
        if self.drift is not None:
            drift = drift + self.drift
            secular = secular + np.where(undamped, 0.0, np.squeeze(self.measures @ self.drift[..., None], -1))
        level = np.einsum("pjr,pr->pj", modes.vectors, _Shares.from_curve(raised, modes.weighted(mass)).means)
        return _lowered(raised, level, drift), secular


def _moved(tables: Tables, source: int, target: int, factors: Array, n: int) -> tuple[Array, Array, Array]:
    """Terms (t,), entries (t,) and coefficients (P, t) that multiply the entries of one matrix (from index
    `source`) by factors (P, n, c) and add them to another (from index `target`)."""
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


@dataclass(frozen=True)
class _Shares:
    """Amplitudes along the modes (P, r) as functions of the phase, represented as a curve, and their means
    (P, r)."""

    nodes: Array
    coefficients: Array

    @classmethod
    def from_curve(cls, curve: PeriodicCurve, rows: Array) -> "_Shares":
        """Amplitudes from rows (P, r, n) applied to curves (P, n, …)."""
        assert isinstance(curve, Curve | FourierCurve)
        parts = curve.coefficients
        amplitudes = rows @ parts.reshape(*parts.shape[:2], -1)
        shares = amplitudes.reshape(*amplitudes.shape[:2], *parts.shape[2:])
        return (_Pieces if isinstance(curve, Curve) else _Series)(curve.nodes, shares)

    @property
    def means(self) -> Array:
        raise NotImplementedError

    def integrated(self) -> "_Shares":
        """Integral, with zero mean, of the functions after subtraction of their means."""
        raise NotImplementedError

    def sum(self, curve: PeriodicCurve, vectors: Array, *parts: "tuple[_Shares, Array]") -> PeriodicCurve:
        """Curve plus vectors (P, n, r) multiplied by these functions and by factors (P, r)."""
        assert isinstance(curve, Curve | FourierCurve)
        degrees = max(curve.coefficients.shape[-1], *(each.coefficients.shape[-1] for each, _ in parts))
        total = np.zeros((*curve.coefficients.shape[:-1], degrees), dtype=curve.coefficients.dtype)
        total[..., : curve.coefficients.shape[-1]] = curve.coefficients
        for each, factors in parts:
            added = np.einsum("pjr,pr,pr...->pj...", vectors, factors, each.coefficients)
            total[..., : added.shape[-1]] += added
        return type(curve)(curve.nodes, total)


class _Pieces(_Shares):
    """Piecewise polynomials on the steps (P, r, m, D)."""

    @property
    def means(self) -> Array:
        return np.asarray(self._of_steps.sum(axis=-1) / self.nodes[-1])

    @property
    def _of_steps(self) -> Array:
        """Integrals over the steps (P, r, m)."""
        count = self.coefficients.shape[-1]
        return (self.coefficients @ (1 / np.arange(1, count + 1))) * np.diff(self.nodes)

    def integrated(self) -> "_Shares":
        h, count = np.diff(self.nodes), self.coefficients.shape[-1]
        left = self.coefficients.copy()
        left[..., 0] -= self.means[..., None]
        coefficients = np.zeros((*left.shape[:-1], count + 1))
        coefficients[..., 1:] = left * h[:, None] / np.arange(1, count + 1)
        gained = coefficients.sum(axis=-1)
        coefficients[..., 0] = np.cumsum(gained, axis=-1) - gained
        found = _Pieces(self.nodes, coefficients)
        coefficients[..., 0] -= found.means[..., None]
        return found


class _Series(_Shares):
    """Fourier series (P, r, N+1)."""

    @property
    def means(self) -> Array:
        return np.real(self.coefficients[..., 0])

    def integrated(self) -> "_Shares":
        rates = 2j * np.pi / self.nodes[-1] * np.arange(self.coefficients.shape[-1])
        rates[0] = np.inf
        return _Series(self.nodes, self.coefficients / rates)


def _lowered(curve: PeriodicCurve, level: Array, drift: Array) -> PeriodicCurve:
    """Curves minus constants (P, n), with a drift (P, n) unless it is zero."""
    assert isinstance(curve, Curve | FourierCurve)
    coefficients = curve.coefficients
    if isinstance(curve, Curve):
        coefficients[..., 0] -= level[..., None]
    else:
        coefficients[..., 0] -= level
    return type(curve)(curve.nodes, coefficients, drift=drift if drift.any() else None)
