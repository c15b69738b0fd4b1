"""Eigenvalues of many monodromy matrices, and their condition numbers, computed by compiled code."""

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


class Conditioned(NamedTuple):
    """Eigenvalues and condition numbers of P matrices.

    values (P, N): eigenvalues in order of decreasing modulus, positive imaginary part first; NaN if the
    iteration does not converge. sizes (P,): Frobenius norms of the balanced matrices; for a 2×2 matrix, the
    smallest norm over all units of the states. norms (P,): spectral norms of the balanced matrices.
    conditions (P, N): condition numbers of the eigenvalues."""

    values: Array
    sizes: Array
    norms: Array
    conditions: Array


def conditioned(matrices: Array, units: Array | None) -> Conditioned | None:
    """Compute the eigenvalues of finite matrices (P, N, N), and their condition numbers.

    units (P, N): powers of 2 that balance the matrices; required if N > 2. Return None if compiled code is
    not available, if required units are missing, or if N is large."""
    P, N, _ = matrices.shape
    if N > 2 * SMALL or (N > 2 and units is None):
        return None
    library = loaded("multipliers.c", (("NX", N),))
    if library is None:
        return None
    given = {"matrices": np.ascontiguousarray(matrices)}
    if units is not None and N > 2:
        given["units"] = np.ascontiguousarray(units)
    result = Conditioned(np.empty((P, N), dtype=complex), np.empty(P), np.empty(P), np.empty((P, N)))
    library.multipliers(ctypes.byref(_Problem(P, **addresses({**given, **result._asdict()}))))
    return result
