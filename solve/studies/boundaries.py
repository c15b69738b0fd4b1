"""Search for stability boundaries on many lines simultaneously. The lines lie in the space of the varied
quantities of a family of systems.

SciPy's `find_root` evaluates one trial per bracket and iteration, and abandons a bracket at the first NaN.
Here each bracket has several trials per iteration if there are few brackets. The verdict at a trial, not only
the sign of a smooth function, decides which end of the bracket the trial replaces. Failed points and a second
edge within a bracket are allowed.
"""

import functools
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from solve.arrays import SPLIT, Array
from solve.batch.batch import POINTS
from solve.results.points import KINDS
from solve.studies.contours import Crossings
from solve.studies.stability_samples import Evaluate, StabilitySamples
from solve.terminal import progress

_BATCH = 64
"""Smallest number of points per evaluation. Chosen by judgement: a batch of this size costs little more than
a single point."""

_MAX_TRIALS = 15
"""Maximum number of evenly spaced trials per bracket. Fifteen trials reduce the width of a bracket to a
sixteenth. Chosen by judgement."""

_KIND_TOLERANCE = 1e-5
"""Width of a bracket, as a fraction of `BoundarySearch.scale`, at which the kind of an edge is determined.
Chosen by judgement."""

_MAX_DISTANCE, _MIN_DISTANCE, _END_MARGIN = 0.05, 1e-8, 1e-3
"""Three fractions of the width of a bracket. The first is the largest distance of the first trials from the
predicted edge. The second is the square of the smallest distance after a trial that missed the edge. The
third is the smallest distance of trials from the ends, unless the spacing of the trials is smaller. Chosen by
judgement."""

_PREDICTION_ERROR = 0.2
"""Assumed error of a parabola's zero, as a fraction of the distance from this zero to the zero of the chord.
Chosen by judgement."""

_EXPONENTS = np.array([2.0, 1.0, 0.5])
"""Exponents of the distances of the pairs of trials around a predicted edge. Each distance is the predicted
error, a number below 1, raised to one exponent: the first pair is closer than the error, and the last pair is
farther. Chosen by judgement."""

_SUFFICIENT = 0.4
"""Distance of trials from the predicted edge, as a fraction of the tolerance, below which no further trial is
needed. Chosen by judgement, below 1/2."""

_COMPLEX = KINDS.index("complex")


Prediction = Callable[["Brackets", Array], tuple[Array, Array]]
"""Type of functions that predict an edge in each of k brackets, from the brackets and the indices (k,) of
their lines. Such a function returns the positions (k,) of the edges, each as a fraction of the width of its
bracket, and the errors (k,) of these fractions."""

Differs = Callable[[StabilitySamples, Array], Array]
"""Type of functions of k samples and the indices (k,) of their lines. Such a function returns a mask (k,) of
the samples that lie on the same side of the edge as the high end of the bracket."""


class Brackets(NamedTuple):
    """Brackets of edges on E lines: samples (E,) at both ends, and samples `beyond` (E,) at a point on the
    same line outside the bracket, or at one of the ends if there is no such point."""

    low: StabilitySamples
    high: StabilitySamples
    beyond: StabilitySamples

    def select(self, lines: Array) -> "Brackets":
        """Brackets on the lines with the indices `lines` (k,)."""
        return Brackets(*(end[lines] for end in self))

    def replaced(self, lines: Array, others: "Brackets") -> "Brackets":
        """Copy in which the brackets on the given lines (k,) are replaced by `others`."""
        return Brackets(*(end.replaced(lines, new) for end, new in zip(self, others, strict=True)))

    @property
    def midpoints(self) -> Array:
        """Midpoints (E, v) of the brackets; NaN if an end failed."""
        failed = self.low.failed | self.high.failed
        return np.where(failed[:, None], np.nan, (self.low.points + self.high.points) / 2)

    @property
    def kinds(self) -> Array:
        """Indices (E,) in KINDS of the kind of instability in each bracket: a multiplier passes through +1 or
        -1, or (_COMPLEX) a complex multiplier leaves the unit circle."""
        passes = (self.low.distances[:, :2] > 0) & (self.high.distances[:, :2] < 0)
        return np.where(passes.any(axis=1), passes.argmax(axis=1), _COMPLEX)


