"""Modes of systems with coefficients frozen at fixed phases, and bounds on the moduli of their eigenvalues.

Bounds are evaluated first. Eigenvalues are computed only if the bounds do not suffice.
"""

from dataclasses import replace
from functools import cached_property

import numpy as np

from solve.arrays import Array, covers_all, midpoint_phases, solved
from solve.kernel import eigenvalues as kernel
from solve.kernel.engines import COMPILED, NUMPY
from solve.matrices import by_rates, leading, split_entries
from solve.period.eigenvalues import balance_matrices
from solve.period.multipliers import UNDERFLOW
from solve.period.pencils import (
    eigenvalues,
    fields_by_rates,
    has_steady_determinant,
    is_periodic_drift,
    mass_normalised,
    pencil_eigenvalues,
    quadratic_moduli,
    quadratic_roots,
    spectral_radius_within_one,
)
from solve.period.points import Points, ScaledEquations, Tables, entry_phases, rate_of
from solve.period.rigid_body import ROUNDING, RigidBodyModes, may_be_singular, rigid_body_modes

PHASES = 128
"""Number of phases at which coefficients are frozen by default. Chosen by judgement."""

_BALANCED = 64.0
"""Largest ratio between the sizes of two rows, or between an entry and the diagonal entry of its column, for
which elimination loses few digits. Chosen by judgement."""

_STEADY = 0.02
"""Modulus of det M, relative to its median modulus, below which M may be singular at a nearby phase. Chosen
by judgement."""

_FEW = np.s_[::16]
"""Phases from which rates are estimated if no bound is required: every 16th phase."""


