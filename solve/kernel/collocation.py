"""Collocation over one period by compiled code. Each lane of a vector register contains a point or a segment
of the period."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from solve.arrays import Array
from solve.kernel.library import Constants, Size, lanes, run

_POINT_TABLES, _SEGMENTS = 1, 2
"""Values of `own` in lanes.c: each lane has its own table, or the lanes are segments of one period."""


class Samples(NamedTuple):
    """Terms of the matrix entries, sampled at the phases that a method uses. An entry is a sum of terms.

    table: (k, R) if shared by all points, otherwise (P, k, R). coefficients: (P, R). entry (R,): index of the
    entry to which each term belongs, in ascending order."""

    table: Array
    coefficients: Array
    entry: Array

    @property
    def summed(self) -> "Samples":
        """Samples in which the terms of each entry are replaced by their sum, for each point. Each entry then
        has one term with coefficient 1, and the compiled loops need no multiplications or sums."""
        first = np.flatnonzero(np.diff(self.entry, prepend=-1))
        if len(first) == len(self.entry) and (self.coefficients == 1).all():
            return self
        table = np.add.reduceat(self.table * self.coefficients[:, None], first, axis=-1)
        return Samples(table, np.ones((len(table), len(first))), self.entry[first])

    @property
    def per_point(self) -> bool:
        return self.table.ndim == 3

    def of_point(self, at: int) -> "Samples":
        """Samples of the point with index `at`."""
        at_point = slice(at, at + 1)
        table = self.table[at_point] if self.per_point else self.table
        return Samples(table, self.coefficients[at_point], self.entry)


class Periods(NamedTuple):
    """Result of the compiled collocation.

    Phi (P, N, N): monodromy matrices. units (P, N): powers of 2 that balance Φ, for several coordinates.
    curves (P, n, m, D): coefficients of the curves, lowest power first, if orbits are computed. condition
    (P,): condition numbers of the linear systems for the curves; not finite if the curves are not finite.
    maps (1, m, N, N+1): maps of the steps, for a single point."""

    Phi: Array
    units: Array | None
    curves: Array | None
    condition: Array | None
    maps: Array | None


def bytes_a_step(n: int, powers: int, orbit: bool) -> int:
    """Memory in bytes per step and point. It is used for a curve with `powers` coefficients, and for the
    point's share of the workspace of its group."""
    return 8 * n * (2 * powers + 12) if orbit else 8


def solved(
    size: Size,
    weights: Constants,
    h: Array,
    jumps: bool,
    stages: Samples,
    nodes: Samples | None,
    alone: bool = False,
) -> Periods:
    """Compute the solutions of the points on steps of lengths h (m,) by compiled code.

    Coefficients are sampled at the stages: m s phases, step by step. For orbits, `nodes` contains further
    samples. If matrices jump at ends of steps, they are at all starts of steps, followed by all ends (2m
    phases). Otherwise, they are at the starts of steps (m phases), and only required if steps do not end at a
    stage.

    Lanes contain different points. If `alone` is true, points are solved one after another, and lanes contain
    the segments of one point. Raises CompilerError, MemoryError."""
    points, m, width = len(stages.coefficients), stages.table.shape[-2] // size.stages, lanes(size)
    segments = alone and m % width == 0 and size.orbit and not jumps
    if segments and points > 1:
        each = (
            solved(size, weights, h, jumps, stages.of_point(at), nodes and nodes.of_point(at), alone)
            for at in range(points)
        )
        Phi, units, curves, condition, _ = map(_joined, zip(*each, strict=True))
        assert Phi is not None
        return Periods(Phi, units, curves, condition, None)
    groups, steps = -(-points // width), m // width if segments else m
    if stages.per_point and not segments:
        stages, nodes = stages.summed, nodes and nodes.summed
    n, N, D = size.n, 2 * size.n - size.first_order, len(weights["powers"])
    Phi, condition = np.empty((groups * width, N, N)), np.empty(groups * width)
    curves = np.empty((groups * width if size.orbit else 0, n, steps, D))
    arrays = {
        "stages": _laid_out(stages, groups, width, segments),
        "nodes": np.zeros(1) if nodes is None else _laid_out(nodes, groups, width, segments),
        "coefficients": _grouped(stages.coefficients, groups, width),
        "h": np.ascontiguousarray(h),
        "Phi": Phi,
        "condition": condition,
        "curves": curves,
    }
    if N > 2:
        arrays["units"] = np.empty((groups * width, N))
    if points == 1 and size.orbit:
        arrays["maps"] = np.empty((width, steps, N, N + 1))
    tables = _SEGMENTS if segments else _POINT_TABLES if stages.per_point else 0
    numbers = {
        "groups": groups,
        "steps": steps,
        "jumps": jumps,
        "terms": len(stages.entry),
        "own": tables,
    }
    run("segments" if segments else "level", size, weights, arrays, stages.entry, **numbers)
    units = arrays["units"][:points] if N > 2 else None
    if not size.orbit:
        return Periods(Phi[:points], units, None, None, None)
    maps = arrays["maps"].reshape(-1, m, N, N + 1)[:1] if "maps" in arrays else None
    curves = curves.swapaxes(0, 1).reshape(1, n, m, D) if segments else curves[:points]
    return Periods(Phi[:points], units, curves, condition[:points], maps)


def _joined(parts: Sequence[Array | None]) -> Array | None:
    """Join arrays of single points into one array; None if a point has no array."""
    present = [part for part in parts if part is not None]
    return np.concatenate(present) if len(present) == len(parts) else None


def _laid_out(samples: Samples, groups: int, width: int, segments: bool) -> Array:
    """Arrange the table of samples as the kernel requires. A table per point, (P, k, R), becomes (groups, k,
    R, width)."""
    if samples.per_point and not segments:
        return _grouped(samples.table, groups, width)
    return np.ascontiguousarray(samples.table)


def _grouped(values: Array, groups: int, width: int) -> Array:
    """Arrange values (P, …) in groups as (groups, …, width). The last point also fills the remaining
    lanes."""
    if len(values) == 1:
        return values.repeat(width)
    filled = values[np.minimum(np.arange(groups * width), len(values) - 1)]
    return np.ascontiguousarray(filled.reshape(groups, width, -1).swapaxes(1, 2))
