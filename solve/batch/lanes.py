"""The same grid in compiled code: eight points side by side in vector registers."""

import numpy as np

from solve.arrays import Array
from solve.batch.curves import Curves
from solve.batch.level import GridTables, Level, finite
from solve.batch.tables import Tables
from solve.kernel.library import LANES, library, run
from solve.methods.collocation import Collocation

_SURE = 1e12
"""Bound of the closed system's condition up to which it is regular without doubt."""

_LANE_TABLES = 1
"""`own` of lanes.c: every lane has tables of its own."""


class LaneEngine:
    """Collocation in lanes. Raises CompilerError where the machine has no working C compiler."""

    name = "compiled"

    def __init__(self) -> None:
        library(Collocation((1.0,)).size(1, False))

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
            **method.weights,
        }
        run(
            "level",
            method.size(n, orbit),
            {**inputs, "Phi": Phi, "closed": closed, "bound": bound, "curves": curves},
            tables.stages.entry,
            groups=groups,
            steps=m,
            h=tables.period / m,
            terms=len(tables.stages.entry),
            own=_LANE_TABLES if tables.stages.table.ndim == 3 else 0,
        )
        Phi = _by_points(Phi, points)
        sound = finite(Phi)
        if not orbit:
            return Level(m, Phi, None, sound, np.full(points, np.nan))
        bound = _by_points(bound, points)
        sound = sound & (bound < _SURE) & np.isfinite(curves[:points].sum(axis=(1, 2, 3)))
        closed = _by_points(closed, points)
        return Level(m, Phi, Curves(curves[:points], tables.period), sound, bound, closed)


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
