"""Identity of Floquet modes as a parameter varies, by adaptive refinement until the identity is unambiguous.

Modes are followed from one sample to the next. Their identity is unambiguous if two conditions hold: every
mode overlaps with only one mode of the next sample, and no exceptional point of two coupled modes lies near
the segment between the samples. Otherwise, a sample is added in the middle.
"""

from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from solve.arrays import Array
from solve.results.followed_modes import CLOSE, LOCKED
from solve.studies.mode_overlaps import CoupledPairs, Overlaps, exceptional_points
from solve.studies.mode_vectors import SURE, ModeVectors

_ACCEPTED = 0.8
"""Overlap above which a mode of the next sample counts as the same mode. Any value above 1/2 excludes a
second candidate; the larger the value, the more samples are required."""

_CLEAR = 0.5
"""Distance of exceptional points from the segment between two samples, relative to the length of the segment,
above which the vectors change gradually: within the segment they rotate by less than 45° (tan 2θ = 1 / (2 ·
0.5))."""

_FEWEST_LEVELS, _MOST_LEVELS = 1, 36
"""Smallest and largest number of bisections of an interval. With at least one bisection, no assignment relies
on two samples alone. After the largest number, the interval is still longer than the round-off of the
parameter."""

_REAL = 0.05
"""Imaginary part of two exceptional points, relative to the distance between them, up to which the points
count as real. Between two real points the pair of modes is locked: its exponents have equal imaginary parts.
Chosen by judgement."""

_WIDE, _FEWEST_LOCKED = 0.5, 4
"""A pair counts as locked if the distance between its two real exceptional points, relative to the step,
exceeds the first number after at least the second number of bisections. Vectors that rotate with the
parameter show an apparent coupling, which is proportional to the square of the step. The apparent coupling
produces exceptional points; the distance between them, relative to the step, is proportional to the step."""


_NEAR, _NARROW = 1.0, 0.1
"""Limits, relative to the step, for the two exceptional points of a mode and its own conjugate. The vector of
the mode is not used as a reference if these points are nearer to the segment than the first number, and half
the distance between the points exceeds the second number. Narrower resonances lie between two samples. Chosen
by judgement."""


_TIE = 0.01
"""Weight of the overlap with the last sample if a track is compared with an earlier sample. This overlap
matters only if overlaps with the earlier sample are equal. Chosen by judgement."""

_FARTHEST = 8.0
"""Distance of exceptional points, relative to the step, up to which the linear model locates them. Chosen by
judgement."""


class Sample(NamedTuple):
    """Modes at a value `x` of the parameter."""

    x: float
    modes: ModeVectors


class Doubt(NamedTuple):
    """Two tracks whose identities are undetermined between the values `low` and `high`."""

    first: int
    second: int
    low: float
    high: float
    kind: str


class Approach(NamedTuple):
    """Two coupled tracks, the two complex exceptional points near which they pass, and the gap in rad/s
    between the exponents of the tracks."""

    first: int
    second: int
    roots: tuple[complex, complex]
    gap: float


class State(NamedTuple):
    """State of the tracks at a sample. For each track: index (T,) of its mode, -1 if it has no mode, and
    shift (T,) of the harmonics."""

    modes: Array
    shifts: Array


