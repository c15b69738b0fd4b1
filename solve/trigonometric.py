"""Trigonometric interpolation of smooth periodic quantities."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from solve.arrays import Array

_FIRST, _MOST = 64, 1024
"""Samples of a period at which interpolation begins, and beyond which it is given up."""

_EPS = float(np.finfo(float).eps)

_AGREED = 1e-8
"""Relative error of the midpoints by which twice as many samples are exact but for rounding: the error
falls geometrically."""


_ABOVE = 4.0
"""Times the largest of the last eighth of the harmonics that makes one more than round-off. The last eighth
is round-off: where half of the samples agree to 1e-8, geometric decay leaves 1e-14 there. Of the damping of
the four-bar with 9 to 198 coordinates 51 to 68 of 129 harmonics are above it."""


class Trigonometric:
    """The trigonometric polynomial through samples (k, ...) on a uniform grid over the period without its
    end point; k samples resolve harmonics below k/2. chopped: without the harmonics behind the last one that
    is larger than round-off."""

    def __init__(self, samples: Array, period: float, chopped: bool = False):
        count = len(samples)
        spectrum = np.fft.rfft(samples, axis=0) / count
        spectrum[1 : (count + 1) // 2] *= 2.0
        if chopped:
            spectrum = spectrum[: _resolved(spectrum)]
        self._shape = samples.shape[1:]
        self._orders = np.arange(len(spectrum)) * (2 * math.pi / period)
        parts = np.stack((spectrum.real, -spectrum.imag), axis=1)
        self._coefficients = parts.reshape(2 * len(spectrum), -1)

    def __call__(self, phase: Array) -> Array:
        """Values (m, ...) at phases (m,)."""
        count = len(self._orders)
        some = math.isqrt(count)
        # Each order is one of the first and a multiple of `some`: that asks for few cosines and sines.
        first, multiples = (_turned(phase, orders) for orders in (self._orders[:some], self._orders[::some]))
        products = multiples[:, :, None] * first[:, None, :]
        waves = products.reshape(len(products), some * multiples.shape[1])[:, :count]
        return (waves.view(float) @ self._coefficients).reshape(len(waves), *self._shape)

    def at(self, phase: Any, cos: Callable[[Any], Any], sin: Callable[[Any], Any]) -> list[Any]:
        """Its values at a phase as expressions of a symbolic language, without harmonics that are
        rounding."""
        cosines, sines = self._coefficients[::2], self._coefficients[1::2]
        kept = np.maximum(np.abs(cosines), np.abs(sines)).max(axis=1) > _EPS * np.abs(cosines).max()
        values: list[Any] = [0.0] * cosines.shape[1]
        for order, a, b in zip(self._orders[kept], cosines[kept], sines[kept], strict=True):
            c, s = cos(order * phase), sin(order * phase)
            values = [value + p * c + q * s for value, p, q in zip(values, a, b, strict=True)]
        return values


def _turned(phase: Array, orders: Array) -> Array:
    """exp(i order phase), (m, k)."""
    angle = np.outer(phase, orders)
    turned = np.empty(angle.shape, dtype=complex)
    turned.real, turned.imag = np.cos(angle), np.sin(angle)
    return turned


def interpolated(function: Callable[[Array], Array], period: float) -> Callable[[Array], Array]:
    """A function of phases (m,) with values (m, ...) by its interpolant, from as many samples as make that
    exact but for rounding; the function itself where it is not smooth enough."""
    phase = np.linspace(0.0, period, _FIRST, endpoint=False)
    samples = function(phase)
    while 2 * len(phase) <= _MOST:
        middles = phase + period / (2 * len(phase))
        between, found = function(middles), Trigonometric(samples, period)
        error = np.abs(found(middles) - between).max()
        samples = np.stack((samples, between), axis=1).reshape(-1, *samples.shape[1:])
        phase = np.stack((phase, middles), axis=1).ravel()
        if error <= _AGREED * np.abs(samples).max():
            return Trigonometric(samples, period, chopped=True)
    return function


def _resolved(spectrum: Array) -> int:
    """Number of harmonics (k, …) up to the last one above round-off."""
    size = np.abs(spectrum).reshape(len(spectrum), -1).max(axis=1)
    roundoff = _ABOVE * size[-(len(size) // 8) :].max()
    return int(np.flatnonzero(size > roundoff)[-1:].sum()) + 1
