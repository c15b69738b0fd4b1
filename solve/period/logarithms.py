"""Logarithms of Floquet multipliers, which remain finite if the multipliers underflow: values, distances and
matching."""

import math

import numpy as np

from solve.arrays import Array
from solve.period.multipliers import matched

UNKNOWN = complex(math.nan, math.nan)
"""Logarithm of a multiplier that is not accurate to even one digit: both parts are unknown."""

_EXACT_ZERO = -1e6
"""Substitute for the logarithm of an exact zero, below the logarithm of any other multiplier. Chosen by
judgement."""


def exponential(logarithms: Array) -> Array:
    """Multipliers ρ (N,) from their logarithms; exactly real if the imaginary part is 0 or π. NaN remains
    NaN."""
    angle = np.imag(logarithms)
    return np.exp(np.real(logarithms)) * np.where(angle == math.pi, -1.0, np.exp(1j * angle))


def matched_logarithms(some: Array, every: Array) -> Array:
    """Indices (k,) of the logarithms in `every` (N,) that match those in `some` (k,)."""
    return matched(log_distances(some, every))[1]


def log_distances(some: Array, others: Array) -> Array:
    """Distances (k, N) between logarithms (k,) and (N,), with imaginary parts modulo 2π."""
    some, others = (np.where(np.isneginf(np.real(values)), _EXACT_ZERO, values) for values in (some, others))
    difference = some[:, None] - others
    return np.hypot(np.real(difference), np.angle(np.exp(1j * np.imag(difference))))
