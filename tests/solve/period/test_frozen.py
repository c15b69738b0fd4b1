"""Bounds for frozen coefficients, by LAPACK and by loops over rows."""

import numpy as np
import pytest

from solve.period import pencils
from solve.period.frozen import FrozenModes
from solve.period.points import Tables


def frozen_system(n, seed):
    """Random system of two points at six phases."""
    rng = np.random.default_rng(seed)
    M = np.eye(n) + 0.3 * rng.uniform(-1, 1, (2, 6, n, n)) / n
    C, K, d = (rng.standard_normal((2, 6, columns)) for columns in (n * n, n * n, n))
    return FrozenModes(
        Tables.from_entries(np.concatenate((M.reshape(2, 6, -1), C, K, d), axis=-1), n), 1.0
    ), M


@pytest.mark.parametrize("n", [2, 12])
def test_bounds_do_not_depend_on_the_algorithm(n, monkeypatch):
    computed = {}
    for most in (0, 100):
        monkeypatch.setattr(pencils, "LOOPED", most)
        computed[most] = frozen_system(n, n)[0]._ratios()
    for ours, theirs in zip(computed[0], computed[100], strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-13 * np.abs(theirs).max())


@pytest.mark.parametrize("most", [0, 100])
def test_inertia_that_varies_strongly_is_not_steady(most, monkeypatch):
    monkeypatch.setattr(pencils, "LOOPED", most)
    modes, M = frozen_system(12, 3)
    entries = np.concatenate((M.reshape(2, 6, -1), np.ones((2, 6, 2 * 144 + 12))), axis=-1)
    for factor in (1e-3, -1.0, 0.0):
        changed = entries.copy()
        changed[1, 4, :12] *= factor
        steady = FrozenModes(Tables.from_entries(changed, 12), 1.0).has_steady_inertia()
        np.testing.assert_array_equal(steady, [True, False])
    assert modes.has_steady_inertia().all()


def test_determinants_that_underflow_are_steady():
    n = 120
    entries = np.zeros((1, 6, 3 * n * n + n))
    entries[..., : n * n] = 1e-4 * np.eye(n).ravel()
    assert FrozenModes(Tables.from_entries(entries, n), 1.0).has_steady_inertia().all()
