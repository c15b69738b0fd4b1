"""Run-up plan: ground length L4 as a function of speed, chosen so that the stresses remain low (section 7.5
of the thesis).

A map contains ratios (P, g) of stress to allowable stress at ascending speeds (P,) and lengths L4 (g,). Of
all paths from the lowest speed to a point of the map, the best one has the smallest maximum ratio. A plan is
a path on which the ratios do not exceed a cap, and which remains close to the mechanism's own L4 and has few
bends."""

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.optimize import linprog

from solve.arrays import Array

_BENDING = 0.005
"""Weight of the bends of a plan, relative to the weight of its distance from the mechanism's own L4. Chosen
by judgement."""

_STRAIGHT, _CLOSE = 1e-4, 1e-12
"""Change of slope, relative to the rate, below which points count as collinear; and difference (m) below
which lengths count as equal.

Both numbers are above the round-off of the linear program and below any change of practical interest.
"""


@dataclass(frozen=True)
class Plan:
    """L4 (m) as a piecewise linear function of the speed, with corners at ascending speeds (rad/s). It is
    constant below the first and above the last speed.

    Corners are rounded: at each speed, L4 is averaged over the speeds from this speed to `lead` (rad/s) above
    it. The velocity of the pivot is then continuous, and zero at the last speed.
    """

    speed: Array
    L4: Array
    lead: float = 0.0

    def __call__(self, speed: Array) -> Array:
        """Return L4 (m) before its corners are rounded, at an array of speeds of any shape."""
        return np.interp(speed, self.speed, self.L4)

    def rounded(self, speed: Array) -> tuple[Array, Array, Array]:
        """Return L4 (m) with rounded corners, and its first and second derivatives with respect to the
        speed."""
        ahead = speed + self.lead
        return (
            (self._integral(ahead) - self._integral(speed)) / self.lead,
            (self(ahead) - self(speed)) / self.lead,
            (self._slope(ahead) - self._slope(speed)) / self.lead,
        )

    def _integral(self, speed: Array) -> Array:
        pieces = np.diff(self.speed) * (self.L4[1:] + self.L4[:-1]) / 2
        cumulative = np.concatenate(([0.0], np.cumsum(pieces)))
        inside = np.clip(speed, self.speed[0], self.speed[-1])
        piece = np.clip(np.searchsorted(self.speed, inside, side="right") - 1, 0, len(pieces) - 1)
        partial = (inside - self.speed[piece]) * (self.L4[piece] + self(inside)) / 2
        below = np.minimum(speed - self.speed[0], 0) * self.L4[0]
        return cumulative[piece] + partial + below + np.maximum(speed - self.speed[-1], 0) * self.L4[-1]

    def _slope(self, speed: Array) -> Array:
        slopes = np.concatenate(([0.0], np.diff(self.L4) / np.diff(self.speed), [0.0]))
        return slopes[np.searchsorted(self.speed, speed, side="right")]


def arrival(ratio: Array) -> Array:
    """Return, for each point (P, g) of the map, the smallest attainable maximum ratio on a path from the
    lowest speed to this point.

    On a path, L4 may change at constant speed, and the speed does not decrease.
    """
    reached, before = np.empty_like(ratio), np.zeros(ratio.shape[1])
    for number, ratios in enumerate(ratio):
        row = np.maximum(ratios, before)
        for j in range(1, len(ratios)):
            row[j] = min(row[j], max(ratios[j], row[j - 1]))
        for j in range(len(ratios) - 2, -1, -1):
            row[j] = min(row[j], max(ratios[j], row[j + 1]))
        reached[number] = before = row
    return reached


def corridor(L4: Array, ratio: Array, cap: float, final: int | None) -> tuple[Array, Array] | None:
    """Return the ends (P,) of a range of L4 at every speed within which the ratio does not exceed the cap;
    None if no such ranges exist.

    Each range overlaps the next one, and the last range contains the length with index `final`, if this is
    given.
    """
    reach = _reached_below(ratio, cap)
    if reach is None:
        return None
    chosen = reach[-1] if final is None else reach[-1] & (np.arange(len(L4)) == final)
    if not chosen.any():
        return None
    ends = []
    for below, ratios in zip(reach[::-1], ratio[::-1], strict=True):
        runs, count = _runs(below)
        shared = np.bincount(runs[chosen], minlength=count + 1)
        chosen = runs == 1 + int(shared[1:].argmax())
        ends.append(_edges(L4, ratios, cap, chosen))
    low, high = np.array(ends[::-1]).T
    return low, high


def _reached_below(ratio: Array, cap: float) -> Array | None:
    """Return a mask (P, g) of the lengths that can be reached with ratios below the cap; None if a speed
    cannot be reached."""
    reach = ratio <= cap
    for number in range(1, len(reach)):
        runs, _ = _runs(reach[number])
        reach[number] &= np.isin(runs, runs[reach[number - 1]])
    return reach if reach.any(axis=1).all() else None