class FrozenModes:
    """Modes of P points with coefficients frozen at the midpoints of k equal intervals of the period."""

    def __init__(self, tables: Tables, period: float, engine: str = NUMPY):
        self._tables, self.n, self.period, self._engine = tables, tables.n, period, engine
        self._first_order = tables.first_order
        self._parent: tuple[Array, Array] | None = None

    def __len__(self) -> int:
        return len(self._tables.coefficients)

    def __getitem__(self, points: Array) -> "FrozenModes":
        if covers_all(points, len(self)):
            return self
        subset = FrozenModes(self._tables[points], self.period, self._engine)
        if "_fields" in self.__dict__:
            subset._parent = self._fields, points
        elif self._parent is not None:
            subset._parent = self._parent[0], self._parent[1][points]
        if "few_eigenvalues" in self.__dict__:
            subset.__dict__["few_eigenvalues"] = self.few_eigenvalues[points]
        if "rigid_body_modes" in self.__dict__:
            modes = self.rigid_body_modes
            subset.__dict__["rigid_body_modes"] = None if modes is None else modes[points]
        return subset

    @property
    def phases(self) -> Array:
        """Phases (k,) at which the coefficients are frozen."""
        return midpoint_phases(self._tables.table.shape[-2], self.period)

    @cached_property
    def rigid_body_modes(self) -> RigidBodyModes | None:
        """Rigid-body modes, from the coefficients at `phases`; None if no point has a rigid-body mode."""
        if self.n == 1 and not self._tables.per_point:
            low, high = self._ranges
            M, C, K = np.maximum(-low[:3], high[:3])
            if (K > ROUNDING * (M + C)).all():
                return None
        elif self.n > 1:
            M, C, K = self._matrices_at(slice(1)).transpose(0, 3, 4, 1, 2)
            if not may_be_singular(K[:, 0], ROUNDING * (np.abs(M) + np.abs(C))[:, 0]).any():
                return None
        M, C, K = self.matrices
        modes = rigid_body_modes(K, C, M).of_one_kind(self._first_order)
        return modes if modes.any.any() else None

    @property
    def matrices(self) -> tuple[Array, Array, Array]:
        """M, C and K (P, k, n, n) of the equations in which the phase replaces time."""
        M, C, K = self._matrices_at().transpose(0, 3, 4, 1, 2)
        return M, C, K

    @property
    def mean_mass(self) -> Array:
        """Mean of M over the period (P, n, n)."""
        return np.moveaxis(self._matrices_at()[0].mean(axis=-1), -1, 0)

    @cached_property
    def _fields(self) -> Array:
        """Entries of M, C, K and d (3n² + n, P, k)."""
        if self._parent is None:
            return self._tables.fields()
        fields, positions = self._parent
        return fields[:, positions]

    @cached_property
    def _ranges(self) -> tuple[Array, Array]:
        """Lower and upper bounds (3n² + n, P) of the entries."""
        return self._tables.ranges()

    def _matrices_at(self, phases: slice = slice(None)) -> Array:
        """M, C and K (3, n, n, P, k') at the k' selected phases."""
        if self._parent is not None and "_fields" not in self.__dict__:
            # Less data are copied if phases are selected before points.
            fields, positions = self._parent
            fields = fields[..., phases][:, positions]
        else:
            fields = self._fields[..., phases]
        return fields[: 3 * self.n**2].reshape(3, self.n, self.n, *fields.shape[1:])

    def _rates_at(self, phases: slice = slice(None)) -> Array:
        """M, C and K (3, n, n, P, k') at the selected phases. For first-order coordinates, the unknowns are
        the rates instead of the coordinates; see `by_rates`."""
        return fields_by_rates(self._matrices_at(phases), self._first_order)

    @property
    def _is_oscillator(self) -> bool:
        return self.n == 1 and not self._first_order

    def has_steady_inertia(self) -> Array:
        """Mask (P,) of the points at which det M, at every phase, has the same sign and a modulus above the
        fraction `_STEADY` of the median modulus."""
        if self._is_oscillator and not self._tables.per_point:
            low, high = self._ranges
            steady = (low[0] > _STEADY * high[0]) | (high[0] < _STEADY * low[0])
            if steady.all():
                return steady
        return has_steady_determinant(self._rates_at()[0], _STEADY)

    def eigenvalues(self, phases: slice = slice(None)) -> Array:
        """Eigenvalues λ (P, k, N), per radian of the phase, of the system with coefficients frozen at the
        selected phases."""
        if self._is_oscillator:
            return quadratic_roots(*self._matrices_at(phases)[:, 0, 0])
        pencils, first_order = self._matrices_at(phases), self._first_order
        values = kernel.eigenvalues(pencils, first_order) if self._engine == COMPILED else None
        if values is None:
            return pencil_eigenvalues(pencils, first_order)
        is_missing = np.isnan(values).any(axis=-1)
        if is_missing.any():
            values[is_missing] = pencil_eigenvalues(pencils[..., is_missing], first_order)
        return values

    @cached_property
    def few_eigenvalues(self) -> Array:
        """Eigenvalues λ (P, k', N) at every 16th phase, per radian of the phase."""
        return self.eigenvalues(_FEW)

    @property
    def phase_advance_estimate(self) -> Array:
        """Estimate (P,) of `phase_advance` from the modes at every 16th phase."""
        return np.abs(self.few_eigenvalues).max(axis=(1, 2)) * self.period

    @cached_property
    def phase_advance(self) -> Array:
        """Phase advance ω_max T (P,) of the fastest mode in a period, in rad."""
        return np.abs(self.eigenvalues()).max(axis=(1, 2)) * self.period

    def cancellation(self, rates: Array) -> Array:
        """Measure (P,) of the cancellation between the terms of det A, where A = λ²M + λC + K and λ = `rates`
        (P,): the maximum of Π |A_ii|/|det A| over every 16th phase.

        For a positive definite A scaled to the diagonal 1, relative changes of the entries are amplified by
        the inverse of its smallest eigenvalue (J. Demmel, K. Veselić, SIAM J. Matrix Anal. Appl. 13 (1992)
        1204). This inverse is at most e times the returned measure, because the product of the other
        eigenvalues is below e."""
        M, C, K = self._matrices_at(_FEW).transpose(0, 3, 4, 1, 2)
        rate = rates[:, None, None, None]
        A = rate**2 * M + rate * C + K
        with np.errstate(all="ignore"):
            unit = 1 / np.sqrt(np.abs(A.diagonal(axis1=-2, axis2=-1)))
            factors = 1 / np.abs(np.linalg.det(A * unit[..., None] * unit[..., None, :]))
        return np.where(np.isfinite(factors), factors, np.inf).max(axis=1)

    def rates_and_decay(self) -> tuple[Array, Array]:
        """Return moduli (P, N) and decay factors (P, N).

        The modulus of an eigenvalue is its maximum over every 16th phase; moduli are in ascending order. The
        decay factor of a mode is exp(σT) with the mean σ of its growth rate over the same phases. Each factor
        is divided by the factor of the least damped mode, or by `UNDERFLOW` if this is larger.
        """
        if self._is_oscillator:
            few = replace(self._tables, table=self._tables.table[..., _FEW, :])
            moduli, real_parts = quadratic_moduli(*few.fields()[:3])
        else:
            values = self.few_eigenvalues.reshape(-1, self.few_eigenvalues.shape[-1])
            order = np.abs(values).argsort(axis=-1)
            values = values[np.arange(len(values))[:, None], order].reshape(self.few_eigenvalues.shape)
            moduli, real_parts = np.abs(values), np.real(values)
        exponents = real_parts.sum(axis=1) * (self.period / real_parts.shape[1])
        exponents -= np.maximum(exponents.max(axis=1, keepdims=True), np.log(UNDERFLOW))
        return moduli.max(axis=1), np.exp(np.maximum(exponents, -700.0))

    def equation_factors(self) -> Array | None:
        """Return factors (P, n) of the equations, powers of 2, that make the inertia terms of the equations
        comparable in balanced units of the coordinates.

        The factors of a point are 1 if the rows of its matrices have similar sizes. Return None if this is
        the case for all points."""
        if self.n == 1:
            return None
        entries = self._rates_at()
        sizes = np.abs(entries[..., entry_phases(entries.shape[-1])]).max(axis=-1)
        diagonals = np.einsum("aiip->aip", sizes)
        with np.errstate(over="ignore"):
            is_balanced = sizes <= _BALANCED * (diagonals + diagonals[:1])[:, None]
        if is_balanced.all():
            return None
        rows = (~is_balanced.all(axis=(0, 1, 2))).nonzero()[0]
        coupling = self[rows]._coupling[0]
        is_finite = np.isfinite(coupling).all(axis=(1, 2))
        rows, units = rows[is_finite], balance_matrices(coupling[is_finite])[1]
        with np.errstate(all="ignore"):
            inertia = np.moveaxis(sizes[0][..., rows], -1, 0) * units[:, None]
            exponents = -np.round(np.log2(inertia.max(axis=2)))
            exponents -= exponents.max(axis=1, keepdims=True)
        needs_factors = np.isfinite(exponents).all(axis=1) & (exponents.min(axis=1) < -np.log2(_BALANCED))
        factors = np.ones((len(self), self.n))
        factors[rows[needs_factors]] = np.exp2(exponents[needs_factors])
        return factors if needs_factors.any() else None

    @property
    def _coupling(self) -> tuple[Array, Array]:
        """Return mean moduli of the accelerations over the period. The first array (P, n, n) contains the
        effect of each coordinate and its rate; the second array (P, n) contains the effect of the load."""
        n = self.n
        M, C, K, load = split_entries(np.moveaxis(self._fields, 0, -1), n)
        M, C, K = by_rates(M, C, K, self._first_order)
        rate = np.abs(rate_of(M, C, K, load)[..., n:, :]).mean(axis=1)
        return rate[..., :n] + rate[..., n : 2 * n], rate[..., -1]

    def load_scale(self, sizes: Array) -> Array:
        """Estimate the displacements (P, n) that the forces on each coordinate cause against its own
        stiffness.

        The forces are exerted by the other coordinates, which have amplitudes `sizes` (P, n), and by the
        largest load in balanced units of the equations."""
        coupling, load = self._coupling
        units = balance_matrices(coupling)[1]
        largest = units * (load / units).max(axis=1, keepdims=True)
        stiffness = 1.0 + np.einsum("pii->pi", coupling)
        return (np.einsum("pij,pj->pi", coupling, sizes) + largest) / stiffness

    def rigid_body_drift(self, points: Array, Phi: Array, errors: Array) -> Array:
        """Return a mask (k,) of the points with indices `points` (k,) that can drift freely in some direction
        v.

        The conditions are C v = K v = 0 at every phase, within round-off, and Φ (v, 0) = (v, 0); the
        monodromy matrix Φ (k, 2n, 2n) depends on all phases. Then q = v t is a solution, and the multiplier
        +1 is defective. errors (k,): errors of the multipliers."""
        drifts = zip(self._damping_and_stiffness(points), Phi, self.units(points), errors, strict=True)
        return np.array([is_periodic_drift(*arguments) for arguments in drifts], dtype=bool)

    def _damping_and_stiffness(self, points: Array) -> Array:
        """Return rows (k, r, n) of C and K at all phases, for the points with indices `points` (k,). If there
        are rigid-body modes, the equations are solved for the accelerations and projected onto the
        coordinates relative to the modes. The projected equations contain no acceleration along the modes."""
        M, C, K = np.moveaxis(self._matrices_at()[..., points, :], (3, 4), (1, 2))
        modes = None if self.rigid_body_modes is None else self.rigid_body_modes[points]
        if modes is not None and modes.any.any():
            relative, mask = modes.relative
            mask = mask[:, None, None]
            M = leading(M, C, self._first_order)
            C, K = (relative[:, None] @ solved(M, matrix) * mask for matrix in (C, K))
            # Reference coordinates of the modes are excluded.
            K = K + (1 - mask) * np.eye(self.n)
        return np.concatenate((C, K), axis=2).reshape(len(points), -1, self.n)

    def units(self, points: Array) -> Array:
        """Units (k, N) that make the states of the points with indices `points` (k,) comparable.

        The unit of a rate is the square root of the mean inertia. The unit of a coordinate is the square root
        of the larger of mean stiffness and mean inertia; it is 1 for a first-order coordinate.
        """
        matrices = self._matrices_at()[::2][..., points, :]
        diagonals = np.abs(np.einsum("aiipk->apik", matrices)).mean(axis=-1)
        inertia, stiffness = np.maximum(diagonals, np.finfo(float).tiny)
        units = np.sqrt(np.concatenate((np.maximum(stiffness, inertia), inertia), axis=-1))
        if self._first_order:
            units = units[:, : 2 * self.n - self._first_order]
            units[:, self.n - self._first_order : self.n] = 1.0
        return units

    def exceeds_rate(self, rate: float) -> Array:
        """Return a mask (P,) of the points at which sqrt(ρ(M⁻¹K)) or ρ(M⁻¹C) exceeds `rate` at any phase,
        where ρ is the spectral radius."""
        if self._is_oscillator:
            exceeds = ~self._bounded_by_ranges(rate)
            rows = exceeds.nonzero()[0]
            if len(rows):
                exceeds[rows] = (self[rows]._largest_rates() > rate).any(axis=1)
            return exceeds
        limits, ratios = (rate, rate**2), self._ratios()
        # The largest eigenvalue is at least the mean of all eigenvalues, the trace divided by n.
        traces = [np.abs(ratio.trace()).max(axis=1) for ratio in ratios]
        exceeds = (traces[0] > self.n * limits[0]) | (traces[1] > self.n * limits[1])
        rows = (~exceeds).nonzero()[0]
        if len(rows):
            scaled = (np.abs(ratio[:, :, rows]) / limit for ratio, limit in zip(ratios, limits, strict=True))
            rows = rows[~np.logical_and(*map(spectral_radius_within_one, scaled))]
        if len(rows) > 1:
            # The stiffest phase of the middle point is an estimate for all points.
            middle = self[rows][np.array([len(rows) // 2])]
            stiffest = int(middle._largest_rates()[0].argmax())
            exceeds[rows] = self[rows]._largest_rates(np.s_[stiffest : stiffest + 1])[:, 0] > rate
            rows = rows[~exceeds[rows]]
        if len(rows):
            exceeds[rows] = (self[rows]._largest_rates() > rate).any(axis=1)
        return exceeds

    def is_within(self, rate: Array | float) -> Array:
        """Return a mask (P,) of the points for which bounds prove that, at all phases, no eigenvalue has a
        modulus above `rate` (P,).

        λ²M + λC + K is regular for all |λ| > r if (|M⁻¹C|/r + |M⁻¹K|/r²) v ≤ v for some positive v."""
        rate = rate + np.zeros(len(self))
        if not self._is_oscillator:
            # The eigenvalues at a few phases are known, and may exceed the rate already.
            is_within = self.phase_advance_estimate <= rate * self.period
            rows = is_within.nonzero()[0]
            if len(rows):
                is_within[rows] = self[rows]._is_coupled_within(rate[rows])
            return is_within
        is_within = self._bounded_by_ranges(rate)
        rows = (~is_within).nonzero()[0]
        if len(rows):
            (C, K), rate = self[rows]._ratios(), rate[rows, None]
            # The criterion of Schur and Cohn is exact for a single mode.
            bounded = (np.abs(K) <= rate**2) & (np.abs(C) <= rate + K / rate)
            is_within[rows] = np.all(bounded, axis=(0, 1, 3))
        return is_within

    def _is_coupled_within(self, rate: Array) -> Array:
        """Evaluate `is_within` for several coordinates."""
        C, K = self._ratios()
        # The sum of squares of the 2n eigenvalues is at most 2n times that of the largest.
        squares = np.einsum("ijpk,jipk->pk", C, C) - 2 * K.trace()
        is_within = np.abs(squares).max(axis=1) <= 2 * self.n * rate**2
        rows = is_within.nonzero()[0]
        if len(rows):
            C, K, rate = C[:, :, rows], K[:, :, rows], rate[rows, None]
            is_within[rows] = spectral_radius_within_one(np.abs(C) / rate + np.abs(K) / rate**2)
        return is_within

    def _bounded_by_ranges(self, rate: Array | float) -> Array:
        """Return a mask (P,) of the points for which the ranges of the entries of an oscillator prove |C/M| +
        |K/M|/rate ≤ rate. The mask is False if the terms differ between points."""
        if self._tables.per_point:
            return np.zeros(len(self), dtype=bool)
        low, high = self._ranges
        C, K = np.maximum(np.abs(low[1:3]), np.abs(high[1:3]))
        with np.errstate(all="ignore"):
            return (low[0] > 0) & (C / low[0] + K / low[0] / rate <= rate)

    def _largest_rates(self, phases: slice = slice(None)) -> Array:
        """Return the larger of sqrt(ρ(M⁻¹K)) and ρ(M⁻¹C) at the selected phases, as an array (P, k); ρ is the
        spectral radius."""
        M, C, K = np.moveaxis(self._rates_at(phases), (3, 4), (1, 2))
        if self.n == 1:
            stiffness, damping = (np.abs(matrix[..., 0, 0] / M[..., 0, 0]) for matrix in (K, C))
        else:
            stiffness, damping = (np.abs(eigenvalues(solved(M, A))).max(axis=-1) for A in (K, C))
        return np.maximum(np.sqrt(stiffness), damping)

    def _ratios(self) -> tuple[Array, Array]:
        """Return M⁻¹C and M⁻¹K as arrays (n, n, P, k). For a first-order coordinate, its rate replaces the
        acceleration."""
        M, C, K = self._rates_at()
        return mass_normalised(M, C, K, self._first_order)


def frozen(points: Points, phases: int = PHASES, engine: str = NUMPY) -> FrozenModes:
    """Modes of `points` with coefficients frozen at `phases` phases."""
    return FrozenModes(points.tables(midpoint_phases(phases, points.period)), points.period, engine)


def balanced(points: Points, modes: FrozenModes) -> Points:
    """Points with balanced equations. Without balancing, the pivots in elimination would depend on the units
    of the equations."""
    factors = modes.equation_factors()
    return points if factors is None else ScaledEquations(points, factors)
