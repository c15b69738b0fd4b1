"""Means over the cycle of natural frequencies with the matrices frozen, over speed, and the speeds at which
combinations of them are whole multiples of the speed."""

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
from solve.studies.tongues import LIGHTLY_DAMPED
from solve.system import PeriodicSystem
from solve.terminal import progress

_SECANTS = 4

_JUMP = 1e-2
"""Part of a frequency that is left after these where there is no crossing."""

_SOME = 24
"""At most twice so many speeds are looked at for what M and K leave out of means."""

_LOW = 4
"""Highest order of combinations that are strong enough to be looked for where only means tell them."""

_CORRECTIONS = 2
"""Of a speed by the means there."""


@dataclass(frozen=True)
class MeanFrequencies:
    """Means over the cycle of the undamped natural frequencies with M and K frozen at a phase and a speed,
    see `mean_modes`: rising, in rad/s, at speeds (P,); NaN at speeds without matrices. Those at other speeds,
    `replace(frequencies, speeds=…)`, share what is known."""

    system: PeriodicSystem
    speeds: Array
    _known: dict[float, tuple[Array, bool, int]] = field(default_factory=dict, repr=False, compare=False)

    @property
    def values(self) -> Array:
        """(P, n)."""
        return self._found[0]

    @property
    def imaginary(self) -> Array:
        """Whether one of the frequencies is imaginary or complex at some phase (P,)."""
        return self._found[1]

    @property
    def rigid(self) -> int:
        """Largest number of rigid-body modes; they come first, with frequency 0."""
        return int(self._found[2].max(initial=0))

    @property
    def lowest(self) -> Array:
        """Lowest elastic frequency (P,)."""
        return self.values[:, min(self.rigid, self.system.n - 1)]

    @cached_property
    def _found(self) -> tuple[Array, Array, Array]:
        means = np.full((len(self.speeds), self.system.n), np.nan)
        imaginary, rigid = np.zeros(len(self.speeds), dtype=bool), np.zeros(len(self.speeds), dtype=int)
        for at, speed in enumerate(self.speeds.tolist()):
            # Where there are no matrices, the solution at this speed says why.
            with progress.subtask("speeds"), suppress(SolveError, np.linalg.LinAlgError):
                if speed not in self._known:
                    mean, _, is_imaginary, count = mean_modes(self.system, speed)
                    self._known[speed] = mean, is_imaginary, count
                means[at], imaginary[at], rigid[at] = self._known[speed]
        return means, imaginary, rigid

    def at(self, speed: float) -> Array:
        """The same (n,) at a speed."""
        return replace(self, speeds=np.array([speed])).values[0]


def combinations(frequencies: MeanFrequencies, orders: int) -> list[Combination]:
    """Every (ω̄i ± ω̄j)/k within the speeds, with k up to `orders` that the matrices may have by their period,
    falling in speed; integer divisions are none."""
    modes, found = np.eye(frequencies.values.shape[1]), []
    for low, high in itertools.combinations_with_replacement(range(frequencies.rigid, len(modes)), 2):
        for sign in (1, -1) if high > low else (1,):
            found_at = crossed(frequencies, modes[high] + sign * modes[low], orders)
            every = (Combination(speed, (high + 1, low + 1), sign, order) for order, speed in found_at)
            found += [one for one in every if not one.is_division and excited(frequencies.system, one.order)]
    return sorted(found, key=lambda one: -one.speed)


def shifted_by_rates(frequencies: MeanFrequencies, most: float) -> list[str]:
    """A line that says at which speeds gyroscopic forces change a mean frequency by more than a part of
    itself, where they do and frequencies are real."""
    known = frequencies.speeds[~frequencies.imaginary & np.isfinite(frequencies.values[:, 0])]
    speeds = known[:: max(1, len(known) // _SOME)]
    shifts = np.array([shift_by_rates(frequencies.system, speed) for speed in speeds.tolist()])
    beyond, text = np.flatnonzero(shifts > most), frequencies.system.speed_unit.text
    if not len(beyond):
        return []
    first, largest = float(speeds[beyond[0]]), int(shifts.argmax())
    return [
        f"gyroscopic forces, or damping that couples modes, change frequencies by over {most:.0%}, as at "
        f"{text(first, '.4g')}, and by up to {shifts[largest]:.0%} at {text(float(speeds[largest]), '.4g')}: "
        "means and divisions, of M and K alone, mean little there"
    ]


def crossed(frequencies: MeanFrequencies, weights: Array, orders: int) -> Iterator[tuple[int, float]]:
    """Orders k and speeds at which the sum of the mean frequencies by their weights (n,) is k Ω; Ω counts
    turns of the mechanism."""
    speeds, values = frequencies.speeds, frequencies.values @ weights
    for order in range(1, orders + 1):
        excess = values - order * speeds
        known = np.isfinite(excess[:-1] + excess[1:])
        below_order = np.append(excess[:-1] < 0, excess[-1] <= 0)
        for at in np.flatnonzero(known & (below_order[:-1] != below_order[1:])):
            low, high = float(speeds[at]), float(speeds[at + 1])
            below, above, here = float(excess[at]), float(excess[at + 1]), np.nan
            for _ in range(_SECANTS):
                middle = low - below * (high - low) / (above - below)
                here = float(frequencies.at(middle) @ weights) - order * middle
                if here == 0.0 or not low < middle < high or np.isnan(here):
                    break
                if (here < 0) == (above < 0):
                    high, above = middle, here
                else:
                    low, below = middle, here
            # Means jump where modes that come near each other begin to keep their shapes.
            if not abs(here) > _JUMP * order * low:
                yield order, low - below * (high - low) / (above - below)


def resonances(rest: MeanFrequencies, low: float, high: float) -> Array:
    """Speeds between two at which combinations of low order lie, of modes that a turn leaves above one half
    in the mean, by their means at these speeds; `rest`: those at rest."""
    system, (values,) = rest.system, rest.values
    every = [
        (np.eye(len(values))[one] + sign * np.eye(len(values))[two], order)
        for one, two in itertools.combinations_with_replacement(range(rest.rigid, len(values))[::-1], 2)
        for sign in ((1, -1) if one != two else (1,))
        for order in range(1, _LOW + 1)
        if excited(system, order) and (one != two or order % 2)
    ]
    if not every:
        return np.zeros(0)
    weights, orders = np.array([each for each, _ in every]), np.array([order for _, order in every])
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
            if _decays(system, speed) @ weight / 2 <= -math.log(LIGHTLY_DAMPED)
        ]
    )


def _decays(system: PeriodicSystem, speed: float) -> Array:
    """Of the modes in a period (n,)."""
    return mean_modes(system, speed).rates * system.period / speed


def excited(system: PeriodicSystem, order: int) -> bool:
    """Whether matrices of this period may have an order of rotation."""
    number = order * system.period / (2 * math.pi)
    return math.isclose(number, round(number), abs_tol=1e-9)
