"""Small systems of linear equations solved side by side."""

import numpy as np
import pytest

from solve.kernel.systems import solved_together
from tests.solve.kernel.test_lanes import needs_compiler
from tests.solve.kernel.test_widths import LACKING, on_x86

RNG = np.random.default_rng(5)


def off(A, b):
    """Largest residual, as parts of what rounding of the solution leaves."""
    x = solved_together(A, b)
    size = np.abs(A) @ np.abs(x) + np.abs(b)
    return (np.abs(A @ x - b) / size).max()


@needs_compiler
@pytest.mark.parametrize(("count", "n", "k"), [(1, 1, 1), (7, 3, 2), (40, 6, 1), (17, 15, 21)])
def test_of_any_number_and_size(count, n, k):
    A = np.eye(n) + 0.3 * RNG.standard_normal((count, n, n))
    assert off(A, RNG.standard_normal((count, n, k))) < 1e-13


@needs_compiler
def test_of_neighbours_that_need_other_pivots():
    A = np.stack([np.eye(5)[RNG.permutation(5)] for _ in range(32)]) + 1e-12 * RNG.standard_normal((32, 5, 5))
    assert off(A, RNG.standard_normal((32, 5, 3))) < 1e-13


@needs_compiler
def test_leading_axes_are_kept_and_singular_ones_unknown():
    A, b = np.eye(3) + 0.1 * RNG.standard_normal((2, 9, 3, 3)), RNG.standard_normal((2, 9, 3, 4))
    A[1, 4] = 1.0
    x = solved_together(A, b)
    assert x.shape == b.shape
    assert np.isnan(x[1, 4]).all()
    x[1, 4] = 0.0
    assert np.isfinite(x).all()


@needs_compiler
@on_x86
@pytest.mark.parametrize("width", LACKING)
def test_every_width(compiled_for, width):
    compiled_for(*LACKING[width])
    assert off(np.eye(4) + 0.2 * RNG.standard_normal((11, 4, 4)), RNG.standard_normal((11, 4, 2))) < 1e-13
