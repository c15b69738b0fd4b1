"""Curves through the points at which a region is left along the lines of a grid."""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from solve.arrays import Array
from solve.results.chart import BoundaryCurve
from solve.results.points import KINDS

_NARROW = 0.1
"""Part of a cell below which an unstable stretch of its rim goes on into the cell, as a tongue does."""


@dataclass(frozen=True)
class Crossings:
    """Points on lines of a grid where stability changes: the line of each (c,), its place along the line
    (c,), and which multiplier leaves the unit circle (c,), a position in KINDS."""

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
    """Boundaries on the grid of the axes x (nx,), y (ny,), from stable (ny, nx), NaN where unknown, and the
    crossings of its rows and columns; is_stable (points (k, 2)) is asked where a cell allows two ways.
    Cells about which something is unknown have no boundary."""
    rims = _Rims(axes, rows, columns)
    joined, open_ = [], []
    for (i, j), rim in rims.cells():
        if len(rim) % 2 or np.isnan(stable[j : j + 2, i : i + 2]).any():
            continue
        # Pairs of neighbouring crossings with an unstable stretch of the rim between them.
        turned = rim if stable[j, i] else [*rim[1:], *rim[:1]]
        arcs = list(zip(turned[::2], turned[1::2], strict=True))
        if len(arcs) > 1:
            open_.append(arcs)
        else:
            joined += arcs
    joined += _decided(rims, open_, is_stable)
    pieces = (_pieces(rims, chain) for chain in _chains(len(rims.points), joined))
    return [piece for piece in itertools.chain.from_iterable(pieces) if len(piece.points) > 1]


class _Rims:
    """The crossings as points (c, 2), and on which edges of which cells they lie."""

    def __init__(self, axes: tuple[Array, Array], rows: Crossings, columns: Crossings):
        x, y = axes
        self.points = np.concatenate(
            (np.column_stack((rows.place, y[rows.line])), np.column_stack((x[columns.line], columns.place)))
        )
        self.kinds = np.concatenate((rows.kind, columns.kind))
        self.size = np.array([np.ptp(x) / (len(x) - 1), np.ptp(y) / (len(y) - 1)])
        self._count = len(x) - 1, len(y) - 1
        self._rows = _by_edge(rows, x, 0)
        self._columns = _by_edge(columns, y, len(rows.line))

    def cells(self) -> list[tuple[tuple[int, int], list[int]]]:
        """Cells (i, j) and the crossings around each, counter-clockwise from its lower left corner."""
        touched = {(i, j - below) for j, i in self._rows for below in (0, 1)}
        touched |= {(i - left, j) for i, j in self._columns for left in (0, 1)}
        nx, ny = self._count
        found = []
        for i, j in sorted(touched):
            if 0 <= i < nx and 0 <= j < ny:
                bottom, top = self._rows.get((j, i), []), self._rows.get((j + 1, i), [])
                left, right = self._columns.get((i, j), []), self._columns.get((i + 1, j), [])
                found.append(((i, j), [*bottom, *right, *reversed(top), *reversed(left)]))
        return found

    def width(self, arc: tuple[int, int]) -> float:
        """Distance of two crossings in cells."""
        first, last = self.points[list(arc)]
        return float(np.linalg.norm((last - first) / self.size))


def _by_edge(crossings: Crossings, nodes: Array, offset: int) -> dict[tuple[int, int], list[int]]:
    """Crossings of every edge (line, cell), in rising order."""
    cell = np.clip(np.searchsorted(nodes, crossings.place, side="right") - 1, 0, len(nodes) - 2)
    found: dict[tuple[int, int], list[int]] = {}
    for at in np.argsort(crossings.place, kind="stable").tolist():
        found.setdefault((int(crossings.line[at]), int(cell[at])), []).append(at + offset)
    return found


def _decided(
    rims: _Rims, cells: Sequence[list[tuple[int, int]]], is_stable: Callable[[Array], Array]
) -> list[tuple[int, int]]:
    """Connections within cells with several unstable arcs. A boundary keeps its kind; where that leaves
    the choice, two arcs are joined if the place between them is unstable, or if both are as narrow as a
    tongue."""
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
    rest = [arc for n, arcs in enumerate(cells) for k, arc in enumerate(arcs) if (n, k) not in used]
    return joined + rest


def _chains(count: int, joined: Sequence[tuple[int, int]]) -> list[list[int]]:
    """Connections as chains of crossings; closed ones end where they begin."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import depth_first_order

    ends = np.array(joined, dtype=int).reshape(-1, 2)
    degree = np.bincount(ends.ravel(), minlength=count)
    graph = coo_array((np.ones(len(ends)), ends.T), shape=(count, count)).tocsr()
    seen = degree == 0
    found = []
    # Open chains from one of their ends, then closed ones.
    for start in np.argsort(degree != 1, kind="stable").tolist():
        if not seen[start]:
            chain = depth_first_order(graph, start, directed=False, return_predecessors=False).tolist()
            seen[chain] = True
            found.append([*chain, start] if len(chain) > 2 and degree[start] > 1 else chain)
    return found


def _pieces(rims: _Rims, chain: list[int]) -> list[BoundaryCurve]:
    """A chain by kinds; neighbouring pieces share a point."""
    kinds, points = rims.kinds[chain], rims.points[chain]
    cuts = [0, *(np.flatnonzero(np.diff(kinds)) + 1).tolist(), len(chain)]
    return [
        BoundaryCurve(KINDS[kinds[first]], points[max(first - 1, 0) : last])
        for first, last in itertools.pairwise(cuts)
    ]
