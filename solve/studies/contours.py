"""Stability boundaries traced through the points at which stability changes along the lines of a grid."""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from solve.arrays import Array
from solve.results.chart import BoundaryCurve
from solve.results.points import KINDS

_NARROW = 0.1
"""Width of an unstable section of a cell's edge, relative to the cell, below which the section counts as part
of a tongue that crosses the cell. Chosen by judgement."""


@dataclass(frozen=True)
class Crossings:
    """Points on the lines of a grid at which stability changes.

    For each point, `line` (c,) is the index of its line, `place` (c,) the coordinate along the line, and
    `kind` (c,) the index in KINDS of the kind of instability.
    """

    line: Array
    place: Array
    kind: Array


def contours(
    axes: tuple[Array, Array],
    stable: Array,
    rows: Crossings,
    columns: Crossings,
    is_stable: Callable[[Array], Array],
) -> list[BoundaryCurve]:
    """Connect crossings to stability boundaries through the cells of a grid.

    `axes` are x (nx,) and y (ny,). `stable` (ny, nx) is 1 at stable grid points, 0 at unstable points, and
    NaN at failed points. `rows` and `columns` are the crossings on the grid lines along x and along y.
    `is_stable` evaluates the stability of points (k, 2); it is called where the crossings around a cell can
    be connected in two ways. Cells with a NaN at a corner have no boundary.
    """
    rims = _CellCrossings(axes, rows, columns)
    i, j = rims.cells
    corners = np.array([stable[j, i], stable[j, i + 1], stable[j + 1, i], stable[j + 1, i + 1]])
    is_closed = ~np.isnan(corners).any(axis=0) & (rims.counts % 2 == 0)
    simple, begins_unstable = is_closed & (rims.counts == 2), corners[0] == 0
    joined = rims.around[rims.starts[simple, None] + [0, 1]]
    joined[begins_unstable[simple]] = joined[begins_unstable[simple], ::-1]
    open_ = [rims.arcs(cell, begins_unstable[cell]) for cell in np.flatnonzero(is_closed & ~simple).tolist()]
    joined = np.concatenate((joined, _decided(rims, open_, is_stable)))
    pieces = (_pieces(rims, chain) for chain in _chains(len(rims.points), joined))
    return [piece for piece in itertools.chain.from_iterable(pieces) if len(piece.points) > 1]


class _CellCrossings:
    """Crossings as points (c, 2), grouped by the k cells on whose edges they lie. `cells` are the column
    indices (k,) and row indices (k,) of the cells. `around` contains the indices of the crossings, cell after
    cell, counter-clockwise from the lower left corner. `starts` (k,) and `counts` (k,) are, for each cell,
    the first index in `around` and the number of crossings."""

    def __init__(self, axes: tuple[Array, Array], rows: Crossings, columns: Crossings):
        x, y = axes
        self.points = np.concatenate(
            (np.column_stack((rows.place, y[rows.line])), np.column_stack((x[columns.line], columns.place)))
        )
        self.kinds = np.concatenate((rows.kind, columns.kind))
        self.size = np.array([np.ptp(x) / (len(x) - 1), np.ptp(y) / (len(y) - 1)])
        i, along_row = _cells_and_ranks(x, rows.place)
        j, along_column = _cells_and_ranks(y, columns.place)
        row, column = np.split(np.arange(len(self.points)), [len(i)])
        sides = (
            (i, rows.line, along_row, row),
            (columns.line - 1, j, along_column, column),
            (i, rows.line - 1, -along_row, row),
            (columns.line, j, -along_column, column),
        )
        side = np.repeat(np.arange(4), [len(crossing) for *_, crossing in sides])
        i, j, along, crossing = (np.concatenate(parts) for parts in zip(*sides, strict=True))
        inside = (i >= 0) & (i < len(x) - 1) & (j >= 0) & (j < len(y) - 1)
        cell = i * len(y) + j
        order = np.lexsort((along, side, cell))
        order = order[inside[order]]
        self.around = crossing[order]
        cells, self.starts, self.counts = np.unique(cell[order], return_index=True, return_counts=True)
        self.cells = np.divmod(cells, len(y))

    def arcs(self, cell: int, begins_unstable: bool) -> list[tuple[int, int]]:
        """Return the pairs of neighbouring crossings between which the edge of the cell is unstable."""
        rim = self.around[self.starts[cell] :][: self.counts[cell]].tolist()
        turned = [*rim[1:], *rim[:1]] if begins_unstable else rim
        return list(zip(turned[::2], turned[1::2], strict=True))

    def width(self, arc: tuple[int, int]) -> float:
        """Return the distance between the two crossings of an arc, in units of the cell size."""
        first, last = self.points[list(arc)]
        return float(np.linalg.norm((last - first) / self.size))


