"""The array type of this package: NumPy, float64 unless a docstring says complex."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

Plane = NDArray[np.complex128]
"""Points, velocities, accelerations or directions in the plane, x + iy."""


def whole(chosen: Array, count: int) -> bool:
    """Whether positions (k,), or a mask, choose all of so many points in their order: nothing to copy."""
    if len(chosen) != count:
        return False
    if count == 1:
        return chosen.dtype != bool or bool(chosen[0])
    return bool(chosen.all() if chosen.dtype == bool else (chosen == np.arange(count)).all())


def different(numbers: Array) -> list[int]:
    """The different ones among whole numbers (k,) of moderate size, rising.

    >>> different(np.array([3, 8, 3]))
    [3, 8]
    """
    return np.flatnonzero(np.bincount(numbers)).tolist()


def runs(flags: Array) -> Array:
    """First and last positions (r, 2) of neighbours that are true among flags (k,).

    >>> runs(np.array([True, False, True, True])).tolist()
    [[0, 0], [2, 3]]
    """
    edges = np.flatnonzero(np.diff(flags.astype(int), prepend=0, append=0))
    return edges.reshape(-1, 2) - [0, 1]


_ROWS = 256
"""From so many rows on, columns are gone along one after another."""


def across(operation: np.ufunc, values: Array, axis: int = -1) -> Array:
    """`operation.reduce` over a short axis, of many rows as quickly as over a long one."""
    if len(values) < _ROWS:
        return operation.reduce(values, axis=axis)
    return reduce(operation, np.moveaxis(values, axis, 0))


def solved(A: Array, b: Array) -> Array:
    """x of A x = b for matrices A (…, n, n) and b (…, n, k); NaN where A is singular."""
    try:
        return np.linalg.solve(A, b)
    except np.linalg.LinAlgError:
        regular = np.linalg.slogdet(A)[0] != 0
        x = np.linalg.solve(np.where(regular[..., None, None], A, np.eye(A.shape[-1])), b)
        return np.where(regular[..., None, None], x, np.nan)


class Recent:
    """Array function of phases that caches its latest values, up to a number of bytes; the next solution uses
    the phases of the same grid. Cached values must not be modified."""

    def __init__(self, function: Callable[[Array], Array], most_bytes: int):
        self._function, self._most = function, most_bytes
        self._values: dict[bytes, Array] = {}

    def __call__(self, phase: Array) -> Array:
        key = phase.tobytes()
        value = self._values.get(key)
        if value is None:
            value = self._values[key] = self._function(phase)
            # Copies of the dictionary, since another thread may modify it.
            excess = sum(each.nbytes for each in [*self._values.values()]) - self._most
            for older, each in [*self._values.items()][:-1]:
                if excess <= 0:
                    break
                excess -= each.nbytes
                self._values.pop(older, None)
        return value


class Asked(Mapping[str, Array]):
    """Values by name, each calculated when it is asked for."""

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
