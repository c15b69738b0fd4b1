"""Checks of a solution that are independent of its error estimate, and scales for relative errors.

The checks are Liouville's formula, the residual of the equation of motion, and one correction of Newton's
method."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from solve.arrays import EPS, Array
from solve.certify.comparison import PHASES_PER_STEP, largest_moduli
from solve.contracts import Motion
from solve.equations import nonlinear_of, roundoff_of
from solve.errors import SolveError
from solve.kernel.formulas import columns_by
from solve.matrices import by_rates
from solve.methods.free import free, solutions_on
from solve.methods.method import Method, Solutions
from solve.period.curve import Curve
from solve.period.frozen import PHASES
from solve.period.grid import Grid
from solve.period.points import SinglePoint
from solve.system import PeriodicSystem, in_phase

CANCELLED = 1e-3
"""Fraction of the load scale below which a coordinate counts as small because forces cancel. Chosen by
judgement. The errors of larger coordinates are relative to max|q|, as `rtol` is."""

_AT_REST = 16
"""Multiple of the round-off of the loads up to which a coordinate counts as zero. The round-off is a
first-order bound divided by diagonal impedances, which do not include amplification by modes. All values
between 1 and 1000 work for every equilibrium tried."""

_LOST = 1e-3
"""Difference between the logarithms of two determinants above which the difference may be round-off. The
determinant is then computed from the resolved multipliers, which is more accurate. Chosen by judgement."""

_MAY_BE_ROUND_OFF = 1e-2
"""Relative residual or correction above which the value may be due to round-off alone, which gives values of
about 1."""


@dataclass(frozen=True)
class CoordinateScale:
    """Scales of the coordinates of a system linearised along a motion, at a speed in rad/s, on a grid.

    A coordinate may be small because the forces on it cancel: at an antiresonance, at an equilibrium, or by
    symmetry. Its largest modulus is then not a suitable scale. The load scale of a coordinate is the
    vibration that the largest single force on it would cause against the stiffness, damping and inertia of
    this coordinate alone. The force is a load, or is exerted by another coordinate:

        B_i = max_f Σ_k |f_ik| / (|M_ii| (kΩ)² + |C_ii| kΩ + |K_ii|),    k: harmonics of the force f on row i,

    where the diagonal entries are means over the period. The scale is max(max|q_i|, fraction · B_i), in the
    unit of the coordinate. If no forces cancel, max|q_i| is at least about B_i, because the modulus of the
    complex impedance is at most the denominator.

    along: linearised system. motion: motion along which it is linearised. steps: number of steps of the grid.
    """

    along: PeriodicSystem
    motion: Motion
    speed: float
    steps: int

    def scales(self, largest: Array, fraction: float = CANCELLED, roundoff: bool = False) -> Array:
        """Return the scales (n,) of coordinates whose largest moduli are `largest` (n,); 1 if no force acts.

        roundoff: whether coordinates that are zero within the round-off of the loads are scaled by the
        displacements that the individual terms of the loads would cause."""
        scale = np.maximum(largest, fraction * self.load_scale)
        if roundoff:
            scale = np.where(largest <= self.roundoff, np.maximum(scale, self._load_terms), scale)
        return np.where(scale > 0, scale, 1.0)

    @property
    def roundoff(self) -> Array:
        """Moduli (n,) up to which coordinates and corrections count as zero within the round-off of the
        loads."""
        return _AT_REST * EPS * self._load_terms

    def load_roundoff(self, largest: Array) -> float:
        """Return the largest relative error, due to the round-off of the loads, of coordinates whose largest
        moduli are `largest` (n,). Coordinates that are zero are omitted."""
        error = EPS * self._load_terms
        return float(np.where(largest > 0, error / np.where(largest > 0, largest, 1.0), 0.0).max())

    def rests(self, largest: Array) -> bool:
        """Whether at least one coordinate with the largest moduli `largest` (n,) is zero within the round-off
        of the loads."""
        return bool((largest <= self.roundoff).any())

    @cached_property
    def load_scale(self) -> Array:
        """Load scale B (n,), in the units of the coordinates."""
        M, C, K, d = self._matrices
        q, v, a = (self.motion(self._phases, derivative).T for derivative in range(3))
        is_other = ~np.eye(self.along.n, dtype=bool)
        forces = (M * a[:, None] + C * v[:, None] + K * q[:, None]) * is_other
        return np.maximum(self._displacements(forces).max(axis=1), self._displacements(d))

    @cached_property
    def _load_terms(self) -> Array:
        """Displacements (n,) that the individual terms of the loads would cause."""
        return self._displacements(roundoff_of(self.along, self._phases, self.speed))

    @cached_property
    def _phases(self) -> Array:
        count = max(PHASES // 2, 2 * self.steps)
        return (np.arange(count) + 0.5) * (self.along.period / count)

    @cached_property
    def _matrices(self) -> tuple[Array, Array, Array, Array]:
        return in_phase(self.along, self._phases, self.speed)

    def _displacements(self, forces: Array) -> Array:
        """Return the displacements (n, …) that `forces` (k, n, …) at k uniform phases would cause against the
        diagonal impedances."""
        spectrum = np.abs(np.fft.rfft(forces, axis=0)) * (2 / len(forces))
        spectrum[0] /= 2
        M, C, K = (np.abs(np.einsum("kii->ki", matrix)).mean(axis=0) for matrix in self._matrices[:3])
        rate = np.arange(len(spectrum))[:, None] * (2 * np.pi / self.along.period)
        impedance = M * rate**2 + C * rate + K
        # A constant force displaces a free coordinate without bound.
        is_bounded = impedance > EPS * impedance[-1]
        compliance = np.where(is_bounded, 1 / np.where(is_bounded, impedance, 1.0), 0.0)
        return np.einsum("ki...,ki->i...", spectrum, compliance)


def corrected(
    system: PeriodicSystem, motion: Motion, speed: float, method: Method, grid: Grid, engine: str
) -> Solutions:
    """Return the next Newton iterate from a motion, on a grid over the period of the motion.

    The iterate is the solution of the system linearised along the motion. Raises SolveError if the linearised
    system has no solution, and LinearModelError for linear systems."""
    along = nonlinear_of(system).along(motion, columns_by(engine))
    point = SinglePoint(along, speed)
    return solutions_on(method, point, grid, True, engine, free(point)).checked()


def correction(motion: Motion, solutions: Solutions) -> tuple[Array, Array]:
    """Return the largest moduli (n,) of the Newton correction from `motion` to the curve of `solutions`, and
    those of this curve."""
    assert solutions.curve is not None
    fractions, after = (np.arange(PHASES_PER_STEP) + 0.5) / PHASES_PER_STEP, solutions.curve
    if isinstance(motion, Curve) and isinstance(after, Curve) and np.array_equal(motion.nodes, after.nodes):
        values, better = (curve.within(fractions).reshape(1, motion.n, -1) for curve in (motion, after))
    else:
        phase = (solutions.grid.nodes[:-1, None] + solutions.grid.h[:, None] * fractions).ravel()
        values, better = motion(phase), after(phase)
    change, largest = largest_moduli(values, better)
    return change[0], largest[0]


def linearisation_error(
    system: PeriodicSystem, motion: Motion, speed: float, method: Method, grid: Grid, engine: str
) -> Array:
    """Return the estimated distance (n,) between the nonlinear orbit and a linear one.

    The estimate is one Newton correction, divided by the scale of each coordinate. It is NaN if the
    linearised system has no solution."""
    try:
        solutions = corrected(system, motion, speed, method, grid, engine)
    except SolveError:
        return np.full(system.n, np.nan)
    change, largest = correction(motion, solutions)
    scale = CoordinateScale(
        nonlinear_of(system).along(motion, columns_by(engine)), motion, speed, solutions.grid.steps
    )
    error = change / scale.scales(largest)
    return change / scale.scales(largest, roundoff=True) if error.max() > _MAY_BE_ROUND_OFF else error


def liouville_defect(system: PeriodicSystem, speed: float, solutions: Solutions, logarithms: Array) -> float:
    """Return the difference of log|det Φ| between the method and Liouville's formula, -∫ tr(M⁻¹C) dt.

    The difference is 0 except for modes that the steps do not resolve. It is NaN for a method without steps.
    speed: in rad/s. logarithms (2n,): ln ρ of the multipliers, NaN for unresolved multipliers."""
    if solutions.steps is None:
        return math.nan
    nodes, weights = np.polynomial.legendre.leggauss(3)
    phases = solutions.grid.stages((nodes + 1) / 2)
    M, C, K, _ = in_phase(system, phases.ravel(), speed)
    M, C, _ = by_rates(M, C, K, len(system.states))
    rates = np.einsum("kii->k", np.linalg.solve(M, C)).reshape(phases.shape)
    volume = -float(solutions.grid.h @ rates @ weights) / 2
    defect = float(np.linalg.slogdet(solutions.steps.A[0])[1].sum()) - volume
    total = float(np.real(logarithms).sum()) - volume
    # In the determinant of a product of step maps, small multipliers are lost to round-off.
    return total if abs(defect) > _LOST and math.isfinite(total) else defect


def equation_residual(
    system: PeriodicSystem, speed: float, phase: Array, state: tuple[Array, Array, Array]
) -> float:
    """Return the largest residual of the equation of motion at phases (k,), for the states q, q̇, q̈ (n, k).

    The residual of each row is divided by the largest term of this row.
    """
    M, C, K, d = system.at(phase, speed)
    q, qd, qdd = state
    terms = [np.einsum("kij,jk->ki", A, x) for A, x in ((M, qdd), (C, qd), (K, q))]
    scale = np.max([np.abs(term).max(axis=0) for term in (*terms, d)], axis=0)
    residual = np.abs(sum(terms) - d).max(axis=0)
    if (residual > _MAY_BE_ROUND_OFF * scale).any():
        # If all terms are round-off, the residual is relative to the individual terms of the load.
        scale = np.maximum(scale, roundoff_of(system, phase, speed).max(axis=0))
    return float(np.max(residual / np.where(scale > 0, scale, 1.0)))