@dataclass(frozen=True)
class Lines:
    """Samples on lines along the quantity with index `along`. `line` (k,) contains the index of the line of
    each sample."""

    samples: StabilitySamples
    line: Array
    along: int

    @cached_property
    def neighbours(self) -> tuple[Array, Array]:
        """Indices (c,) of the samples that have a successor on the same line, and indices (c,) of their
        successors."""
        order = np.lexsort((self.samples.points[:, self.along], self.line))
        first, last = order[:-1], order[1:]
        same = self.line[first] == self.line[last]
        return first[same], last[same]

    def changes(self) -> tuple[Array, Brackets]:
        """Return the line indices (c,) and the brackets (c,) of the c changes of stability between
        neighbouring samples. The low end of each bracket is stable."""
        samples, (first, last) = self.samples, self.neighbours
        failed = samples.failed[first] | samples.failed[last]
        changes = (samples.unstable[first] != samples.unstable[last]) & ~failed
        low, high = first[changes], last[changes]
        stable, unstable = (
            samples[np.where(samples.stable[low] == side, low, high)] for side in (True, False)
        )
        has_next = np.append(first[1:] == last[:-1], False)
        beyond = np.where(has_next, np.roll(last, -1), first)
        beyond = np.where(~has_next & np.roll(has_next, 1), np.roll(first, 1), beyond)
        return self.line[low], Brackets(stable, unstable, samples[beyond[changes]])


