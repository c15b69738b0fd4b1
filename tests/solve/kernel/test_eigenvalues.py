"""Eigenvalues of pencils in compiled code, compared with prescribed roots and with LAPACK."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import eigvals
from scipy.optimize import linear_sum_assignment

import solve
from solve.arguments import SMALL
from solve.kernel.eigenvalues import eigenvalues
from solve.period.frozen import frozen
from solve.period.points import SinglePoint
from tests.solve.kernel.test_lanes import needs_compiler

pytestmark = needs_compiler


def distance(some, others):
    """Largest distance between matched numbers, relative to the largest of them."""
    distances = np.abs(some[:, None] - others[None])
    return distances[linear_sum_assignment(distances)].max() / np.abs(others).max()


def by_generalised_problem(M, C, K):
    """Eigenvalues of λ²M + λC + K by SciPy, without an inverse of M."""
    n = len(M)
    zero, one = np.zeros((n, n)), np.eye(n)
    return eigvals(np.block([[zero, one], [-K, -C]]), np.block([[one, zero], [zero, M]]))


@pytest.mark.parametrize("n", [1, 2, 3, 5, SMALL])
@pytest.mark.parametrize("count", [1, 7, 16])
def test_eigenvalues_of_random_pencils_match_lapack(n, count, width):
    M, C, K = np.random.default_rng(n).standard_normal((3, n, n, count))
    M += 3 * n * np.eye(n)[..., None]
    computed = eigenvalues(np.stack((M, C, K)))
    assert computed is not None
    assert computed.shape == (count, 2 * n)
    for at, values in enumerate(computed):
        # Backward errors of both grow with the number of coordinates.
        expected = by_generalised_problem(M[..., at], C[..., at], K[..., at])
        assert distance(values, expected) < 64 * n * np.finfo(float).eps


@given(st.lists(st.tuples(st.floats(0.1, 1e3), st.floats(-0.5, 0.99)), min_size=1, max_size=4), st.randoms())
def test_eigenvalues_match_prescribed_modes(modes, random):
    """Modes with ω and ζ are mixed by a transformation of coordinates with very different units."""
    omega, zeta = np.array(modes).T
    n = len(omega)
    numbers = np.random.default_rng(random.randrange(2**32))
    mixed = np.linalg.qr(numbers.standard_normal((n, n)))[0]
    units = 2.0 ** numbers.integers(-20, 21, n)
    parts = (mixed * each @ mixed.T for each in (np.ones(n), 2 * zeta * omega, omega**2))
    pencil = np.stack([units[:, None] * part * units for part in parts])
    computed = eigenvalues(pencil[..., None])
    assert computed is not None
    expected = omega * (-zeta + 1j * np.sqrt(1 - zeta**2))
    # Two equal modes are a defective pair for rounding: half of the digits.
    assert distance(computed[0], np.concatenate((expected, expected.conj()))) < 1e-6


def test_rows_are_exchanged_if_the_first_inertia_is_zero():
    M, K = np.array([[0.0, 1.0], [1.0, 0.0]]), np.array([[0.0, 9.0], [4.0, 0.0]])
    computed = eigenvalues(np.stack((M, np.zeros((2, 2)), K))[..., None])
    assert computed is not None
    np.testing.assert_allclose(sorted(computed[0].imag), [-3, -2, 2, 3], rtol=1e-12)


def test_cyclic_matrix_converges_with_exceptional_shifts():
    """QR steps do not change a cyclic matrix, except with a shift that breaks its symmetry."""
    n = 3
    K = -np.roll(np.eye(n), 1, axis=0)
    computed = eigenvalues(np.stack((np.eye(n), np.zeros((n, n)), K))[..., None])
    assert computed is not None
    np.testing.assert_allclose(computed[0] ** 6, 1.0, rtol=1e-12)


def test_non_finite_pencils_give_nan_and_leave_others_unchanged():
    pencils = np.repeat(np.stack((np.eye(2), np.zeros((2, 2)), np.diag([4.0, 9.0])))[..., None], 3, axis=3)
    pencils[0, :, :, 0], pencils[2, 0, 0, 2] = 0.0, np.inf
    computed = eigenvalues(pencils)
    assert computed is not None
    assert np.isnan(computed).any(axis=1).tolist() == [True, False, True]
    np.testing.assert_allclose(sorted(computed[1].imag), [-3, -2, 2, 3], rtol=1e-12)


def test_eigenvalues_do_not_depend_on_other_lanes(width):
    pencils = np.random.default_rng(9).standard_normal((3, 3, 3, 24)) + np.eye(3)[..., None]
    together, alone = eigenvalues(pencils), [eigenvalues(pencils[..., [at]]) for at in range(24)]
    assert together is not None
    np.testing.assert_array_equal(together, np.concatenate(alone))


def test_large_pencils_are_not_solved_by_the_kernel():
    assert eigenvalues(np.zeros((3, SMALL + 1, SMALL + 1, 1))) is None


def test_frozen_modes_agree_between_engines():
    point = SinglePoint(solve.load("cam", case="1"), 60.0)
    numpy, compiled = (frozen(point, engine=engine).eigenvalues()[0] for engine in ("numpy", "compiled"))
    assert max(map(distance, compiled, numpy)) < 1e-12
