"""Modes of a result, extracted from tracks: one mode of each conjugate pair, with its harmonics, crossings
and veerings."""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from solve.arrays import Array
from solve.results.followed_modes import CROSSING, VEERING, Ambiguity, Meeting
from solve.studies.mode_tracks import Approach, Doubt, Sample, State, Tracks
from solve.studies.mode_vectors import SURE, ModeVectors

_COVERED = 0.99
"""Fraction of each mode that the listed harmonics must contain. `_MOST_HARMONICS` limits their number. Chosen
by judgement."""

_MOST_HARMONICS = 12
"""Maximum number of harmonics listed on either side of the main harmonic. Chosen by judgement."""

_SAME = 1e-6
"""Relative difference between the participations of two harmonics up to which they count as equal. Chosen by
judgement."""

_LEAST_EXCHANGE = 4.0
"""A veering is listed if the ratio of the range of values to the width of the veering is at least this
number. In a wider veering, the modes exchange their vectors only in part. Chosen by judgement."""


class Identities(NamedTuple):
    """Modes at the P given values and at the S samples of the whole path; for the fields see
    `FollowedModes`."""

    exponents: Array
    errors: Array
    labels: list[str]
    harmonics: Array
    participation: Array
    meetings: list[Meeting]
    ambiguous: list[Ambiguity]
    path: Array
    path_exponents: Array
    resolution: float


@dataclass(frozen=True)
class _Path:
    """All samples in ascending order of x, with the states of T tracks at each sample."""

    samples: Sequence[Sample]
    states: Sequence[State]

    @classmethod
    def from_branches(cls, branches: tuple[Tracks, Tracks]) -> "_Path":
        down, up = branches
        pairs = [*zip(down.samples[:0:-1], down.states[:0:-1], strict=True)]
        pairs += zip(up.samples, up.states, strict=True)
        samples, states = zip(*pairs, strict=True)
        return cls(samples, states)

    @property
    def x(self) -> Array:
        return np.array([sample.x for sample in self.samples])

    def of_modes(self, name: str) -> Array:
        """Values (S, T) of the attribute `name` of the modes; NaN where a track has no mode."""
        rows = []
        for sample, state in zip(self.samples, self.states, strict=True):
            values = getattr(sample.modes, name)[state.modes]
            rows.append(np.where(state.modes >= 0, values, np.nan))
        return np.array(rows)

    @property
    def rotations(self) -> Array:
        """Angular frequencies 2π/T (S, 1) in rad/s at the samples."""
        return np.array([[sample.modes.rotation] for sample in self.samples])

    def partners(self) -> Array:
        """Index (S, T) of the track that contains the complex conjugate of each track's mode. It is the index
        of the same track if the multiplier is real, and -1 if no track contains the conjugate."""
        rows = []
        for sample, state in zip(self.samples, self.states, strict=True):
            track_of = np.full(len(sample.modes.exponents) + 1, -1)
            track_of[state.modes] = np.arange(len(state.modes))
            track_of[-1] = -1
            conjugate = np.append(sample.modes.partners, -1)[state.modes]
            rows.append(np.where(state.modes >= 0, track_of[conjugate], -1))
        return np.array(rows)


def identified(branches: tuple[Tracks, Tracks], values: Sequence[float]) -> Identities:
    """Identify the modes at the given values. The two branches are the tracks from one sample towards lower
    and towards higher values."""
    path = _Path.from_branches(branches)
    indices = np.searchsorted(path.x, values)
    main = np.array([_main_harmonic(path, indices, track) for track in range(len(path.states[0].modes))])
    shifts = np.array([state.shifts for state in path.states]) + main
    twins = {**branches[0].twins, **branches[1].twins}
    exponents = path.of_modes("exponents") + 1j * shifts * path.rotations
    tracks, exponents = _columns(path, exponents, twins)
    first = np.nan_to_num(np.abs(np.imag(exponents[indices[0], tracks])), nan=np.inf)
    tracks = tracks[np.argsort(first, kind="stable")]
    labels = [str(number) for number in range(1, len(tracks) + 1)]
    label_of = dict(zip(tracks.tolist(), labels, strict=True))
    label_of |= {twins[track]: label for track, label in label_of.items() if track in twins}
    doubts = [doubt for branch in branches for doubt in branch.doubts]
    ambiguous = _ambiguities(doubts, label_of)
    approaches = [approach for branch in branches for approach in branch.approaches]
    meetings = _veerings(approaches, label_of, path.x)
    meetings += _crossings(path.x, exponents[:, tracks], labels, ambiguous)
    errors = path.of_modes("errors")[:, tracks]
    return Identities(
        exponents[indices][:, tracks],
        errors[indices],
        labels,
        *_participation(path, indices, tracks, shifts),
        sorted(meetings, key=lambda meeting: meeting.value),
        ambiguous,
        path.x,
        exponents[:, tracks],
        4 * SURE * float(np.nanmax(errors, initial=0.0)),
    )


