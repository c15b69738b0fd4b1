"""Figures over one turn of many curves, and of formulas of these, in compiled code."""

import ctypes
import logging
from functools import lru_cache
from pathlib import Path

import numpy as np

from solve.arrays import Array
from solve.kernel.compiler import CompilerError, compiled
from solve.kernel.library import INSTEAD
from solve.system import Formulas

_LOGGER = logging.getLogger(__name__)
_SOURCE = Path(__file__).with_name("figures.c")
_FIGURES = 7


class _Problem(ctypes.Structure):
    """`problem` of figures.c."""

    _fields_ = (
        *((name, ctypes.c_long) for name in ("points", "steps", "samples")),
        *((name, ctypes.c_int) for name in ("wanted", "zooms", "around")),
        ("period", ctypes.c_double),
        *((name, ctypes.c_void_p) for name in ("quantity", "curves", "speeds", "parameters", "parts")),
        ("figures", ctypes.c_void_p),
    )


@lru_cache
def _library(n: int, powers: int, outputs: int, parameters: int, text: str) -> ctypes.CDLL | None:
    """None where there is none; a line of the logger says why."""
    try:
        sizes = {"N": n, "D": powers, "OUTPUTS": outputs, "PARAMETERS": parameters}
        return compiled(_SOURCE, sizes, text)
    except CompilerError as error:
        _LOGGER.warning("%s; %s", error, INSTEAD)
        return None


def figures(
    curves: Array,
    period: float,
    speeds: Array,
    samples: int,
    parts: Array,
    zooms: int,
    wanted: Array,
    formulas: Formulas | None = None,
) -> Array | None:
    """Figures (P, k, 7) of the `wanted` quantities (k,), coordinates and behind them formulas, in the order
    of `solve.statistics.Statistics`; None without compiled code or memory.

    curves (P, n, m, D): of equal steps, powers of θ, lowest first; speeds (P,) in rad/s; samples: of a step;
    zooms: narrowings of an extremum to a sixteenth, each by values at these `parts` of its surroundings.
    formulas: with values (P, p) of their parameters.
    """
    points, n, m, D = curves.shape
    values = np.zeros((points, 0)) if formulas is None else formulas.values
    text, outputs = ("", 0) if formulas is None else formulas[:2]
    library = _library(n, D, outputs, values.shape[1], text)
    if library is None:
        return None
    made = np.zeros((points, len(wanted), _FIGURES))
    given = {"curves": curves, "speeds": speeds, "parameters": values, "parts": parts, "figures": made}
    arrays = {name: np.ascontiguousarray(each, dtype=float) for name, each in given.items()}
    arrays["quantity"] = np.ascontiguousarray(wanted, dtype=np.intc)
    pointers = {name: each.ctypes.data for name, each in arrays.items()}
    numbers = {"points": points, "steps": m, "samples": samples, "wanted": len(wanted)}
    problem = _Problem(**numbers, zooms=zooms, around=len(parts), period=period, **pointers)
    return None if library.turn(ctypes.byref(problem)) else made
