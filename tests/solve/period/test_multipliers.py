"""Multipliers and the digits of them that are known."""

import numpy as np

from solve.period.multipliers import Multipliers


def _of(*values: complex) -> Multipliers:
    return Multipliers(np.array(values), np.array(len(values)), np.array(0.0))


def test_those_below_the_error_are_left_out():
    kept = _of(0.5, 1e-3).with_digits(np.array(0.01))
    assert kept.resolved == 1
    assert list(kept.values) == [0.5, 0.0]
    assert kept.bound == 0.005


def test_an_unknown_error_leaves_no_digit_of_any():
    """Nor of multipliers that are all 0, where the spectral radius says nothing."""
    for values in ((0.5, 1e-3), (0.0, 0.0)):
        kept = _of(*values).with_digits(np.array(np.inf))
        assert kept.resolved == 0
        assert kept.bound == np.inf
        assert not kept.values.any()
