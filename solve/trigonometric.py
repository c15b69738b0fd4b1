"""Trigonometric interpolation of smooth periodic quantities."""

import math

import numpy as np

from solve.arrays import Array


class Trigonometric:
    """The trigonometric polynomial through samples (k, ...) on a uniform grid over the period without its
    end point; k samples resolve harmonics below k/2."""

    def __init__(self, samples: Array, period: float):
        count = len(samples)
        spectrum = np.fft.rfft(samples, axis=0) / count
        spectrum[1 : (count + 1) // 2] *= 2.0
        self._shape = samples.shape[1:]
        self._orders = np.arange(count // 2 + 1) * (2 * math.pi / period)
        parts = np.concatenate((spectrum.real, -spectrum.imag))
        self._coefficients = parts.reshape(len(parts), -1)

    def __call__(self, phase: Array) -> Array:
        """Values (m, ...) at phases (m,)."""
        angle = np.outer(phase, self._orders)
        waves = np.concatenate((np.cos(angle), np.sin(angle)), axis=1)
        return (waves @ self._coefficients).reshape(len(angle), *self._shape)
