"""Search for narrow unstable tongues between stable neighbouring points on lines."""

import functools

import numpy as np

from solve.arrays import EPS, Array
from solve.studies.speed_grids import LIGHTLY_DAMPED
from solve.studies.stability_samples import Evaluate, StabilitySamples

_MAX_PARABOLAS, _DECREASE = 10, 0.5
"""Maximum number of parabolas per minimum, and largest ratio of the predicted to the current minimum with
which the search continues. SciPy's `find_minimum` would continue to the minimum; here the search ends at the
first unstable point, or as soon as the minimum is unlikely to reach zero. Chosen by judgement."""

_TRIAL_SPACING, _MARGIN = 0.05, 1e-3
"""Distance of the outer trials from the predicted minimum, as a fraction of the bracket; and smallest
distance of trials from the ends of the bracket, as a fraction of the first of these two numbers."""

_FROM_END = 1e-3
"""Distance of additional points from the ends of a line, as a fraction of the first or last interval. The
distance to instability then changes by about 1e-3 of its value. This change exceeds the errors of multipliers
at the default tolerance 1e-8."""


def near_ends(values: Array) -> Array:
    """Return two values just inside the ends of ascending values (k,). With these, a minimum of the distance
    to instability within the first or last interval lies between three samples."""
    first, last = _FROM_END * np.diff(values)[[0, -1]]
    return np.array([values[0] + first, values[-1] - last])


def find_narrow_tongues(
    evaluate: Evaluate, samples: StabilitySamples, middle: Array, stride: int = 1, predicted: float = 1.0
) -> StabilitySamples:
    """Return unstable points found between stable neighbours on lines.

    Each of k lines consists of three samples, with the indices `middle - stride`, `middle` (k,) and `middle +
    stride`. Where the distance to a kind of instability is smallest at the middle sample, its minimum is
    located by parabolas. The search is skipped if the first parabola predicts a minimum above the fraction
    `predicted` of the distance at the middle.
    """
    stable, distances = samples.stable, samples.distances
    middle = middle[stable[middle - stride] & stable[middle] & stable[middle + stride]]
    middle = middle[np.abs(samples.multipliers[middle, 0]) > LIGHTLY_DAMPED]
    lowest = distances[middle]
    line, kind = np.nonzero((lowest < distances[middle - stride]) & (lowest < distances[middle + stride]))
    three = middle[line, None] + stride * np.array([-1, 0, 1])
    points, h = samples.points[three], distances[three, kind[:, None]]
    place, length = (np.linalg.norm(points[:, at] - points[:, 0], axis=1) for at in (1, 2))
    t = np.column_stack((np.zeros(len(line)), place / np.where(length > 0, length, 1.0), np.ones(len(line))))
    follow = _vertex(t, h)[1] <= predicted * h[:, 1]
    start, span = points[follow, 0], (points[:, 2] - points[:, 0])[follow]
    return _descend(evaluate, start, span, kind[follow], t[follow], h[follow])


def _descend(
    evaluate: Evaluate, start: Array, span: Array, kind: Array, t: Array, h: Array
) -> StabilitySamples:
    """Narrow brackets of minima until unstable points are found, and return these points. A bracket consists
    of three fractions `t` (k, 3) of its span (k, v), with the function values `h` (k, 3)."""
    unstable_samples = []
    for _ in range(_MAX_PARABOLAS):
        if len(t) == 0:
            break
        width = _TRIAL_SPACING * (t[:, 2] - t[:, 0])
        trials = _vertex(t, h)[0][:, None] + width[:, None] * np.array([-1.0, 0.0, 1.0])
        trials = np.clip(trials, t[:, :1] + _MARGIN * width[:, None], t[:, 2:] - _MARGIN * width[:, None])
        points = start[:, None] + trials[:, :, None] * span[:, None]
        samples = evaluate(points.reshape(-1, start.shape[1]))
        unstable, failed = samples.unstable.reshape(-1, 3), samples.failed.reshape(-1, 3)
        unstable_samples.append(samples[np.flatnonzero(samples.unstable)])
        new = samples.distances[np.arange(len(samples)), np.repeat(kind, 3)].reshape(-1, 3)
        t, h = _around_lowest(np.concatenate((t, trials), axis=1), np.concatenate((h, new), axis=1))
        active = ~(unstable | failed).any(axis=1)
        active &= _vertex(t, h)[1] < _DECREASE * h[:, 1]
        start, span, kind, t, h = (column[active] for column in (start, span, kind, t, h))
    none = np.empty(0, dtype=bool)
    empty = StabilitySamples.from_multipliers(
        np.empty((0, start.shape[1])), none, none, np.empty((0, 2), dtype=complex)
    )
    return functools.reduce(lambda samples, more: more + samples, unstable_samples, empty)


def _vertex(t: Array, h: Array) -> tuple[Array, Array]:
    """Return the abscissas (k,) and values (k,) of the vertices of parabolas through three points (k, 3)."""
    left, right = np.maximum(np.diff(t, axis=1), EPS).T
    fall, rise = (h[:, 1] - h[:, 0]) / left, (h[:, 2] - h[:, 1]) / right
    bend = (rise - fall) / (left + right)
    slope = (fall * right + rise * left) / (left + right)
    bends = bend > 0
    shift = np.where(bends, -slope / (2 * np.where(bends, bend, 1.0)), 0.0)
    shift = np.clip(shift, -0.9 * left, 0.9 * right)
    return t[:, 1] + shift, h[:, 1] + shift * (slope + bend * shift)


def _around_lowest(t: Array, h: Array) -> tuple[Array, Array]:
    """Return the abscissas and values (k, 3) of the lowest interior point and its two neighbours."""
    order = np.argsort(t, axis=1)
    t, h = (np.take_along_axis(column, order, axis=1) for column in (t, h))
    lowest = 1 + h[:, 1:-1].argmin(axis=1)
    three = lowest[:, None] + np.array([-1, 0, 1])
    return np.take_along_axis(t, three, axis=1), np.take_along_axis(h, three, axis=1)
