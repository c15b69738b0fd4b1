"""Derivatives by extrapolated differences."""

import math

import numpy as np

from solve.approximation import slope, slopes


def test_less_accurate_slope_bounds_the_error():
    """Derivatives of exp(20 x), whose truncation error dominates, and of a function with a round-off of
    1e-10."""
    for values, exact in (
        (lambda x: np.exp(20 * x), 20 * math.exp(20)),
        (lambda x: np.round(x**2, 10), 2.0),
    ):
        best, coarser = slopes(values, 1.0)
        assert 0 < abs(best - exact) < 2 * abs(best - coarser)
        assert slope(values, 1.0) == best


def test_largest_step_may_be_prescribed():
    assert abs(slope(np.sin, 0.0, largest_step=0.1) - 1.0) < 1e-14
