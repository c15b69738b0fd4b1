"""Where stability is lost along lines through the quantities of a family, many lines at once."""

import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from solve.arrays import Array
from solve.batch.batch import POINTS, Batch
from solve.batch.gathering import gathered
from solve.progress import part, stage
from solve.results.points import KINDS, Kept, PointResults, kinds_of
from solve.studies.contours import Crossings

_STABILITY = Kept(warnings=False, meetings=False)
_TOGETHER = 64
"""Points that one call of the judge should have at least."""

LIGHTLY_DAMPED = 0.5
"""Modulus of the largest multiplier from which instability is looked for next to stable points."""

_PARABOLAS, _GAIN = 10, 0.5
"""Parabolas a minimum, each of which must predict that it comes down to this part of itself."""

_CLOSE = 1e-10
_NEAR = 1e-5
"""Part of the scale to which an edge is bracketed before its kind is determined."""

_FAR = 1e6
_NOISE = 1e-6
"""Distance from the unit circle up to which it is noise."""


@dataclass(frozen=True)
class Judged:
    """Points (k, v) and what is known of them: unstable (k,), that a multiplier lies outside the unit circle
    by more than its error; stable (k,), that none does; neither where the point failed or its errors leave
    that open. multipliers (k, N), falling in modulus."""

    points: Array
    stable: Array
    unstable: Array
    multipliers: Array

    @classmethod
    def of(cls, points: Array, results: PointResults) -> "Judged":
        failed, outside = results.failed, results.outside
        multipliers = np.where(failed[:, None], 0.0, results.multipliers)
        return cls(points, ~(failed | outside | results.undetermined), outside, multipliers)

    def __getitem__(self, some: Array) -> "Judged":
        return Judged(*(getattr(self, name)[some] for name in Judged.__annotations__))

    def __add__(self, other: "Judged") -> "Judged":
        if len(other.points) == 0:
            return self
        parts = ((getattr(self, name), getattr(other, name)) for name in Judged.__annotations__)
        return Judged(*map(np.concatenate, parts))

    @property
    def failed(self) -> Array:
        """Where nothing is known (k,)."""
        return ~(self.stable | self.unstable)

    @property
    def kinds(self) -> Array:
        """Positions in KINDS (k,) of what the largest multiplier is."""
        return kinds_of(self.multipliers)

    @property
    def gaps(self) -> Array:
        """How far stable points (k,) are from each way to lose stability, (k, 4): det(I - Φ) for +1,
        det(I + Φ) for -1, the distance of two pairs squared, and that of a pair from the unit circle."""
        rho = self.multipliers
        upper = np.imag(rho) > 0
        both = upper[:, :, None] & upper[:, None, :] & ~np.eye(rho.shape[1], dtype=bool)
        distance = np.abs(rho[:, :, None] - rho[:, None, :]) ** 2
        pairs = np.where(both, distance, _FAR).min(axis=(1, 2))
        inside = 1 - np.abs(np.where(upper, rho, 0.0)).max(axis=1)
        inside = np.where(inside > _NOISE, inside, _FAR)
        plus, minus = (np.real(np.prod(1 - sign * rho, axis=1)) for sign in (1, -1))
        return np.clip(np.column_stack((plus, minus, pairs, inside)), -_FAR, _FAR)


Judge = Callable[[Array], Judged]
"""From points (k, v) to what is known of them."""


def judge(batch: Batch) -> Judge:
    """The judge that solves."""

    def judged(points: Array) -> Judged:
        with part(POINTS, len(points)):
            return Judged.of(points, gathered(batch, points, _STABILITY))

    return judged


