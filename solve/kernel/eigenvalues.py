"""Eigenvalues of many pencils λ²M + λC + K, computed by compiled code."""

import ctypes

import numpy as np

from solve.arguments import SMALL
from solve.arrays import Array
from solve.kernel.library import address, loaded


class _Problem(ctypes.Structure):
    """Structure `problem` of eigenvalues.c."""

    _fields_ = (("count", ctypes.c_long), ("entries", ctypes.c_void_p), ("values", ctypes.c_void_p))


def eigenvalues(pencils: Array, first_order: int = 0) -> Array | None:
    """Finite eigenvalues (…, 2n - first_order) of λ²M + λC + K. `pencils` (3, n, n, …) contains M, C and K.

    The last `first_order` columns of M are zero. Eigenvalues are NaN if the iteration does not converge.
    Return None if compiled code is not available, or if n is large."""
    n = pencils.shape[1]
    sizes = ("N", n), ("P", n - first_order)
    library = loaded("eigenvalues.c", sizes) if n <= SMALL else None
    if library is None:
        return None
    entries = np.ascontiguousarray(pencils)
    values = np.empty((2 * n - first_order, *pencils.shape[3:]), dtype=complex)
    problem = _Problem(values[0].size, address(entries), address(values))
    library.eigenvalues(ctypes.byref(problem))
    return values.transpose(*range(1, values.ndim), 0)
