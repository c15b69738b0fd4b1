"""Chains of affine maps with any number of right-hand sides, solved by compiled code."""

import ctypes

import numpy as np

from solve.arguments import SMALL
from solve.arrays import Array
from solve.kernel.library import address, loaded


class _Chain(ctypes.Structure):
    """Structure `problem` of chain.c."""

    _fields_ = (
        ("steps", ctypes.c_long),
        ("columns", ctypes.c_long),
        *((name, ctypes.c_void_p) for name in ("maps", "loads", "states", "condition")),
    )


def closed(A: Array, b: Array) -> tuple[Array, float] | None:
    """Solve the cyclic chain x_{k+1} = A_k x_k + b_k, x_m = x_0, with maps A (m, N, N) and loads b (m, N, r).

    Return the states x (m+1, N, r) and the condition number of the cyclic system, as
    `solve.period.period_map.periodic_states` does. Return None if compiled code is not available, or if
    numbers overflow.
    """
    m, N, r = b.shape
    x, condition = np.empty((m + 1, N, r)), np.empty(1)
    A, b = np.ascontiguousarray(A), np.ascontiguousarray(b)
    if not _called("closed", N, (m, r), A, b, x, condition):
        return None
    x[-1] = x[0]
    return (x, float(condition[0])) if np.isfinite(condition[0]) and np.isfinite(x).all() else None


def followed(A: Array, start: Array) -> Array | None:
    """States (m+1, N, r) of x_{k+1} = A_k x_k, from the first states `start` (N, r), which may be complex;
    None if compiled code is not available."""
    m, N, _ = A.shape
    kind = np.result_type(start, float)
    x = np.empty((m + 1, *start.shape), dtype=kind)
    x[0] = start
    numbers = x.view(float)
    A = np.ascontiguousarray(A)
    return x if _called("followed", N, (m, numbers.shape[-1]), A, numbers, numbers, numbers) else None


def _called(name: str, N: int, sizes: tuple[int, int], *arrays: Array) -> bool:
    library = loaded("chain.c", (("NX", N),)) if N <= 2 * SMALL else None
    if library is None:
        return False
    problem = _Chain(*sizes, *map(address, arrays))
    return getattr(library, name)(ctypes.byref(problem)) == 1
