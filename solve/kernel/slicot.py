"""Periodic Schur form by SLICOT (P. Benner et al., Applied and Computational Control, Signals, and Circuits 1
(1999) 499-539) through the package `ctrlsys`, which is not available on all platforms.

Of the two iterations in SLICOT, the complex one (mb03bz) is used. In version 1.1.1, the real one (mb03bd) did
not converge for cyclic permutations, nor for 768 steps of a beam structure with 54 states. It also left
entries unchanged in some chains of numerically singular factors."""

import numpy as np

from solve.arrays import Array
from solve.kernel.cyclic import triangular_bases


def available() -> bool:
    """Whether the package `ctrlsys` is installed and can be loaded."""
    try:
        import ctrlsys  # noqa: F401
    except ImportError:
        return False
    return True


def product_logarithms(A: Array) -> Array:
    """Logarithms log ρ (N,) of the eigenvalues of the product A_{m-1} … A_0 of real factors (m, N, N), in
    arbitrary order. The real part is -inf for an exact 0.

    Raises LinAlgError if the factors are not finite, or the iteration does not converge."""
    from ctrlsys import mb03bz

    H, _, _ = _hessenberg(A)
    N, _, m = H.shape
    _, _, values, _, exponents, failed = mb03bz("E", "N", m, N, 1, N, _signs(m), H)
    with np.errstate(divide="ignore"):
        if not failed and N > 1:
            return np.log(values) + np.log(2) * exponents
        return np.log(np.diagonal(periodic_schur(A)[0], axis1=1, axis2=2)).sum(axis=0)


def periodic_schur(A: Array) -> tuple[Array, Array]:
    """Return upper triangular F_k = Q_{k+1}ᴴ A_k Q_k and unitary Q_k with Q_m = Q_0, for real factors A_k.
    All are (m, N, N). Raises LinAlgError under the same conditions as `product_logarithms`."""
    from ctrlsys import mb03bz, mb03vy

    H, reflections, tau = _hessenberg(A)
    N, _, m = H.shape
    if N == 1:
        # For 1×1 factors, mb03bz returns the factor 1.
        return A.astype(complex), np.ones(A.shape, dtype=complex)
    Q, failed = mb03vy(N, m, 1, N, reflections, tau)
    _check(failed, "mb03vy")
    Q = np.asfortranarray(Q, dtype=complex)
    for _ in range(N):
        H, Q, _, _, _, failed = mb03bz("S", "V", m, N, 1, N, _signs(m), H, Q)
        if not failed:
            break
        _split(H, Q, failed - 2)
    _check(failed, "mb03bz")
    # SLICOT numbers factors in reverse order, and its bases belong to the ends of the factors.
    return _factors(H)[::-1], np.roll(_factors(Q)[::-1], 1, axis=0)


def _split(H: Array, Q: Array, at: int) -> None:
    """Triangularise in place the 2×2 block in rows `at` and `at` + 1 of factors (N, N, m).

    SLICOT's iteration does not converge if two eigenvalues are nearly equal and round-off has made them
    complex."""
    if at < 0 or (at > 0 and H[at, at - 1, 0] != 0):
        _check(at + 2, "mb03bz")
    factors, bases, two = np.moveaxis(H, -1, 0), np.moveaxis(Q, -1, 0), slice(at, at + 2)
    U = np.roll(triangular_bases(factors[::-1, two, two])[::-1], 1, axis=0)
    factors[:, :, two] = factors[:, :, two] @ np.roll(U, -1, axis=0)
    factors[:, two] = U.conj().swapaxes(1, 2) @ factors[:, two]
    factors[:, at + 1, at] = 0.0
    bases[:, :, two] = bases[:, :, two] @ U


def _hessenberg(A: Array) -> tuple[Array, Array, Array]:
    """Reverse the chain and reduce it to complex Hessenberg-triangular form (N, N, m). Return it with the
    reflections of the reduction."""
    from ctrlsys import mb03vd

    # SLICOT does not terminate if entries are infinite.
    if not np.isfinite(A).all():
        raise np.linalg.LinAlgError("factors of a product have NaN or infinite entries")
    m, N, _ = A.shape
    # The transpose of this C-ordered copy has the shape (N, N, m) and Fortran order.
    reversed_ = np.ascontiguousarray(A[::-1].swapaxes(1, 2), dtype=float).T
    reflections, tau, failed = mb03vd(N, m, 1, N, reversed_)
    _check(failed, "mb03vd")
    H = np.asfortranarray(reflections, dtype=complex)
    H[(*np.tril_indices(N, -1), slice(1, None))] = 0.0
    H[(*np.tril_indices(N, -2), 0)] = 0.0
    return H, reflections, tau


def _signs(m: int) -> Array:
    return np.ones(m, dtype=np.int32)


def _check(failed: int, routine: str) -> None:
    if failed:
        raise np.linalg.LinAlgError(f"SLICOT's {routine} ended with INFO = {failed}")


def _factors(chain: Array) -> Array:
    """Rearrange a chain (N, N, m) as factors (m, N, N)."""
    return np.ascontiguousarray(np.moveaxis(chain, -1, 0))
