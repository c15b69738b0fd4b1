"""Stage accelerations of the steps of one turn by collocation in compiled code."""

import ctypes
from collections.abc import Mapping

import numpy as np

from solve.arrays import Array
from solve.kernel.library import loaded

_MOST_ROWS = 64
"""Accelerations in a step beyond which LAPACK is as quick."""


class _Steps(ctypes.Structure):
    """`problem` of responses.c."""

    _fields_ = (
        ("steps", ctypes.c_long),
        *((name, ctypes.c_void_p) for name in ("h", "entries", "A", "A2", "c", "responses")),
    )


def responses(weights: Mapping[str, Array], h: Array, entries: Array, n: int) -> Array | None:
    """Stage accelerations (m, s n, 2n + s n), linear in q and q′ at the starts of steps of lengths h (m,) and
    in loads at their stages, from entries (m, s, 3n² + n) there. weights: the numbers of the method. None
    without compiled code."""
    m, s, _ = entries.shape
    library = loaded("responses.c", (("N", n), ("S", s))) if s * n <= _MOST_ROWS else None
    if library is None:
        return None
    made = np.empty((m, s * n, (s + 2) * n))
    arrays = {"h": h, "entries": entries, **{name: weights[name] for name in ("A", "A2", "c")}}
    arrays = {name: np.ascontiguousarray(each, dtype=float) for name, each in arrays.items()}
    addresses = {name: each.ctypes.data for name, each in {**arrays, "responses": made}.items()}
    return made if library.responses(ctypes.byref(_Steps(steps=m, **addresses))) else None
