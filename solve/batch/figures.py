"""Extrema, mean, root mean square and harmonics of many points' coordinates and outputs over one turn."""

import math
from functools import cached_property

import numpy as np

from solve.arrays import Array
from solve.batch.curves import Curves
from solve.batch.family import Family
from solve.period.signal import Statistics

FIGURES = tuple(Statistics.__dataclass_fields__)

_LEAST_SAMPLES = 2048
_SAMPLES_PER_STEP = 4
_ZOOMS = 6
_ZOOM = np.linspace(-1.0, 1.0, 33)
"""As a single solve refines its extrema."""


class Signals:
    """Coordinates, and with `outputs` these too, of points (P, v) at speeds (P,): q quantities."""

    def __init__(self, family: Family, points: Array, speeds: Array, curves: Curves, outputs: bool):
        self._family, self._points, self._curves, self._outputs = family, points, curves, outputs
        self._rates = [np.ones((len(points), 1, 1)), speeds[:, None, None], speeds[:, None, None] ** 2]

    @property
    def _period(self) -> float:
        return self._curves.period

    @cached_property
    def values(self) -> Array:
        """Samples (P, q, k), evenly over the turn, that resolve the curves."""
        steps = self._curves.steps
        wanted = max(_LEAST_SAMPLES, 2 ** math.ceil(math.log2(_SAMPLES_PER_STEP * steps)))
        a_step = math.ceil(wanted / steps)
        q = self._curves.sampled(a_step)
        if not self._outputs:
            return q
        phase = np.arange(a_step * steps) * (self._period / (a_step * steps))
        rates = (self._curves.sampled(a_step, order) * self._rates[order] for order in (1, 2))
        every = np.broadcast_to(phase, (len(q), len(phase)))
        return np.concatenate((q, self._family.outputs(every, self._points, q, *rates)), axis=1)

    def at(self, phase: Array) -> Array:
        """Each quantity at phases of its own (P, q, k): (P, q, k)."""
        P, _, k = phase.shape
        n = self._curves.coefficients.shape[1]
        found = self._curves.at(phase[:, :n])
        if not self._outputs:
            return found
        o = phase.shape[1] - n
        every = phase[:, n:].reshape(P, 1, o * k)
        states = (self._curves.at(np.repeat(every, n, axis=1), i) * self._rates[i] for i in range(3))
        outputs = self._family.outputs(every[:, 0], self._points, *states).reshape(P, o, o, k)
        return np.concatenate((found, outputs[:, np.arange(o), np.arange(o)]), axis=1)

    def figures(self) -> Array:
        """(P, q, 7): the fields of `Statistics`."""
        values = self.values
        high_at, high = self._extreme(values, 1.0)
        low_at, low = self._extreme(values, -1.0)
        found = {
            "max": high,
            "min": -low,
            "max_abs": np.maximum(high, low),
            "mean": values.mean(axis=2),
            "max_phase": high_at % self._period,
            "min_phase": low_at % self._period,
            "rms": np.sqrt(np.mean(values**2, axis=2)),
        }
        return np.stack([found[name] for name in FIGURES], axis=-1)

    def amplitudes(self, quantities: list[int], count: int) -> Array:
        """(P, chosen, count + 1): signed mean and single-sided amplitudes of `count` harmonics."""
        values = self.values[:, quantities]
        spectrum = np.fft.rfft(values, axis=2)[:, :, : count + 1] / values.shape[2]
        found = 2 * np.abs(spectrum)
        found[:, :, 0] = np.real(spectrum[:, :, 0])
        return np.pad(found, ((0, 0), (0, 0), (0, count + 1 - found.shape[2])))

    def _extreme(self, values: Array, sign: float) -> tuple[Array, Array]:
        """Phases (P, q) and values, times the sign, of the largest maxima of sign · value."""
        width = self._period / values.shape[2]
        centre = (sign * values).argmax(axis=2) * width
        highest = np.full_like(centre, -np.inf)
        for _ in range(_ZOOMS):
            phase = centre[..., None] + width * _ZOOM
            found = sign * self.at(phase)
            best = found.argmax(axis=2)[..., None]
            centre, highest = (np.take_along_axis(part, best, axis=2)[..., 0] for part in (phase, found))
            width /= 16
        return centre, highest
