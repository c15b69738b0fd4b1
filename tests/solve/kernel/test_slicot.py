"""Periodic Schur form of SLICOT: residuals, difficult eigenvalues, errors and threads."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from solve.kernel.slicot import periodic_schur, product_logarithms

EPS = np.finfo(float).eps


def residual(A):
    """Largest error of A_k Q_k = Q_{k+1} F_k, in units of the round-off of ‖A_k‖, and largest entry below the
    diagonals."""
    F, Q = periodic_schur(A)
    apart = np.linalg.norm(A @ Q - np.roll(Q, -1, axis=0) @ F, axis=(1, 2))
    unitary = np.abs(Q.conj().swapaxes(1, 2) @ Q - np.eye(A.shape[-1])).max()
    assert unitary <= 100 * EPS * A.shape[-1]
    return (apart / np.linalg.norm(A, axis=(1, 2))).max() / EPS, np.abs(np.tril(F, -1)).max()


@pytest.mark.parametrize(("N", "m"), [(1, 1), (1, 4), (2, 1), (2, 3), (5, 2), (8, 40), (24, 60)])
def test_periodic_schur_factors_reproduce_the_chain(N, m):
    error, below = residual(np.random.default_rng([N, m]).standard_normal((m, N, N)))
    assert error < 60
    assert below == 0.0


def test_product_of_scalars_has_its_logarithm():
    assert product_logarithms(np.array([[[2.0]], [[-3.0]]])) == pytest.approx([np.log(6.0) + 1j * np.pi])


@pytest.mark.parametrize("m", [1, 2, 9, 40])
def test_pairs_of_nearly_equal_eigenvalues_are_made_triangular(m):
    """Iterations with real shifts do not converge: SLICOT itself returns with INFO > 0."""
    rng = np.random.default_rng(m)
    for size in (2, 3, 4):
        core = np.diag(np.exp(rng.uniform(-1, 1, size)))
        core[0, 0], core[0, 1] = core[1, 1], 1.0
        S = rng.standard_normal((m, size, size)) + 3 * np.eye(size)
        A = np.roll(S, -1, axis=0) @ core @ np.linalg.inv(S)
        error, below = residual(A)
        assert error < 1e3
        assert below == 0.0
        logarithms = np.sort(product_logarithms(A).real)
        assert logarithms == pytest.approx(m * np.sort(np.log(np.diagonal(core))), abs=1e-5)


def test_residuals_of_singular_factors():
    """SLICOT's real iteration does not change some entries of such factors."""
    rng = np.random.default_rng(7)
    for _ in range(40):
        A = rng.standard_normal((3, 4, 1)) @ rng.standard_normal((3, 1, 4))
        A += 1e-16 * rng.standard_normal((3, 4, 4))
        assert residual(A)[0] < 60


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_entries_that_are_not_finite_are_refused(value):
    A = np.tile(np.eye(3), (4, 1, 1))
    A[2, 1, 0] = value
    for work in (periodic_schur, product_logarithms):
        with pytest.raises(np.linalg.LinAlgError, match="NaN or infinite"):
            work(A)


def test_threads_do_not_affect_each_other(capfd):
    chains = np.random.default_rng(8).standard_normal((16, 30, 12, 12))
    alone = [product_logarithms(chain) for chain in chains]
    with ThreadPoolExecutor(8) as pool:
        together = list(pool.map(product_logarithms, chains))
    assert all((a == b).all() for a, b in zip(alone, together, strict=True))
    assert capfd.readouterr() == ("", "")
