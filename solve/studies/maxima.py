"""Local maxima over speed of figures that are solved for, several at once."""

import itertools
from collections.abc import Callable

import numpy as np

from solve.arrays import Array
from solve.batch.batch import POINTS
from solve.progress import part, stage
from solve.results.critical_rows import Maximum

_PROMINENT = 1e-2
"""Part of its own height by which a maximum must rise above the ground on either side."""

_SURE = 2.0
"""Times its error by which it must rise besides."""

_BESIDE = 0.05
"""Part of a bracket at which a parabola's vertex is verified on both of its sides."""

_FIRST, _A_ROUND, _SHRINKS = 9, 5, 8.0
"""Speeds solved for a maximum in each of the first two rounds and in a further one, and how much shorter its
bracket is after one, as measured."""


def peaks(values: Array, errors: Array) -> Array:
    """Positions (k,) of local maxima of finite values (P,) that rise above the ground on either side by more
    than a hundredth of their height and more than twice their errors (P,)."""
    from scipy.signal import find_peaks

    top, found = find_peaks(values, prominence=0.0)
    doubt = _SURE * np.nan_to_num(errors[top], nan=0.0)
    return top[found["prominences"] > np.maximum(_PROMINENT * np.abs(values[top]), doubt)]


def sharpened(
    speeds: Array, values: Array, top: Array, value: Callable[[Array], Array], tolerance: float
) -> list[Maximum]:
    """The maxima at positions `top` (k,) of finite values (P,) over rising speeds (P,), each to a tolerance
    relative to its speed. value: of speeds (m,), NaN where there is none.

    The highest point known is kept between its neighbours, which bracket the maximum. The first two rounds
    divide a bracket evenly: it may hold several maxima, such as one where a pair of multipliers has met on
    the real axis. Each further round tries the vertex of the parabola through the three points, points beside
    it, and the middles of both sides: these halve the bracket where no parabola fits, as beside a jump.
    """
    if len(top) == 0:
        return []
    around = top[:, None] + np.array([-1, 0, 1])
    x, y = speeds[around], values[around]
    rounds = np.log(((x[:, 2] - x[:, 0]) / (2 * tolerance * x[:, 1])).max()) / np.log(_SHRINKS)
    with stage(POINTS, len(top) * (2 * _FIRST + _A_ROUND * np.ceil(max(0.0, rounds - 2)))):
        for trying in itertools.chain([_even, _even], itertools.repeat(_trials)):
            open_ = np.flatnonzero(x[:, 2] - x[:, 0] > 2 * tolerance * x[:, 1])
            if len(open_) == 0:
                break
            trials = trying(x[open_], y[open_])
            with part(POINTS, trials.size):
                found = value(trials.ravel()).reshape(trials.shape)
            every = np.concatenate((x[open_], trials), axis=1)
            heights = np.concatenate((y[open_], np.where(np.isfinite(found), found, -np.inf)), axis=1)
            x[open_], y[open_] = _narrowed(every, heights)
    return [Maximum(float(speed), float(height)) for speed, height in zip(x[:, 1], y[:, 1], strict=True)]


def _even(x: Array, y: Array) -> Array:
    """Speeds (k, 9) that divide brackets x (k, 3) evenly, none of them the one that is known."""
    low, best, high = x.T
    at, apart = np.linspace(low, high, _FIRST + 2, axis=1)[:, 1:-1], (high - low)[:, None] / (4 * _FIRST)
    # A bracket's middle is often the point that is known, and would tell nothing.
    return np.where(np.abs(at - best[:, None]) < apart, best[:, None] + apart, at)


def _trials(x: Array, y: Array) -> Array:
    """Speeds (k, 5) within brackets x (k, 3) with heights y (k, 3), the highest in the middle."""
    (low, best, high), beside = x.T, _BESIDE * (x[:, 2] - x[:, 0])
    left, right = best - low, high - best
    with np.errstate(invalid="ignore", divide="ignore"):
        before, after = (y[:, 1] - y[:, 0]) * right, (y[:, 1] - y[:, 2]) * left
        moved = (before * right - after * left) / (2 * (before + after))
    moved = np.where(np.isfinite(moved), moved, 0.0)
    # A speed that is known already would tell nothing.
    moved = np.where(np.abs(moved) < beside / 4, np.copysign(beside / 4, moved), moved)
    vertex = np.clip(best + moved, low + 1.5 * beside, high - 1.5 * beside)
    return np.stack((best - left / 2, vertex - beside, vertex, vertex + beside, best + right / 2), axis=1)


def _narrowed(x: Array, y: Array) -> tuple[Array, Array]:
    """Of points (k, m) the highest, but for the lowest and the highest speed, between its neighbours."""
    order = np.argsort(x, axis=1)
    x, y = (np.take_along_axis(each, order, axis=1) for each in (x, y))
    at = y[:, 1:-1].argmax(axis=1)[:, None] + 1
    best = np.take_along_axis(x, at, axis=1)
    below, above = (x < best).sum(axis=1)[:, None] - 1, (x <= best).sum(axis=1)[:, None]
    chosen = np.concatenate((below, at, above), axis=1)
    return np.take_along_axis(x, chosen, axis=1), np.take_along_axis(y, chosen, axis=1)
