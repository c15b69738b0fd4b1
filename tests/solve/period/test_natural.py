"""Natural frequencies of free machines, with negative springs, and with nonsymmetric K."""

import mpmath
import numpy as np
import pytest

from solve.period.natural import eigenvalues, natural_frequencies, slopes
from tests.solve.period.test_rigid_body import CHAIN, chain

INERTIA = 3.5e-3, 3.5e-3, 3.5e-3, 0.15, 0.05


def exact(M, K):
    """Roots λ for diagonal M and symmetric K, with 40 digits."""
    with mpmath.workdps(40):
        unit = mpmath.diag([1 / mpmath.sqrt(m) for m in np.diag(M)])
        return np.array([float(x) for x in sorted(mpmath.eigsy(unit * mpmath.matrix(K) * unit)[0])])


def test_first_frequency_of_free_chain_is_exactly_zero():
    frequencies = natural_frequencies(np.diag(INERTIA)[None], chain(CHAIN)[None], 5)
    hertz = frequencies.frequencies[0] / (2 * np.pi)
    assert hertz[0] == 0.0
    np.testing.assert_allclose(hertz[1:], [81.21, 141.21, 378.95, 536.36], atol=5e-3)
    np.testing.assert_allclose(
        frequencies.frequencies[0] ** 2, exact(np.diag(INERTIA), chain(CHAIN)), atol=1e-6
    )
    assert np.isnan(frequencies.growth_rates).all()


@pytest.mark.parametrize("seed", range(5))
def test_frequencies_are_accurate_with_rigid_body_and_stiff_modes(seed):
    """Two unconnected geared trains have two rigid-body modes. The units are mixed."""
    draw = np.random.default_rng(seed)
    M, K = np.zeros((2, 7, 7))
    for part in (slice(0, 3), slice(3, 7)):
        n = part.stop - part.start
        units = 10.0 ** draw.uniform(-3, 3, n)
        K[part, part] = units[:, None] * chain(10.0 ** draw.uniform(0, 8, n - 1)) * units
        M[part, part] = np.diag(units**2 * draw.uniform(0.1, 1.0, n))
    computed = eigenvalues(M[None], K[None])[0]
    truth = exact(M, K)
    assert (computed[:2] == 0).all()
    np.testing.assert_allclose(computed[2:], truth[2:], rtol=1e-7)


@pytest.mark.parametrize("k1", [-3.0, -2.0, -0.5, 0.5, 3.0])
def test_negative_spring_does_not_change_mode_numbers(k1):
    """Closed form for two unit masses on springs k1 and 100 N/m, with 1 N/m between the masses."""
    a, b = k1 + 1.0, 101.0
    root = np.hypot((a - b) / 2, 1.0)
    low, high = (a + b) / 2 - root, (a + b) / 2 + root
    frequencies = natural_frequencies(np.eye(2)[None], np.array([[[a, -1.0], [-1.0, b]]]), 2)
    if low < 0:
        assert np.isnan(frequencies.frequencies[0, 0])
        assert frequencies.growth_rates[0, 0] == pytest.approx(np.sqrt(-low), rel=1e-12)
    else:
        assert frequencies.frequencies[0, 0] == pytest.approx(np.sqrt(low), rel=1e-12)
        assert np.isnan(frequencies.growth_rates[0, 0])
    assert frequencies.frequencies[0, 1] == pytest.approx(np.sqrt(high), rel=1e-14)
    assert np.isnan(frequencies.growth_rates[0, 1])


def test_growing_mode_precedes_the_rigid_body_mode():
    """Two discs on a shaft of negative stiffness, and two on a shaft of positive stiffness."""
    K = np.zeros((4, 4))
    K[:2, :2], K[2:, 2:] = chain([-8.0]), chain([2.0])
    frequencies = natural_frequencies(np.eye(4)[None], K[None], 4)
    np.testing.assert_allclose(frequencies.growth_rates[0], [4.0, np.nan, np.nan, np.nan])
    np.testing.assert_allclose(frequencies.frequencies[0], [np.nan, 0.0, 0.0, 2.0])


def test_circulatory_forces_yield_frequency_and_growth_rate():
    """λ = k ± i p for K = [[k, p], [-p, k]]."""
    frequencies = natural_frequencies(np.eye(2)[None], np.array([[[4.0, 3.0], [-3.0, 4.0]]]), 2)
    root = np.sqrt(-(4.0 + 3.0j))
    np.testing.assert_allclose(frequencies.frequencies[0], [abs(root.imag)] * 2, rtol=1e-14)
    np.testing.assert_allclose(frequencies.growth_rates[0], [abs(root.real)] * 2, rtol=1e-14)


@pytest.mark.parametrize("seed", range(5))
def test_equations_in_any_units_have_the_same_frequencies(seed):
    """The rows are scaled, so that neither matrix is symmetric. Two λ are equal and must not be separated by
    round-off."""
    draw = np.random.default_rng(seed)
    vectors = np.linalg.qr(draw.standard_normal((4, 4)))[0]
    rows = np.diag(10.0 ** draw.uniform(-4, 4, 4))
    K = vectors @ np.diag([1.0, 9.0, 9.0, 100.0]) @ vectors.T
    frequencies = natural_frequencies(rows[None], (rows @ K)[None], 4)
    np.testing.assert_allclose(frequencies.frequencies[0], [1.0, 3.0, 3.0, 10.0], rtol=1e-9)
    assert np.isnan(frequencies.growth_rates).all()


def test_positions_with_and_without_a_rigid_body_mode():
    held = chain([1.0]) + np.diag([3.0, 0.0])
    computed = eigenvalues(np.stack([np.eye(2)] * 3), np.stack([chain([1.0]), held, chain([2.0])]))
    np.testing.assert_allclose(computed[:, 0], [0.0, (5 - np.sqrt(13)) / 2, 0.0], rtol=1e-14, atol=0)
    np.testing.assert_allclose(computed[:, 1], [2.0, (5 + np.sqrt(13)) / 2, 4.0], rtol=1e-14)


def test_slopes_of_a_free_pair_and_of_equal_eigenvalues():
    """λ = 0 and k (1/J1 + 1/J2). For two equal λ of diagonal matrices, the result is the mean of both
    slopes."""
    J1, J2, k = 0.1, 0.2, 10.0
    by_K, by_M = np.array([chain([1.0]), 0 * chain([1.0])]), np.array([0 * np.eye(2), np.diag([1.0, 0.0])])
    computed = slopes(np.diag([J1, J2]), chain([k]), by_M, by_K)
    np.testing.assert_allclose(computed, [[0, 1 / J1 + 1 / J2], [0, -k / J1**2]], rtol=1e-12, atol=1e-9)
    equal = slopes(np.eye(3), np.diag([2.0, 2.0, 5.0]), np.zeros((1, 3, 3)), np.diag([1.0, 3.0, 7.0])[None])
    np.testing.assert_allclose(equal, [[2.0, 2.0, 7.0]], rtol=1e-14)
