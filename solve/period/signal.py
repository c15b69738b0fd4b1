"""One quantity over one turn: extrema of the continuous curve, mean and harmonics."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from solve.arrays import Array
from solve.errors import ValueOutOfBoundsError

Signal = Callable[[Array], Array]
"""Values (k,) at phases (k,)."""


@dataclass(frozen=True)
class Statistics:
    """max, min, max_abs, mean and root mean square of a quantity over the turn, and the phases of max
    and min."""

    max: float
    min: float
    max_abs: float
    mean: float
    max_phase: float
    min_phase: float
    rms: float


def statistics(signal: Signal, period: float, samples: int = 2048) -> Statistics:
    """Extrema refined between the samples, so that they are those of the continuous curve."""
    phase = np.arange(samples) * (period / samples)
    values = signal(phase)
    high_at, high = _refined(signal, phase[np.argmax(values)], period / samples)
    low_at, low = _refined(lambda p: -signal(p), phase[np.argmin(values)], period / samples)
    mean, rms = float(values.mean()), float(np.sqrt(np.mean(values**2)))
    return Statistics(high, -low, max(high, low), mean, high_at % period, low_at % period, rms)


def _refined(signal: Signal, centre: float, width: float) -> tuple[float, float]:
    """Phase and value of the largest maximum within `width` of the centre."""
    highest = -np.inf
    for _ in range(6):
        phase = centre + width * np.linspace(-1.0, 1.0, 33)
        values = signal(phase)
        best = int(np.argmax(values))
        centre, width, highest = float(phase[best]), width / 16, float(values[best])
    return centre, highest


def harmonics(signal: Signal, period: float, count: int, samples: int = 2048) -> tuple[Array, Array]:
    """Amplitudes [A0, A1, …] and phase angles [0, ψ1, …] of A0 + Σ A_k cos(k 2π φ/period + ψ_k).

    A0 is the signed mean, the others are single-sided peak amplitudes; `count` harmonics. Raises
    ValueOutOfBoundsError.
    """
    if not (isinstance(count, int | np.integer) and count >= 0):
        raise ValueOutOfBoundsError(f"harmonics are {count!r}; allowed: whole numbers from 0 on, such as 60")
    samples = max(samples, 8 * count)
    spectrum = np.fft.rfft(signal(np.arange(samples) * (period / samples)))[: count + 1] / samples
    amplitudes, angles = 2 * np.abs(spectrum), np.angle(spectrum)
    amplitudes[0], angles[0] = spectrum[0].real, 0.0
    return amplitudes, angles
