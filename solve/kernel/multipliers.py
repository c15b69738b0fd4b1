"""Eigenvalues of many monodromy matrices in compiled code, and their conditions."""

import ctypes
from typing import NamedTuple

import numpy as np

from solve.arguments import SMALL
from solve.arrays import Array
from solve.kernel.library import addresses, loaded


class _Problem(ctypes.Structure):
    """`problem` of multipliers.c."""

    _fields_ = (
        ("count", ctypes.c_long),
        *(
            (name, ctypes.c_void_p)
            for name in ("matrices", "units", "values", "sizes", "norms", "conditions")
        ),
    )


class Found(NamedTuple):
    """values (P, N): eigenvalues, falling in modulus, of a conjugate pair that with + imaginary part first;
    NaN where they are not found. sizes (P,): Frobenius' norms of the balanced matrices, of two rows the least
    in any units."""

    values: Array
    sizes: Array


class Conditioned(NamedTuple):
    """The same, and norms (P,): spectral norms of the balanced matrices. conditions (P, N): condition numbers
    of the eigenvalues of these."""

    values: Array
    sizes: Array
    norms: Array
    conditions: Array


def eigenvalues(matrices: Array, units: Array | None) -> Found | None:
    """Of finite matrices (P, N, N), of even N; units (P, N): powers of 2 in which those of more than two rows
    are balanced. None without compiled code, and where N is large or units are missing."""
    P, N, _ = matrices.shape
    made = Found(np.empty((P, N), dtype=complex), np.empty(P))
    return made if _written(matrices, units, made._asdict()) else None


def conditioned(matrices: Array, units: Array | None) -> Conditioned | None:
    """The same with the conditions."""
    P, N, _ = matrices.shape
    made = Conditioned(np.empty((P, N), dtype=complex), np.empty(P), np.empty(P), np.empty((P, N)))
    return made if _written(matrices, units, made._asdict()) else None


def _written(matrices: Array, units: Array | None, results: dict[str, Array]) -> bool:
    """Whether there is a library that has written the results."""
    N = matrices.shape[-1]
    if N > 2 * SMALL or (N > 2 and units is None):
        return False
    library = loaded("multipliers.c", (("N", N // 2),))
    if library is None:
        return False
    given = {"matrices": np.ascontiguousarray(matrices), **results}
    if units is not None and N > 2:
        given["units"] = np.ascontiguousarray(units)
    library.multipliers(ctypes.byref(_Problem(len(matrices), **addresses(given))))
    return True
