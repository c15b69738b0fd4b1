"""Cycle means of the frozen natural frequencies, as functions of the speed, and the speeds of combination
resonances. At a combination resonance, the sum or difference of two means is an integer multiple of the
speed."""

import itertools
import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from solve.arrays import Array
from solve.errors import SolveError
from solve.results.critical_speeds import Combination
from solve.studies.mean_modes import mean_modes, shift_by_rates
from solve.studies.speed_grids import LIGHTLY_DAMPED
from solve.system import PeriodicSystem
from solve.terminal import progress

_TOLERANCE, _MAX_ITERATIONS = 1e-10, 10
"""Relative tolerance of the speeds of divisions, and maximum number of iterations. Means are nearly linear
between two speeds of the grid, so that four iterations suffice. The maximum number is reached only where a
mean jumps."""

_JUMP = 1e-2
"""Relative difference between a mean frequency and a multiple of the speed, after the iteration, above which
the mean is assumed to jump over the multiple instead of crossing it. Chosen by judgement."""

CLOSE = 0.05
"""Relative difference between a frequency and an integer multiple of the speed up to which they may belong to
a resonance. Chosen by judgement."""

_SAMPLES = 24
"""Frequencies with and without C are compared at this number of speeds or more, if available. Chosen by
judgement."""

_MAX_LOW_ORDER = 4
"""Highest order of combination resonances for which grid points are added. Chosen by judgement: their growth
rates decrease with the order, because higher orders require a higher harmonic of the matrices or a higher
power of the first harmonic."""

_CORRECTIONS = 2
"""Number of times that a resonant speed is recomputed from the mean frequencies at that speed. Chosen by
judgement."""


