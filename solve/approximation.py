"""Trigonometric interpolation of periodic functions, and derivatives by extrapolated finite differences."""

import math
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np

from solve.arrays import EPS, Array, uniform_phases

_FIRST_SAMPLES, _MAX_SAMPLES = 64, 1024
"""Number of samples per period of the first interpolant, and largest number of samples. Above this number,
the function is not interpolated. Chosen by judgement."""

_MIDPOINT_ERROR = 1e-8
"""Relative error at the midpoints below which an interpolant with twice as many samples is exact up to
round-off. For a smooth function, the error decreases geometrically; doubling the number of samples squares
the error."""

_ABOVE_ROUNDOFF = 4.0
"""Amplitude above which a harmonic is retained, relative to the largest amplitude in the last eighth of the
harmonics. The last eighth is round-off: if half as many samples agree to 1e-8, geometric decay reduces these
harmonics to 1e-14. Measured for the damping of the four-bar with 9 to 198 coordinates: 51 to 68 of 129
harmonics are retained."""

_RELATIVE_STEP = 1e-2
"""Largest step of the finite differences, relative to the argument. With four levels of extrapolation, the
error is of the order of the eighth power of this step, 1e-16."""

_LEVELS = 4
"""Number of step sizes. Each is half of the previous one. Chosen by judgement."""


class Trigonometric:
    """Trigonometric interpolant of samples (k, …) on a uniform grid over a period, without the end point.

    k samples resolve the harmonics below k/2. If `chopped`, the harmonics after the last one that exceeds
    round-off are omitted."""

    def __init__(self, samples: Array, period: float, chopped: bool = False):
        count = len(samples)
        spectrum = np.fft.rfft(samples, axis=0) / count
        spectrum[1 : (count + 1) // 2] *= 2.0
        if chopped:
            spectrum = spectrum[: _resolved_harmonics(spectrum)]
        self._shape = samples.shape[1:]
        self._frequencies = np.arange(len(spectrum)) * (2 * math.pi / period)
        amplitudes = np.stack((spectrum.real, -spectrum.imag), axis=1)
        self._amplitudes = amplitudes.reshape(2 * len(spectrum), -1)

    def __call__(self, phase: Array) -> Array:
        """Values (m, …) at phases (m,)."""
        count = len(self._frequencies)
        base = math.isqrt(count)
        # Each frequency is the sum of a low frequency and a multiple of `base`, so that only a few cosines
        # and sines are computed.
        low, multiples = (
            _exponentials(phase, frequencies)
            for frequencies in (self._frequencies[:base], self._frequencies[::base])
        )
        products = multiples[:, :, None] * low[:, None, :]
        waves = products.reshape(len(products), base * multiples.shape[1])[:, :count]
        return (waves.view(float) @ self._amplitudes).reshape(len(waves), *self._shape)

    def at(self, phase: Any, cos: Callable[[Any], Any], sin: Callable[[Any], Any]) -> list[Any]:
        """Values at a symbolic phase, without harmonics that are round-off in every entry.

        Round-off is relative to the largest harmonic of each entry, because entries may have different units.
        """
        cosines, sines = self._amplitudes[::2], self._amplitudes[1::2]
        sizes = np.maximum(np.abs(cosines), np.abs(sines))
        significant = (sizes > EPS * sizes.max(axis=0)).any(axis=1)
        values: list[Any] = [0.0] * cosines.shape[1]
        selected = self._frequencies[significant], cosines[significant], sines[significant]
        for frequency, a, b in zip(*selected, strict=True):
            c, s = cos(frequency * phase), sin(frequency * phase)
            values = [value + p * c + q * s for value, p, q in zip(values, a, b, strict=True)]
        return values


def _exponentials(phase: Array, frequencies: Array) -> Array:
    """Values of exp(i f φ) for frequencies f (k,) and phases φ (m,), as an array (m, k)."""
    angle = np.outer(phase, frequencies)
    values = np.empty(angle.shape, dtype=complex)
    values.real, values.imag = np.cos(angle), np.sin(angle)
    return values


def interpolated(function: Callable[[Array], Array], period: float) -> Callable[[Array], Array]:
    """Trigonometric interpolant of a function with values (m, …) at phases (m,), exact to round-off.

    If the function is not smooth enough, it is returned unchanged."""
    phase = uniform_phases(_FIRST_SAMPLES, period)
    samples = function(phase)
    while 2 * len(phase) <= _MAX_SAMPLES:
        midpoints = phase + period / (2 * len(phase))
        between, interpolant = function(midpoints), Trigonometric(samples, period)
        error = np.abs(interpolant(midpoints) - between).max()
        samples = np.stack((samples, between), axis=1).reshape(-1, *samples.shape[1:])
        phase = np.stack((phase, midpoints), axis=1).ravel()
        if error <= _MIDPOINT_ERROR * np.abs(samples).max():
            return Trigonometric(samples, period, chopped=True)
    return function


def _resolved_harmonics(spectrum: Array) -> int:
    """Number of harmonics in a spectrum (k, …), up to the last one that exceeds round-off."""
    size = np.abs(spectrum).reshape(len(spectrum), -1).max(axis=1)
    roundoff = _ABOVE_ROUNDOFF * size[-(len(size) // 8) :].max()
    return int(np.flatnonzero(size > roundoff)[-1:].sum()) + 1


def slope(function: Callable[[float], Array], x: float, largest_step: float | None = None) -> Array:
    """Derivative of a smooth function of one variable, by central differences that are extrapolated to zero
    step (L. F. Richardson, Phil. Trans. R. Soc. A 210 (1911) 307-357).

    This function is used for assembled matrices, for which automatic differentiation is not available. If
    `largest_step` is omitted, x must not be 0."""
    return slopes(function, x, largest_step)[0]


def slopes(
    function: Callable[[float], Array], x: float, largest_step: float | None = None
) -> tuple[Array, Array]:
    """Return the result of `slope`, and a second value that is extrapolated without the smallest step.

    The second value has a larger truncation error and less round-off. The difference between the two values
    is an error estimate."""
    largest = _RELATIVE_STEP * abs(x) if largest_step is None else largest_step
    steps = [largest / 2**level for level in range(_LEVELS)]
    estimates = [(function(x + step) - function(x - step)) / (2 * step) for step in steps]
    for level in range(1, _LEVELS - 1):
        estimates = _extrapolated(estimates, level)
    return _extrapolated(estimates, _LEVELS - 1)[0], estimates[0]


def _extrapolated(estimates: list[Array], level: int) -> list[Array]:
    return [(4**level * finer - coarser) / (4**level - 1) for coarser, finer in pairwise(estimates)]
