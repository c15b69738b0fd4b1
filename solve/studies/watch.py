"""Stability of slow modes alone, where fast ones neither die nor can be followed at many speeds.

The axial vibration of an undamped steel link turns thousands of radians while the crank turns once, and so
do its multipliers over speed. Radau, which loses what it does not follow, leaves the slow modes: a
multiplier is one of theirs where two grids agree on it.
"""

from collections.abc import Callable

import numpy as np

from solve.arrays import Array
from solve.batch.batch import Batch
from solve.methods.auto import RESOLVABLE, Rule, auto
from solve.period.frozen import frozen, surviving
from solve.period.multipliers import UNIT_CIRCLE
from solve.period.points import OnePoint
from solve.studies.boundaries import Judge, Judged
from solve.system import PeriodicSystem

WATCHED = 128.0
"""Angle in rad that a watched mode turns at most in one period, at the lowest speed."""

_STEPS = 192, 256
_AGREED = 1e-4
_ALIVE = 1e-2
"""Part of a fast mode that is left after a period, above which it is not lost on its own."""


def unwatched(system: PeriodicSystem, speed: float, method: Rule) -> int:
    """How many modes are too fast to be watched from this speed on: 0 where all can be followed or those
    that cannot die within a turn, where a method is named, and where no mode would be left."""
    values = frozen(OnePoint(system, speed)).eigenvalues()[0]
    reach = np.abs(values).max(axis=0) * system.period
    fast = int((np.sort(reach)[::2] > WATCHED).sum())
    lives = float(surviving(values, system.period, RESOLVABLE)) > _ALIVE
    needed = method is auto and reach.max() > RESOLVABLE and lives
    return fast if needed and fast < system.n else 0


def watching(batch: Batch, count: Callable[[int], None]) -> Judge:
    """The judge of watched modes, by the batch's method, Radau; `count` is told of every number of points
    solved. Unstable: a multiplier on which both grids agree is outside the unit circle by more than their
    difference."""

    def judged(points: Array) -> Judged:
        coarse, fine = (batch.multipliers(points, steps) for steps in _STEPS)
        error = np.abs(fine[:, :, None] - coarse[:, None, :]).min(axis=2)
        agreed = (error < _AGREED) & (fine != 0)
        beyond = (agreed & (np.abs(fine) - 1 > np.maximum(error, UNIT_CIRCLE))).any(axis=1)
        known = agreed.any(axis=1)
        kept = np.where(agreed, fine, 0.0)
        order = np.argsort(-np.abs(kept), axis=1, kind="stable")
        count(len(points))
        return Judged(points, known & ~beyond, known & beyond, np.take_along_axis(kept, order, axis=1))

    return judged
