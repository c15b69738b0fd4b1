"""The same grid in compiled code: eight points side by side in vector registers."""

import ctypes
from functools import lru_cache
from pathlib import Path

import numpy as np

from solve.arrays import Array
from solve.batch.compiler import compiled
from solve.batch.curves import Curves
from solve.batch.level import GridTables, Level, finite
from solve.batch.tables import Tables
from solve.methods.collocation import Collocation

LANES = 8
_SOURCE = Path(__file__).with_name("lanes.c")
_SURE = 1e12
"""Bound of the closed system's condition up to which it is regular without doubt."""

_DOUBLES = ctypes.POINTER(ctypes.c_double)


class _Problem(ctypes.Structure):
    """`problem` of lanes.c."""

    _fields_ = (
        ("groups", ctypes.c_long),
        ("steps", ctypes.c_long),
        ("h", ctypes.c_double),
        ("terms", ctypes.c_int),
        ("own", ctypes.c_int),
        ("entry", ctypes.POINTER(ctypes.c_int)),
        *((name, _DOUBLES) for name in ("stages", "nodes", "coefficients")),
        *((name, _DOUBLES) for name in ("A", "A2", "b", "bA", "c", "powers")),
        *((name, _DOUBLES) for name in ("Phi", "closed", "bound", "curves")),
    )


class LaneEngine:
    """Collocation in lanes. Raises CompilerError where the machine has no working C compiler."""

    name = "compiled"

    def __init__(self) -> None:
        _library(1, Collocation((1.0,)), False)

    def bytes_a_step(self, method: Collocation, n: int, orbit: bool) -> int:
        return 8 * n * (2 * len(method.curve_powers) + 12) if orbit else 8

    def level(self, tables: GridTables, coefficients: Array, orbit: bool) -> Level:
        method, m, n = tables.method, tables.steps, tables.stages.n
        points, groups = len(coefficients), -(-len(coefficients) // LANES)
        N, D = 2 * n, len(method.curve_powers)
        Phi, closed, bound = (np.zeros((groups, *shape, LANES)) for shape in ((N, N), (2, N, N), ()))
        curves = np.zeros((groups * LANES if orbit else 0, n, m, D))
        inputs = {
            "stages": _own(tables.stages, groups),
            "nodes": np.zeros(1) if tables.nodes is None else _own(tables.nodes, groups),
            "coefficients": _grouped(coefficients, groups),
            **{name: np.ascontiguousarray(part) for name, part in _weights(method).items()},
        }
        entry = tables.stages.entry.astype(np.intc)
        arrays = {**inputs, "Phi": Phi, "closed": closed, "bound": bound, "curves": curves}
        problem = _Problem(
            groups=groups,
            steps=m,
            h=tables.period / m,
            terms=len(entry),
            own=tables.stages.table.ndim == 3,
            entry=entry.ctypes.data_as(ctypes.POINTER(ctypes.c_int)),
            **{name: part.ctypes.data_as(_DOUBLES) for name, part in arrays.items()},
        )
        if _library(n, method, orbit).level(ctypes.byref(problem)):
            raise MemoryError(f"no memory for {m} steps of {n} coordinates")
        Phi = _by_points(Phi, points)
        sound = finite(Phi)
        if not orbit:
            return Level(m, Phi, None, sound, np.full(points, np.nan))
        bound = _by_points(bound, points)
        sound = sound & (bound < _SURE) & np.isfinite(curves[:points].sum(axis=(1, 2, 3)))
        closed = _by_points(closed, points)
        return Level(m, Phi, Curves(curves[:points], tables.period), sound, bound, closed)


@lru_cache
def _library(n: int, method: Collocation, orbit: bool) -> ctypes.CDLL:
    sizes = {
        "N": n,
        "S": len(method.c),
        "NODES": len(method.curve_nodes),
        "STIFF": int(method.stiffly_accurate),
        "ORBIT": int(orbit),
    }
    return compiled(_SOURCE, sizes)


def _weights(method: Collocation) -> dict[str, Array]:
    A, b = method.A, method.b
    return {"A": A, "A2": A @ A, "b": b, "bA": b @ A, "c": np.array(method.c), "powers": method.curve_powers}


def _own(tables: Tables, groups: int) -> Array:
    """The tables; those that belong to a point each (P, k, R), by groups (groups, k, R, LANES)."""
    return _grouped(tables.table, groups) if tables.table.ndim == 3 else np.ascontiguousarray(tables.table)


def _grouped(values: Array, groups: int) -> Array:
    """(P, …) as (groups, …, LANES); the last point fills the lanes that are left."""
    filled = np.concatenate((values, np.repeat(values[-1:], groups * LANES - len(values), axis=0)))
    return np.ascontiguousarray(np.moveaxis(filled.reshape(groups, LANES, *values.shape[1:]), 1, -1))


def _by_points(values: Array, points: int) -> Array:
    """(groups, …, LANES) as (P, …)."""
    moved = np.moveaxis(values, -1, 1)
    return np.ascontiguousarray(moved.reshape(-1, *moved.shape[2:])[:points])
