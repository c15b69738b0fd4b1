"""Derivatives by central differences, extrapolated to vanishing steps (L. F. Richardson, Phil. Trans. R. Soc.
A 210 (1911) 307-357), for what no automatic differentiation reaches: matrices that are assembled."""

from collections.abc import Callable
from itertools import pairwise

from solve.arrays import Array

_STEP = 1e-2
"""Largest step, relative to the quantity: its eighth power is rounding, and so little is lost by that."""

_LEVELS = 4


def slope(values: Callable[[float], Array], at: float, largest: float | None = None) -> Array:
    """Derivative of a smooth function of a number; without a largest step, of one other than 0."""
    return slopes(values, at, largest)[0]


def slopes(values: Callable[[float], Array], at: float, largest: float | None = None) -> tuple[Array, Array]:
    """Derivative as by `slope`, and the one without the smallest step, whose truncation error is larger and
    whose round-off is smaller: their difference estimates the error."""
    step = _STEP * abs(at) if largest is None else largest
    steps = [step / 2**level for level in range(_LEVELS)]
    found = [(values(at + step) - values(at - step)) / (2 * step) for step in steps]
    for level in range(1, _LEVELS - 1):
        found = _extrapolated(found, level)
    return _extrapolated(found, _LEVELS - 1)[0], found[0]


def _extrapolated(found: list[Array], level: int) -> list[Array]:
    return [(4**level * finer - coarser) / (4**level - 1) for coarser, finer in pairwise(found)]
