"""Figures of a quantity over one turn."""

from collections.abc import Callable
from typing import Any, NamedTuple


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


class Limit(NamedTuple):
    """What the figures of a quantity may be.

    left: whether figures, of one solution or arrays of many, are beyond it. says: what that means, of one.
    """

    quantity: str
    left: Callable[[Statistics], Any]
    says: Callable[[Statistics], str]
