"""Differences of curves in compiled code compared with polynomials evaluated one by one."""

import numpy as np
import pytest

from solve.kernel.curves import MOST, differences
from tests.solve.kernel.test_lanes import needs_compiler


def values(curves, phases):
    """Values of curves (k, m, D) at phases given as fractions of the period, by NumPy's polynomials."""
    m = curves.shape[1]
    return np.array(
        [
            [np.polynomial.Polynomial(curve[int(at * m)])(float(at * m % 1)) for at in phases]
            for curve in curves
        ]
    )


@needs_compiler
@pytest.mark.parametrize(
    ("steps", "samples"),
    [((4, 8), (4, 2)), ((9, 12), (4, 3)), ((8, 12), (6, 4)), ((5, 5), (1, 1)), ((3, 6), (MOST, 4))],
)
def test_curves_are_compared_at_the_samples_of_both(steps, samples):
    random = np.random.default_rng(1)
    coarse, fine = (random.standard_normal((2, 3, m, D)) for m, D in zip(steps, (6, 8), strict=True))
    computed = differences(coarse, fine, samples)
    assert computed is not None
    count = steps[0] * samples[0]
    phases = (np.arange(count) + 1e-9) / count
    theirs = [values(each.reshape(6, *each.shape[2:]), phases).reshape(2, 3, -1) for each in (coarse, fine)]
    expected = np.abs(theirs[0] - theirs[1]).max(axis=2), np.abs(theirs[1]).max(axis=2)
    np.testing.assert_allclose(computed, expected, rtol=1e-6)


@needs_compiler
def test_largest_difference_may_be_at_either_end():
    zero = np.zeros((1, 5, 2))
    for at in (0, 4):
        other = zero.copy()
        other[0, at, 0] = -3.0
        assert differences(zero, other, (1, 1)) == (3.0, 3.0)
        assert differences(other, zero, (1, 1)) == (3.0, 0.0)