@dataclass(frozen=True)
class BoundarySearch:
    """Search for edges on lines. `scale` (v,) contains the sizes of the varied quantities; `tolerance` is the
    allowed error of the position of an edge, relative to `scale`."""

    evaluate: Evaluate
    scale: Array
    tolerance: float

    def narrow(
        self,
        brackets: Brackets,
        differs: Differs,
        tolerance: float | None = None,
        predict: Prediction | None = None,
    ) -> Brackets:
        """Narrow brackets (E,) to a tolerance; the default is that of the search.

        Without a prediction, trials are evenly spaced between the ends. With a prediction, trials lie on both
        sides of the predicted edge. The next trials lie closer to the edge if the last trials enclosed it,
        and farther if they missed it.
        """
        width = (self.tolerance if tolerance is None else tolerance) * self.scale
        width = np.maximum(width, np.finfo(float).tiny)
        lines, distance = np.arange(len(brackets.low)), np.full(len(brackets.low), np.nan)
        while True:
            low, high, _ = brackets
            ratio = (np.abs(high.points[lines] - low.points[lines]) / width).max(axis=1, initial=0.0)
            lines, ratio = lines[ratio > 1], ratio[ratio > 1]
            if len(lines) == 0:
                return brackets
            active, radii = brackets.select(lines), np.empty(0)
            if predict is None:
                count = _trial_count(len(lines))
                fractions = np.tile((np.arange(count) + 1) / (count + 1), (len(lines), 1))
            else:
                centre, error = predict(active, lines)
                radii = _trial_distances(np.where(np.isnan(distance[lines]), error, distance[lines]))
                fractions = _fractions_around(centre[:, None], radii, _SUFFICIENT / ratio[:, None])
            span = active.high.points - active.low.points
            trials = active.low.points[:, None] + fractions[..., None] * span[:, None]
            samples = self.evaluate(trials.reshape(-1, trials.shape[2]))
            changed = differs(samples, np.repeat(lines, fractions.shape[1])).reshape(fractions.shape)
            first = np.where(changed.any(axis=1), changed.argmax(axis=1), fractions.shape[1])
            if predict is not None:
                distance[lines] = _next_distances(radii, first)
            narrowed = _narrowed(active, samples, first)
            moved = [
                (new.points != end.points).any(axis=1) for new, end in zip(narrowed, active, strict=True)
            ]
            brackets = brackets.replaced(lines, narrowed)
            lines = lines[moved[0] | moved[1]]

    def edges(
        self, stable: StabilitySamples, unstable: StabilitySamples, beyond: StabilitySamples | None = None
    ) -> tuple[Array, Array]:
        """Return the positions (E, v) and kinds (E,) of the edges between E stable and E unstable samples. A
        position is NaN if a failed point lies between the two samples. For `beyond`, see `Brackets`.

        Where a multiplier passes through +1 or -1, the sign of det(I - Φ) or det(I + Φ) changes. These
        determinants pass through zero smoothly, whereas the modulus of a multiplier need not vary smoothly.
        """
        if len(stable) == 0:
            return stable.points, np.zeros(0, dtype=int)
        brackets = Brackets(stable, unstable, stable if beyond is None else beyond)
        with progress.task(POINTS, self._max_points(np.abs(unstable.points - stable.points))):
            brackets = self._narrow_by_parabolas(
                brackets, lambda samples, _: samples.unstable, _KIND_TOLERANCE
            )
            kinds = brackets.kinds

            def has_left(samples: StabilitySamples, lines: Array) -> Array:
                kind = kinds[lines]
                sign = samples.distances[np.arange(len(lines)), np.minimum(kind, 1)] < 0
                return np.where(kind == _COMPLEX, samples.unstable, sign & ~samples.failed)

            return self._narrow_by_parabolas(brackets, has_left).midpoints, kinds

    def _narrow_by_parabolas(
        self, brackets: Brackets, differs: Differs, tolerance: float | None = None
    ) -> Brackets:
        """Narrow brackets around the zeros of parabolas through values of the crossing function."""
        kinds = brackets.kinds
        on_circle = (kinds == _COMPLEX) & (brackets.low.crossing_values[:, _COMPLEX] < SPLIT)
        predict = _parabolic_prediction(np.where(on_circle, _COMPLEX + 1, kinds))
        return self.narrow(brackets, differs, tolerance, predict)

    def _max_points(self, widths: Array) -> float:
        """Maximum number of evaluations for edges in brackets of these widths (E, v)."""
        fraction = (widths / np.where(self.scale > 0, self.scale, 1.0)).max()
        count = _trial_count(len(widths))
        iterations = np.log(max(fraction, _KIND_TOLERANCE) / self.tolerance) / np.log(count + 1)
        return len(widths) * count * max(1.0, np.ceil(iterations))

    def crossings(self, *sets_of_lines: Lines) -> list[Crossings]:
        """For each set of lines, locate the changes of stability between neighbouring samples. Changes next
        to failed points are omitted.

        A stable interval between two unstable neighbours is located only if one neighbour has a multiplier
        beyond +1, and the other has a multiplier beyond -1.
        """
        changes = [lines.changes() for lines in sets_of_lines]
        ends = zip(*(brackets for _, brackets in changes), strict=True)
        points, kinds = self.edges(*(functools.reduce(StabilitySamples.__add__, end) for end in ends))
        splits = np.cumsum([len(line) for line, _ in changes])[:-1]
        crossings = []
        for lines, (line, _), place, kind in zip(
            sets_of_lines, changes, np.split(points, splits), np.split(kinds, splits), strict=True
        ):
            neighbour, other_place, other_kind = self._stable_stretches(lines.samples, *lines.neighbours)
            is_located = ~np.isnan(place).any(axis=1)
            crossings.append(
                Crossings(
                    np.concatenate((line[is_located], lines.line[neighbour])),
                    np.concatenate((place[is_located], other_place))[:, lines.along],
                    np.concatenate((kind[is_located], other_kind)),
                )
            )
        return crossings

    def sign_changes(self, low: StabilitySamples, high: StabilitySamples, kind: int) -> Brackets:
        """Return brackets (E,), narrowed to the tolerance, of sign changes of the crossing function of +1
        (kind 0) or -1 (kind 1). `low` and `high` (E,) are the samples at the initial ends."""

        def passed(samples: StabilitySamples, lines: Array) -> Array:
            return samples.distances[:, kind] * high.distances[lines, kind] > 0

        predict = _parabolic_prediction(np.full(len(low), kind))
        return self.narrow(Brackets(low, high, low), passed, predict=predict)

    def _stable_stretches(
        self, samples: StabilitySamples, first: Array, last: Array
    ) -> tuple[Array, Array, Array]:
        """Locate the edges of stable intervals between two unstable neighbours, one with a multiplier beyond
        +1 and the other with a multiplier beyond -1. Return, for each edge, the index (c,) of the first
        neighbour, the position (c, v) and the kind (c,)."""
        plus, minus = samples.distances[:, 0] < 0, samples.distances[:, 1] < 0
        beyond_plus, beyond_minus = plus & ~minus, minus & ~plus
        opposite = (beyond_plus[first] & beyond_minus[last]) | (beyond_minus[first] & beyond_plus[last])
        first, last = first[opposite], last[opposite]
        start, end = (samples[np.where(beyond_plus[first] == side, first, last)] for side in (True, False))
        leave, enter = (self.sign_changes(start, end, kind).midpoints for kind in (0, 1))
        is_stretch = np.linalg.norm(leave - start.points, axis=1) < np.linalg.norm(
            enter - start.points, axis=1
        )
        # With several coordinates, another multiplier may be outside the unit circle between the two edges,
        # or at an edge.
        middles = self.evaluate((leave + enter) / 2)
        is_stretch &= middles.stable
        middles, kinds = middles[is_stretch], np.repeat([0, 1], is_stretch.sum())
        middles, ends = middles + middles, start[is_stretch] + end[is_stretch]
        points = np.concatenate((leave[is_stretch], enter[is_stretch]))
        inward = 2 * self.tolerance * self.scale
        beside = self.evaluate(points + np.clip(middles.points - points, -inward, inward))
        other = beside.unstable
        points[other], kinds[other] = self.edges(middles[other], ends[other])
        is_located = ~np.isnan(points).any(axis=1)
        return np.tile(first[is_stretch], 2)[is_located], points[is_located], kinds[is_located]


