"""Damping of moving beams from one ratio ζ (thesis 6.2)."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from solve.arrays import Array
from solve.structure.beams import Beams
from solve.structure.eigen import lowest_frequencies, modes
from solve.structure.positions import Positions
from solve.trigonometric import Trigonometric

_POSITIONS = 36
"""Positions over which the lowest frequencies are averaged for Rayleigh damping."""

_FIRST, _MOST = 64, 1024
"""Samples of a turn at which interpolation of C begins, and beyond which it is given up."""

_AGREED = 1e-8
"""Relative error of the midpoints by which twice as many samples are exact but for rounding: the error
falls geometrically."""


@dataclass(frozen=True)
class Rayleigh:
    """C = αM + βK that gives the two lowest modes, averaged over a turn, the ratio ζ."""

    beams: Beams
    period: float

    def __call__(self, phase: Array) -> Array:
        """C (m, n, n) at phases (m,)."""
        M, K = Positions(self.beams, phase).matrices()
        by_mass, by_stiffness = self._factors
        return by_mass * M + by_stiffness * K

    @cached_property
    def _factors(self) -> tuple[float, float]:
        """α (1/s) and β (s)."""
        phase = np.linspace(0.0, self.period, _POSITIONS, endpoint=False)
        first, second = lowest_frequencies(*Positions(self.beams, phase).matrices(), 2).mean(axis=0)
        ratio = 2 * self.beams.properties.damping_ratio / (first + second)
        return ratio * first * second, ratio


@dataclass(frozen=True)
class Modal:
    """C = MΦ diag(2ζω) ΦᵀM at every position: 2ζ times the geometric mean of M and K, as smooth in the
    phase as these are. So a few hundred positions give it at all others, once for all speeds."""

    beams: Beams
    period: float

    def __call__(self, phase: Array) -> Array:
        """C (m, n, n) at phases (m,)."""
        return self._at_positions(phase) if self._interpolant is None else self._interpolant(phase)

    def _at_positions(self, phase: Array) -> Array:
        M, K = Positions(self.beams, phase).matrices()
        frequencies, vectors = modes(M, K)
        shapes = M @ vectors
        ratio = self.beams.properties.damping_ratio
        return (shapes * (2 * ratio * frequencies)[:, None, :]) @ np.swapaxes(shapes, 1, 2)

    @cached_property
    def _interpolant(self) -> Trigonometric | None:
        """None where C is not smooth enough."""
        phase = np.linspace(0.0, self.period, _FIRST, endpoint=False)
        samples = self._at_positions(phase)
        while 2 * len(phase) <= _MOST:
            middles = phase + self.period / (2 * len(phase))
            between, found = self._at_positions(middles), Trigonometric(samples, self.period)
            error = np.abs(found(middles) - between).max()
            samples = np.stack((samples, between), axis=1).reshape(-1, *samples.shape[1:])
            phase = np.stack((phase, middles), axis=1).ravel()
            if error <= _AGREED * np.abs(samples).max():
                return Trigonometric(samples, self.period)
        return None
