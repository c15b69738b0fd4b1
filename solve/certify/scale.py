"""The scale of a coordinate, by which changes and errors of a nonlinear orbit are measured.

A coordinate may be small because the forces on it cancel: at an antiresonance, at an equilibrium, by
symmetry. Its largest modulus is then no measure. Its load scale is one: the vibration that the largest single
force on it, a load or the force of another coordinate, would cause against its own stiffness, damping and
inertia,

    B_i = max_f Σ_k |f_ik| / (|M_ii| (kΩ)² + |C_ii| kΩ + |K_ii|),    k: harmonics of the force f on row i,

with means of the diagonals over the period. The scale is max(max|q_i|, part · B_i), in the coordinate's own
unit. Without cancellation max|q_i| is at least about B_i, since a sum of the terms in the denominator with
signs is not larger than their sum.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from solve.arrays import Array
from solve.contracts import Motion
from solve.period.multipliers import EPS
from solve.system import PeriodicSystem

CANCELLED = 1e-3
"""Part of the load scale below which a coordinate counts as small by cancellation, for errors: forces that
cancel to three digits. Where they cancel less, errors are relative to max|q| as `rtol` is."""

_AT_REST = 16
"""Times the round-off of the loads up to which a coordinate counts as zero. The round-off is a bound to first
order; own impedances, by which it is divided, neglect that modes amplify it. Between 1 and 1000 it works for
every equilibrium tried."""

_LEAST_PHASES = 64
"""Phases of the period at which forces are sampled at least; else two a step of the grid."""


@dataclass(frozen=True)
class CoordinateScale:
    """Of a system linearised along a motion, at a speed in rad/s, on a grid of this number of steps."""

    along: PeriodicSystem
    motion: Motion
    speed: float
    steps: int

    def of(self, largest: Array, part: float = CANCELLED, roundoff: bool = False) -> Array:
        """Scales (n,) of coordinates with these largest moduli (n,); 1 where nothing acts. roundoff: whether
        coordinates that are zero except for round-off of the loads are measured by what these loads are sums
        of."""
        scale = np.maximum(largest, part * self.load_scale)
        if roundoff:
            at_rest = largest <= self.roundoff
            scale = np.where(at_rest, np.maximum(scale, self._terms), scale)
        return np.where(scale > 0, scale, 1.0)

    @property
    def roundoff(self) -> Array:
        """Moduli (n,) of coordinates, and of corrections, that are zero within the round-off of the loads."""
        return _AT_REST * EPS * self._terms

    def rests(self, largest: Array) -> bool:
        """Whether some coordinate is zero within the round-off of the loads."""
        return bool((largest <= self.roundoff).any())

    @cached_property
    def load_scale(self) -> Array:
        """B (n,), in the units of the coordinates."""
        M, C, K, d = self._matrices
        q, v, a = (self.motion(self._phases, derivative).T for derivative in range(3))
        others = ~np.eye(self.along.n, dtype=bool)
        forces = (M * a[:, None] + C * v[:, None] + K * q[:, None]) * others
        return np.maximum(self._moved(forces).max(axis=1), self._moved(d))

    @cached_property
    def _terms(self) -> Array:
        """The same (n,) of the terms whose sums are the loads."""
        return self._moved(self.along.roundoff(self._phases, self.speed))

    @cached_property
    def _phases(self) -> Array:
        count = max(_LEAST_PHASES, 2 * self.steps)
        return (np.arange(count) + 0.5) * (self.along.period / count)

    @cached_property
    def _matrices(self) -> tuple[Array, Array, Array, Array]:
        return self.along.in_phase(self._phases, self.speed)

    def _moved(self, forces: Array) -> Array:
        """What forces (k, n, …) on the rows would move (n, …) against the own impedances."""
        spectrum = np.abs(np.fft.rfft(forces, axis=0)) * (2 / len(forces))
        spectrum[0] /= 2
        M, C, K = (np.abs(np.einsum("kii->ki", part)).mean(axis=0) for part in self._matrices[:3])
        rate = np.arange(len(spectrum))[:, None] * (2 * np.pi / self.along.period)
        impedance = M * rate**2 + C * rate + K
        # A constant force on a free coordinate moves it without end.
        bounded = impedance > EPS * impedance[-1]
        compliance = np.where(bounded, 1 / np.where(bounded, impedance, 1.0), 0.0)
        return np.einsum("ki...,ki->i...", spectrum, compliance)
