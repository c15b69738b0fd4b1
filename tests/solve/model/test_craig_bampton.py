"""Component modes of bodies, compared with closed forms and with the full eigenproblem."""

import numpy as np
import pytest
from scipy.linalg import eigh, null_space
from scipy.optimize import brentq

from solve.errors import MatricesError, ValueOutOfBoundsError
from solve.model.craig_bampton import craig_bampton, static_shapes


def chain(n, held=True):
    """Return unit masses and springs in a row. If `held`, the first spring is connected to ground."""
    K = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    K[-1, -1] = 1.0
    K[0, 0] = 2.0 if held else 1.0
    return np.eye(n), K


def cantilever(count):
    """Return a cantilever with EI = µ = L = 1 and Hermite cubics. The last coordinates are those of the
    tip."""
    h = 1 / count
    k = np.array([[12, 6 * h, -12, 6 * h], [6 * h, 4 * h**2, -6 * h, 2 * h**2]]) / h**3
    k = np.vstack((k, -k[0], [k[0, 1], k[1, 3], -k[0, 1], k[1, 1]]))
    m = np.array(
        [
            [156, 22 * h, 54, -13 * h],
            [22 * h, 4 * h**2, 13 * h, -3 * h**2],
            [54, 13 * h, 156, -22 * h],
            [-13 * h, -3 * h**2, -22 * h, 4 * h**2],
        ]
    )
    M, K = np.zeros((2, 2 * count + 2, 2 * count + 2))
    for first in range(count):
        at = slice(2 * first, 2 * first + 4)
        M[at, at] += m * h / 420
        K[at, at] += k
    return M[2:, 2:], K[2:, 2:]


def test_fixed_interface_frequencies_of_a_chain_match_closed_forms():
    """The frequencies of m masses between fixed ends are 2 sin(jπ/(2(m+1)))."""
    reduction = craig_bampton(*chain(8), interface=[7], modes=3)
    expected = 2 * np.sin(np.arange(1, 5) * np.pi / 16)
    np.testing.assert_allclose(reduction.frequencies, expected[:3], rtol=1e-13)
    assert reduction.discarded == pytest.approx(expected[3], rel=1e-13)
    np.testing.assert_allclose(reduction.mass[1:, 1:], np.eye(3), atol=1e-13)
    np.testing.assert_allclose(reduction.stiffness[1:, 1:], np.diag(expected[:3] ** 2), atol=1e-13)
    np.testing.assert_allclose(reduction.basis[:, 0], np.arange(1, 9) / 8, rtol=1e-13)


@pytest.mark.parametrize("interface", [[7], [0, 7], [5, 2], []])
def test_basis_with_all_modes_is_complete(interface):
    M, K = chain(8)
    reduction = craig_bampton(M, K, interface, modes=8 - len(interface))
    assert reduction.discarded == np.inf
    np.testing.assert_allclose(eigh(reduction.stiffness, reduction.mass)[0], eigh(K, M)[0], rtol=1e-12)
    np.testing.assert_array_equal(reduction.basis[interface, : len(interface)], np.eye(len(interface)))


def test_frequencies_of_a_reduced_cantilever_are_upper_bounds():
    """cos λ cosh λ = −1 and ω = λ². The basis contains the coordinates of the tip and four clamped-clamped
    modes."""
    M, K = cantilever(40)
    reduction = craig_bampton(M, K, [78, 79], modes=4)
    omega = np.sqrt(eigh(reduction.stiffness, reduction.mass, eigvals_only=True)[:3])
    exact = [brentq(lambda x: np.cos(x) + 1 / np.cosh(x), a, a + 2) ** 2 for a in (1, 4, 7)]
    whole = np.sqrt(eigh(K, M, eigvals_only=True)[:3])
    assert (np.abs(omega / exact - 1) < [1e-5, 2e-4, 1e-3]).all()
    assert (omega >= whole * (1 - 1e-10)).all()
    clamped = [brentq(lambda x: np.cos(x) - 1 / np.cosh(x), a, a + 1.5) ** 2 for a in (4, 7, 10, 13.5, 16.5)]
    np.testing.assert_allclose([*reduction.frequencies, reduction.discarded], clamped, rtol=1e-4)


def test_static_shapes_complete_the_modes():
    """The deflection under a uniform load is a linear combination of the basis and one static shape."""
    M, K = cantilever(12)
    load = M @ np.tile([1.0, 0.0], 12)
    reduction = craig_bampton(M, K, [22, 23], modes=2)
    shapes = static_shapes(K, reduction.basis, [22, 23], np.column_stack((load, 2 * load)))
    assert shapes.shape == (24, 1)
    np.testing.assert_allclose(
        shapes.T @ K @ np.column_stack((reduction.basis, shapes)), [[0] * 4 + [1]], atol=1e-9
    )
    deflection = np.linalg.solve(K, load)
    fitted = np.column_stack((reduction.basis, shapes))
    coefficients = np.linalg.lstsq(fitted, deflection, rcond=None)[0]
    np.testing.assert_allclose(fitted @ coefficients, deflection, rtol=1e-9)
    assert (
        np.linalg.norm(reduction.basis @ np.linalg.lstsq(reduction.basis, deflection)[0] - deflection) > 1e-5
    )
    everything = craig_bampton(M, K, [22, 23], modes=22)
    assert static_shapes(K, everything.basis, [22, 23], load[:, None]).shape == (24, 0)


@pytest.mark.parametrize(
    ("interface", "modes", "words"),
    [
        ([7], 8, "modes is 8; allowed: 0 to 7"),
        ([7], -1, "allowed: 0 to 7"),
        ([7, 7], 1, "different indices"),
        ([8], 1, "indices from 0 to 7"),
    ],
)
def test_invalid_arguments_are_refused(interface, modes, words):
    with pytest.raises(ValueOutOfBoundsError, match=words):
        craig_bampton(*chain(8), interface, modes)


def test_rigid_body_mode_at_fixed_interface_is_refused():
    M, K = chain(8, held=False)
    assert null_space(K).shape[1] == 1
    with pytest.raises(MatricesError, match="add coordinates to the interface"):
        craig_bampton(M, K, [], modes=2)
    K[3:, :3] = K[:3, 3:] = 0.0
    K[2, 2] = K[3, 3] = 1.0
    with pytest.raises(MatricesError, match="has a rigid-body mode"):
        craig_bampton(M, K, [7], modes=2)


def test_mode_without_mass_is_refused():
    M, K = chain(4)
    M[0, 0] = M[1, 1] = 0.0
    assert craig_bampton(M, K, [3], modes=1).discarded == np.inf
    with pytest.raises(MatricesError, match="only 1 fixed-interface modes"):
        craig_bampton(M, K, [3], modes=2)
