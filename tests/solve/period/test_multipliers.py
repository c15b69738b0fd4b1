"""Multipliers and the number of their known digits."""

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from solve.period.eigenvalues import balance_matrices
from solve.period.multipliers import UNDERFLOW, Multipliers, matched


def _of(*values: complex) -> Multipliers:
    return Multipliers(np.array(values), np.array(len(values)), np.array(0.0))


def test_multipliers_below_the_error_are_omitted():
    kept = _of(0.5, 1e-3).with_digits(np.array(0.01))
    assert kept.resolved == 1
    assert list(kept.values) == [0.5, 0.0]
    assert kept.bound == 0.005


def test_infinite_error_leaves_no_multiplier_resolved():
    """Errors are infinite if all multipliers are below the bound, or 0; only the bound remains."""
    for values in ((UNDERFLOW / 2, 1e-40), (0.0, 0.0)):
        kept = _of(*values).with_digits(np.array(np.inf))
        assert kept.resolved == 0
        assert kept.bound == UNDERFLOW
        assert not kept.values.any()


@given(st.integers(0, 2**31), st.integers(2, 5), st.booleans())
def test_pairing_minimises_the_sum_of_distances(seed, size, near):
    """Compared with all permutations, for multipliers that nearly agree in their sequence or do not."""
    random = np.random.default_rng(seed)
    numbers = random.normal(size=size)
    others = numbers + 0.3 * random.normal(size=size) if near else random.normal(size=size)
    distance = np.abs(numbers[:, None] - others)
    least = min(distance[range(size), order].sum() for order in permutations(range(size)))
    assert distance[matched(distance)].sum() == pytest.approx(least, rel=1e-12)


def test_multiplier_distance_uses_the_best_pairing():
    """Two computed multipliers are nearest to the same reference. The pairing by position has the minimum
    largest distance."""
    ours, theirs = _of(1.0, 0.5, 0.4), _of(1.25, 0.48, 0.2)
    assert ours.distance(theirs) == pytest.approx(0.25)
    assert _of(0.5, 0.4).distance(_of(0.2, 0.45)) == pytest.approx(0.2)


@given(st.integers(0, 2**31), st.integers(2, 8))
def test_balancing_removes_the_effect_of_units(seed, size):
    """Norms of rows and columns are similar in any units: within a factor of 2, and of another 2 for each
    because scale factors are rounded to powers of two."""
    random = np.random.default_rng(seed)
    units = 10.0 ** random.uniform(-9, 9, size)
    matrices = random.uniform(0.1, 1.0, (3, size, size))
    matrices[1] = matrices[1] * units / units[:, None]
    balanced, computed = balance_matrices(matrices)
    rows, columns = np.linalg.norm(balanced, axis=2), np.linalg.norm(balanced, axis=1)
    assert (np.maximum(rows / columns, columns / rows) <= 8).all()
    assert (np.frexp(computed)[0] == 0.5).all()
    np.testing.assert_allclose(balanced, matrices * computed[:, None, :] / computed[:, :, None])
    np.testing.assert_array_equal(balance_matrices(matrices[1:2])[1], computed[1:2])


def test_balancing_does_not_change_zeros():
    for matrix in (np.zeros((3, 3)), [[0.0, 1.0], [0.0, 0.0]]):
        balanced, computed = balance_matrices(np.array(matrix))
        np.testing.assert_array_equal(balanced, matrix)
        np.testing.assert_array_equal(computed, 1.0)
