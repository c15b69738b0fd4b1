"""Damping of moving beams from one ratio ζ (thesis 6.2)."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from solve.arrays import Array
from solve.beams.beams import Beams
from solve.beams.eigen import lowest_frequencies, modes
from solve.beams.positions import Positions
from solve.trigonometric import interpolated

_POSITIONS = 36
"""Positions over which the lowest frequencies are averaged for Rayleigh damping."""


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
        if self.beams.properties.damping_ratio == 0:
            return np.zeros((len(phase), self.beams.freedoms.n, self.beams.freedoms.n))
        return self._everywhere(phase)

    @cached_property
    def _everywhere(self) -> Callable[[Array], Array]:
        return interpolated(self._at_positions, self.period)

    def _at_positions(self, phase: Array) -> Array:
        return modal_damping(*Positions(self.beams, phase).matrices(), self.beams.properties.damping_ratio)


def modal_damping(M: Array, K: Array, ratio: float) -> Array:
    """C = MΦ diag(2ζω) ΦᵀM (m, n, n) that gives every mode of M and K (m, n, n) the ratio ζ."""
    frequencies, vectors = modes(M, K)
    shapes = M @ vectors
    return (shapes * (2 * ratio * frequencies)[:, None, :]) @ np.swapaxes(shapes, 1, 2)
