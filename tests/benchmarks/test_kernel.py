"""The kernels that the benchmarks time give equal results."""

import numpy as np
import pytest

from tests.benchmarks import kernel
from tests.benchmarks.lane_compilers import by_casadi, by_lanes, by_numba, problem
from tests.solve.kernel.test_lanes import needs_compiler


@needs_compiler
def test_compiled_products_match_numpy():
    assert kernel.chain(6)[1] < 1e-13


@needs_compiler
def test_casadi_vector_code_gives_the_same_maps():
    computed, truth = (way(2, *problem(2))() for way in (by_casadi, by_lanes))
    np.testing.assert_allclose(computed, truth, rtol=0, atol=1e-12 * np.abs(truth).max())


@needs_compiler
@pytest.mark.slow
def test_numba_gives_the_same_maps():
    pytest.importorskip("numba")
    computed = by_numba(2, *problem(2), lanes=8)()
    truth = by_lanes(2, *problem(2))()
    np.testing.assert_allclose(computed, truth, rtol=0, atol=1e-12 * np.abs(truth).max())


def test_fitted_power_is_independent_of_the_fixed_cost(monkeypatch):
    monkeypatch.setattr(kernel, "best", lambda run, repeats: run)
    assert kernel.exponent([16, 32, 64, 128], lambda size: 5e4 + size**1.5) == pytest.approx(1.5)
