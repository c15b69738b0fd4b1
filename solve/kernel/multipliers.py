"""Eigenvalues of many monodromy matrices, and their condition numbers, by compiled code."""

import ctypes
from typing import NamedTuple

import numpy as np

from solve.arguments import SMALL
from solve.arrays import Array
from solve.kernel.library import addresses, loaded


class _Problem(ctypes.Structure):
    """Structure `problem` of multipliers.c."""

    _fields_ = (
        ("count", ctypes.c_long),
        *(
            (name, ctypes.c_void_p)
            for name in ("matrices", "units", "values", "sizes", "norms", "conditions")
        ),
    )


class Eigenvalues(NamedTuple):
    """Eigenvalues of matrices.

    values (P, N): in order of decreasing modulus, + imaginary part first; NaN without convergence. sizes
    (P,): Frobenius norms of the balanced matrices, for two rows the smallest in any units."""

    values: Array
    sizes: Array


class EigenvaluesWithConditions(NamedTuple):
    """Eigenvalues and condition numbers of matrices.

    values and sizes as in `Eigenvalues`. norms (P,): spectral norms of the balanced matrices. conditions
    (P, N): condition numbers of their eigenvalues."""

    values: Array
    sizes: Array
    norms: Array
    conditions: Array


def eigenvalues(matrices: Array, units: Array | None) -> Eigenvalues | None:
    """Eigenvalues of finite matrices (P, N, N).

    units (P, N): powers of 2 that balance matrices of more than two rows. None without compiled code, for
    large N and without units."""
    P, N, _ = matrices.shape
    made = Eigenvalues(np.empty((P, N), dtype=complex), np.empty(P))
    return made if _written(matrices, units, made._asdict()) else None


def eigenvalues_with_conditions(matrices: Array, units: Array | None) -> EigenvaluesWithConditions | None:
    """Eigenvalues of finite matrices (P, N, N), and condition numbers of the eigenvalues."""
    P, N, _ = matrices.shape
    made = EigenvaluesWithConditions(
        np.empty((P, N), dtype=complex), np.empty(P), np.empty(P), np.empty((P, N))
    )
    return made if _written(matrices, units, made._asdict()) else None


def _written(matrices: Array, units: Array | None, results: dict[str, Array]) -> bool:
    """Compute the results if a library is available. Returns whether they were written."""
    N = matrices.shape[-1]
    if N > 2 * SMALL or (N > 2 and units is None):
        return False
    library = loaded("multipliers.c", (("NX", N),))
    if library is None:
        return False
    given = {"matrices": np.ascontiguousarray(matrices), **results}
    if units is not None and N > 2:
        given["units"] = np.ascontiguousarray(units)
    library.multipliers(ctypes.byref(_Problem(len(matrices), **addresses(given))))
    return True
