"""A single period in compiled code: eight segments of it side by side in vector registers.

Worth its compilation only where many grids of one kind are solved: the first ones go through NumPy, then
a library that an earlier process has left in the cache is taken, and many grids later one is compiled.
"""

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import NamedTuple

import numpy as np

from solve.arrays import Array
from solve.kernel.library import LANES, CompilerError, Size, library, run
from solve.methods.collocation import Collocation

LOOK_AFTER, COMPILE_AFTER = 16, 512
"""Grids of one kind after which a library is looked for, and compiled."""

_OWN_SEGMENTS = 2
"""`own` of lanes.c: the lanes are segments of one period."""

_numpy_alone = ContextVar("_numpy_alone", default=False)
_solved: Counter[Size] = Counter()
_ready: dict[Size, bool] = {}


class Segments(NamedTuple):
    """Monodromy matrix Phi (N, N), maps of the steps (m, N, N+1), closed (2, N, N): G and H of the closed
    system (G + H) x = r, and coefficients of the curve (D, m, n), lowest power first."""

    Phi: Array
    maps: Array
    closed: Array
    curve: Array


@contextmanager
def in_numpy() -> Iterator[None]:
    """Grids go through NumPy whatever is compiled, for times to be compared: only some numbers of steps
    suit compiled code."""
    token = _numpy_alone.set(True)
    try:
        yield
    finally:
        _numpy_alone.reset(token)


def ready(method: Collocation, n: int, steps: int) -> bool:
    """Whether compiled code is at hand for a grid of so many steps, after one grid more of this kind."""
    if steps % LANES or _numpy_alone.get():
        return False
    size = method.size(n, True)
    _solved[size] += 1
    count = _solved[size]
    if count in (LOOK_AFTER, COMPILE_AFTER) and not _ready.get(size):
        prepare(method, n, kept=count == LOOK_AFTER)
    return _ready.get(size, False)


def prepare(method: Collocation, n: int, kept: bool = False) -> bool:
    """Compile now, or with `kept` take what is in the cache; whether there is something to use."""
    size = method.size(n, True)
    try:
        library(size, kept)
        if kept:
            library(size)
        _ready[size] = True
    except CompilerError:
        _ready[size] = False
    return _ready[size]


def solved(method: Collocation, h: float, entries: Array, nodes: Array | None) -> Segments:
    """The period on m equal steps of length h, from entries (m s, 3n² + n) at the stages and, where no
    step ends at a stage, (m, 3n² + n) at the nodes."""
    m, s = len(entries) // len(method.c), len(method.c)
    n = _coordinates(entries.shape[1])
    N, D, L = 2 * n, len(method.curve_powers), m // LANES
    assert entries.shape[0] == m * s
    Phi, closed, bound = (np.empty((*shape, LANES)) for shape in ((N, N), (2, N, N), ()))
    maps, curves = np.empty((m, N, N + 1)), np.empty((LANES, n, L, D))
    arrays = {
        "stages": np.ascontiguousarray(entries),
        "nodes": np.zeros(1) if nodes is None else np.ascontiguousarray(nodes),
        "coefficients": np.zeros(1),
        **method.weights,
        "Phi": Phi,
        "closed": closed,
        "bound": bound,
        "curves": curves,
        "maps": maps,
    }
    run("segments", method.size(n, True), arrays, groups=1, steps=L, h=h, terms=0, own=_OWN_SEGMENTS)
    curve = np.moveaxis(curves, (3, 0, 2, 1), (0, 1, 2, 3)).reshape(D, m, n)
    return Segments(Phi[..., 0], maps, closed[..., 0], curve)


def _coordinates(entries: int) -> int:
    """n of 3n² + n entries."""
    return round((-1 + (1 + 12 * entries) ** 0.5) / 6)