def _main_harmonic(path: _Path, given: Array, track: int) -> int:
    """Return the number, as counted in the track, of the harmonic whose participation is largest when summed
    over all given values. If several harmonics have equal sums, the harmonic with the highest frequency is
    returned."""
    totals: dict[int, float] = {}
    frequencies: dict[int, float] = {}
    for at in given.tolist():
        sample, state = path.samples[at], path.states[at]
        mode, shift = int(state.modes[track]), int(state.shifts[track])
        if mode < 0:
            continue
        harmonics = _every_harmonic(sample.modes)
        power = sample.modes.power(harmonics)[mode].sum(axis=0)
        power /= power.sum()
        angular = np.imag(sample.modes.exponents[mode]) + harmonics * sample.modes.rotation
        for h, share, frequency in zip((harmonics - shift).tolist(), power, np.abs(angular), strict=True):
            totals[h] = totals.get(h, 0.0) + float(share)
            frequencies[h] = frequencies.get(h, 0.0) + float(frequency)
    largest = max(totals.values())
    return max((h for h in totals if totals[h] >= (1 - _SAME) * largest), key=lambda h: frequencies[h])


def _every_harmonic(modes: ModeVectors) -> Array:
    """Return the numbers of all harmonics that the nodes resolve."""
    most = (len(modes.nodes) - 1) // 2
    return np.arange(-most, most + 1)


def _columns(path: _Path, exponents: Array, twins: Mapping[int, int]) -> tuple[Array, Array]:
    """Return the first track of each conjugate pair, and the exponents (S, T). Of two conjugate exponents,
    the one whose imaginary part is positive on average is returned. Where the multipliers are real, the
    exponent of the less damped mode is returned."""
    partners, columns = path.partners(), exponents.copy()
    tracks = [track for track in range(exponents.shape[1]) if twins.get(track, track) >= track]
    for track in tracks:
        other = twins.get(track, track)
        is_real = (partners[:, track] == track) & (partners[:, other] == other)
        is_weaker = is_real & (np.real(exponents[:, other]) > np.real(exponents[:, track]))
        column = np.where(is_weaker, exponents[:, other].conj(), exponents[:, track])
        columns[:, track] = column if np.nansum(np.imag(column)) >= 0 else column.conj()
    return np.array(tracks), columns


def _participation(path: _Path, given: Array, tracks: Array, shifts: Array) -> tuple[Array, Array]:
    """Return the harmonics (H,) relative to the main harmonic, and their participation (P, M, n, H) in each
    mode and coordinate."""
    window = np.arange(-_MOST_HARMONICS, _MOST_HARMONICS + 1)
    n = len(path.samples[0].modes.inertia)
    values = np.full((len(given), len(tracks), n, len(window)), np.nan)
    for row, at in enumerate(given.tolist()):
        sample, state = path.samples[at], path.states[at]
        harmonics = _every_harmonic(sample.modes)
        power = sample.modes.power(harmonics)
        power /= power.sum(axis=(1, 2), keepdims=True)
        for column, track in enumerate(tracks.tolist()):
            if state.modes[track] >= 0:
                indices = window + shifts[at, track] - harmonics[0]
                is_inside = (indices >= 0) & (indices < len(harmonics))
                picked = power[state.modes[track]][:, np.where(is_inside, indices, 0)]
                values[row, column] = np.where(is_inside, picked, 0.0)
    sums = np.nan_to_num(values.sum(axis=2), nan=1.0)
    covers = [
        (sums[..., np.abs(window) <= half].sum(axis=-1) >= _COVERED).all() for half in range(_MOST_HARMONICS)
    ]
    half = covers.index(True) if True in covers else _MOST_HARMONICS
    return window[np.abs(window) <= half], values[..., np.abs(window) <= half]