def _trial_distances(predicted: Array) -> Array:
    """Return ascending distances (E, k) of the trial points from the predicted edges. `predicted` (E,) are
    the distances at which the edges are expected; the result includes these. If there are few lines, k is
    above 1."""
    pairs = min(len(_EXPONENTS), max(1, _BATCH // (2 * len(predicted))))
    return predicted[:, None] ** (_EXPONENTS[:pairs] if pairs > 1 else 1.0)


def _fractions_around(centre: Array, radii: Array, minimum: Array) -> Array:
    """Return fractions (E, 2k) of the brackets on both sides of `centre` (E, 1), at the distances `radii` (E,
    k). Distances below `minimum` (E, 1) are replaced by `minimum`."""
    radii = np.maximum(radii, minimum)
    margin = np.minimum(_END_MARGIN, radii[:, :1])
    fractions = np.column_stack((centre - radii[:, ::-1], centre + radii))
    return np.clip(fractions, margin, 1 - margin)


def _next_distances(radii: Array, first: Array) -> Array:
    """Return the distances (E,) at which the edges are expected from their next predictions.

    `radii` (E, k) are the distances of the last trials on either side of the prediction; `first` (E,) are the
    indices of the first trials beyond the edge.
    """
    lines, pairs = np.arange(len(radii)), radii.shape[1]
    ring = np.abs(first - pairs)
    missed = np.sqrt(np.maximum(radii[:, -1], _MIN_DISTANCE))
    enclosed = np.where(ring == 0, radii[:, 0] ** 2, radii[lines, np.minimum(ring, pairs - 1)])
    return np.where(ring == pairs, missed, enclosed)


def _narrowed(brackets: Brackets, trials: StabilitySamples, first: Array) -> Brackets:
    """Return brackets (E,) narrowed by trials. All brackets have the same number of trials. The new high end
    is the trial with index `first` (E,), or the old high end if there is no such trial. The new low end is
    the point before the new high end. The new point outside the bracket is the next point on either side."""
    count = len(brackets.low)
    samples = brackets.low + trials + brackets.high
    inside, line = len(trials) // count, np.arange(count)

    def at(place: Array) -> StabilitySamples:
        inner = count + line * inside + place - 1
        outer = np.where(place == 0, line, count * (inside + 1) + line)
        return samples[np.where((place > 0) & (place <= inside), inner, outer)]

    return Brackets(at(first), at(first + 1), at(np.where(2 * first > inside, first - 1, first + 2)))


def _parabolic_prediction(columns: Array) -> Prediction:
    """Return a function that predicts edges from the crossing values of samples. For each line, `columns`
    (E,) is the index of the column of crossing values. The prediction is the zero of the parabola through
    three points, or of the chord if there are only two points. The assumed error is a fraction of the
    distance between the zeros of the parabola and the chord. If the sign does not change, for example because
    of another edge inside the bracket, the midpoint is predicted."""

    def predict(brackets: Brackets, lines: Array) -> tuple[Array, Array]:
        low, high, beyond = brackets
        start, end, third = (
            points.crossing_values[np.arange(len(lines)), columns[lines]] for points in brackets
        )
        span = high.points - low.points
        place = ((beyond.points - low.points) * span).sum(axis=1) / np.square(span).sum(axis=1)
        has_root, rise, separation = start * end < 0, end - start, place * (place - 1)
        curved = has_root & (separation > 0) & ~beyond.failed
        bend = np.where(curved, third - start - rise * place, 0.0) / np.where(curved, separation, 1.0)
        # start + (rise - bend) t + bend t² has one root between 0 and 1.
        slope = rise - bend
        larger = -(slope + np.copysign(np.sqrt(np.maximum(slope**2 - 4 * bend * start, 0.0)), slope)) / 2
        root = start / np.where(larger != 0, larger, 1.0)
        other = larger / np.where(bend != 0, bend, 1.0)
        root = np.where((root >= 0) & (root <= 1), root, other)
        chord = -start / np.where(has_root, rise, 1.0)
        error = np.clip(_PREDICTION_ERROR * np.abs(root - chord), _MIN_DISTANCE, _MAX_DISTANCE)
        return np.where(has_root, np.clip(root, 0.0, 1.0), 0.5), np.where(curved, error, _MAX_DISTANCE)

    return predict


def _trial_count(lines: int) -> int:
    """Return the number of trials per bracket in a batch of `lines` brackets."""
    return max(1, min(_MAX_TRIALS, _BATCH // max(lines, 1)))
