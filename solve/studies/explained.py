"""What explains a maximum over speed: a division of a natural frequency, a combination of two, or nothing."""

import itertools
import math
from typing import NamedTuple

import numpy as np

from solve.arrays import Array
from solve.results.critical_speeds import Combination, Maximum
from solve.system import PeriodicSystem

_PHASES = 64

_NEAR, CLOSE = 0.2, 0.05
"""Difference of frequency over speed from an integer, and its part of this, up to which a maximum may belong
to that division."""

_TURNED = 0.02
"""Part of a full turn that a multiplier's angle may differ from what a division or a combination asks for."""


class Explained(NamedTuple):
    """A maximum with the divisions that may explain it, modes from 1 on and their orders of rotation, or the
    combination of two modes that does."""

    maximum: Maximum
    divisions: set[tuple[int, int]]
    combination: Combination | None = None


def allowed_distance(order: int) -> float:
    """Difference of a frequency over the speed from an order, up to which that may explain a maximum."""
    return min(_NEAR, CLOSE * order)


def frozen_phases(system: PeriodicSystem) -> Array:
    """Where in the period matrices are frozen, evenly."""
    return (np.arange(_PHASES) + 0.5) * (system.period / _PHASES)


def of_multipliers(
    system: PeriodicSystem, maximum: Maximum, rho: Array, ratios: Array, orders: int
) -> Explained:
    """What explains a maximum of the real part of the first of the multipliers (2n,); ratios (n,):
    mean natural frequencies over the speed.

    A multiplier belongs to the mode that decays most nearly as fast. An order of that mode explains the
    maximum where the multiplier has turned to +1 but for the angle arctan(δ/ω): there exp(-δT) cos ωT is
    largest. A combination with another mode does where a multiplier of that one has turned as far, so that
    both meet, and the sum or difference of the frozen frequencies is near an order.
    """
    speed, turns = maximum.speed, system.period / (2 * math.pi)
    rho = rho[np.abs(rho) > 0]
    if len(rho) == 0:
        return Explained(maximum, set())
    decays = _mean_decays(system, speed) * system.period / speed
    modes = np.abs(np.log(np.abs(rho))[:, None] + decays).argmin(axis=1)
    first, angles = int(modes[0]), np.abs(np.angle(rho)) / (2 * math.pi)
    rotated = 2 * math.pi * turns * np.arange(1, orders + 1)
    allowed = _TURNED + np.arctan(max(0.0, -math.log(abs(rho[0]))) / rotated) / (2 * math.pi)
    divisions = {(first + 1, int(at) + 1) for at in np.flatnonzero(angles[0] <= allowed)}
    found = []
    meeting = {int(mode) for mode in modes[np.abs(angles - angles[0]) <= _TURNED]} - {first}
    for other, sign in itertools.product(() if divisions else meeting, (1, -1)):
        low, high = sorted((first, other))
        order = ratios[high] + sign * ratios[low]
        k = round(np.nan_to_num(order))
        if 1 <= k <= orders and abs(order - k) < allowed_distance(k):
            found.append(
                (abs(order - k), Combination(float(speed * order / k), (high + 1, low + 1), sign, k))
            )
    return Explained(maximum, divisions, min(found, default=(0.0, None), key=lambda one: one[0])[1])


def _mean_decays(system: PeriodicSystem, speed: float) -> Array:
    """Means over the cycle of the rates in 1/s (n,) at which vibrations of the frozen modes die out, in the
    order of their frequencies, to the first order in C."""
    M, C, K, _ = system.at(frozen_phases(system), speed)
    squares, shapes = np.linalg.eig(np.linalg.solve(M, K))
    # Shapes that are one another's have no inverse.
    damping = np.linalg.pinv(shapes) @ np.linalg.solve(M, C) @ shapes
    rates = np.real(np.einsum("kii->ki", damping)) / 2
    return np.take_along_axis(rates, np.argsort(np.real(squares), axis=1), axis=1).mean(axis=0)
