"""The array type of this package: NumPy, float64 unless a docstring says complex."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]


def whole(chosen: Array, count: int) -> bool:
    """Whether positions (k,), or a mask, choose all of so many points in their order: nothing to copy."""
    if len(chosen) != count:
        return False
    return bool(chosen.all() if chosen.dtype == bool else (chosen == np.arange(count)).all())


def solved(A: Array, b: Array) -> Array:
    """x of A x = b for matrices A (…, n, n) and b (…, n, k); NaN where A is singular."""
    try:
        return np.linalg.solve(A, b)
    except np.linalg.LinAlgError:
        regular = np.linalg.slogdet(A)[0] != 0
        x = np.linalg.solve(np.where(regular[..., None, None], A, np.eye(A.shape[-1])), b)
        return np.where(regular[..., None, None], x, np.nan)
