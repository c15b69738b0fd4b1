"""Constant coefficients: the multipliers of all suitable methods match those of the matrix exponential."""

import numpy as np
import pytest
from scipy.linalg import expm

from solve import Radau, floquet
from solve.methods.gauss import Gauss
from tests.solve.certificates.trials import matched_error
from tests.solve.systems import constant, spd

ALL = ["auto", "radau", "gauss", Radau(13), Gauss(16), "fourier", "hill", "hsu"]


def structure(seed, n):
    """Return symmetric positive definite M and K, and a general C. Natural frequencies are near the speed."""
    rng = np.random.default_rng(seed)
    return spd(rng, n, 0.5, 2.0), 0.1 * rng.standard_normal((n, n)) + 0.2 * np.eye(n), spd(rng, n, 0.5, 20.0)


def exponential(M, C, K, period):
    n = len(M)
    state = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    return np.linalg.eigvals(expm(state * period))


@pytest.mark.parametrize("method", ALL, ids=str)
@pytest.mark.parametrize("n", [1, 2, 3])
def test_multipliers_match_the_matrix_exponential_to_1e_12(method, n):
    M, C, K = structure(n, n)
    given = constant(M, C, K, lambda phase: np.ones((len(phase), n)))
    stability = floquet(given, 1.3, method, rtol=1e-12)
    assert matched_error(stability.multipliers, exponential(M, C, K, 2 * np.pi / 1.3)) < 1e-12
