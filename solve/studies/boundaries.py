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

_NEAR = 1e-5
"""Part of the scale to which an edge is bracketed before its kind is determined."""

_REACH, _CLOSEST, _LEAST = 0.05, 1e-8, 1e-3
"""Parts of a bracket: how far from where a change is expected the first trials are; the square of how far
those after a miss are at least; how far from the ends trials are unless they are nearer to each other."""

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
        found = Judged(*map(np.concatenate, zip(self._parts, other._parts, strict=True)))
        if "gaps" in self.__dict__:
            found.__dict__["gaps"] = np.concatenate((self.gaps, other.gaps))
        return found

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
class Lines:
    """Known points on lines (k,) along one of the quantities."""

    known: Judged
    line: Array
    along: int

    @cached_property
    def neighbours(self) -> tuple[Array, Array]:
        """Positions (c,) of points and of the next ones on their lines."""
        order = np.lexsort((self.known.points[:, self.along], self.line))
        first, last = order[:-1], order[1:]
        same = self.line[first] == self.line[last]
        return first[same], last[same]

    def changes(self) -> tuple[Array, Judged, Judged]:
        """Lines (c,) on which stability changes between neighbours, the stable and the unstable ones."""
        known, (first, last) = self.known, self.neighbours
        changes = (known.unstable[first] != known.unstable[last]) & ~(
            known.failed[first] | known.failed[last]
        )
        one, other = first[changes], last[changes]
        stable, unstable = (known[np.where(known.stable[one] == side, one, other)] for side in (True, False))
        return self.line[one], stable, unstable


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
        within `reach` of the bracket, then nearer when they hold it and farther when they miss it.
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
                least = np.minimum(_LEAST, around)[:, None]
                fractions = np.clip(aims, least, 1 - least)
            trials = one.points[:, None] + fractions[..., None] * (other.points - one.points)[:, None]
            found = self.judge(trials.reshape(-1, one.points.shape[1]))
            changed = differs(found, np.repeat(lines, inside)).reshape(fractions.shape)
            first = np.where(changed.any(axis=1), changed.argmax(axis=1), inside)
            near[lines] = np.where(first == 1, near[lines] ** 2, np.sqrt(np.maximum(near[lines], _CLOSEST)))
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

    def crossings(self, *looked: Lines) -> list[Crossings]:
        """Where stability changes between known neighbours on lines; none beside points that failed. Stable
        stretches between two unstable neighbours are found where one of these has a multiplier beyond +1 and
        the other beyond -1."""
        pairs = [lines.changes() for lines in looked]
        stable = functools.reduce(Judged.__add__, [each for _, each, _ in pairs])
        unstable = functools.reduce(Judged.__add__, [each for *_, each in pairs])
        places, kinds = self.edges(stable, unstable)
        ends, found = np.cumsum([len(line) for line, *_ in pairs])[:-1], []
        parts = zip(looked, pairs, np.split(places, ends), np.split(kinds, ends), strict=True)
        for lines, (line, *_), place, kind in parts:
            apart, further, others = self._narrow_stable(lines.known, *lines.neighbours)
            sure = ~np.isnan(place).any(axis=1)
            found.append(
                Crossings(
                    np.concatenate((line[sure], lines.line[apart])),
                    np.concatenate((place[sure], further))[:, lines.along],
                    np.concatenate((kind[sure], others)),
                )
            )
        return found

    def passages(self, low: Judged, high: Judged, way: int) -> tuple[Judged, Judged]:
        """Brackets, to the tolerance, between points low and high (E,): where the gap for +1, way 0, or for
        -1, way 1, changes its sign."""

        def passed(known: Judged, lines: Array) -> Array:
            return known.gaps[:, way] * high.gaps[lines, way] > 0

        return self.sectioned(passed, low, high, aim=_chord(np.full(len(low.points), way)))

    def _narrow_stable(self, known: Judged, first: Array, last: Array) -> tuple[Array, Array, Array]:
        """Both edges of stable stretches between neighbours of which one is beyond +1, the other beyond -1:
        a neighbour (c,), place (c, v) and kind (c,) of each edge."""
        plus, minus = known.gaps[:, 0] < 0, known.gaps[:, 1] < 0
        rising, falling = plus & ~minus, minus & ~plus
        facing = (rising[first] & falling[last]) | (falling[first] & rising[last])
        first, last = first[facing], last[facing]
        start, end = (known[np.where(rising[first] == way, first, last)] for way in (True, False))
        leaves, enters = (_middles(*self.passages(start, end, way)) for way in (0, 1))
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