@dataclass
class Tracks:
    """Tracks of modes through samples, in the order in which the samples were accepted.

    Attributes
    ----------
    solve : callable
        Function that returns the modes at a value of the parameter, or None if there is no solution.
    samples, states : list
        Accepted samples, and the states of the tracks at these samples.
    doubts, approaches : list
        Undetermined identities, and approaches of coupled modes.
    base : int
        Index of the sample with which the next sample is compared.
    held : dict
        Mapping from tracks that are compared with an earlier sample than `base` to the index of that sample.
    twins : dict
        Mapping from each track to the track of its complex conjugate.
    locked : set
        Pairs of tracks that are locked at the last sample.
    budget : int
        Number of samples that may still be added.
    exhausted : float or None
        Value at which the budget was exhausted. Beyond this value, further samples were required but not
        added.
    """

    solve: Callable[[float], ModeVectors | None]
    budget: int
    samples: list[Sample] = field(default_factory=list)
    states: list[State] = field(default_factory=list)
    doubts: list[Doubt] = field(default_factory=list)
    approaches: list[Approach] = field(default_factory=list)
    base: int = 0
    held: dict[int, int] = field(default_factory=dict)
    twins: dict[int, int] = field(default_factory=dict)
    locked: set[tuple[int, int]] = field(default_factory=set)
    exhausted: float | None = None

    def start(self, sample: Sample) -> None:
        """Begin a track for each mode of the first sample."""
        count = len(sample.modes.exponents)
        self.samples.append(sample)
        self.states.append(State(np.arange(count), np.zeros(count, dtype=int)))
        self.note_twins()

    def note_twins(self) -> None:
        """Record which tracks are complex conjugates at the last sample."""
        sample, modes = self.samples[-1], self.states[-1].modes
        track_of = {mode: track for track, mode in enumerate(modes.tolist()) if mode >= 0}
        for mode, track in track_of.items():
            other = track_of.get(int(sample.modes.partners[mode]), track)
            if other != track and track not in self.twins and other not in self.twins:
                self.twins[track], self.twins[other] = other, track

    def extend(self, sample: Sample, level: int = 0) -> None:
        """Extend the tracks to a sample, through additional samples where needed."""
        step = Step(self, sample, level)
        if level < _FEWEST_LEVELS or not step.settled:
            x = self.samples[-1].x
            middle = (x + sample.x) / 2
            between = None
            if level < _MOST_LEVELS and self.budget > 0 and min(x, sample.x) < middle < max(x, sample.x):
                self.budget -= 1
                between = self.solve(middle)
            if between is not None:
                self.extend(Sample(middle, between), level + 1)
                self.extend(sample, level + 1)
                return
            if self.budget == 0 and self.exhausted is None:
                self.exhausted = x
        step.accept()


