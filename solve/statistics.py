"""Figures of a quantity over one turn."""

from typing import NamedTuple


class Statistics(NamedTuple):
    """max, min, max_abs, mean and root mean square of a quantity over the turn, and the phases of max
    and min."""

    max: float
    min: float
    max_abs: float
    mean: float
    max_phase: float
    min_phase: float
    rms: float
