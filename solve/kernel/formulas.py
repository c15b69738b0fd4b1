"""Evaluation of the formulas of generated models by compiled code.

The functions return values at phases for many points, values for columns of inputs, and statistics over one
period for curves and for formulas along curves."""

import ctypes
from collections.abc import Sequence

import numpy as np

from solve.arrays import Array
from solve.contracts import Columns, Formulas
from solve.kernel.engines import COMPILED
from solve.kernel.library import addresses, loaded

_FIGURES = 7
WIDEST = 8
"""Largest number of values per vector register."""


class _Turn(ctypes.Structure):
    """Structure `problem` of figures.c."""

    _fields_ = (
        *((name, ctypes.c_long) for name in ("points", "steps", "samples")),
        *((name, ctypes.c_int) for name in ("wanted", "zooms", "rough", "around")),
        *((name, ctypes.c_double) for name in ("period", "tie")),
        *((name, ctypes.c_void_p) for name in ("quantity", "curves", "speeds", "parameters", "parts")),
        ("figures", ctypes.c_void_p),
    )


class _Phases(ctypes.Structure):
    """Structure `problem` of pointwise.c."""

    _fields_ = (
        *((name, ctypes.c_long) for name in ("points", "phases")),
        *((name, ctypes.c_void_p) for name in ("phase", "speeds", "parameters", "values")),
    )


class _Columns(ctypes.Structure):
    """Structure `problem` of columns.c."""

    _fields_ = (
        ("columns", ctypes.c_long),
        *((name, ctypes.c_void_p) for name in ("first", "given", "shared", "values")),
        ("sums", ctypes.c_long),
        *((name, ctypes.c_void_p) for name in ("row", "weights")),
    )


def values(formulas: Formulas, phase: Array, speeds: Array) -> Array | None:
    """Values (P, k, outputs) of formulas at phases (k,) and speeds (P,), with parameters (P, p); None if
    compiled code is not available."""
    parameters = np.ascontiguousarray(formulas.values, dtype=float)
    sizes = ("OUTPUTS", formulas.outputs), ("PARAMETERS", parameters.shape[1])
    library = loaded("pointwise.c", sizes, formulas.text)
    if library is None:
        return None
    result = np.empty((len(speeds), len(phase), formulas.outputs))
    given = {"phase": phase, "speeds": speeds, "parameters": parameters, "values": result}
    arrays = {name: np.ascontiguousarray(each, dtype=float) for name, each in given.items()}
    problem = _Phases(points=len(speeds), phases=len(phase), **addresses(arrays))
    library.pointwise(ctypes.byref(problem))
    return result


def columns(
    formulas: Formulas, inputs: Sequence[Array], along: tuple[Array, Array] | None = None
) -> Array | None:
    """Values (outputs, k) of formulas for k columns of inputs, with parameters (p,); None if compiled code is
    not available.

    along: pair of indices (outputs,) and weights (rows, c, k). For each output, the index selects a row of
    weights. With `along`, weighted sums (outputs, c) of the values are returned.
    """
    widths, count = [len(each) for each in inputs], inputs[0].shape[-1]
    rows, shared = sum(widths), np.ascontiguousarray(formulas.values, dtype=float)
    sizes = ("INPUTS", len(inputs)), ("ROWS", rows), ("SHARED", len(shared)), ("OUTPUTS", formulas.outputs)
    library = loaded("columns.c", sizes, formulas.text)
    if library is None:
        return None
    padded = np.empty((rows, -(-count // WIDEST) * WIDEST))
    np.concatenate(inputs, out=padded[:, :count])
    padded[:, count:] = padded[:, count - 1 : count]
    first, width = np.cumsum([0, *widths[:-1]], dtype=np.intc), padded.shape[-1]
    result = np.empty((formulas.outputs, width if along is None else along[1].shape[1]))
    arrays = {"first": first, "given": padded, "shared": shared, "values": result}
    if along is None:
        library.columns(ctypes.byref(_Columns(columns=width, **addresses(arrays))))
        return result[:, :count]
    weights = np.zeros((*along[1].shape[:2], width))
    weights[..., :count] = along[1]
    arrays |= {"row": np.ascontiguousarray(along[0], dtype=np.intc), "weights": weights}
    problem = _Columns(columns=width, sums=result.shape[-1], **addresses(arrays))
    return result if library.sums(ctypes.byref(problem)) else None


def columns_by(engine: str) -> Columns | None:
    """Return the function `columns` for the engine COMPILED, and None for the engine NUMPY."""
    return columns if engine == COMPILED else None


def figures(
    curves: Array,
    period: float,
    speeds: Array,
    samples: int,
    parts: Array,
    zooms: tuple[int, int],
    tie: float,
    wanted: Array,
    formulas: Formulas | None = None,
) -> Array | None:
    """Statistics (P, k, 7) of selected quantities, in the order of `solve.contracts.Statistics`. Return None
    if compiled code is not available, or if memory is insufficient.

    curves (P, n, m, D): coefficients on equal steps, lowest power of θ first. speeds (P,): speeds in rad/s.
    samples: number of samples per step. parts: at least 8 ascending fractions of the interval around an
    extremum; each refinement computes values there. zooms: number of refinements of an extremum, and number
    of refinements of a sample that may be near a larger one. Each refinement reduces the interval to a
    sixteenth. tie: relative difference above which extrema are distinct. wanted (k,): indices of the
    quantities; coordinates are counted first, then formulas. formulas: formulas with the values (P, p) of
    their parameters."""
    points, n, m, D = curves.shape
    parameters = np.zeros((points, 0)) if formulas is None else formulas.values
    text, outputs = ("", 0) if formulas is None else formulas[:2]
    sizes = ("N", n), ("D", D), ("OUTPUTS", outputs), ("PARAMETERS", parameters.shape[1])
    library = loaded("figures.c", sizes, text)
    if library is None:
        return None
    result = np.zeros((points, len(wanted), _FIGURES))
    given = {"curves": curves, "speeds": speeds, "parameters": parameters, "parts": parts, "figures": result}
    arrays = {name: np.ascontiguousarray(each, dtype=float) for name, each in given.items()}
    arrays["quantity"] = np.ascontiguousarray(wanted, dtype=np.intc)
    numbers = {"points": points, "steps": m, "samples": samples, "wanted": len(wanted)}
    numbers |= {"zooms": zooms[0], "rough": zooms[1], "around": len(parts)}
    problem = _Turn(**numbers, period=period, tie=tie, **addresses(arrays))
    return None if library.turn(ctypes.byref(problem)) else result
