"""The scaled first-order form of a periodic system, with enclosures of its coefficients.

The equations of motion Ω²M q″ + ΩC q′ + K q = d, with derivatives with respect to the phase, are scaled by
modes T and frequencies W of constant matrices. With y = (T⁻¹q, W⁻¹T⁻¹q′) and a load of size one as a further
component,

    y₁′ = W y₂,    m y₂′ + r (y₁, y₂, 1) = 0,    m = P M T W,    r = P [K T/Ω², C T W/Ω, −d/(Ω² λ)].

T, W, λ and P may contain any exact numbers; W must be diagonal, and P regular. They do not change the
multipliers, and change the orbit only by known factors."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import matrix_balance

from solve.arrays import Array
from solve.proof.balls import (
    Ball,
    Matrix,
    acb,
    acb_mat,
    arb,
    arb_mat,
    arb_series,
    coefficient,
    interval,
    largest,
    norm,
)
from solve.proof.instructions import ANY, Entries, Instructions, Outcomes, UndecidedError
from solve.proof.motion import TrigonometricMotion

_CONDITION = 1e6
"""Condition number of the matrix of modes above which modal coordinates are not used."""

_TINY = 1e-290
"""Modulus above which a number keeps all digits when it is multiplied by scales near 1, because the product
is not subnormal."""

_HALVINGS = 30
"""Largest number of halvings of a step in the search for decided outcomes. After 30 halvings, a part is
shorter than a window at a jump. The radius of a ball is rounded up by a factor of up to 1 + 2^-30."""


@dataclass(frozen=True)
class Equation:
    """Periodic system with n coordinates at a speed, in scaled first-order form.

    Parameters
    ----------
    instructions : Instructions
        M, C, K and d as functions of phase, speed and parameters.
    n : int
        Number of coordinates.
    speed : ball
        Speed in rad/s.
    parameters : tuple of balls
        Values of the parameters.
    modes : (n, n) array
        T, exact.
    frequencies : (n,) array
        Diagonal of W, exact, in multiples of the speed.
    load : float
        λ, exact.
    about : TrigonometricMotion, optional
        Motion about which the equations are linearised. Its q, q̇ and q̈ are inputs of the instructions.
    """

    instructions: Instructions
    n: int
    speed: Ball
    parameters: tuple[Ball, ...]
    modes: Array
    frequencies: Array
    load: float
    about: TrigonometricMotion | None = None

    @classmethod
    def scaled(
        cls,
        instructions: Instructions,
        speed: Ball,
        parameters: Sequence[Ball],
        samples: tuple[Array, Array, Array, Array],
        about: TrigonometricMotion | None = None,
    ) -> "Equation":
        """Equation in scales that balance the mean moduli of its coefficients.

        samples: M, C, K (m, n, n) and d (m, n) at m phases, for derivatives with respect to the phase."""
        M, C, K, d = samples
        n = d.shape[1]
        modes = np.linalg.eig(np.linalg.solve(M.mean(axis=0), K.mean(axis=0)))[1]
        if np.iscomplexobj(modes) or np.linalg.cond(modes) > _CONDITION:
            modes = np.eye(n)
        rates = np.zeros((2 * n, 2 * n))
        rates[:n, n:] = np.eye(n)
        for columns, part in ((slice(0, n), K), (slice(n, 2 * n), C)):
            rates[n:, columns] = np.abs(np.linalg.solve(M @ modes, part @ modes)).mean(axis=0)
        with np.errstate(invalid="ignore"):
            # SciPy also converts the scales to indices of permutations. These are not used.
            scales = matrix_balance(rates, permute=False, separate=True)[1][0]
        modes, frequencies = modes * scales[:n], scales[n:] / scales[:n]
        if not _exact(modes, modes * frequencies):
            modes, frequencies = np.eye(n), np.ones(n)
        moved = np.abs(np.linalg.solve(M @ (modes * frequencies), d[..., None])).max()
        return cls(instructions, n, speed, tuple(parameters), modes, frequencies, float(moved or 1.0), about)

    def vanishes(self, period: Ball) -> tuple[bool, bool]:
        """Return whether C is exactly zero at all phases, and whether d is exactly zero at all phases. If C =
        0, det Φ = 1 (Liouville's formula)."""
        entries = self._entries(interval(arb(0), period), None)
        rates, loads = (all(value.is_zero() for *_, value in entries[k][0]) for k in (1, 3))
        return rates, loads

    def outcomes(self, start: Ball, end: Ball, halvings: int = _HALVINGS) -> Outcomes:
        """Branches taken by the piecewise operations between two phases. An interval that is too wide for a
        decision is halved. Raises UndecidedError if a branch changes between the phases."""
        try:
            return self.instructions(self.inputs(interval(start, end)))[1]
        except UndecidedError:
            if not halvings:
                raise
        middle = ((start + end) / 2).mid()
        first, second = self.outcomes(start, middle, halvings - 1), self.outcomes(middle, end, halvings - 1)
        if first != second:
            raise UndecidedError
        return first

    def largest_rate(self, phase: Ball) -> Ball:
        """Upper bound on ‖[0 W 0; −m⁻¹r]‖ over an interval of phases, for all branches of piecewise
        operations."""
        m, r = self.at(phase, None)
        return largest((norm(m.inv() * r), arb(float(self.frequencies.max()))))

    def growth(self, phase: Ball, outcomes: Outcomes) -> tuple[Ball, Ball]:
        """Upper bounds over an interval of phases on the logarithmic norm μ₂(A) and on Re tr A, with A = [0
        W; −m⁻¹r_y].

        μ₂ is the largest eigenvalue of (A + A*)/2, which is bounded by Gershgorin's discs."""
        n = self.n
        P = self.at(phase.mid(), outcomes)[0].mid().inv().mid()
        m, r = self.at(phase, outcomes, P)
        by_state = -1 * (m.inv() * r)
        A = acb_mat(2 * n, 2 * n)
        for i in range(n):
            A[i, n + i] = acb(float(self.frequencies[i]))
            for j in range(2 * n):
                A[n + i, j] = by_state[i, j]
        rows = [
            A[i, i].real
            + sum((abs(A[i, j] + A[j, i].conjugate()) / 2 for j in range(2 * n) if j != i), arb(0))
            for i in range(2 * n)
        ]
        bounds = [row.upper() for row in rows]
        if not all(bound.is_finite() for bound in bounds):
            # max() may ignore NaN among its arguments.
            return arb.pos_inf(), arb.pos_inf()
        return max(bounds), A.trace().real.upper()

    def at(self, phase: Ball, outcomes: Outcomes | None, P: Matrix | None = None) -> tuple[Matrix, Matrix]:
        """Coefficients m (n, n) and r (n, 2n+1) at real or complex phases.

        outcomes: branches of the piecewise operations, or None for all possible branches. P: matrix by which
        r is multiplied, if given."""
        matrix, zero = (acb_mat, acb(0)) if isinstance(phase, acb) else (arb_mat, arb(0))
        found = self._entries(phase, outcomes)
        M, C, K, d = (self._filled(matrix, zero, entries, columns) for entries, columns in found)
        return self._scaled(matrix, M, C, K, d, P)

    def series(
        self, phase: Ball, outcomes: Outcomes, P: Matrix, terms: int
    ) -> tuple[list[Matrix], list[Matrix]]:
        """Taylor coefficients of m and of r at a phase."""
        found = self._entries(arb_series([phase, arb(1)]), outcomes)
        coefficients = []
        for term in range(terms):
            M, C, K, d = (
                self._filled(arb_mat, arb(0), [(i, j, coefficient(x, term)) for i, j, x in entries], columns)
                for entries, columns in found
            )
            coefficients.append(self._scaled(arb_mat, M, C, K, d, P))
        return [m for m, _ in coefficients], [r for _, r in coefficients]

    def inputs(self, phase: Ball) -> list[Sequence[Ball]]:
        """Inputs of the instructions for real or complex phases, or for power series in the phase."""
        if self.about is None:
            return [[phase], [self.speed], self.parameters]
        states = self.about.states(phase)
        rates = [[x * self.speed**order for x in row] for order, row in enumerate(states)]
        return [[phase], [self.speed], *rates, self.parameters]

    def _entries(self, phase: Ball, outcomes: Outcomes | None) -> list[tuple[Entries, int]]:
        values, _ = self.instructions(self.inputs(phase), ANY if outcomes is None else outcomes)
        return list(zip(values, (self.n, self.n, self.n, 1), strict=True))

    def _filled(self, matrix: type, zero: Ball, entries: Entries, columns: int) -> Matrix:
        values = [zero] * (self.n * columns)
        for i, j, value in entries:
            values[i * columns + j] = value
        return matrix(self.n, columns, values)

    def _scaled(
        self, matrix: type, M: Matrix, C: Matrix, K: Matrix, d: Matrix, P: Matrix | None
    ) -> tuple[Matrix, Matrix]:
        n, T, TW = self.n, self._modes, self._modes_by_frequencies
        m, by_rate, by_position = M * TW, C * TW / self.speed, K * T / self.speed**2
        load = d / (-self.load * self.speed**2)
        rows = [
            [*(by_position[i, j] for j in range(n)), *(by_rate[i, j] for j in range(n)), load[i, 0]]
            for i in range(n)
        ]
        r = matrix(n, 2 * n + 1, [entry for row in rows for entry in row])
        return (m, r) if P is None else (P * m, P * r)

    @cached_property
    def _modes(self) -> Matrix:
        return arb_mat(self.modes.tolist())

    @cached_property
    def _modes_by_frequencies(self) -> Matrix:
        return arb_mat((self.modes * self.frequencies).tolist())


def _exact(*factors: Array) -> bool:
    """Whether all entries of `factors` remain finite and normal numbers if they are multiplied by the scales,
    which are powers of two."""
    sizes = np.abs(np.concatenate([factor.ravel() for factor in factors]))
    return bool((np.isfinite(sizes) & ((sizes == 0) | (sizes > _TINY))).all())
