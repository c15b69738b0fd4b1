"""Where stability is lost along lines through the quantities of a family, many lines at once."""

import functools
import itertools
from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import cached_property

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

_REACH, _LOST, _LEAST = 0.05, 0.25, 1e-3
"""Parts of a bracket: how far from where a change is expected the first trials are, and those after it was
missed; how far from the ends all are."""

_ENOUGH = 0.4
"""Of the tolerance: nearer to where a change is expected no trial is needed."""

_COMPLEX = KINDS.index("complex")
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
        chosen = Judged(*(part[some] for part in self._parts))
        if "gaps" in self.__dict__:
            chosen.__dict__["gaps"] = self.gaps[some]
        return chosen

    def __add__(self, other: "Judged") -> "Judged":
        if len(other.points) == 0:
            return self
        return Judged(*map(np.concatenate, zip(self._parts, other._parts, strict=True)))

    def replaced(self, rows: Array, others: "Judged") -> "Judged":
        """The same with other points in some rows (k,)."""
        changed = [each.copy() for each in self._parts]
        for each, new in zip(changed, others._parts, strict=True):
            each[rows] = new
        return Judged(*changed)

    @property
    def _parts(self) -> tuple[Array, ...]:
        return tuple(getattr(self, each.name) for each in fields(self))

    @property
    def failed(self) -> Array:
        """Where nothing is known (k,)."""
        return ~(self.stable | self.unstable)

    @property
    def kinds(self) -> Array:
        """Positions in KINDS (k,) of what the largest multiplier is."""
        return kinds_of(self.multipliers)

    @cached_property
    def gaps(self) -> Array:
        """How far stable points (k,) are from each way to lose stability, (k, 4): det(I - Φ) for +1,
        det(I + Φ) for -1, the distance of two pairs squared, and that of a pair from the unit circle."""
        rho = np.ascontiguousarray(self.multipliers.T)
        upper = np.imag(rho) > 0
        pairs = np.full(rho.shape[1], _FAR)
        for one, other in itertools.combinations(range(len(rho)), 2):
            both = upper[one] & upper[other]
            if both.any():
                distance = np.abs(rho[one, both] - rho[other, both]) ** 2
                pairs[both] = np.minimum(pairs[both], distance)
        inside = 1 - np.abs(np.where(upper, rho, 0.0)).max(axis=0)
        inside = np.where(inside > _NOISE, inside, _FAR)
        plus, minus = (np.real(np.prod(1 - sign * rho, axis=0)) for sign in (1, -1))
        return np.clip(np.column_stack((plus, minus, pairs, inside)), -_FAR, _FAR)


Judge = Callable[[Array], Judged]
"""From points (k, v) to what is known of them."""

