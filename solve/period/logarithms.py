"""Logarithms of Floquet multipliers: values, distances and matching. Logarithms remain finite if the
multipliers underflow."""

import math

import numpy as np

from solve.arrays import Array
from solve.period.multipliers import matched

UNKNOWN = complex(math.nan, math.nan)
"""Logarithm of a multiplier without an accurate digit: real and imaginary part are unknown."""

_EXACT_ZERO = -1e6
"""Real number that replaces the logarithm of an exact zero. It is below the real part of any other logarithm.
Chosen by judgement."""


def exponential(logarithms: Array) -> Array:
    """Multipliers ρ (N,) from their logarithms. They are exactly real if the imaginary part is 0 or π. NaN
    remains NaN."""
    angle = np.imag(logarithms)
    return np.exp(np.real(logarithms)) * np.where(angle == math.pi, -1.0, np.exp(1j * angle))


def matched_logarithms(some: Array, every: Array) -> Array:
    """Match each logarithm of `some` (k,) with one of `every` (N,). Return the indices (k,) in `every`."""
    return matched(log_distances(some, every))[1]


def log_distances(some: Array, others: Array) -> Array:
    """Distances (k, N) between the logarithms `some` (k,) and `others` (N,), with imaginary parts modulo
    2π."""
    some, others = (np.where(np.isneginf(np.real(values)), _EXACT_ZERO, values) for values in (some, others))
    difference = some[:, None] - others
    return np.hypot(np.real(difference), np.angle(np.exp(1j * np.imag(difference))))
