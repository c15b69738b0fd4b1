"""Where in a range of speeds there are matrices, and where there are no results."""

from collections.abc import Iterable

import numpy as np

from solve.arrays import Array, runs
from solve.errors import SolveError
from solve.system import PeriodicSystem
from solve.units import ShownUnit

_PARTS = 40
"""Of a range in which matrices are looked for."""


def ends_with_matrices(system: PeriodicSystem, speeds: Array) -> tuple[float, float]:
    """The lowest and the highest of rising speeds (rad/s), and of those that divide their range evenly, at
    which there are matrices that can be solved. Raises why the highest has none where no speed has."""
    every = np.unique(np.concatenate((speeds, np.linspace(speeds[0], speeds[-1], _PARTS + 1)))).tolist()
    reasons: list[SolveError] = []

    def first(speeds: Iterable[float]) -> float:
        for speed in speeds:
            try:
                system.checked(speed)
            except SolveError as reason:
                reasons.append(reason)
                continue
            return speed
        raise reasons[0]

    highest = first(reversed(every))
    return first(every), highest


def without_result(speeds: Array, failed: Array, unit: ShownUnit, reason: str) -> str:
    """How many of rising speeds (P,) failed (P,), where, and why."""
    ranges = unit.spans((float(speeds[low]), float(speeds[high])) for low, high in runs(failed))
    return f"{failed.sum()} of {len(speeds)} speeds give no result, {ranges}: {reason}"
