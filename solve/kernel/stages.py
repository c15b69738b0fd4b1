"""Stage systems of the collocation steps of one period, solved by compiled code."""

import ctypes
from collections.abc import Mapping
from typing import Any

import numpy as np

from solve.arrays import Array
from solve.kernel.collocation import Samples
from solve.kernel.formulas import WIDEST
from solve.kernel.library import address, addresses, loaded

_MOST_ROWS = 64
"""Number of stage accelerations per step above which compiled code is not faster than LAPACK."""


_NUMBERS = "A", "A2", "b", "bA", "c"


class _Steps(ctypes.Structure):
    """Structure `problem` of stages.c."""

    _fields_ = (
        ("steps", ctypes.c_long),
        ("columns", ctypes.c_long),
        ("h", ctypes.c_void_p),
        ("terms", ctypes.c_long),
        ("between", ctypes.c_long),
        *((name, ctypes.c_void_p) for name in ("entry", "table", "coefficients", *_NUMBERS)),
        *((name, ctypes.c_void_p) for name in ("factors", "order", "by_state", "maps", "given", "found")),
    )


class FactorisedStages:
    """Factorised stage systems of m steps.

    by_state (m, s n, 2n): accelerations at the stages per unit of q and q′ at the start of the step. maps (m,
    2n, 2n): maps from the start to the end of each step, without loads."""

    def __init__(
        self, library: Any, weights: Mapping[str, Array], h: Array, samples: Samples, stages: slice, n: int
    ):
        """Factorise the systems. Raises MemoryError."""
        m, rows = len(h), len(weights["c"]) * n
        self._library = library
        self.by_state, self.maps = np.empty((m, rows, 2 * n)), np.empty((m, 2 * n, 2 * n))
        table = np.ascontiguousarray(samples.table).reshape(m, -1, len(samples.entry))
        given = {"h": h, "coefficients": samples.coefficients, **{name: weights[name] for name in _NUMBERS}}
        self._arrays = {name: np.ascontiguousarray(each, dtype=float) for name, each in given.items()}
        self._arrays |= {
            "table": table[:, stages],
            "entry": np.ascontiguousarray(samples.entry, dtype=np.intc),
            "factors": np.empty((m + WIDEST, rows, rows)),
            "order": np.empty((m + WIDEST, rows), dtype=np.int64),
            "by_state": self.by_state,
            "maps": self.maps,
        }
        sizes = {"steps": m, "terms": table.shape[2], "between": table.shape[1] * table.shape[2]}
        self._problem = _Steps(**sizes, **addresses(self._arrays))
        if not library.factorised(ctypes.byref(self._problem)):
            raise MemoryError(f"not enough memory for stage systems of {n} coordinates")

    def solved(self, loads: Array) -> Array:
        """Accelerations at the stages due to loads at the stages, both (m, s n, r). Each step starts from
        rest."""
        return self._called(self._library.solved, loads)

    def pulled(self, weights: Array) -> Array:
        """Gradients (m, s n, r) of r weighted sums of the stage accelerations, with respect to the loads at
        the stages. `weights` (m, s n, r) contains the weights of the sums."""
        return self._called(self._library.pulled, weights)

    def _called(self, solve: Any, given: Array) -> Array:
        given = np.ascontiguousarray(given, dtype=float)
        found, problem = np.empty(given.shape), _Steps.from_buffer_copy(self._problem)
        problem.columns, problem.given, problem.found = given.shape[-1], address(given), address(found)
        solve(ctypes.byref(problem))
        return found


def factorised(
    weights: Mapping[str, Array], h: Array, samples: Samples, stages: slice, n: int
) -> FactorisedStages | None:
    """Factorise the stage systems of one point for steps of lengths h (m,).

    weights: coefficients of the method. samples: samples at k phases per step. stages: indices of the stages
    among these k phases. Return None if compiled code is not available. Raises MemoryError."""
    s = len(weights["c"])
    library = loaded("stages.c", (("N", n), ("S", s))) if s * n <= _MOST_ROWS else None
    return None if library is None else FactorisedStages(library, weights, h, samples, stages, n)
