"""Checks of a solution that are independent of its error estimate: Liouville's formula, the residual."""

import math

import numpy as np

from solve.arrays import Array
from solve.methods.method import Solutions
from solve.system import PeriodicSystem

_DOUBTFUL = 1e-2
"""Relative residual above which it may consist of round-off; pure round-off gives about 1."""


def liouville_defect(system: PeriodicSystem, speed: float, solutions: Solutions) -> float:
    """log|det Φ| of the method minus that of the system, -∫ tr(M⁻¹C) dt by Liouville's formula, at a speed in
    rad/s: 0 except for modes that the steps do not resolve. NaN for a method without steps."""
    if solutions.steps is None:
        return math.nan
    nodes, weights = np.polynomial.legendre.leggauss(3)
    phases = solutions.grid.stages((nodes + 1) / 2)
    M, C, _, _ = system.in_phase(phases.ravel(), speed)
    rates = np.einsum("kii->k", np.linalg.solve(M, C)).reshape(phases.shape)
    volume = -float(solutions.grid.h @ rates @ weights) / 2
    return float(np.linalg.slogdet(solutions.steps.A[0])[1].sum()) - volume


def equation_residual(
    system: PeriodicSystem, speed: float, phase: Array, state: tuple[Array, Array, Array]
) -> float:
    """Largest residual of the equation of motion at phases (k,) for states q, q̇, q̈ (n, k), per row, relative
    to the largest of its terms."""
    M, C, K, d = system.at(phase, speed)
    q, qd, qdd = state
    terms = [np.einsum("kij,jk->ki", A, x) for A, x in ((M, qdd), (C, qd), (K, q))]
    scale = np.max([np.abs(term).max(axis=0) for term in (*terms, d)], axis=0)
    residual = np.abs(sum(terms) - d).max(axis=0)
    if (residual > _DOUBTFUL * scale).any():
        # If all terms are round-off, relative to the summands of the load.
        scale = np.maximum(scale, system.roundoff(phase, speed).max(axis=0))
    return float(np.max(residual / np.where(scale > 0, scale, 1.0)))
