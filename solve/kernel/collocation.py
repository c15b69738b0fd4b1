"""Collocation over one period in compiled code: many points, or segments of one period, side by side in
vector registers."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from solve.arrays import Array
from solve.kernel.library import Size, lanes, run

_POINT_TABLES, _SEGMENTS = 1, 2
"""`own` of lanes.c: every lane has tables of its own; the lanes are segments of one period."""


class Samples(NamedTuple):
    """Terms of the entries at the phases that a method samples: table (k, R), the same for all points, or
    (P, k, R); coefficients (P, R); entry (R,), rising: where each term belongs."""

    table: Array
    coefficients: Array
    entry: Array

    @property
    def summed(self) -> "Samples":
        """Of points with tables of their own, one term an entry, with coefficients 1: lanes with such tables
        read neither coefficients nor sums."""
        first = np.flatnonzero(np.diff(self.entry, prepend=-1))
        if len(first) == len(self.entry) and (self.coefficients == 1).all():
            return self
        table = np.add.reduceat(self.table * self.coefficients[:, None], first, axis=-1)
        return Samples(table, np.ones((len(table), len(first))), self.entry[first])

    @property
    def own(self) -> bool:
        return self.table.ndim == 3


class Periods(NamedTuple):
    """Monodromy matrices Phi (P, N, N); of several coordinates, the units (P, N), powers of 2, in which these
    are balanced; with orbits, coefficients of the curves (P, n, m, D), lowest power first, and condition
    numbers (P,) of the linear systems that gave them, not finite where the curves are not; of one point, the
    maps of the steps (1, m, N, N+1)."""

    Phi: Array
    units: Array | None
    curves: Array | None
    condition: Array | None
    maps: Array | None


def bytes_a_step(n: int, powers: int, orbit: bool) -> int:
    """Memory that a step of a point takes: its curve of so many powers, and a part of a group's work."""
    return 8 * n * (2 * powers + 12) if orbit else 8


def solved(
    size: Size,
    weights: Mapping[str, Array],
    h: Array,
    jumps: bool,
    stages: Samples,
    nodes: Samples | None,
    alone: bool = False,
) -> Periods:
    """Each point on steps of lengths h (m,), sampled at the stages (m s phases, step by step) and, for orbits
    by a method whose steps do not end at a stage, at their starts (m phases); for orbits by any method at
    their starts and then their ends (2m) where the matrices jump at ends of steps. Raises CompilerError,
    MemoryError.

    The lanes are points, or where one is solved `alone` its segments.
    """
    points, m, width = len(stages.coefficients), stages.table.shape[-2] // size.stages, lanes(size)
    segments = alone and m % width == 0 and size.orbit and not jumps
    groups, steps = -(-points // width), m // width if segments else m
    if stages.own and not segments:
        stages, nodes = stages.summed, nodes and nodes.summed
    n, N, D = size.n, 2 * size.n, len(weights["powers"])
    Phi, condition = np.empty((groups * width, N, N)), np.empty(groups * width)
    curves = np.empty((groups * width if size.orbit else 0, n, steps, D))
    arrays = {
        "stages": _laid_out(stages, groups, width, segments),
        "nodes": np.zeros(1) if nodes is None else _laid_out(nodes, groups, width, segments),
        "coefficients": _grouped(stages.coefficients, groups, width),
        "h": np.ascontiguousarray(h),
        **weights,
        "Phi": Phi,
        "condition": condition,
        "curves": curves,
    }
    if n > 1:
        arrays["units"] = np.empty((groups * width, N))
    if points == 1 and size.orbit:
        arrays["maps"] = np.empty((width, steps, N, N + 1))
    own = _SEGMENTS if segments else _POINT_TABLES if stages.own else 0
    numbers = {"groups": groups, "steps": steps, "jumps": jumps, "terms": len(stages.entry), "own": own}
    run("segments" if segments else "level", size, arrays, stages.entry, **numbers)
    units = arrays["units"][:points] if n > 1 else None
    if not size.orbit:
        return Periods(Phi[:points], units, None, None, None)
    maps = arrays["maps"].reshape(-1, m, N, N + 1)[:1] if "maps" in arrays else None
    curves = curves.swapaxes(0, 1).reshape(1, n, m, D) if segments else curves[:points]
    return Periods(Phi[:points], units, curves, condition[:points], maps)


def _laid_out(samples: Samples, groups: int, width: int, segments: bool) -> Array:
    """The table; where each point has its own (P, k, R), by groups (groups, k, R, width)."""
    if samples.own and not segments:
        return _grouped(samples.table, groups, width)
    return np.ascontiguousarray(samples.table)


def _grouped(values: Array, groups: int, width: int) -> Array:
    """(P, …) as (groups, …, width); the last point fills the lanes that are left."""
    filled = values[np.minimum(np.arange(groups * width), len(values) - 1)]
    return np.ascontiguousarray(filled.reshape(groups, width, -1).swapaxes(1, 2))