def _pair(label_of: Mapping[int, str], pair: Approach | Doubt) -> tuple[str, str] | None:
    """Return the labels of two tracks in ascending order; None for a mode and its own conjugate, or if a
    track has no label."""
    labels = [label_of.get(pair.first), label_of.get(pair.second)]
    if None in labels or labels[0] == labels[1]:
        return None
    first, second = sorted((str(label) for label in labels), key=lambda text: (len(text), text))
    return first, second


def _ambiguities(doubts: Sequence[Doubt], label_of: Mapping[int, str]) -> list[Ambiguity]:
    """Return the ambiguities in ascending order. Ambiguities of the same pair and kind are joined if their
    ranges touch."""
    ambiguities = set()
    for doubt in doubts:
        pair = _pair(label_of, doubt)
        if pair is not None:
            low, high = sorted((doubt.low, doubt.high))
            ambiguities.add(Ambiguity(pair, low, high, doubt.kind))
    joined: list[Ambiguity] = []
    for one in sorted(ambiguities, key=lambda one: (one.modes, one.kind, one.low)):
        last = joined[-1] if joined else None
        if last and (last.modes, last.kind) == (one.modes, one.kind) and one.low <= last.high:
            joined[-1] = Ambiguity(one.modes, last.low, max(last.high, one.high), one.kind)
        else:
            joined.append(one)
    return sorted(joined, key=lambda one: one.low)


def _veerings(approaches: Sequence[Approach], label_of: Mapping[int, str], x: Array) -> list[Meeting]:
    """Return the veerings that are narrower than a quarter of the range of the values. A pair of modes veers
    if its exceptional points lie on both sides of the real axis."""
    by_pair: dict[tuple[str, str], list[tuple[float, float, float]]] = {}
    for approach in sorted(approaches, key=lambda approach: approach.gap):
        pair = _pair(label_of, approach)
        above, below = (root.imag for root in approach.roots)
        place = float(np.mean([root.real for root in approach.roots]))
        width = max(abs(above), abs(below))
        if pair is None or above * below >= 0 or _LEAST_EXCHANGE * width > np.ptp(x):
            continue
        listed = by_pair.setdefault(pair, [])
        if all(abs(place - other) > 2 * max(width, wide) for other, wide, _ in listed):
            listed.append((place, width, approach.gap))
    return [
        Meeting(pair, place, VEERING, gap) for pair, minima in by_pair.items() for place, _, gap in minima
    ]


def _crossings(
    x: Array,
    exponents: Array,
    labels: Sequence[str],
    ambiguous: Sequence[Ambiguity],
) -> list[Meeting]:
    """Return the crossings of unfolded frequencies, from exponents (S, M). The values at which they cross are
    interpolated between samples. Crossings of ambiguous pairs are omitted."""
    crossings, frequencies = [], np.abs(np.imag(exponents))
    for first, second in itertools.combinations(range(len(labels)), 2):
        difference, pair = frequencies[:, first] - frequencies[:, second], (labels[first], labels[second])
        growth = np.real(exponents[:, first] - exponents[:, second])
        with np.errstate(invalid="ignore"):
            changes = np.flatnonzero(difference[:-1] * difference[1:] < 0)
        for at in changes.tolist():
            t = difference[at] / (difference[at] - difference[at + 1])
            value = float(x[at] + t * (x[at + 1] - x[at]))
            is_ambiguous = any(one.modes == pair and one.low <= value <= one.high for one in ambiguous)
            if not is_ambiguous:
                gap = float(abs(growth[at] + t * (growth[at + 1] - growth[at])))
                crossings.append(Meeting(pair, value, CROSSING, gap))
    return crossings
