"""How steps grow from grid to grid, and what two grids tell of the finer one's error.

Numbers of steps are 8, 12, 16, 24, 32, 48, …: few different ones, so that grids are met again and what
belongs to them can be kept. A grid is compared with the one before; how fast their differences fall tells
the power of the steps with which the error falls, and how far the next grid should go.
"""

import math
from dataclasses import dataclass

import numpy as np

from solve.arrays import Array, across
from solve.methods.method import Method

_LEAST = 8
_ORBIT_LEAST = 16
"""Steps to begin with where loads of high orders may look like low ones, and where steps are samples of a
series, which shows nothing of what it leaves out."""

_DAMPING_LEAST = 64
"""Steps to begin with where stiff modes may be present that need not be followed."""

_LEAST_ORDERS = np.array([1.0, 0.5])
"""Parts of their orders with which errors of orbit and multipliers fall at least."""

_NO_GAIN = 2.0
"""Times the differences that an error of first order would leave: larger ones are rounding."""


@dataclass(frozen=True)
class Pace:
    """A grid's steps, their ratio to those of the grid before, and that grid's to the one before it."""

    steps: int
    ratio: float = math.inf
    ratio_before: float = math.inf

    def to(self, steps: int) -> "Pace":
        return Pace(steps, steps / self.steps, self.ratio)

    def onward(self, far: bool, most: int) -> "Pace":
        """To the next rung, or to twice the steps where that is `far` and not beyond `most`."""
        return self.to(2 * self.steps if far and 2 * self.steps <= most else rung(self.steps + 1))

    def over_one(self, most: int) -> "Pace":
        """To three times the steps, past the next rung, where that is a rung and not beyond `most`."""
        steps = 3 * self.steps
        return self.to(steps) if steps <= most and rung(steps) == steps else self.onward(False, most)


def rung(steps: int) -> int:
    """The least of the numbers 8, 12, 16, 24, 32, … that is not below `steps`."""
    power = 1 << (max(steps, _LEAST) - 1).bit_length()
    return 3 * power // 4 if 3 * power // 4 >= max(steps, _LEAST) else power


def first_steps(method: Method, orbit: bool) -> int:
    """Steps of the first grid, for orbits or for multipliers alone."""
    if method.l_stable:
        return _DAMPING_LEAST
    return _ORBIT_LEAST if orbit or method.spectral else _LEAST


def seen_by_both(pace: Pace, method: Method) -> int:
    """Steps that must follow a mode for two grids to tell its error: the coarser grid's where the method
    damps what it does not follow, so that neither keeps it."""
    return round(pace.steps / pace.ratio) if method.l_stable else pace.steps


def far(pace: Pace, errors: Array, wanted: Array, orders: Array) -> Array:
    """Whether more than the next rung is needed to bring errors (…, 2) down to the `wanted` ones (…)."""
    nearest = rung(pace.steps + 1) / pace.steps
    return np.asarray(across(np.logical_or, errors > wanted * nearest**orders))


def needed_steps(pace: Pace, errors: Array, wanted: Array, orders: Array) -> float:
    """Steps, two rungs on at least, on which errors (k, 2) come down to the `wanted` ones if they go on
    falling with the order."""
    with np.errstate(all="ignore"):
        ratio = np.where(errors > wanted, (errors / wanted) ** (1 / orders), 1.0)
    return pace.steps * float(max(2.0, ratio[np.isfinite(ratio)].max(initial=1.0)))


def judged(found: Array, orders: Array) -> Array:
    """Errors (…, 2) of a grid, of orbit and multipliers, from the differences to one twice as fine. Where two
    multipliers nearly meet, theirs fall with half the order."""
    return found / (1 - 0.5 ** (orders * _LEAST_ORDERS))


def estimated(found: Array, before: Array, pace: Pace, orders: Array) -> Array:
    """Errors (…, 2) of the finer of two grids from their differences, and those of the grids before: they
    fall with the power of the steps that is seen, between 1 and the order.

    Never less than the differences before leave when they fall with the order: two grids may meet by
    chance, which would count twice, as a small difference and as a steep power."""
    known = (found > 0) & np.isfinite(before)
    if not math.isfinite(pace.ratio_before):
        return found / (pace.ratio - 1)
    seen = np.where(known, before, 0.0) / np.where(known, found, 1.0)
    power = np.broadcast_to(orders, found.shape)
    for _ in range(3):
        # before / found = (ratio_before^p - 1) / (1 - ratio^-p).
        power = np.log1p(seen * (1 - pace.ratio**-power)) / math.log(pace.ratio_before)
    errors = found / (pace.ratio ** np.clip(power, 1.0, orders) - 1)
    left = np.where(np.isfinite(before), before, 0.0) / (pace.ratio_before**orders - 1) / pace.ratio**orders
    return np.maximum(errors, left)


def finished(
    found: Array, before: Array, errors: Array, wanted: Array, pace: Pace, tiny: Array | bool = False
) -> Array:
    """Whether both errors (…, 2) are `wanted` ones, or finer grids gain no more, which is looked for in
    small differences and in those of `tiny` quantities (…, 2). Differences before are needed: without
    them how fast the errors fall is unknown."""
    if not math.isfinite(pace.ratio_before):
        return np.zeros(found.shape[:-1], dtype=bool)
    no_gain = _NO_GAIN * (1 - 1 / pace.ratio) / (pace.ratio_before - 1)
    stalled = (found >= no_gain * before) & ((found < 1e-6) | tiny)
    return np.asarray(across(np.logical_and, (errors <= wanted) | stalled))