def _cells_and_ranks(nodes: Array, place: Array) -> tuple[Array, Array]:
    """For each position in `place` (c,), return the index of the interval of `nodes` that contains the
    position, and the rank of the position in ascending order."""
    cell = np.clip(np.searchsorted(nodes, place, side="right") - 1, 0, len(nodes) - 2)
    rank = np.empty(len(place), dtype=int)
    rank[np.argsort(place, kind="stable")] = np.arange(len(place))
    return cell, rank


def _decided(
    rims: _CellCrossings, cells: Sequence[list[tuple[int, int]]], is_stable: Callable[[Array], Array]
) -> Array:
    """Return connections (k, 2) between crossings in cells that have several unstable arcs. Crossings of the
    same kind are connected. Where the kinds leave several connections possible, two arcs are joined in two
    cases: the point between the arcs is unstable, or both arcs are as narrow as a tongue."""
    pairs = [
        (n, k, (k + 1) % len(arcs))
        for n, arcs in enumerate(cells)
        for k in range(len(arcs) - (len(arcs) == 2))
    ]
    between = [rims.points[[*cells[n][k], *cells[n][other]]].mean(axis=0) for n, k, other in pairs]
    unstable = ~is_stable(np.array(between)) if between else []
    joined, used = [], set()
    for (n, k, other), through in zip(pairs, unstable, strict=True):
        first, second = cells[n][k], cells[n][other]
        kinds = rims.kinds[[*first, *second]]
        closed = kinds[0] == kinds[1] and kinds[2] == kinds[3]
        open_ = kinds[1] == kinds[2] and kinds[3] == kinds[0]
        tongue = open_ and max(map(rims.width, (first, second))) < _NARROW
        goes_on = open_ if open_ != closed else through or tongue
        if goes_on and not {(n, k), (n, other)} & used:
            used |= {(n, k), (n, other)}
            joined += [(first[1], second[0]), (second[1], first[0])]
    unjoined = [arc for n, arcs in enumerate(cells) for k, arc in enumerate(arcs) if (n, k) not in used]
    return np.array(joined + unjoined, dtype=int).reshape(-1, 2)


def _chains(count: int, ends: Array) -> list[list[int]]:
    """Return chains of crossings from connections (k, 2). A closed chain ends with its first crossing."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import depth_first_order

    degree = np.bincount(ends.ravel(), minlength=count)
    graph = coo_array((np.ones(len(ends)), ends.T), shape=(count, count)).tocsr()
    seen = degree == 0
    chains = []
    # Open chains are followed from one of their ends; closed chains come last.
    for start in np.argsort(degree != 1, kind="stable").tolist():
        if not seen[start]:
            chain = depth_first_order(graph, start, directed=False, return_predecessors=False).tolist()
            seen[chain] = True
            chains.append([*chain, start] if len(chain) > 2 and degree[start] > 1 else chain)
    return chains


def _pieces(rims: _CellCrossings, chain: list[int]) -> list[BoundaryCurve]:
    """Split a chain into boundaries wherever the kind of crossing changes. Neighbouring boundaries share a
    point."""
    kinds, points = rims.kinds[chain], rims.points[chain]
    cuts = [0, *(np.flatnonzero(np.diff(kinds)) + 1).tolist(), len(chain)]
    return [
        BoundaryCurve(KINDS[kinds[first]], points[max(first - 1, 0) : last])
        for first, last in itertools.pairwise(cuts)
    ]
