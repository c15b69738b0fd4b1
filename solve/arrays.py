"""Array type and small array operations. Arrays are NumPy arrays of float64 unless a docstring states
otherwise."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import reduce
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

Value = TypeVar("Value")

Plane = NDArray[np.complex128]
"""Array of points, velocities, accelerations or directions in the plane, each as x + iy."""

EPS = float(np.finfo(float).eps)
"""Distance from 1 to the next larger float64, 2.2e-16."""

ROUND_OFF = 1e-12
"""Relative error that counts as round-off of a computed value: the round-off of a sum of about a thousand
terms, times a condition number of up to 10."""

CACHE_SIZE = 8
"""Number of entries of caches: a solution requires the same matrices on several grids. Chosen by
judgement."""

SPLIT = 1e-6
"""Relative distance between computed eigenvalues up to which the exact eigenvalues may be equal: round-off
splits a double eigenvalue by the square root of `EPS`, 1.5e-8, times a condition number. Chosen by
judgement."""


def covers_all(selection: Array, count: int) -> bool:
    """Whether `selection`, indices (k,) or a mask, selects all of `count` points in order. No copy is then
    necessary."""
    if len(selection) != count:
        return False
    if count == 1:
        return selection.dtype != bool or bool(selection[0])
    return bool(selection.all() if selection.dtype == bool else (selection == np.arange(count)).all())


def unique_integers(numbers: Array) -> list[int]:
    """Distinct nonnegative integers of moderate size, in ascending order.

    >>> unique_integers(np.array([3, 8, 3]))
    [3, 8]
    """
    return np.bincount(numbers).nonzero()[0].tolist()


def others(count: int, positions: Sequence[int]) -> Array:
    """Indices (k,) from 0 to `count` - 1 that are not among `positions`.

    >>> others(4, [1]).tolist()
    [0, 2, 3]
    """
    if not positions:
        return np.arange(count)
    is_other = np.ones(count, dtype=bool)
    is_other[positions] = False
    return is_other.nonzero()[0]


def runs(flags: Array) -> Array:
    """First and last index, as an array (r, 2), of each run of true values in `flags` (k,).

    >>> runs(np.array([True, False, True, True])).tolist()
    [[0, 0], [2, 3]]
    """
    edges = np.diff(flags.astype(int), prepend=0, append=0).nonzero()[0]
    return edges.reshape(-1, 2) - [0, 1]


_MANY_ROWS = 256
"""Number of rows above which `across` reduces column by column. For many rows, NumPy's reduction over a short
last axis is slow."""

_SMALLEST = 4
"""Number of rows of a matrix up to which elimination in all matrices at the same time is faster than LAPACK,
which treats one matrix at a time."""


def across(operation: np.ufunc, values: Array, axis: int = -1) -> Array:
    """Result of `operation.reduce` over a short axis. Unlike NumPy's function, it is also fast for many
    rows."""
    if len(values) < _MANY_ROWS:
        return operation.reduce(values, axis=axis)
    return reduce(operation, np.moveaxis(values, axis, 0))


def solved(A: Array, b: Array) -> Array:
    """Solution x of A x = b for matrices A (…, n, n) and b (…, n, k); NaN if A is singular."""
    try:
        return np.linalg.solve(A, b)
    except np.linalg.LinAlgError:
        regular = np.linalg.slogdet(A)[0] != 0
        x = np.linalg.solve(np.where(regular[..., None, None], A, np.eye(A.shape[-1])), b)
        return np.where(regular[..., None, None], x, np.nan)


def definite_solved(A: Array, b: Array) -> Array:
    """Solution x of A x = b for symmetric positive definite matrices A (k, n, n). For many small matrices,
    this function is faster than `solved`, because elimination requires no pivoting."""
    k, n, _ = A.shape
    if k < _MANY_ROWS or n > _SMALLEST or not (np.swapaxes(A, 1, 2) == A).all():
        return solved(A, b)
    rows = np.concatenate((A, b), axis=-1).transpose(1, 2, 0).copy()
    for at in range(n):
        if not (rows[at, at] > 0).all():
            return solved(A, b)
        rows[at, at + 1 :] /= rows[at, at]
        for other in range(at + 1, n):
            rows[other, at + 1 :] -= rows[other, at] * rows[at, at + 1 :]
    for at in range(n - 1, 0, -1):
        for other in range(at):
            rows[other, n:] -= rows[other, at] * rows[at, n:]
    return np.ascontiguousarray(rows[:, n:].transpose(2, 0, 1))


class Recent:
    """Array-valued function of phases. Its most recent values are cached, up to `max_bytes` bytes.

    The next solution often uses the phases of the same grid. Cached values must not be modified."""

    def __init__(self, function: Callable[[Array], Array], max_bytes: int):
        self._function, self._max_bytes = function, max_bytes
        self._values: dict[bytes, Array] = {}

    def __call__(self, phase: Array) -> Array:
        key = phase.tobytes()
        value = self._values.get(key)
        if value is None:
            value = self._values[key] = self._function(phase)
            # The dictionary is copied, because another thread may modify it.
            excess = sum(cached.nbytes for cached in [*self._values.values()]) - self._max_bytes
            for oldest, cached in [*self._values.items()][:-1]:
                if excess <= 0:
                    break
                excess -= cached.nbytes
                self._values.pop(oldest, None)
        return value


class Latest(Generic[Value]):
    """Function of phases (m,). Its most recent value is cached, because successive speeds use the same grid.

    The value must not be modified."""

    def __init__(self, function: Callable[[Array], Value]):
        self._function = function
        self._cached: tuple[bytes, Value] | None = None

    def __call__(self, phase: Array) -> Value:
        key, cached = phase.tobytes(), self._cached
        if cached is None or cached[0] != key:
            cached = self._cached = key, self._function(phase)
        return cached[1]


class LazyMapping(Mapping[str, Array]):
    """Mapping from names to values. Each value is computed on access."""

    def __init__(self, names: Sequence[str], value: Callable[[str], Array]):
        self._names, self._value = names, value

    def __getitem__(self, name: str) -> Array:
        if name not in self._names:
            raise KeyError(name)
        return self._value(name)

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)


def symmetric_of(triangle: Array) -> Array:
    """Symmetric matrices (k, N, N) from their upper triangles (N (N + 1) / 2, k), which are stored in row
    order."""
    N = int(np.sqrt(2 * len(triangle)))
    rows, columns = np.triu_indices(N)
    X = np.empty((triangle.shape[1], N, N))
    X[:, rows, columns] = X[:, columns, rows] = triangle.T
    return X


def uniform_phases(count: int, period: float) -> Array:
    """Return `count` phases that divide a period into equal intervals, from 0 without the end.

    >>> uniform_phases(4, 2.0)
    array([0. , 0.5, 1. , 1.5])
    """
    return np.arange(count) * (period / count)


def midpoint_phases(count: int, period: float) -> Array:
    """Return the midpoints of `count` equal intervals of a period.

    >>> midpoint_phases(4, 2.0)
    array([0.25, 0.75, 1.25, 1.75])
    """
    return (np.arange(count) + 0.5) * (period / count)
