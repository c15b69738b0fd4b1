"""Multipliers and their condition numbers in compiled code, compared with LAPACK and prescribed matrices."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from solve import floquet
from solve.arguments import SMALL
from solve.kernel import multipliers as kernel
from solve.kernel.engines import COMPILED
from solve.period.eigenvalues import balance_matrices, conditioned, multiplier_roundoff
from solve.period.multipliers import Multipliers
from tests.solve.kernel.test_eigenvalues import distance
from tests.solve.kernel.test_lanes import needs_compiler
from tests.solve.systems import random_system

pytestmark = needs_compiler

SIZES = [2, 4, 6, 10, 2 * SMALL]


def multipliers_of(matrices):
    """Multipliers of matrices (P, N, N), whose scale factors are computed in NumPy."""
    made = kernel.conditioned(matrices, balance_matrices(matrices)[1])
    assert made is not None
    return made


def matrix_with(values, numbers):
    """Matrix with the given eigenvalues and random, well-conditioned eigenvectors. Pairs are 2 by 2
    blocks."""
    blocks = np.zeros((len(values), len(values)))
    for at in range(0, len(values), 2):
        first, second = values[at : at + 2]
        pair = (
            [[first, 0], [0, second]]
            if np.isreal(first)
            else [[first.real, first.imag], [-first.imag, first.real]]
        )
        blocks[at : at + 2, at : at + 2] = np.real(pair)
    mixed = np.linalg.qr(numbers.standard_normal(blocks.shape))[0]
    return mixed @ blocks @ mixed.T


@pytest.mark.parametrize("N", SIZES)
@pytest.mark.parametrize("count", [1, 7, 16])
def test_eigenvalues_of_random_matrices_match_numpy(N, count, width):
    matrices = np.random.default_rng(N).standard_normal((count, N, N))
    computed = multipliers_of(matrices)
    for matrix, values in zip(matrices, computed.values, strict=True):
        assert distance(values, np.linalg.eigvals(matrix)) < 1e-12
        assert (np.diff(np.abs(values)) <= 0).all()
        pairs = values[np.imag(values) != 0]
        assert (np.imag(pairs[::2]) > 0).all()
        np.testing.assert_array_equal(pairs[1::2], pairs[::2].conj())
    if N > 2:
        balanced = balance_matrices(matrices)[0]
        np.testing.assert_allclose(computed.sizes, np.linalg.norm(balanced, axis=(1, 2)), rtol=1e-14)


@given(st.lists(st.just(0.0) | st.floats(1e-60, 1.0), min_size=4, max_size=4), st.integers(-200, 200))
def test_norm_of_two_rows_is_the_minimum_over_units(entries, power):
    """The reference minimises over the units numerically."""
    a, b, c, d = entries * np.array([1, -1, 1, -1])
    matrix = np.array([[a, b * 2.0**power], [c * 2.0**-power, d]])
    units = 2.0 ** np.linspace(-40, 40, 20001)
    least = np.sqrt(a**2 + d**2 + (b * units) ** 2 + (c / units) ** 2).min()
    assert multipliers_of(matrix[None]).sizes[0] <= least * (1 + 1e-14)
    if abs(b * c) > 1e-10:
        assert multipliers_of(matrix[None]).sizes[0] == pytest.approx(least, rel=1e-5)


@pytest.mark.parametrize("N", SIZES[1:])
def test_norms_and_conditions_match_numpy_eigenvectors(N, width):
    matrices = np.random.default_rng(N).standard_normal((9, N, N))
    computed, balanced = multipliers_of(matrices), balance_matrices(matrices)[0]
    np.testing.assert_allclose(computed.norms, np.linalg.norm(balanced, 2, axis=(1, 2)), rtol=1e-6)
    for matrix, values, conditions in zip(balanced, computed.values, computed.conditions, strict=True):
        exact, right = np.linalg.eig(matrix)
        expected = np.linalg.norm(right, axis=0) * np.linalg.norm(np.linalg.inv(right), axis=1)
        nearest = np.abs(values[:, None] - exact).argmin(axis=1)
        np.testing.assert_allclose(conditions, expected[nearest], rtol=1e-8)


radii = st.floats(-1.5, 1.5)


@given(st.lists(st.tuples(radii, radii, st.booleans()), min_size=1, max_size=4), st.integers(0, 2**32 - 1))
def test_multipliers_match_prescribed_spectra(pairs, seed):
    """Real values and conjugate pairs of a normal matrix in very different units."""
    numbers = np.random.default_rng(seed)
    values = np.ravel([(x, y) if real else (x + 1j * y, x - 1j * y) for x, y, real in pairs]).astype(complex)
    units = 2.0 ** numbers.integers(-20, 21, len(values))
    matrix = matrix_with(values, numbers) * units / units[:, None]
    if np.abs(values).max() > 1e-3:
        computed = multipliers_of(matrix[None])
        units = balance_matrices(matrix[None])[1]
        (rounding,) = multiplier_roundoff(
            matrix[None], units, known=conditioned(matrix[None], units, COMPILED)
        )
        assert distance(computed.values[0], values) < 1e-12 + 10 * rounding
        gaps = np.abs(values[:, None] - values) + np.diag(np.full(len(values), np.inf))
        # Those of equal ones are a matter of rounding.
        if gaps.min() > 1e-2 * np.abs(values).max():
            assert (computed.conditions < 1e6).all()


@pytest.mark.parametrize("engine", ["compiled", "numpy"])
@pytest.mark.parametrize("size", [2, 4])
def test_defective_pair_has_roundoff_near_the_square_root(engine, size):
    matrix = np.diag([0.5, 0.5, 0.1, -0.2][:size])
    matrix[0, 1] = 1.0
    units = np.ones((1, size))
    errors = multiplier_roundoff(matrix[None], units, known=conditioned(matrix[None], units, engine))
    assert 1e-8 < errors[0] < 1e-6


def test_eigenvalues_of_multiples_of_the_identity_are_exact():
    for N in SIZES:
        computed = multipliers_of(np.stack((np.zeros((N, N)), np.eye(N), -2 * np.eye(N))))
        np.testing.assert_array_equal(computed.values, np.array([[0], [1], [-2]]) * np.ones(N))
        np.testing.assert_array_equal(computed.norms, [0, 1, 2])


@pytest.mark.parametrize("power", [-900, 0, 1000])
def test_squares_neither_overflow_nor_underflow(power):
    matrices = np.random.default_rng(3).standard_normal((4, 6, 6))
    computed, scaled = multipliers_of(matrices), multipliers_of(np.ldexp(matrices, power))
    np.testing.assert_allclose(np.ldexp(1.0, -power) * scaled.values, computed.values, rtol=1e-12)
    np.testing.assert_array_equal(scaled.conditions, computed.conditions)


def test_multipliers_do_not_depend_on_other_lanes(width):
    matrices = np.random.default_rng(9).standard_normal((24, 6, 6))
    together = multipliers_of(matrices)
    for part, alone in zip(
        together, zip(*(multipliers_of(matrices[[at]]) for at in range(24)), strict=True), strict=True
    ):
        np.testing.assert_array_equal(part, np.concatenate(alone))


def test_large_matrices_are_not_solved_by_the_kernel():
    assert (
        kernel.conditioned(np.zeros((1, 2 * SMALL + 2, 2 * SMALL + 2)), np.ones((1, 2 * SMALL + 2))) is None
    )
    assert kernel.conditioned(np.zeros((1, 4, 4)), None) is None
    assert kernel.conditioned(np.zeros((1, 2, 2)), None) is not None


def test_matrices_without_convergence_are_solved_by_numpy(monkeypatch):
    Phi = np.random.default_rng(4).standard_normal((3, 4, 4))
    units = balance_matrices(Phi)[1]
    expected, compiled = conditioned(Phi, units, COMPILED), kernel.conditioned(Phi, units)
    assert expected is not None
    assert compiled is not None
    for part in compiled:
        part[1] = np.nan
    monkeypatch.setattr(kernel, "conditioned", lambda Phi, units: compiled)
    completed = conditioned(Phi, units, COMPILED)
    assert completed is not None
    # NumPy does not balance the matrices if that leaves the same digits.
    assert (completed.sizes >= 0.999 * expected.sizes).all()
    for part, known in zip(completed[:1] + completed[2:], expected[:1] + expected[2:], strict=True):
        np.testing.assert_allclose(part, known, rtol=1e-10)


@pytest.mark.parametrize("n", [1, 2, 4])
def test_multipliers_and_errors_agree_between_engines(n):
    Phi = np.random.default_rng(n).standard_normal((40, 2 * n, 2 * n))
    units = balance_matrices(Phi)[1]
    known = conditioned(Phi, units, COMPILED)
    compiled, numpy = Multipliers.from_matrices(Phi, units, known), Multipliers.from_matrices(Phi, units)
    assert (compiled.distance(numpy) < 1e-12 * numpy.spectral_radius).all()
    np.testing.assert_array_equal(compiled.resolved, numpy.resolved)
    np.testing.assert_allclose(
        multiplier_roundoff(Phi, units, known=known), multiplier_roundoff(Phi, units), rtol=1e-6
    )
    one, other = (floquet(random_system(n, n), 1.0, engine=engine) for engine in ("compiled", "numpy"))
    np.testing.assert_allclose(one.multipliers, other.multipliers, atol=1e-12 * one.spectral_radius)
