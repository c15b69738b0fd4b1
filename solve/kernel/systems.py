"""Many small systems of linear equations in compiled code."""

import ctypes

import numpy as np

from solve.arrays import Array, solved
from solve.kernel.library import loaded


class _Systems(ctypes.Structure):
    """`problem` of systems.c."""

    _fields_ = (
        ("count", ctypes.c_long),
        *((name, ctypes.c_void_p) for name in ("systems", "solutions", "unsure")),
    )


def solved_together(A: Array, b: Array) -> Array:
    """x of A x = b for matrices A (…, n, n) and b (…, n, k); NaN where A is singular. Neighbouring matrices
    exchange their rows alike; those for which that will not do are solved by LAPACK."""
    *shape, n, k = b.shape
    library = loaded("systems.c", (("R", n), ("C", k)))
    if library is None:
        return solved(A, b)
    systems = np.ascontiguousarray(np.concatenate((A, b), axis=-1).reshape(-1, n, n + k))
    solutions, unsure = np.empty((len(systems), n, k)), np.empty(len(systems), dtype=np.intc)
    given = {"systems": systems, "solutions": solutions, "unsure": unsure}
    addresses = {name: each.ctypes.data for name, each in given.items()}
    library.systems(ctypes.byref(_Systems(count=len(systems), **addresses)))
    at = np.flatnonzero(unsure)
    if len(at):
        solutions[at] = solved(systems[at, :, :n], systems[at, :, n:])
    return solutions.reshape(*shape, n, k)
