"""Formulas of generated models in compiled code: values at phases, and figures over one turn of curves and of
formulas of these, for many points."""

import ctypes
import logging
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path

import numpy as np

from solve.arrays import Array
from solve.kernel.compiler import CompilerError, compiled
from solve.kernel.library import INSTEAD
from solve.system import Formulas

_LOGGER = logging.getLogger(__name__)
_FOLDER = Path(__file__).parent
_FIGURES = 7


class _Turn(ctypes.Structure):
    """`problem` of figures.c."""

    _fields_ = (
        *((name, ctypes.c_long) for name in ("points", "steps", "samples")),
        *((name, ctypes.c_int) for name in ("wanted", "zooms", "around")),
        ("period", ctypes.c_double),
        *((name, ctypes.c_void_p) for name in ("quantity", "curves", "speeds", "parameters", "parts")),
        ("figures", ctypes.c_void_p),
    )


class _Phases(ctypes.Structure):
    """`problem` of pointwise.c."""

    _fields_ = (
        *((name, ctypes.c_long) for name in ("points", "phases")),
        *((name, ctypes.c_void_p) for name in ("phase", "speeds", "parameters", "values")),
    )


class _States(ctypes.Structure):
    """`problem` of states.c."""

    _fields_ = (
        ("phases", ctypes.c_long),
        ("speed", ctypes.c_double),
        *((name, ctypes.c_void_p) for name in ("phase", "states", "parameters", "values")),
    )


@lru_cache
def _library(source: str, sizes: tuple[tuple[str, int], ...], text: str) -> ctypes.CDLL | None:
    """None where there is none; a line of the logger says why."""
    try:
        return compiled(_FOLDER / source, dict(sizes), text)
    except CompilerError as error:
        _LOGGER.warning("%s; %s", error, INSTEAD)
        return None


def _addresses(arrays: Mapping[str, Array]) -> dict[str, int]:
    return {name: each.ctypes.data for name, each in arrays.items()}


def values(formulas: Formulas, phase: Array, speeds: Array) -> Array | None:
    """Formulas of phase and speed at phases (k,) and speeds (P,) with values (P, p) of their parameters:
    (P, k, outputs); None without compiled code."""
    parameters = np.ascontiguousarray(formulas.values, dtype=float)
    sizes = ("OUTPUTS", formulas.outputs), ("PARAMETERS", parameters.shape[1])
    library = _library("pointwise.c", sizes, formulas.text)
    if library is None:
        return None
    made = np.empty((len(speeds), len(phase), formulas.outputs))
    given = {"phase": phase, "speeds": speeds, "parameters": parameters, "values": made}
    arrays = {name: np.ascontiguousarray(each, dtype=float) for name, each in given.items()}
    problem = _Phases(points=len(speeds), phases=len(phase), **_addresses(arrays))
    library.pointwise(ctypes.byref(problem))
    return made


def at_states(formulas: Formulas, phase: Array, speed: float, states: Array) -> Array | None:
    """Formulas of phase, speed and a state at phases (k,), a speed and states (3, n, k): (k, outputs); None
    without compiled code."""
    sizes = ("N", states.shape[1]), ("OUTPUTS", formulas.outputs), ("PARAMETERS", len(formulas.values))
    library = _library("states.c", sizes, formulas.text)
    if library is None:
        return None
    made = np.empty((len(phase), formulas.outputs))
    given = {"phase": phase, "states": states, "parameters": formulas.values, "values": made}
    arrays = {name: np.ascontiguousarray(each, dtype=float) for name, each in given.items()}
    problem = _States(phases=len(phase), speed=speed, **_addresses(arrays))
    library.at_states(ctypes.byref(problem))
    return made


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
    parameters = np.zeros((points, 0)) if formulas is None else formulas.values
    text, outputs = ("", 0) if formulas is None else formulas[:2]
    sizes = ("N", n), ("D", D), ("OUTPUTS", outputs), ("PARAMETERS", parameters.shape[1])
    library = _library("figures.c", sizes, text)
    if library is None:
        return None
    made = np.zeros((points, len(wanted), _FIGURES))
    given = {"curves": curves, "speeds": speeds, "parameters": parameters, "parts": parts, "figures": made}
    arrays = {name: np.ascontiguousarray(each, dtype=float) for name, each in given.items()}
    arrays["quantity"] = np.ascontiguousarray(wanted, dtype=np.intc)
    numbers = {"points": points, "steps": m, "samples": samples, "wanted": len(wanted)}
    problem = _Turn(**numbers, zooms=zooms, around=len(parts), period=period, **_addresses(arrays))
    return None if library.turn(ctypes.byref(problem)) else made
