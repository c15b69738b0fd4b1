"""Where stability is lost along lines through the quantities of a family, many lines at once."""

import functools
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from solve.arrays import Array
from solve.batch.batch import POINTS
from solve.results.points import KINDS
from solve.studies.contours import Crossings
from solve.studies.judged import NOISE, Judge, Judged
from solve.terminal import progress

_TOGETHER = 64
"""Points that one call of the judge should have at least."""

_NEAR = 1e-5
"""Part of the scale to which an edge is bracketed before its kind is determined."""

_REACH, _CLOSEST, _LEAST = 0.05, 1e-8, 1e-3
"""Parts of a bracket: how far from where a change is expected the first trials are at most; the square of how
far those after a miss are at least; how far from the ends trials are unless they are nearer to each other."""

_DOUBT = 0.2
"""Of the distance between the zeros of a chord and a parabola, how far from the latter a change may lie."""

_POWERS = np.array([2.0, 1.0, 0.5])
"""Of the distance at which a change is looked for, as many as there may be pairs of trials."""

_ENOUGH = 0.4
"""Of the tolerance: nearer to where a change is expected no trial is needed."""

_COMPLEX = KINDS.index("complex")


Aim = Callable[[Judged, Judged, Judged, Array], tuple[Array, Array]]
"""From the ends of brackets on lines (k,), and points beyond one of the ends, or one of these again, to the
part of each bracket (k,) at which a change is expected, and by how much it may lie elsewhere (k,)."""


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

    def changes(self) -> tuple[Array, Judged, Judged, Judged]:
        """Lines (c,) on which stability changes between neighbours, the stable and the unstable ones, and
        the next points beyond one of these, or the same again."""
        known, (first, last) = self.known, self.neighbours
        changes = (known.unstable[first] != known.unstable[last]) & ~(
            known.failed[first] | known.failed[last]
        )
        one, other = first[changes], last[changes]
        stable, unstable = (known[np.where(known.stable[one] == side, one, other)] for side in (True, False))
        follows = np.append(first[1:] == last[:-1], False)
        beyond = np.where(follows, np.roll(last, -1), first)
        beyond = np.where(~follows & np.roll(follows, 1), np.roll(first, 1), beyond)
        return self.line[one], stable, unstable, known[beyond[changes]]


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
        beyond: Judged | None = None,
    ) -> tuple[Judged, Judged, Judged]:
        """Bracket changes between points low and high (E,), to this tolerance or the search's own; returns
        the ends, and points beyond one of these.

        differs(known (k,), line (k,)): which points belong to the high end of their line. Without `aim`
        trials lie evenly between the ends; with it on either side of where it expects the change, nearer
        when they hold it and farther when they miss it.
        beyond: points of the same lines outside the brackets, (E,).
        """
        close = (self.tolerance if tolerance is None else tolerance) * self.scale
        close = np.maximum(close, np.finfo(float).tiny)
        lines, near = np.arange(len(low.points)), np.full(len(low.points), np.nan)
        beyond = low if beyond is None else beyond
        while True:
            width = (np.abs(high.points[lines] - low.points[lines]) / close).max(axis=1, initial=0.0)
            lines, width = lines[width > 1], width[width > 1]
            if len(lines) == 0:
                return low, high, beyond
            one, other, radii = low[lines], high[lines], np.empty(0)
            if aim is None:
                inside = _inside(len(lines))
                fractions = np.tile((np.arange(inside) + 1) / (inside + 1), (len(lines), 1))
            else:
                aims, doubts = (part[:, None] for part in aim(one, other, beyond[lines], lines))
                radii = _radii(np.where(np.isnan(near[lines]), doubts[:, 0], near[lines]))
                around = np.maximum(radii, _ENOUGH / width[:, None])
                least = np.minimum(_LEAST, around[:, :1])
                fractions = np.column_stack((aims - around[:, ::-1], aims + around))
                fractions = np.clip(fractions, least, 1 - least)
            trials = one.points[:, None] + fractions[..., None] * (other.points - one.points)[:, None]
            found = self.judge(trials.reshape(-1, one.points.shape[1]))
            changed = differs(found, np.repeat(lines, fractions.shape[1])).reshape(fractions.shape)
            first = np.where(changed.any(axis=1), changed.argmax(axis=1), fractions.shape[1])
            if aim is not None:
                near[lines] = _next_reach(radii, first)
            before, after, next_to = _around(one, found, other, first)
            moved = (before.points != one.points).any(axis=1) | (after.points != other.points).any(axis=1)
            low, high = low.replaced(lines, before), high.replaced(lines, after)
            beyond = beyond.replaced(lines, next_to)
            lines = lines[moved]

    def edges(self, stable: Judged, unstable: Judged, beyond: Judged | None = None) -> tuple[Array, Array]:
        """Where stability is lost between stable and unstable points (E,): places (E, v) and kinds (E,); NaN
        where a point that failed stands in the way. beyond: of `sectioned`.

        Where a multiplier passes +1 or -1, the sign of det(I - Φ) or det(I + Φ) changes; unlike moduli these
        pass through zero smoothly.
        """
        if len(stable.points) == 0:
            return stable.points, np.zeros(0, dtype=int)
        with progress.task(POINTS, self._points(np.abs(unstable.points - stable.points))):
            return self._edges(stable, unstable, beyond)

    def _edges(self, stable: Judged, unstable: Judged, beyond: Judged | None) -> tuple[Array, Array]:
        ends = self._bracketed(stable, unstable, lambda known, _: known.unstable, _NEAR, beyond)
        kinds = _passing(*ends[:2])

        def lost(known: Judged, lines: Array) -> Array:
            kind = kinds[lines]
            sign = known.gaps[np.arange(len(lines)), np.minimum(kind, 1)] < 0
            return np.where(kind == _COMPLEX, known.unstable, sign & ~known.failed)

        return _middles(*self._bracketed(*ends[:2], lost, beyond=ends[2])[:2]), kinds

    def _bracketed(
        self,
        low: Judged,
        high: Judged,
        differs: Callable[[Judged, Array], Array],
        tolerance: float | None = None,
        beyond: Judged | None = None,
    ) -> tuple[Judged, Judged, Judged]:
        """`sectioned`, by parabolas of what passes zero."""
        kinds = _passing(low, high)
        on_circle = (kinds == _COMPLEX) & (low.margins[:, _COMPLEX] < NOISE)
        aim = _parabola(np.where(on_circle, _COMPLEX + 1, kinds))
        return self.sectioned(differs, low, high, tolerance, aim, beyond)

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
        ends = (functools.reduce(Judged.__add__, each) for each in list(zip(*pairs, strict=True))[1:])
        places, kinds = self.edges(*ends)
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

        return self.sectioned(passed, low, high, aim=_parabola(np.full(len(low.points), way)))[:2]

    def _narrow_stable(self, known: Judged, first: Array, last: Array) -> tuple[Array, Array, Array]:
        """Both edges of stable stretches between neighbours of which one is beyond +1, the other beyond -1:
        a neighbour (c,), place (c, v) and kind (c,) of each edge."""
        plus, minus = known.gaps[:, 0] < 0, known.gaps[:, 1] < 0
        rising, falling = plus & ~minus, minus & ~plus
        facing = (rising[first] & falling[last]) | (falling[first] & rising[last])
        first, last = first[facing], last[facing]
        start, end = (known[np.where(rising[first] == way, first, last)] for way in (True, False))
        leaves, enters = (_middles(*self.passages(start, end, way)) for way in (0, 1))
        apart = np.linalg.norm(leaves - start.points, axis=1) < np.linalg.norm(enters - start.points, axis=1)
        # Beyond one coordinate other multipliers may be outside between the two, or beside an edge only.
        middles = self.judge((leaves + enters) / 2)
        apart &= middles.stable
        middles, kinds = middles[apart], np.repeat([0, 1], apart.sum())
        middles, ends = middles + middles, start[apart] + end[apart]
        places, aside = np.concatenate((leaves[apart], enters[apart])), 2 * self.tolerance * self.scale
        others = self.judge(places + np.clip(middles.points - places, -aside, aside)).unstable
        places[others], kinds[others] = self.edges(middles[others], ends[others])
        sure = ~np.isnan(places).any(axis=1)
        return np.tile(first[apart], 2)[sure], places[sure], kinds[sure]


