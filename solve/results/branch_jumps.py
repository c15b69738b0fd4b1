"""Kinds of the points of a branch, and jumps of the response during a slow change of its parameter."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from solve.arrays import Array
from solve.period.multipliers import VERDICTS

KINDS = "regular", "fold", "doubling", "torus", "grazing", "branching"
REGULAR, FOLD, DOUBLING, TORUS, GRAZING, BRANCHING = KINDS
"""Kinds of points on a branch. Folds are smooth turning points; at tori (Neimark–Sacker points), a pair of
complex multipliers crosses the unit circle. At a grazing point, the branch has a corner, where it may turn
back. At a branching point, another branch of orbits with the same period crosses this one."""

STABLE, _, UNSTABLE, UNDETERMINED = VERDICTS


@dataclass(frozen=True)
class Jump:
    """Jump of the response during a slow change of the parameter. `at` is the index of the turning point at
    which the jump begins. `direction` is the direction of the change. `after` (n,) contains the largest
    absolute values of the coordinates after the jump; it is None if there is no stable orbit to jump to."""

    at: int
    direction: str
    after: Array | None


def jumps_of(
    values: Array, peaks: Array, radii: Array, kinds: Sequence[str], verdicts: Sequence[str]
) -> list[Jump]:
    """Return the jumps along a branch of P orbits. Each jump begins at a turning point (a fold or a corner)
    that has stable orbits on one side only.

    values, peaks, radii: values (P,) of the parameter, largest absolute values (P, n) of the coordinates, and
    spectral radii (P,); kinds, verdicts: names (P,)."""
    jumps = []
    for at, kind in enumerate(kinds):
        before, after = _beside(values, at, -1), _beside(values, at, 1)
        if kind != FOLD and not (kind == GRAZING and (before - values[at]) * (after - values[at]) > 0):
            continue
        stable = [way for way in (-1, 1) if _is_stable(radii, kinds, verdicts, at, way)]
        if len(stable) == 1:
            direction = "up" if values[at] > (before if stable[0] < 0 else after) else "down"
            jumps.append(Jump(at, direction, _target(values, peaks, verdicts, at)))
    return jumps


def relative_change(before: Array, after: Array) -> Array:
    """Return the relative changes (n,) from the peaks `before` (n,) to the peaks `after` (n,)."""
    largest = np.maximum(before, after)
    return np.abs(after - before) / np.where(largest > 0, largest, 1.0)


def is_closed(values: Sequence[float] | Array, figures: Sequence[Array] | Array) -> bool:
    """Return whether the last orbit of a branch equals the first one, in the value of the varied quantity and
    in the statistics. Statistics alone do not suffice, because the orbit may be zero for every value of the
    quantity."""
    return len(figures) > 2 and values[0] == values[-1] and np.array_equal(figures[0], figures[-1])


def _beside(values: Array, at: int, way: int) -> float:
    """Search for a different value of the parameter, from the point `at` in the direction `way` along the
    branch. Return the first such value; NaN if there is none."""
    others = values[at::way][values[at::way] != values[at]]
    return float(others[0]) if len(others) else np.nan


def _is_stable(radii: Array, kinds: Sequence[str], verdicts: Sequence[str], at: int, way: int) -> bool:
    """Return whether the orbits next to the turning point `at`, in the direction `way` along the branch, are
    stable. The first determined verdict decides. No special point may precede this verdict, except grazing
    orbits next to a fold. If all verdicts up to the end of the branch are undetermined, as near a grazing
    orbit, the spectral radius of the nearest orbit decides."""
    place, passed = at + way, (REGULAR, GRAZING) if kinds[at] == FOLD else (REGULAR,)
    while 0 <= place < len(kinds) and kinds[place] in passed:
        if verdicts[place] != UNDETERMINED:
            return verdicts[place] == STABLE
        place += way
    is_end = place != at + way and not 0 <= place < len(kinds)
    return is_end and bool(radii[at + way] < 1)


def _target(values: Array, peaks: Array, verdicts: Sequence[str], at: int) -> Array | None:
    """Return the peaks (n,) of the orbit to which the response jumps at the turning point `at`; None if there
    is no such orbit. Among the stable orbits at the same value of the parameter, the response jumps to the
    orbit that differs least from the orbit at the turning point."""
    targets = []
    for side in range(len(values) - 1):
        apart, step = values[at] - values[side], values[side + 1] - values[side]
        pair = {verdicts[side], verdicts[side + 1]}
        stable = STABLE in pair and UNSTABLE not in pair
        if stable and apart * (values[side + 1] - values[at]) > 0:
            targets.append(peaks[side] + apart / step * (peaks[side + 1] - peaks[side]))
    return min(targets, key=lambda each: relative_change(peaks[at], each).max(), default=None)