def _runs(chosen: Array) -> tuple[Array, int]:
    """Return labels, counted from 1, of the runs of neighbouring elements of `chosen` that are True, and the
    number of runs. Other elements have the label 0."""
    starts = np.diff(chosen, prepend=False) & chosen
    return np.where(chosen, np.cumsum(starts), 0), int(starts.sum())


def _edges(L4: Array, ratio: Array, cap: float, run: Array) -> tuple[float, float]:
    """Return the values of L4 at which the ratio crosses the cap on the two sides of a run. On a side without
    a crossing, the end of the range of L4 is returned."""
    ends = np.flatnonzero(run)[[0, -1]]
    low, high = (
        _edge(L4, ratio, cap, int(at), int(at) + step) for at, step in zip(ends, (-1, 1), strict=True)
    )
    return low, high


def _edge(L4: Array, ratio: Array, cap: float, inner: int, outer: int) -> float:
    if not 0 <= outer < len(L4) or not np.isfinite(ratio[outer]):
        return float(L4[inner])
    fraction = (cap - ratio[inner]) / (ratio[outer] - ratio[inner])
    return float(L4[inner] + min(max(fraction, 0.0), 1.0) * (L4[outer] - L4[inner]))


def least_change(
    speeds: Array,
    low: Array,
    high: Array,
    own_L4: float,
    rate: float,
    ends: tuple[float | None, float | None],
) -> Plan | None:
    """Return the plan within a corridor that minimises the weighted sum of its distance from the mechanism's
    own L4 (m) and its bends, by linear programming.

    `rate` is the largest change of L4 (m per rad/s). `ends` are L4 at the first and the last speed; None
    where it is free. Return None if no plan exists.
    """
    P, low, high = len(speeds), low.copy(), high.copy()
    for at, end in zip((0, -1), ends, strict=True):
        if end is not None:
            if not low[at] - _CLOSE <= end <= high[at] + _CLOSE:
                return None
            low[at] = high[at] = end
    slope = np.diff(np.eye(P), axis=0) / np.diff(speeds)[:, None]
    bend, one, other = np.diff(slope, axis=0), np.eye(P), np.eye(P - 2)
    # Unknowns: L4 at every speed, and upper bounds on its distances from the mechanism's own L4 and on its
    # bends.
    rows = [
        np.hstack((sign * of_lengths, distance, bends))
        for of_lengths, distance, bends in (
            (slope, np.zeros((P - 1, P)), np.zeros((P - 1, P - 2))),
            (one, -one, np.zeros((P, P - 2))),
            (bend, np.zeros((P - 2, P)), -other),
        )
        for sign in (1, -1)
    ]
    limits = [np.full(2 * (P - 1), rate), np.full(P, own_L4), np.full(P, -own_L4), np.zeros(2 * (P - 2))]
    speed_range = speeds[-1] - speeds[0]
    cost = np.concatenate(
        (np.zeros(P), np.gradient(speeds) / speed_range, np.full(P - 2, _BENDING * speed_range))
    )
    bounds = [*zip(low, high, strict=True), *[(0.0, None)] * (2 * P - 2)]
    A = sparse.csr_array(np.vstack(rows))
    solution = linprog(cost, A_ub=A, b_ub=np.concatenate(limits), bounds=bounds)
    return _knots(speeds, solution.x[:P], rate) if solution.status == 0 else None


def _knots(speeds: Array, L4: Array, rate: float) -> Plan:
    """Return the plan through the points at which the slope of L4 changes."""
    slope = np.diff(L4) / np.diff(speeds)
    bends = np.abs(np.diff(slope)) > _STRAIGHT * rate
    knots = np.concatenate(([True], bends, [True]))
    return Plan(speeds[knots], L4[knots])


def plan_below(
    speeds: Array, L4: Array, ratio: Array, cap: float, own_index: int, rate: float, returns: bool
) -> Plan | None:
    """Return a plan from the lowest to the highest speed on which ratios do not exceed the cap. It starts at
    the L4 with index `own_index`.

    If `returns` is True, L4 must be able to return to this initial value at the highest speed. None is
    returned if no such plan exists.
    """
    passage = corridor(L4, ratio, cap, own_index if returns else None)
    if passage is None:
        return None
    return least_change(speeds, *passage, float(L4[own_index]), rate, (float(L4[own_index]), None))


def least_cap(speeds: Array, L4: Array, ratio: Array, own_index: int, rate: float, returns: bool) -> float:
    """Return the smallest cap for which `plan_below` returns a plan, approximated from above with a relative
    error of 1e-3."""
    reached = arrival(ratio)[-1]
    low = float(max(reached[own_index] if returns else reached.min(), ratio[0, own_index]))
    high, best = low, np.inf
    while not np.isfinite(best):
        if plan_below(speeds, L4, ratio, high, own_index, rate, returns):
            best = high
        elif high > 1e3 * low:
            return np.inf
        else:
            low, high = high, 1.1 * high
    while best - low > 1e-3 * best and low < best:
        middle = (low + best) / 2
        if plan_below(speeds, L4, ratio, middle, own_index, rate, returns):
            best = middle
        else:
            low = middle
    return best
