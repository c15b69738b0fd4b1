"""How steps grow from grid to grid, and what two grids tell of the finer one's error.

Numbers of steps are 8, 12, 16, 24, 32, 48, …: few different ones, so that grids are met again and what
belongs to them can be kept. A grid is compared with the one before; how fast their differences fall tells
the power of the steps with which the error falls, and how far the next grid should go.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from solve.arrays import Array, across
from solve.methods.method import Method

LEAST = 8
"""Steps that a grid has at least."""

_LEAST_ORDERS = np.array([1.0, 0.5])
"""Parts of their orders with which errors of orbit and multipliers fall at least."""

_USUAL = 0.6
"""Part of its order with which an error falls from grid to grid, where it falls."""

_SURE = 0.5
"""Part of its order with which an error falls surely, though no third grid shows how fast."""

_SPARE = 0.5
"""Part of the wanted error that the next grid is to have."""

FARTHEST = 2.0
"""Times the steps that the next grid has at most."""

SECOND, SECOND_FAR = 1.4, 3.0
"""Times the steps of the first grid that the second, a finer one, has at least; the second of these where the
first grid does not follow the curves."""

_NO_GAIN = 2.0
"""Times the differences that an error of first order would leave: larger ones are rounding."""


@dataclass(frozen=True)
class Pace:
    """A grid's steps, their ratio to those of the grid before, and that grid's to the one before it, infinite
    where there was none: (k, 1), or numbers where they are the same for all points."""

    steps: int
    ratio: Any
    ratio_before: Any = math.inf

    def __getitem__(self, some: Array | slice) -> "Pace":
        return Pace(self.steps, self.ratio[some], self.ratio_before[some])

    @property
    def tells(self) -> Array:
        """Whether there are differences of two grids (k,), which tell how fast they fall."""
        return np.isfinite(self.ratio_before[:, 0])

    @property
    def both(self) -> Array:
        """Steps (k, 2) of the grid before and of this one."""
        return np.round(self.steps / np.column_stack((self.ratio, np.ones(len(self.ratio)))))


def onward(steps: int, times: Array, most: int) -> Array:
    """Steps (k,) of the grids after one of so many: of the rungs above these the first one with at least so
    many `times` (k,) the steps, or the last one that `most` allows. Where it allows none, the next one: more
    than `most`."""
    rungs = [rung(steps + 1)]
    while rungs[-1] < times.max(initial=0) * steps and rung(rungs[-1] + 1) <= most:
        rungs.append(rung(rungs[-1] + 1))
    places = np.searchsorted(rungs, times * steps)
    return np.array(rungs)[np.minimum(places, len(rungs) - 1)]


def rung(steps: int) -> int:
    """The least of the numbers 8, 12, 16, 24, 32, … that is not below `steps`."""
    power = 1 << (max(steps, LEAST) - 1).bit_length()
    return 3 * power // 4 if 3 * power // 4 >= max(steps, LEAST) else power


def rungs_above(steps: Array) -> Array:
    """`rung` of each (k,)."""
    rungs = _rungs(steps)
    return rungs[np.searchsorted(rungs, steps)]


def _rungs(steps: Array) -> Array:
    """Those up to the first that is not below any of the `steps`."""
    found = [rung(1)]
    while found[-1] < steps.max(initial=0):
        found.append(rung(found[-1] + 1))
    return np.array(found)


def times_more(found: Array, wanted: Array, pace: Pace, orders: Array) -> Array:
    """How many times the steps (k,) bring errors down to the `wanted` ones (k, 2), at most twice, if these
    fall as they usually do; from the differences `found` (k, 2)."""
    power = _USUAL * orders
    with np.errstate(all="ignore"):
        too_large = found / ((pace.ratio**power - 1) * _SPARE * wanted)
        times = np.exp(across(np.maximum, np.log(too_large) / power))
    return np.where(np.isnan(times), FARTHEST, np.clip(times, 1.0, FARTHEST))


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


def fallen(found: Array, pace: Pace, power: Array | float) -> Array:
    """Errors (…) of the finer of two grids, falling with such a power of the steps, from the differences;
    infinite where it has no more steps."""
    times = np.maximum(np.expm1(np.log(pace.ratio) * power), 0.0)
    return np.where(times > 0, found / np.where(times > 0, times, 1.0), np.inf)


def sure_powers(method: Method) -> Array:
    """Powers of the steps with which errors of orbit and multipliers (2,) fall surely, unless a third grid
    shows more."""
    orders = np.array([method.curve_order, method.order])
    return np.ones(2) if method.spectral else np.maximum(_SURE * orders, 1.0)


def estimated(found: Array, before: Array, pace: Pace, orders: Array) -> Array:
    """Errors (…, 2) of the finer of two grids from their differences, and those of the grids before: they
    fall with the power of the steps that is seen, between 1 and the order.

    Never less than the differences before leave when they fall with the order: two grids may meet by
    chance, which would count twice, as a small difference and as a steep power. Where the grid before was no
    finer than the one before it, differences tell nothing."""
    known = (found > 0) & np.isfinite(before)
    seen = np.where(known, before, 0.0) / np.where(known, found, 1.0)
    power = np.broadcast_to(orders, found.shape)
    finer = np.log(pace.ratio)
    with np.errstate(divide="ignore", invalid="ignore"):
        for _ in range(3):
            # before / found = (ratio_before^p - 1) / (1 - ratio^-p).
            power = np.log1p(seen * (1 - np.exp(-finer * power))) / np.log(pace.ratio_before)
        errors = fallen(found, pace, np.clip(power, 1.0, orders))
        left = np.where(np.isfinite(before), before, 0.0) / (pace.ratio_before**orders - 1)
        left /= pace.ratio**orders
    return np.where(pace.ratio_before > 1, np.maximum(errors, left), np.inf)


def finished(
    found: Array, before: Array, errors: Array, wanted: Array, pace: Pace, tiny: Array | bool = False
) -> Array:
    """Whether both errors (…, 2) are `wanted` ones, or finer grids gain no more, which differences before
    tell, of small differences and of those of `tiny` quantities (…, 2)."""
    no_gain = _NO_GAIN * (1 - 1 / pace.ratio) / (pace.ratio_before - 1)
    with np.errstate(invalid="ignore"):
        stalled = (found >= no_gain * before) & ((found < 1e-6) | tiny)
    return np.asarray(across(np.logical_and, (errors <= wanted) | stalled))