def _radii(near: Array) -> Array:
    """Distances (E, k) of trials from where changes are expected, rising, one of them `near` (E,); more than
    one where there are few lines."""
    pairs = min(len(_POWERS), max(1, _TOGETHER // (2 * len(near))))
    return near[:, None] ** (_POWERS[:pairs] if pairs > 1 else 1.0)


def _next_reach(radii: Array, first: Array) -> Array:
    """Distances (E,) at which to look next, where of trials at the radii (E, k) on either side the ones at
    the positions `first` (E,) were the first beyond the change."""
    lines, pairs = np.arange(len(radii)), radii.shape[1]
    ring = np.abs(first - pairs)
    missed = np.sqrt(np.maximum(radii[:, -1], _CLOSEST))
    held = np.where(ring == 0, radii[:, 0] ** 2, radii[lines, np.minimum(ring, pairs - 1)])
    return np.where(ring == pairs, missed, held)


def _around(low: Judged, trials: Judged, high: Judged, first: Array) -> tuple[Judged, Judged, Judged]:
    """Of the ends of brackets (E,) and as many trials between those of each, line by line, the first that is
    changed, at the position `first` (E,) or the high end, the one before it, and one beside these two."""
    lines, every = len(low.points), low + trials + high
    inside, line = len(trials.points) // lines, np.arange(lines)

    def at(place: Array) -> Judged:
        inner = lines + line * inside + place - 1
        outer = np.where(place == 0, line, lines * (inside + 1) + line)
        return every[np.where((place > 0) & (place <= inside), inner, outer)]

    return at(first), at(first + 1), at(np.where(2 * first > inside, first - 1, first + 2))


def _passing(low: Judged, high: Judged) -> Array:
    """Positions in KINDS (k,) of the multiplier that passes +1 or -1 between two points; else _COMPLEX."""
    passes = (low.gaps[:, :2] > 0) & (high.gaps[:, :2] < 0)
    return np.where(passes.any(axis=1), passes.argmax(axis=1), _COMPLEX)


def _parabola(ways: Array) -> Aim:
    """Where margins, each of a line (E,) at the positions `ways` (E,), are zero on parabolas through three
    points, on chords where a third is not known; in doubt by a part of the distance between these. The middle
    where they are not, as beyond another edge that came to lie between."""

    def aim(low: Judged, high: Judged, beyond: Judged, lines: Array) -> tuple[Array, Array]:
        every, way = np.arange(len(lines)), ways[lines]
        start, end, third = (each.margins[every, way] for each in (low, high, beyond))
        along = high.points - low.points
        place = ((beyond.points - low.points) * along).sum(axis=1) / np.square(along).sum(axis=1)
        passes, rise, apart = start * end < 0, end - start, place * (place - 1)
        known = passes & (apart > 0) & ~beyond.failed
        bend = np.where(known, third - start - rise * place, 0.0) / np.where(known, apart, 1.0)
        # start + (rise - bend) t + bend t² has one root between 0 and 1.
        slope = rise - bend
        larger = -(slope + np.copysign(np.sqrt(np.maximum(slope**2 - 4 * bend * start, 0.0)), slope)) / 2
        root = start / np.where(larger != 0, larger, 1.0)
        other = larger / np.where(bend != 0, bend, 1.0)
        root = np.where((root >= 0) & (root <= 1), root, other)
        chord = -start / np.where(passes, rise, 1.0)
        doubt = np.where(known, np.clip(_DOUBT * np.abs(root - chord), _CLOSEST, _REACH), _REACH)
        return np.where(passes, np.clip(root, 0.0, 1.0), 0.5), doubt

    return aim


def _middles(low: Judged, high: Judged) -> Array:
    """Places between (E, v); NaN where one of the ends failed."""
    failed = low.failed | high.failed
    return np.where(failed[:, None], np.nan, (low.points + high.points) / 2)


def _inside(lines: int) -> int:
    """Points between the ends of each of so many lines."""
    return max(1, min(15, _TOGETHER // max(lines, 1)))
