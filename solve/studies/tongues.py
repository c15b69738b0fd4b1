"""Narrow unstable tongues between stable points that are neighbours on lines."""

import functools
from collections.abc import Callable, Sequence

import numpy as np

from solve.arrays import Array
from solve.period.frozen import frozen
from solve.period.points import OnePoint
from solve.studies.judged import Judge, Judged, passing
from solve.system import PeriodicSystem

LIGHTLY_DAMPED = 0.5
"""Modulus of the largest multiplier from which instability is looked for next to stable points."""

_PARABOLAS, _GAIN = 10, 0.5
"""Parabolas a minimum, each of which must predict that it comes down to this part of itself."""

_CLOSE = 1e-10

_PHASES = 16
_DAMPED_OUT = 1e-2
"""Modulus below which a multiplier, with the matrices frozen, has no part in losing stability."""

_PARTINGS = 20
"""Of the distance of two speeds between which two pairs of multipliers may pass +1 or -1."""

_WITHIN, _AS_ONE = 0.5, 1e-4
"""Distance from +1 or -1 up to which a pair of multipliers may pass there before the next speed; difference
of these distances up to which two pass as one."""

Turning = Callable[[Array], Array]
"""By how much the fastest multiplier that counts turns over 1/Ω (k,), at speeds (k,): its frequency by the
period in phase."""


def fastest_turning(system: PeriodicSystem, ends: tuple[float, float], most: float = np.inf) -> Turning:
    """From the matrices frozen at phases and at the lowest and the highest speed that have some; a mode that
    is damped out within a turn does not count, nor one that turns by more than `most` at the lowest."""
    values = [omega * frozen(OnePoint(system, omega), _PHASES).eigenvalues().ravel() for omega in ends]
    exponents = np.concatenate(values) * system.period
    exponents = exponents[np.abs(np.imag(exponents)) <= most * ends[0]]

    def turning(speeds: Array) -> Array:
        counts = np.real(exponents) > np.log(_DAMPED_OUT) * speeds[:, None]
        return np.where(counts, np.abs(np.imag(exponents)), 0.0).max(axis=1, initial=0.0)

    return turning


def rising(known: Judged) -> Judged:
    """The same in order of the speeds."""
    return known[np.argsort(known.points[:, 0])]


def parted(judge: Judge, known: Judged, turning: Turning, signs: Sequence[int] = (1, -1)) -> Judged:
    """Known speeds, rising, and others between those between which two pairs of multipliers may both pass +1,
    or both -1: each then has a minimum of the gap of its own."""
    for _ in range(_PARTINGS):
        speeds = known.points[:, 0]
        reach = np.minimum(-2 * np.diff(1 / speeds) * turning(speeds[1:]), _WITHIN)
        near = np.any([_both_near(known, sign, reach) for sign in signs], axis=0)
        if not near.any():
            break
        known = rising(known + judge(((speeds[:-1] + speeds[1:]) / 2)[near, None]))
    return known


def _both_near(known: Judged, sign: int, reach: Array) -> Array:
    """Whether two pairs may pass +1, or -1, between neighbours (k - 1,), within reach of both of these."""
    nearest = passing(known.multipliers, sign)
    distance, beyond = np.sqrt(np.maximum(nearest, 0.0)), nearest[:, 1:] < 0
    farther, apart = (
        np.maximum(each[:-1], each[1:]) for each in (distance[:, 1:], np.diff(distance, axis=1))
    )
    near = (farther < reach[:, None]) & (apart > _AS_ONE) & ~(beyond[:-1] | beyond[1:])
    return np.asarray(near.any(axis=1))