@dataclass(frozen=True)
class Search:
    """Looks for changes along lines. scale (v,): of the quantities; tolerance: of a place, as part of the
    scale."""

    judge: Judge
    scale: Array
    tolerance: float

    def sectioned(
        self,
        differs: Callable[[Array, Array], Array],
        low: Array,
        high: Array,
        tolerance: float | None = None,
    ) -> tuple[Array, Array]:
        """Bracket changes between points low and high (E, v), to this tolerance or the search's own.

        differs(points (k, v), line (k,)): which points belong to the high end of their line (k,).
        """
        low, high = low.copy(), high.copy()
        close = (self.tolerance if tolerance is None else tolerance) * self.scale
        inside = _inside(len(low))
        fractions = (np.arange(inside) + 1) / (inside + 1)
        while len(low) and (np.abs(high - low) > close).any():
            trials = low[:, None] + fractions[:, None] * (high - low)[:, None]
            lines = np.repeat(np.arange(len(low)), inside)
            changed = differs(trials.reshape(-1, low.shape[1]), lines).reshape(len(low), inside)
            first = np.where(changed.any(axis=1), changed.argmax(axis=1), inside)
            ends = np.concatenate((low[:, None], trials, high[:, None]), axis=1)
            every = np.arange(len(low))
            before, after = ends[every, first], ends[every, first + 1]
            if np.array_equal(before, low) and np.array_equal(after, high):
                break
            low, high = before, after
        return low, high

    def edges(self, stable: Array, unstable: Array) -> tuple[Array, Array]:
        """Where stability is lost between stable and unstable points (E, v): places (E, v) and kinds (E,);
        NaN where a point that failed stands in the way.

        Where a multiplier passes +1 or -1, the sign of det(I - Φ) or det(I + Φ) changes; unlike moduli these
        pass through zero smoothly.
        """
        if len(stable) == 0:
            return stable, np.zeros(0, dtype=int)
        with stage(POINTS, self._points(np.abs(unstable - stable))):
            return self._edges(stable, unstable)

    def _edges(self, stable: Array, unstable: Array) -> tuple[Array, Array]:
        judge = self.judge
        low, high = self.sectioned(lambda points, _: judge(points).unstable, stable, unstable, _NEAR)
        before, after = self._both(low, high)
        passes = (before.gaps[:, :2] > 0) & (after.gaps[:, :2] < 0)
        kinds = np.where(passes.any(axis=1), passes.argmax(axis=1), KINDS.index("complex"))

        def lost(points: Array, lines: Array) -> Array:
            known, kind = judge(points), kinds[lines]
            sign = known.gaps[np.arange(len(points)), np.minimum(kind, 1)] < 0
            return np.where(kind == KINDS.index("complex"), known.unstable, sign & ~known.failed)

        smooth = np.flatnonzero(passes.any(axis=1))
        low[smooth], high[smooth] = self._aimed(before[smooth], after[smooth], kinds[smooth])
        return self._middles(*self.sectioned(lost, low, high)), kinds

    def _points(self, across: Array) -> float:
        """How many edges between ends so far apart (E, v) take at most."""
        parts = (across / np.where(self.scale > 0, self.scale, 1.0)).max()
        inside = _inside(len(across))
        halvings = np.log(max(parts, _NEAR) / self.tolerance) / np.log(inside + 1)
        return len(across) * (inside * max(1.0, np.ceil(halvings)) + 6)

    def _aimed(self, before: Judged, after: Judged, kinds: Array) -> tuple[Array, Array]:
        """Brackets (E, v) of zeros of the gaps of these kinds, which are positive before and negative after:
        narrowed to the tolerance where the chord between them aims well enough."""
        low, high, every = before.points, after.points, np.arange(len(kinds))
        if len(low) == 0:
            return low, high
        across = high - low
        part = np.abs(across / np.where(self.scale > 0, self.scale, 1.0)).max(axis=1)
        reach = 0.4 * self.tolerance / np.where(part > 0, part, 1.0)
        above, below = (known.gaps[every, kinds] for known in (before, after))
        aim = above / (above - below)
        ends = [low + np.clip(aim + way * reach, 0.0, 1.0)[:, None] * across for way in (-1, 1)]
        lost = [(known.gaps[every, kinds] < 0) & ~known.failed for known in self._both(*ends)]
        first, second = (side[:, None] for side in lost)
        narrowed = np.where(first, low, np.where(second, ends[0], ends[1]))
        return narrowed, np.where(first, ends[0], np.where(second, ends[1], high))

    def _both(self, low: Array, high: Array) -> tuple[Judged, Judged]:
        """What is known of two rows of points."""
        known, every = self.judge(np.concatenate((low, high))), np.arange(len(low))
        return known[every], known[every + len(low)]

    def _middles(self, low: Array, high: Array) -> Array:
        """Places between (E, v); NaN where one of the ends failed."""
        before, after = self._both(low, high)
        known = ~(before.failed | after.failed)
        return np.where(known[:, None], (low + high) / 2, np.nan)

    def crossings(self, known: Judged, lines: Array, along: int) -> Crossings:
        """Where stability changes between known neighbours on lines (k,) along one of the quantities; none
        beside points that failed. Stable stretches between two unstable neighbours are found where one of
        these has a multiplier beyond +1 and the other beyond -1."""
        order = np.lexsort((known.points[:, along], lines))
        first, last = order[:-1], order[1:]
        neighbours = lines[first] == lines[last]
        changes = neighbours & (known.unstable[first] != known.unstable[last])
        changes &= ~(known.failed[first] | known.failed[last])
        one, other = first[changes], last[changes]
        stable, unstable = (np.where(known.stable[one] == side, one, other) for side in (True, False))
        places, kinds = self.edges(known.points[stable], known.points[unstable])
        sure = np.isfinite(places).all(axis=1)
        apart, further, others = self._narrow_stable(known, first[neighbours], last[neighbours])
        return Crossings(
            np.concatenate((lines[one[sure]], lines[apart])),
            np.concatenate((places[sure], further))[:, along],
            np.concatenate((kinds[sure], others)),
        )

    def _narrow_stable(self, known: Judged, first: Array, last: Array) -> tuple[Array, Array, Array]:
        """Both edges of stable stretches between neighbours of which one is beyond +1, the other beyond -1:
        a neighbour (c,), place (c, v) and kind (c,) of each edge."""
        plus, minus = known.gaps[:, 0] < 0, known.gaps[:, 1] < 0
        rising, falling = plus & ~minus, minus & ~plus
        facing = (rising[first] & falling[last]) | (falling[first] & rising[last])
        first, last = first[facing], last[facing]
        start = known.points[np.where(rising[first], first, last)]
        end = known.points[np.where(rising[first], last, first)]
        leaves = self.sectioned(lambda points, _: self.judge(points).gaps[:, 0] > 0, start, end)
        enters = self.sectioned(lambda points, _: self.judge(points).gaps[:, 1] < 0, start, end)
        sides = [self._middles(*ends) for ends in (leaves, enters)]
        apart = np.linalg.norm(sides[0] - start, axis=1) < np.linalg.norm(sides[1] - start, axis=1)
        # Beyond one coordinate other multipliers may be outside between the two.
        apart[apart] = self.judge((sides[0] + sides[1])[apart] / 2).stable
        kinds = np.repeat([0, 1], apart.sum())
        return np.tile(first[apart], 2), np.concatenate([part[apart] for part in sides]), kinds