Aim = Callable[[Judged, Judged, Array], Array]
"""From the ends of brackets on lines (k,) to the part of each (k,) at which a change is expected."""


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
        differs: Callable[[Judged, Array], Array],
        low: Judged,
        high: Judged,
        tolerance: float | None = None,
        aim: Aim | None = None,
        reach: float = _REACH,
    ) -> tuple[Judged, Judged]:
        """Bracket changes between points low and high (E,), to this tolerance or the search's own.

        differs(known (k,), line (k,)): which points belong to the high end of their line. Without `aim`
        trials lie evenly between the ends; with it one on either side of where it expects the change, first
        within `reach` of the bracket, then ever nearer as long as they hold it.
        """
        close = (self.tolerance if tolerance is None else tolerance) * self.scale
        close = np.maximum(close, np.finfo(float).tiny)
        lines, near = np.arange(len(low.points)), np.full(len(low.points), reach)
        while True:
            width = (np.abs(high.points[lines] - low.points[lines]) / close).max(axis=1, initial=0.0)
            lines, width = lines[width > 1], width[width > 1]
            if len(lines) == 0:
                return low, high
            one, other = low[lines], high[lines]
            if aim is None:
                inside = _inside(len(lines))
                fractions = np.tile((np.arange(inside) + 1) / (inside + 1), (len(lines), 1))
            else:
                inside, around = 2, np.maximum(near[lines], _ENOUGH / width)
                aims = aim(one, other, lines)[:, None] + around[:, None] * np.array([-1.0, 1.0])
                fractions = np.clip(aims, _LEAST, 1 - _LEAST)
            trials = one.points[:, None] + fractions[..., None] * (other.points - one.points)[:, None]
            found = self.judge(trials.reshape(-1, one.points.shape[1]))
            changed = differs(found, np.repeat(lines, inside)).reshape(fractions.shape)
            first = np.where(changed.any(axis=1), changed.argmax(axis=1), inside)
            near[lines] = np.where(first == 1, near[lines] ** 2, _LOST)
            before, after = _around(one, found, other, first)
            moved = (before.points != one.points).any(axis=1) | (after.points != other.points).any(axis=1)
            low, high = low.replaced(lines, before), high.replaced(lines, after)
            lines = lines[moved]

    def edges(self, stable: Judged, unstable: Judged) -> tuple[Array, Array]:
        """Where stability is lost between stable and unstable points (E,): places (E, v) and kinds (E,); NaN
        where a point that failed stands in the way.

        Where a multiplier passes +1 or -1, the sign of det(I - Φ) or det(I + Φ) changes; unlike moduli these
        pass through zero smoothly.
        """
        if len(stable.points) == 0:
            return stable.points, np.zeros(0, dtype=int)
        with stage(POINTS, self._points(np.abs(unstable.points - stable.points))):
            return self._edges(stable, unstable)

    def _edges(self, stable: Judged, unstable: Judged) -> tuple[Array, Array]:
        low, high = self._bracketed(stable, unstable, lambda known, _: known.unstable, _REACH, _NEAR)
        kinds = _passing(low, high)

        def lost(known: Judged, lines: Array) -> Array:
            kind = kinds[lines]
            sign = known.gaps[np.arange(len(lines)), np.minimum(kind, 1)] < 0
            return np.where(kind == _COMPLEX, known.unstable, sign & ~known.failed)

        return _middles(*self._bracketed(low, high, lost, 0.0)), kinds

    def _bracketed(
        self,
        low: Judged,
        high: Judged,
        differs: Callable[[Judged, Array], Array],
        reach: float,
        tolerance: float | None = None,
    ) -> tuple[Judged, Judged]:
        """`sectioned`, by the chord of the gap that passes zero where one does."""
        kinds = _passing(low, high)
        for smooth in (True, False):
            some = np.flatnonzero((kinds != _COMPLEX) == smooth)

            def differing(known: Judged, lines: Array, some: Array = some) -> Array:
                return differs(known, some[lines])

            aim = _chord(kinds[some]) if smooth else None
            ends = self.sectioned(differing, low[some], high[some], tolerance, aim, reach)
            low, high = (
                known.replaced(some, narrowed) for known, narrowed in zip((low, high), ends, strict=True)
            )
        return low, high

    def _points(self, across: Array) -> float:
        """How many edges between ends so far apart (E, v) take at most."""
        parts = (across / np.where(self.scale > 0, self.scale, 1.0)).max()
        inside = _inside(len(across))
        halvings = np.log(max(parts, _NEAR) / self.tolerance) / np.log(inside + 1)
        return len(across) * inside * max(1.0, np.ceil(halvings))

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
        places, kinds = self.edges(known[stable], known[unstable])
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
        start, end = (known[np.where(rising[first] == way, first, last)] for way in (True, False))
        signs = np.array([1.0, -1.0])
        leaves, enters = (
            _middles(*self.sectioned(lambda one, _, k=k: signs[k] * one.gaps[:, k] > 0, start, end, aim=aim))
            for k, aim in enumerate(_chord(np.full(len(first), k)) for k in range(2))
        )
        sides = [leaves, enters]
        apart = np.linalg.norm(leaves - start.points, axis=1) < np.linalg.norm(enters - start.points, axis=1)
        # Beyond one coordinate other multipliers may be outside between the two.
        apart[apart] = self.judge((sides[0] + sides[1])[apart] / 2).stable
        kinds = np.repeat([0, 1], apart.sum())
        return np.tile(first[apart], 2), np.concatenate([part[apart] for part in sides]), kinds


def _around(low: Judged, trials: Judged, high: Judged, first: Array) -> tuple[Judged, Judged]:
    """Of the ends of brackets (E,) and as many trials between those of each, line by line, the first that is
    changed, at the position `first` (E,) or the high end, and the one before it."""
    lines, every = len(low.points), low + trials + high
    inside, line = len(trials.points) // lines, np.arange(lines)
    trial = lines + line * inside + first
    before = np.where(first == 0, line, trial - 1)
    after = np.where(first == inside, lines * (inside + 1) + line, trial)
    return every[before], every[after]


def _passing(low: Judged, high: Judged) -> Array:
    """Positions in KINDS (k,) of the multiplier that passes +1 or -1 between two points; else _COMPLEX."""
    passes = (low.gaps[:, :2] > 0) & (high.gaps[:, :2] < 0)
    return np.where(passes.any(axis=1), passes.argmax(axis=1), _COMPLEX)


def _chord(kinds: Array) -> Aim:
    """Where gaps of these kinds (E,) are zero on the chords between two points; the middle where they are
    not, as beyond another edge that came to lie between."""

    def aim(low: Judged, high: Judged, lines: Array) -> Array:
        every, kind = np.arange(len(lines)), kinds[lines]
        above, below = low.gaps[every, kind], high.gaps[every, kind]
        passes = above * below < 0
        return np.where(passes, above / np.where(passes, above - below, 1.0), 0.5)

    return aim


def _middles(low: Judged, high: Judged) -> Array:
    """Places between (E, v); NaN where one of the ends failed."""
    failed = low.failed | high.failed
    return np.where(failed[:, None], np.nan, (low.points + high.points) / 2)


def _inside(lines: int) -> int:
    """Points between the ends of each of so many lines."""
    return max(1, min(15, _TOGETHER // max(lines, 1)))


def hidden(judge: Judge, before: Judged, middle: Judged, after: Judged, predicted: float = 1.0) -> Judged:
    """Unstable points between stable ones that are neighbours on lines, three a line (k,).

    Where one of the gaps is least at the middle, its minimum is followed by parabolas; `predicted`: part
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
    chosen = _vertex(t, h)[1] <= predicted * h[:, 1]
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