def hidden(judge: Judge, known: Judged, middle: Array, stride: int = 1, predicted: float = 1.0) -> Judged:
    """Unstable points between stable ones that are neighbours on lines: three a line, the middle ones at
    positions (k,) among the known, the others `stride` before and after these.

    Where one of the gaps is least at the middle, its minimum is followed by parabolas; `predicted`: part
    of the middle's gap below which the first parabola must predict the minimum.
    """
    stable, gaps = known.stable, known.gaps
    middle = middle[stable[middle - stride] & stable[middle] & stable[middle + stride]]
    middle = middle[np.abs(known.multipliers[middle, 0]) > LIGHTLY_DAMPED]
    lowest = gaps[middle]
    line, way = np.nonzero((lowest < gaps[middle - stride]) & (lowest < gaps[middle + stride]))
    three = middle[line, None] + stride * np.array([-1, 0, 1])
    points, h = known.points[three], gaps[three, way[:, None]]
    place, whole = (np.linalg.norm(points[:, at] - points[:, 0], axis=1) for at in (1, 2))
    t = np.column_stack((np.zeros(len(line)), place / np.where(whole > 0, whole, 1.0), np.ones(len(line))))
    chosen = _vertex(t, h)[1] <= predicted * h[:, 1]
    start, span = points[chosen, 0], (points[:, 2] - points[:, 0])[chosen]
    return _descended(judge, start, span, way[chosen], t[chosen], h[chosen])


def _descended(judge: Judge, start: Array, span: Array, way: Array, t: Array, h: Array) -> Judged:
    """Follow minima h (k, 3) at fractions t (k, 3) of the spans until an unstable point is met."""
    met = []
    for _ in range(_PARABOLAS):
        if len(t) == 0:
            break
        width = 0.05 * (t[:, 2] - t[:, 0])
        trials = _vertex(t, h)[0][:, None] + width[:, None] * np.array([-1.0, 0.0, 1.0])
        trials = np.clip(trials, t[:, :1] + 1e-3 * width[:, None], t[:, 2:] - 1e-3 * width[:, None])
        points = start[:, None] + trials[:, :, None] * span[:, None]
        found = judge(points.reshape(-1, start.shape[1]))
        unstable, failed = found.unstable.reshape(-1, 3), found.failed.reshape(-1, 3)
        met.append(found[np.flatnonzero(found.unstable)])
        new = found.gaps[np.arange(len(found.points)), np.repeat(way, 3)].reshape(-1, 3)
        t, h = _lowest(np.concatenate((t, trials), axis=1), np.concatenate((h, new), axis=1))
        goes_on = ~(unstable | failed).any(axis=1) & (t[:, 2] - t[:, 0] > _CLOSE)
        goes_on &= _vertex(t, h)[1] < _GAIN * h[:, 1]
        start, span, way, t, h = (part[goes_on] for part in (start, span, way, t, h))
    none = np.empty(0, dtype=bool)
    nothing = Judged(np.empty((0, start.shape[1])), none, none, np.empty((0, 1), dtype=complex))
    return functools.reduce(lambda known, more: more + known, met, nothing)


def _vertex(t: Array, h: Array) -> tuple[Array, Array]:
    """Place and value (k,) of the lowest point of the parabola through three points (k, 3)."""
    left, right = np.maximum(np.diff(t, axis=1), 1e-14).T
    fall, rise = (h[:, 1] - h[:, 0]) / left, (h[:, 2] - h[:, 1]) / right
    bend = (rise - fall) / (left + right)
    slope = (fall * right + rise * left) / (left + right)
    bends = bend > 0
    shift = np.where(bends, -slope / (2 * np.where(bends, bend, 1.0)), 0.0)
    shift = np.clip(shift, -0.9 * left, 0.9 * right)
    return t[:, 1] + shift, h[:, 1] + shift * (slope + bend * shift)


def _lowest(t: Array, h: Array) -> tuple[Array, Array]:
    """The lowest of the inner points and its neighbours, (k, 3) each."""
    order = np.argsort(t, axis=1)
    t, h = (np.take_along_axis(part, order, axis=1) for part in (t, h))
    best = 1 + h[:, 1:-1].argmin(axis=1)
    three = best[:, None] + np.array([-1, 0, 1])
    return np.take_along_axis(t, three, axis=1), np.take_along_axis(h, three, axis=1)
