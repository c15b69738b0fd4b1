"""Natural frequencies over speed, their integer divisions and combinations: a Campbell diagram."""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from solve.arrays import Array
from solve.errors import SolveError
from solve.results.critical_speeds import Combination
from solve.system import PeriodicSystem

_PHASES = 64
_SECANTS = 4


@dataclass(frozen=True)
class MeanFrequencies:
    """Means over the cycle of the undamped natural frequencies with M and K frozen at a phase and a
    speed: values (P, n), rising, in rad/s at speeds (P,). Where K is not positive they count as 0; NaN at
    speeds without matrices."""

    system: PeriodicSystem
    speeds: Array
    values: Array

    def at(self, speed: float) -> Array:
        """The same (n,) at a speed."""
        return mean_frequencies(self.system, np.array([speed])).values[0]


def mean_frequencies(system: PeriodicSystem, speeds: Array) -> MeanFrequencies:
    """At speeds (P,) in rad/s, 0 for the mechanism at rest."""
    phase = (np.arange(_PHASES) + 0.5) * (system.period / _PHASES)
    means = np.full((len(speeds), system.n), np.nan)
    for mean, speed in zip(means, speeds, strict=True):
        try:
            M, _, K, _ = system.at(phase, float(speed))
        except SolveError:
            # The solution at this speed fails for the same reason, and says so.
            continue
        squares = np.sort(np.real(np.linalg.eigvals(np.linalg.solve(M, K))), axis=1)
        mean[:] = np.sqrt(np.maximum(squares, 0.0)).mean(axis=0)
    return MeanFrequencies(system, speeds, means)


def divisions(frequencies: MeanFrequencies, orders: int) -> list[tuple[int, int, float]]:
    """Mode (from 0), order k and speed of every ω̄(Ω) = k Ω within the speeds, k up to `orders`; Ω counts
    turns of the mechanism."""
    return [
        (mode, order, speed)
        for mode, weights in enumerate(np.eye(frequencies.values.shape[1]))
        for order, speed in _crossed(frequencies, weights, orders)
    ]


def combinations(frequencies: MeanFrequencies, orders: int) -> list[Combination]:
    """Every (ω̄i ± ω̄j)/k within the speeds, k up to `orders`, falling in speed."""
    modes, found = np.eye(frequencies.values.shape[1]), []
    for low, high in itertools.combinations(range(len(modes)), 2):
        for sign in (1, -1):
            crossed = _crossed(frequencies, modes[high] + sign * modes[low], orders)
            found += [Combination(speed, (high + 1, low + 1), sign, order) for order, speed in crossed]
    return sorted(found, key=lambda one: -one.speed)


def _crossed(frequencies: MeanFrequencies, weights: Array, orders: int) -> Iterator[tuple[int, float]]:
    """Orders k and speeds at which the sum of the mean frequencies by their weights (n,) is k Ω."""
    speeds, values = frequencies.speeds, frequencies.values @ weights
    for order in range(1, orders + 1):
        excess = values - order * speeds
        known = np.isfinite(excess[:-1] + excess[1:])
        for at in np.flatnonzero(known & (np.sign(excess[:-1]) != np.sign(excess[1:]))):
            low, high = float(speeds[at]), float(speeds[at + 1])
            below, above = float(excess[at]), float(excess[at + 1])
            for _ in range(_SECANTS):
                middle = low - below * (high - low) / (above - below)
                here = float(frequencies.at(middle) @ weights) - order * middle
                if here == 0.0 or not low < middle < high or np.isnan(here):
                    break
                if (here < 0) == (above < 0):
                    high, above = middle, here
                else:
                    low, below = middle, here
            yield order, low - below * (high - low) / (above - below)
