"""Craig–Bampton reduction of an elastic body from its matrices.

R. R. Craig, M. C. C. Bampton, Coupling of substructures for dynamic analyses, AIAA J. 6 (1968) 1313-1319.

The coordinates q of a body consist of interface coordinates b, which are retained, and interior coordinates
i:

    q = T p,   q_b = p_b,   q_i = Ψ p_b + Φ η,   Ψ = −K_ii⁻¹ K_ib

Φ contains the lowest modes of K_ii and M_ii, that is, of the body with fixed interface. If all modes are
retained, T is invertible."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from solve.arrays import ROUND_OFF, Array
from solve.errors import MatricesError, ValueOutOfBoundsError

_DEPENDENT = 1e-10
"""Singular value, relative to the largest one in the energy norm, below which static responses are linearly
dependent. Measured for links of 3 to 30 elements with 1 to 15 modes: up to 1e-13 for dependent responses,
3e-7 or more for independent ones."""


@dataclass(frozen=True)
class CraigBampton:
    """Reduced body: matrices and basis.

    Parameters
    ----------
    basis : (n, r) array
        T. The first columns belong to the interface coordinates in their given order, the others to the
        modes, with ΦᵀM Φ = I.
    mass, stiffness : (r, r) arrays
        TᵀM T and TᵀK T.
    frequencies : (k,) array
        Frequencies of the retained modes in rad/s, ascending.
    discarded : float
        Lowest frequency of the discarded modes in rad/s; infinite if no mode is discarded.
    """

    basis: Array
    mass: Array
    stiffness: Array
    frequencies: Array
    discarded: float


def craig_bampton(M: Array, K: Array, interface: Sequence[int] | Array, modes: int) -> CraigBampton:
    """Reduce a body to its interface coordinates and its lowest fixed-interface modes.

    Parameters
    ----------
    M, K : (n, n) arrays
        Symmetric matrices; K positive definite with the interface fixed.
    interface : sequence of int
        Indices of the retained coordinates. If empty, the basis consists of modes only.
    modes : int
        Number of retained modes, from 0 to the number of interior coordinates.

    Raises
    ------
    ValueOutOfBoundsError
        If the number of modes is invalid, or an index is out of range or repeated.
    MatricesError
        If the body has a rigid-body mode with its interface fixed, or a retained mode has no mass.

    Examples
    --------
    A chain of three unit masses and springs, fixed at one end:

    >>> K = np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
    >>> reduced = craig_bampton(np.eye(3), K, interface=[2], modes=1)
    >>> reduced.basis.shape, reduced.frequencies.round(6), round(reduced.discarded, 6)
    ((3, 2), array([1.]), 1.732051)
    """
    n = len(M)
    retained = np.array(interface, dtype=int)
    if len(np.unique(retained)) < len(retained) or not ((retained >= 0) & (retained < n)).all():
        raise ValueOutOfBoundsError(
            f"interface is {[*interface]}; allowed: different indices from 0 to {n - 1}"
        )
    inner = np.setdiff1d(np.arange(n), retained)
    if not 0 <= modes <= len(inner):
        raise ValueOutOfBoundsError(f"modes is {modes}; allowed: 0 to {len(inner)} for this body")
    basis = np.zeros((n, len(retained) + modes))
    basis[retained, np.arange(len(retained))] = 1.0
    basis[inner, : len(retained)] = -_flexible(K, inner, K[np.ix_(inner, retained)])
    frequencies, discarded = np.zeros(0), np.inf
    if len(inner):
        squares, shapes = _lowest(M[np.ix_(inner, inner)], K[np.ix_(inner, inner)], modes)
        basis[inner, len(retained) :] = shapes
        frequencies = np.sqrt(squares[:modes])
        discarded = float(np.sqrt(squares[modes])) if modes < len(inner) else np.inf
    return CraigBampton(basis, _projected(M, basis), _projected(K, basis), frequencies, discarded)


def static_shapes(K: Array, basis: Array, interface: Sequence[int] | Array, loads: Array) -> Array:
    """Compute static responses of a body to loads, without their components in the span of a basis.

    Parameters
    ----------
    K : (n, n) array
        Symmetric stiffness matrix.
    basis : (n, r) array
        Matrix T of `craig_bampton` for the same interface.
    loads : (n, c) array
        Forces on the coordinates. Forces on the interface have no effect, because the interface is fixed.

    Returns
    -------
    (n, s) array
        Independent shapes, s ≤ c. They are zero on the interface, and K-orthogonal to the basis and to each
        other. They represent the contribution of all discarded modes at low frequency
        (residual flexibility: R. H. MacNeal, Computers & Structures 1 (1971) 581).
    """
    inner = np.setdiff1d(np.arange(len(K)), interface)
    modes, stiffness = basis[inner, len(interface) :], K[np.ix_(inner, inner)]
    responses = _flexible(K, inner, loads[inner])
    responses = responses[:, responses.any(axis=0)]
    root = np.linalg.cholesky(stiffness).T
    responses = responses / np.linalg.norm(root @ responses, axis=0)
    # ΦᵀK Φ is diagonal. The second pass removes the round-off of the first pass.
    squares = np.einsum("ij,ij->j", modes, stiffness @ modes)
    for _ in range(2):
        responses = responses - (modes / squares) @ (modes.T @ stiffness @ responses)
    _, sizes, vectors = np.linalg.svd(root @ responses, full_matrices=False)
    strong = (sizes > _DEPENDENT) & (np.arange(len(sizes)) < len(inner) - modes.shape[1])
    shapes = np.zeros((len(K), int(strong.sum())))
    shapes[inner] = responses @ (vectors[strong].T / sizes[strong])
    return shapes


def _projected(A: Array, basis: Array) -> Array:
    product = basis.T @ A @ basis
    return (product + product.T) / 2


def _flexible(K: Array, inner: Array, loads: Array) -> Array:
    """Static responses K_ii⁻¹ f to c loads f (i, c). Raises MatricesError if K_ii is not positive
    definite."""
    from scipy.linalg import cho_factor, cho_solve

    stiffness = K[np.ix_(inner, inner)]
    try:
        factor = cho_factor(stiffness) if len(inner) else None
        # Measured ratios: up to 5e-15 for free chains of 8 to 500 masses, 7e-3 or more for links of up to 100
        # elements with fixed ends.
        free = factor is not None and (np.diag(factor[0]) ** 2 < ROUND_OFF * np.diag(stiffness)).any()
    except np.linalg.LinAlgError:
        free, factor = True, None
    if free:
        raise MatricesError(
            "a body has a rigid-body mode with its interface fixed: K of its interior coordinates is not "
            "positive definite; add coordinates to the interface"
        )
    return np.zeros(loads.shape) if factor is None else cho_solve(factor, loads)


def _lowest(M: Array, K: Array, modes: int) -> tuple[Array, Array]:
    """Return the squared frequencies ω² of the lowest modes and of the next mode, and the shapes of the
    lowest modes with ΦᵀMΦ = I.

    The eigenvalues 1/ω² of the pencil M − (1/ω²) K are computed. Low frequencies then remain accurate for any
    stiffness of the highest modes."""
    from scipy.linalg import eigh

    i = len(K)
    first_and_last = [i - min(modes + 1, i), i - 1]
    values, vectors = eigh(M, K, subset_by_index=first_and_last)
    values, vectors = values[::-1], vectors[:, ::-1]
    if (values[:modes] <= 0).any():
        raise MatricesError(
            f"only {int((values > 0).sum())} fixed-interface modes of a body have mass; retain fewer modes"
        )
    with np.errstate(divide="ignore"):
        squares = np.where(values > 0, 1 / values, np.inf)
    return squares, vectors[:, :modes] / np.sqrt(values[:modes])
