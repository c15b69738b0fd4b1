"""Differences between curves, computed by compiled code."""

import ctypes
from functools import cache

import numpy as np

from solve.arrays import Array
from solve.kernel.library import address, loaded

MOST = 8
"""Largest number of samples per step."""


class _Side(ctypes.Structure):
    _fields_ = (
        *((name, ctypes.c_long) for name in ("steps", "samples")),
        *((name, ctypes.c_void_p) for name in ("coefficients", "powers")),
    )


class _Problem(ctypes.Structure):
    """Structure `problem` of curves.c."""

    _fields_ = (
        ("curves", ctypes.c_long),
        ("coarse", _Side),
        ("fine", _Side),
        ("apart", ctypes.c_void_p),
        ("largest", ctypes.c_void_p),
    )


def differences(coarse: Array, fine: Array, samples: tuple[int, int]) -> tuple[Array, Array] | None:
    """Compare coarse and fine curves (…, m, D) with finite coefficients. Return the largest moduli (…) of
    their differences, and of the fine curves.

    Curves are polynomials in θ on equal steps. samples: numbers of samples per step of the coarse and of the
    fine curve, each at most MOST; both curves are sampled at the same phases. Return None if compiled code is
    not available, or if memory is insufficient."""
    library = loaded("curves.c", (("COARSE", coarse.shape[-1]), ("FINE", fine.shape[-1])))
    if library is None:
        return None
    coarse, fine = np.ascontiguousarray(coarse), np.ascontiguousarray(fine)
    apart, largest = np.empty(coarse.shape[:-2]), np.empty(coarse.shape[:-2])
    sides = _side(coarse, samples[0]), _side(fine, samples[1])
    problem = _Problem(apart.size, *sides, address(apart), address(largest))
    return None if library.differences(ctypes.byref(problem)) else (apart, largest)


def _side(curves: Array, samples: int) -> _Side:
    *_, steps, D = curves.shape
    return _Side(steps, samples, address(curves), address(_powers(samples, D)))


@cache
def _powers(samples: int, D: int) -> Array:
    """Powers of θ (D, MOST) at the samples of a step. Unused columns are at the end."""
    return (np.arange(MOST) / samples) ** np.arange(D)[:, None]