class Step:
    """Assignment of the modes of the next sample to the tracks."""

    def __init__(self, tracks: Tracks, sample: Sample, level: int):
        self.tracks, self.sample, self.level = tracks, sample, level
        self.before = tracks.samples[tracks.base]
        self.overlaps = Overlaps.between(self.before.modes, sample.modes)
        self.references, products = self._references()
        largest = products.max(axis=-1)
        self.modes = _assigned(largest)
        self.shifts = products[np.arange(len(products)), self.modes].argmax(axis=-1) - self.overlaps.largest
        self.shifts[self.modes < 0] = 0
        self.products = largest
        self.quality = self._quality()

    def _references(self) -> tuple[State, Array]:
        """Return the state with which each track is compared, and the overlaps (T, k, S) of T tracks with k
        modes of the next sample at S shifts."""
        tracks = self.tracks
        modes, shifts = (values.copy() for values in tracks.states[tracks.base])
        products = np.where((modes >= 0)[:, None, None], self.overlaps.products[modes], 0.0)
        for track, at in tracks.held.items():
            earlier = Overlaps.between(tracks.samples[at].modes, self.sample.modes).products
            modes[track], shifts[track] = (values[track] for values in tracks.states[at])
            # The last sample decides between modes whose overlaps with the earlier sample are equal.
            products[track] = earlier[modes[track]] + _TIE * products[track]
        return State(modes, shifts), products

    def _quality(self) -> Array:
        """Overlap (T,) of each track with its mode. Overlaps are summed over modes that coincide at one of
        the two samples, and over a mode and its conjugate."""
        quality, base = np.zeros(len(self.modes)), self.tracks.states[self.tracks.base].modes
        for track in np.flatnonzero(self.modes >= 0).tolist():
            twin = self.tracks.twins.get(track, track)
            after = self.sample.modes.coincident[self.modes[track]].copy()
            after[self.modes[twin]] |= self.modes[twin] >= 0
            before = self.before.modes.coincident[base[track]][base] & (base >= 0)
            before[twin] = True
            rows = self.products[:, self.modes[track]]
            quality[track] = max(self.products[track, after].sum(), rows[before].sum())
        return quality

    @cached_property
    def self_overlap(self) -> Array:
        """Overlap (T,) of each track with its mode alone, without coincident or conjugate modes."""
        return np.where(self.modes >= 0, self.products[np.arange(len(self.modes)), self.modes], 0.0)

    @property
    def noise(self) -> Array:
        """Bounds (T,) on the sum of the errors of each track's exponents at the two samples."""
        at_base = self.tracks.states[self.tracks.base].modes
        return SURE * (self.before.modes.errors[at_base] + self.sample.modes.errors[self.modes])

    @cached_property
    def compared(self) -> Array:
        """Indices of the tracks that have a mode both at the sample `base` and at the next sample."""
        return np.flatnonzero((self.modes >= 0) & (self.tracks.states[self.tracks.base].modes >= 0))

    @cached_property
    def pairs(self) -> CoupledPairs:
        """Exceptional points of all pairs of the compared tracks."""
        at, base = self.compared, self.tracks.states[self.tracks.base]
        mode_indices, points = (base.modes[at], self.modes[at]), (self.before.modes, self.sample.modes)
        shifts = self.references.shifts + self.shifts - base.shifts
        return exceptional_points(self.overlaps, points, mode_indices, shifts[at], self.noise[at])

    @cached_property
    def twins(self) -> Array:
        """Mask (r,) of the pairs in `pairs` that consist of a mode and its conjugate."""
        first, second = (self.compared[each] for each in (self.pairs.first, self.pairs.second))
        pairs = zip(first.tolist(), second.tolist(), strict=True)
        return np.array([self.tracks.twins.get(one) == other for one, other in pairs], dtype=bool)

    @cached_property
    def close(self) -> Array:
        """Mask (r, S) of the pairs and shifts whose tracks are coupled and have exceptional points near the
        segment."""
        pairs = self.pairs
        modes = self.tracks.states[self.tracks.base].modes[self.compared]
        is_separate = ~self.before.modes.coincident[modes[pairs.first], modes[pairs.second]]
        is_held = np.isin(self.compared, list(self.tracks.held))
        is_open = is_separate & ~self.twins & ~(is_held[pairs.first] & is_held[pairs.second])
        return pairs.coupled & (pairs.distance < _CLEAR) & is_open[:, None]

    @cached_property
    def locked(self) -> Array:
        """Mask (r, S) of the pairs and shifts in `close` whose exceptional points are real."""
        roots = self.pairs.roots
        with np.errstate(invalid="ignore"):
            separation = np.abs(np.real(roots[0] - roots[1]))
        is_real = np.abs(np.imag(roots)).max(axis=0) <= _REAL * separation
        return self.close & is_real & (separation > _WIDE) & (self.level >= _FEWEST_LOCKED)

    @cached_property
    def locked_pairs(self) -> list[tuple[int, int]]:
        return self._pairs(self.locked)

    @cached_property
    def unsettled(self) -> list[tuple[int, int]]:
        """Pairs of tracks whose identities are undetermined after this step."""
        pairs = self._pairs(self.close & ~self.locked)
        exempt = {*self.tracks.held, *(track for pair in self.locked_pairs for track in pair)}
        weak = [track for track in np.flatnonzero(self.quality < _ACCEPTED).tolist() if track not in exempt]
        pairs += [(track, self._rival(track)) for track in weak if self.modes[track] >= 0]
        return sorted({(min(pair), max(pair)) for pair in pairs})

    @property
    def settled(self) -> bool:
        return not self.unsettled

    def _pairs(self, flags: Array) -> list[tuple[int, int]]:
        rows = np.flatnonzero(flags.any(axis=1))
        first, second = (self.compared[each[rows]] for each in (self.pairs.first, self.pairs.second))
        return [*zip(first.tolist(), second.tolist(), strict=True)]

    def _rival(self, track: int) -> int:
        """Return the other track whose overlap with the mode of this track is largest."""
        overlap = self.products[:, self.modes[track]].copy()
        overlap[track] = -1.0
        return int(overlap.argmax())

    def accept(self) -> None:
        """Append the sample to the tracks."""
        tracks, here = self.tracks, len(self.tracks.samples)
        low, high = self.before.x, self.sample.x
        tracks.locked |= set(self.locked_pairs)
        for kind, pairs in ((CLOSE, self.unsettled), (LOCKED, sorted(tracks.locked))):
            tracks.doubts += [Doubt(*pair, low, high, kind) for pair in pairs]
        tracks.locked = {pair for pair in tracks.locked if self._is_locked(*pair)}
        self._note_approaches()
        tracks.samples.append(self.sample)
        tracks.states.append(State(self.modes, self.references.shifts + self.shifts))
        self._hold()
        tracks.note_twins()
        if not self._coincidence_is_new() or tracks.base < here - 1:
            tracks.base = here

    def _hold(self) -> None:
        """Decide which tracks are compared with an earlier sample because their eigenvectors are mixed:
        tracks of locked pairs, and of modes near a resonance with their own conjugates."""
        tracks, found = self.tracks, self.pairs
        width = np.abs(found.roots[0] - found.roots[1]) / 2
        is_near = found.coupled & (found.distance < np.maximum(width, _NEAR)) & (width > _NARROW)
        near = {track for pair in self._pairs(is_near & self.twins[:, None]) for track in pair}
        for track in [track for track in tracks.held if self._is_released(track, near)]:
            del tracks.held[track]
        locked = {track for pair in self.locked_pairs for track in pair}
        mixed = {track for track in tracks.twins if 0 < self.self_overlap[track] < _ACCEPTED}
        for track in near | mixed | {track for track in locked if self.self_overlap[track] < _ACCEPTED}:
            tracks.held.setdefault(track, tracks.base)

    def _is_locked(self, first: int, second: int) -> bool:
        """Return whether the exponents of two tracks at the sample have equal imaginary parts and different
        growth rates."""
        if self.modes[first] < 0 or self.modes[second] < 0:
            return False
        modes = self.sample.modes
        one, other = modes.exponents[self.modes[[first, second]]]
        limit = SURE * float(modes.errors[self.modes[[first, second]]].sum())
        turns = (one - other).imag / modes.rotation
        return abs(turns - round(turns)) * modes.rotation <= limit < abs((one - other).real)

    def _is_released(self, track: int, near: Collection[int]) -> bool:
        """Return whether a held track can be compared with the last sample again. This is the case if the
        eigenvector of the track is no longer mixed, or if the earlier sample is too different."""
        mode = self.modes[track]
        is_real = mode >= 0 and track in self.tracks.twins and self.sample.modes.partners[mode] == mode
        if any(track in pair for pair in self.tracks.locked):
            return False
        if is_real or track in near:
            return bool(self.quality[track] < _ACCEPTED)
        return bool(self.self_overlap[track] >= _ACCEPTED)

    def _coincidence_is_new(self) -> bool:
        """Return whether modes coincide at this sample that do not coincide at the sample `base`."""
        present = np.flatnonzero((self.modes >= 0) & (self.tracks.states[self.tracks.base].modes >= 0))
        before = self.tracks.states[self.tracks.base].modes[present]
        after = self.modes[present]
        coincident_before = self.before.modes.coincident[np.ix_(before, before)]
        return bool((self.sample.modes.coincident[np.ix_(after, after)] & ~coincident_before).any())

    def _note_approaches(self) -> None:
        """For each coupled pair, record the two exceptional points if the midpoint between them lies within
        this step."""
        pairs, width = self.pairs, self.sample.x - self.before.x
        middle = np.real(pairs.roots).mean(axis=0)
        is_near = pairs.coupled & (middle >= 0) & (middle < 1) & (pairs.distance < _FARTHEST)
        for row, column in np.argwhere(is_near).tolist():
            first, second = (self.before.x + width * complex(root) for root in pairs.roots[:, row, column])
            pair = sorted((int(self.compared[pairs.first[row]]), int(self.compared[pairs.second[row]])))
            gap = float(pairs.gap[row, column])
            self.tracks.approaches.append(Approach(pair[0], pair[1], (first, second), gap))


def _assigned(overlaps: Array) -> Array:
    """Assign modes to tracks so that the sum of the `overlaps` (T, k) is maximal. Return, for each track, the
    index (T,) of its mode; -1 for a track without a mode."""
    from scipy.optimize import linear_sum_assignment

    modes = np.full(len(overlaps), -1)
    rows, columns = linear_sum_assignment(-overlaps)
    modes[rows] = np.where(overlaps[rows, columns] > 0, columns, -1)
    return modes