@dataclass(frozen=True)
class MeanFrequencies:
    """Cycle means of undamped natural frequencies at speeds (P,), in rad/s and in ascending order; see
    `mean_modes`. The natural frequencies are those of M and K frozen at phases of the period. Means are NaN
    at speeds without matrices. Copies at other speeds, `replace(frequencies, speeds=…)`, share a cache."""

    system: PeriodicSystem
    speeds: Array
    _cache: dict[float, tuple[Array, bool, int]] = field(default_factory=dict, repr=False, compare=False)

    @property
    def values(self) -> Array:
        """Mean frequencies (P, n) in rad/s."""
        return self._results[0]

    @property
    def imaginary(self) -> Array:
        """Mask (P,) of the speeds at which a frequency is imaginary or complex at some phase."""
        return self._results[1]

    @property
    def rigid(self) -> int:
        """Largest number of rigid-body modes at any of the speeds. These modes come first, with frequency
        0."""
        return int(self._results[2].max(initial=0))

    @property
    def lowest(self) -> Array:
        """Lowest frequency (P,) of an elastic mode, in rad/s."""
        return self.values[:, min(self.rigid, self.system.n - 1)]

    @cached_property
    def _results(self) -> tuple[Array, Array, Array]:
        means = np.full((len(self.speeds), self.system.n), np.nan)
        imaginary, rigid = np.zeros(len(self.speeds), dtype=bool), np.zeros(len(self.speeds), dtype=int)
        for at, speed in enumerate(self.speeds.tolist()):
            # If matrices are missing at a speed, the solution at that speed reports the reason.
            with progress.subtask("speeds"), suppress(SolveError, np.linalg.LinAlgError):
                if speed not in self._cache:
                    mean, _, is_imaginary, count = mean_modes(self.system, speed)
                    self._cache[speed] = mean, is_imaginary, count
                means[at], imaginary[at], rigid[at] = self._cache[speed]
        return means, imaginary, rigid

    def at(self, speed: float) -> Array:
        """Mean frequencies (n,) in rad/s at one speed."""
        return replace(self, speeds=np.array([speed])).values[0]

    def shift_notes(self) -> list[str]:
        """Notes on speeds at which C changes a mean frequency by more than the fraction `CLOSE`: a list with
        one note, or an empty list if there are no such speeds. Speeds with imaginary frequencies are
        excluded."""
        real = self.speeds[~self.imaginary & np.isfinite(self.values[:, 0])]
        speeds = real[:: max(1, len(real) // _SAMPLES)]
        shifts = np.array([shift_by_rates(self.system, speed) for speed in speeds.tolist()])
        beyond, text = np.flatnonzero(shifts > CLOSE), self.system.labels.speed_unit.text
        if not len(beyond):
            return []
        first, largest = float(speeds[beyond[0]]), int(shifts.argmax())
        return [
            "gyroscopic forces, or damping that couples modes, change the frequencies by more than "
            f"{CLOSE:.0%} (first at {text(first, '.4g')}), and by up to {shifts[largest]:.0%} at "
            f"{text(float(speeds[largest]), '.4g')}: mean frequencies, which are computed from M and K "
            "only, and their integer fractions are unreliable there"
        ]


def combinations(frequencies: MeanFrequencies, orders: int) -> list[Combination]:
    """Return the combination resonances (ω̄i ± ω̄j)/k within the range of the speeds, in descending order of
    speed. The orders k are those up to `orders` that the period of the matrices permits. Integer divisions of
    a single frequency are excluded."""
    listed = [
        Combination(speed, (high + 1, low + 1), sign, order)
        for low, high, sign, weights in _sums_of_two(frequencies.rigid, frequencies.values.shape[1])
        for order, speed in resonance_speeds(frequencies, weights, orders)
    ]
    listed = [one for one in listed if not one.is_division and is_excited(frequencies.system, one.order)]
    return sorted(listed, key=lambda one: -one.speed)


def _sums_of_two(rigid: int, count: int) -> Iterator[tuple[int, int, int, Array]]:
    """Yield the lower mode, the higher mode, the sign and the weights (n,) of each sum or difference of two
    elastic frequencies."""
    unit = np.eye(count)
    for low, high in itertools.combinations_with_replacement(range(rigid, count), 2):
        for sign in (1, -1) if high > low else (1,):
            yield low, high, sign, unit[high] + sign * unit[low]


def resonance_speeds(
    frequencies: MeanFrequencies, weights: Array, orders: int
) -> Iterator[tuple[int, float]]:
    """Yield the order k per revolution and the speed Ω wherever the sum of the mean frequencies, weighted by
    `weights` (n,), equals kΩ."""
    from scipy.optimize.elementwise import find_root

    def excess(speeds: Array, order: Array) -> Array:
        return replace(frequencies, speeds=speeds).values @ weights - order * speeds

    speeds, order = frequencies.speeds, np.arange(1, orders + 1)[:, None]
    values = frequencies.values @ weights - order * speeds
    is_known = np.isfinite(values[:, :-1] + values[:, 1:])
    is_below = np.column_stack((values[:, :-1] < 0, values[:, -1] <= 0))
    row, at = np.nonzero(is_known & (is_below[:, :-1] != is_below[:, 1:]))
    if not len(row):
        return
    ends, tolerances = (speeds[at], speeds[at + 1]), {"xrtol": _TOLERANCE, "xatol": 0.0, "fatol": 0.0}
    root = find_root(excess, ends, args=(row + 1,), tolerances=tolerances, maxiter=_MAX_ITERATIONS)
    # At some speeds, the means jump because two modes are no longer exchanged during a period.
    crosses = np.abs(root.f_x) <= _JUMP * (row + 1) * speeds[at]
    yield from zip((row[crosses] + 1).tolist(), root.x[crosses].tolist(), strict=True)


def resonances(rest: MeanFrequencies, low: float, high: float) -> Array:
    """Return the speeds, between `low` and `high`, of combination resonances of low order. Only modes that,
    on average, keep more than half of their amplitude per period are considered. The search starts from
    `rest`, the mean frequencies at speed 0."""
    system, (values,) = rest.system, rest.values
    candidates = [
        (weights, order)
        for first, second, _, weights in _sums_of_two(rest.rigid, len(values))
        for order in range(1, _MAX_LOW_ORDER + 1)
        if is_excited(system, order) and (first != second or order % 2)
    ]
    if not candidates:
        return np.zeros(0)
    weights, orders = (np.array(column) for column in zip(*candidates, strict=True))
    speeds = weights @ values / orders
    for _ in range(_CORRECTIONS):
        near = (speeds > low / 2) & (speeds < 2 * high)
        weights, orders, speeds = weights[near], orders[near], speeds[near]
        speeds = (MeanFrequencies(system, speeds).values * weights).sum(axis=1) / orders
    within = (speeds > low) & (speeds < high)
    return np.array(
        [
            speed
            for speed, weight in zip(speeds[within].tolist(), np.abs(weights[within]), strict=True)
            if _decay_per_period(system, speed) @ weight / 2 <= -math.log(LIGHTLY_DAMPED)
        ]
    )


def _decay_per_period(system: PeriodicSystem, speed: float) -> Array:
    """Return the logarithmic decrements (n,) of the modes per period."""
    return mean_modes(system, speed).rates * system.period / speed


def is_excited(system: PeriodicSystem, order: int) -> bool:
    """Return whether matrices with the system's period can have a harmonic of this order per revolution."""
    number = order * system.period / (2 * math.pi)
    return math.isclose(number, round(number), abs_tol=1e-9)