def _inside(lines: int) -> int:
    """Points between the ends of each of so many lines."""
    return max(1, min(15, _TOGETHER // max(lines, 1)))


def hidden(judge: Judge, before: Judged, middle: Judged, after: Judged, promising: float = 1.0) -> Judged:
    """Unstable points between stable ones that are neighbours on lines, three a line (k,).

    Where one of the gaps is least at the middle, its minimum is followed by parabolas; `promising`: part
    of the middle's gap below which the first parabola must predict the minimum.
    """
    gaps = np.stack([part.gaps for part in (before, middle, after)], axis=1)
    all_stable = before.stable & middle.stable & after.stable
    all_stable &= np.abs(middle.multipliers[:, 0]) > LIGHTLY_DAMPED
    least = (gaps[:, 1] < np.minimum(gaps[:, 0], gaps[:, 2])) & all_stable[:, None]
    line, way = np.nonzero(least)
    place = np.linalg.norm(middle.points - before.points, axis=1)[line]
    whole = np.linalg.norm(after.points - before.points, axis=1)[line]
    t = np.column_stack((np.zeros(len(line)), place / np.where(whole > 0, whole, 1.0), np.ones(len(line))))
    h = gaps[line, :, way]
    chosen = _vertex(t, h)[1] <= promising * h[:, 1]
    start, span = before.points[line[chosen]], (after.points - before.points)[line[chosen]]
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
