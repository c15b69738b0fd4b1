"""Floquet modes followed as the speed or a parameter varies."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from solve.arguments import matches_annotations
from solve.arrays import Array
from solve.equations import warnings_of
from solve.errors import counted, listed, require_name
from solve.labels import unit_of
from solve.results.contents import Column, Columns, FileContents, HeaderRows, to_json
from solve.results.result import ResultOver
from solve.results.serialization import serializable, stored_property
from solve.system import PeriodicSystem

CROSSING, VEERING = "crossing", "veering"
CLOSE, LOCKED = "close", "locked"

_REASONS = {
    CLOSE: "their exponents differ by less than the tolerance resolves",
    LOCKED: "they are locked in a parametric resonance",
}
_DOUBTFUL = 1e-4
"""Relative error of an exponent above which a warning is issued, because four digits are shown."""


@serializable
@dataclass(frozen=True)
class Meeting:
    """Two modes whose frequencies cross or nearly coincide.

    Attributes
    ----------
    modes : tuple of str
        Labels of the two modes.
    value : float
        Speed in rad/s, or value of the parameter.
    kind : {"crossing", "veering"}
        At a crossing the frequencies are equal and each mode keeps its vector. At a veering the modes are
        coupled: their exponents stay apart and their vectors are exchanged gradually.
    gap : float
        Distance in rad/s between the exponents at this value; at a crossing, the difference between the
        growth rates.
    """

    modes: tuple[str, str]
    value: float
    kind: str
    gap: float


@serializable
@dataclass(frozen=True)
class Ambiguity:
    """Two modes whose identity is undetermined between two values of the speed or parameter.

    Attributes
    ----------
    modes : tuple of str
        Labels of the two modes.
    low, high : float
        Speeds in rad/s, or values of the parameter.
    kind : {"close", "locked"}
        "close": the difference between the exponents is below the resolution. "locked": in a parametric
        resonance, it is undetermined which of the two exponents belongs to which mode.
    """

    modes: tuple[str, str]
    low: float
    high: float
    kind: str


@dataclass(frozen=True)
class ModesOver(ResultOver):
    """M Floquet modes at P speeds, or P values of a parameter.

    Attributes
    ----------
    speeds : (P,) array
        Speeds in rad/s.
    exponents : (P, M) complex array
        Exponents λ in 1/s, whose imaginary part is the frequency of harmonic 0 of the mode; NaN without a
        result.
    errors : (P, M) array
        Estimated errors of the exponents in 1/s.
    labels : sequence of str
        Labels of the modes: numbers in ascending order of the frequency at the first speed.
    harmonics : (H,) array
        Harmonics h of the modes. Harmonic h has the frequency |Im λ + 2πh/T|.
    participation : (P, M, n, H) array
        Fraction of each mode contained in each harmonic of each coordinate. Coordinates are weighted by their
        mean inertia.
    meetings : sequence of Meeting
        Crossings and veerings.
    ambiguous : sequence of Ambiguity
        Pairs of modes whose identities are undetermined.
    path, path_exponents : (S,), (S, M) arrays
        All solved values of the varied quantity, including those added by the refinement, and the exponents
        at these values.
    resolution : float
        Gap in rad/s up to which a veering is reported as a crossing.
    rtol : float
        Relative tolerance of the multipliers.
    steps : int
        Number of steps per period.
    failures : mapping of int to str
        Reasons why speeds, or values of the parameter, have no result. The keys are the indices of these
        speeds or values.
    parameters : mapping of str to (P,) array
        Values of the parameter that varies instead of the speed.
    notes : sequence of str
        Sentences on the computation.
    """

    system: PeriodicSystem
    speeds: Array
    exponents: Array
    errors: Array
    labels: Sequence[str]
    harmonics: Array
    participation: Array
    meetings: Sequence[Meeting]
    ambiguous: Sequence[Ambiguity]
    path: Array
    path_exponents: Array
    resolution: float
    rtol: float
    steps: int
    failures: Mapping[int, str] = field(default_factory=dict)
    parameters: Mapping[str, Array] = field(default_factory=dict)
    notes: Sequence[str] = ()

    @property
    def frequencies(self) -> Array:
        """Unfolded frequencies (P, M) in rad/s."""
        return np.abs(np.imag(self.exponents))

    @property
    def damping(self) -> Array:
        """Damping ratios -Re λ/|λ| (P, M); negative for a mode that grows, and 0 if λ is zero within its
        error."""
        return damping_ratios(self.exponents, self.resolution)

    @matches_annotations
    def mode(self, label: str) -> int:
        """Index of the mode with a label. Raises UnknownNameError."""
        require_name("mode", label, self.labels)
        return list(self.labels).index(label)


@dataclass(frozen=True)
class FollowedModes(ModesOver):
    """Floquet modes followed as the speed or a parameter varies, from `solve.follow_modes`.

    It has the attributes of `ModesOver`.
    """

    _recorded: ClassVar[str] = "labels ambiguous meetings resolution rtol steps notes"

    @stored_property
    def warnings(self) -> list[str]:
        """Warnings about undetermined identities, errors above the tolerance and failures, one sentence
        each."""
        sentences = [*self._reduction, *self.notes]
        for kind, reason in _REASONS.items():
            sentences += self._ambiguity(kind, reason)
        with np.errstate(invalid="ignore", divide="ignore"):
            sizes = np.maximum(np.abs(self.exponents), self.speeds[:, None] * 2 * np.pi / self.system.period)
            worst = float(np.nanmax(self.errors / sizes, initial=0.0))
        if worst > _DOUBTFUL:
            steps = f"{self.steps} steps do not resolve all modes"
            sentences.append(f"relative errors of the exponents are up to {worst:.1e}: {steps}")
        for position, reason in self.failures.items():
            sentences.append(f"no result at {self.text_of(float(self.values[position]))}: {reason}")
        return [*sentences, *warnings_of(self.system, float(self.speeds.max()))]

    def _ambiguity(self, kind: str, reason: str) -> list[str]:
        """Sentence on the ambiguous pairs of one kind; an empty list if there are none."""
        pairs = [pair for pair in self.ambiguous if pair.kind == kind]
        if not pairs:
            return []
        texts = [f"{pair.modes[0]} and {pair.modes[1]} at {self.text_of(pair.low)}" for pair in pairs]
        return [f"the identity of modes {listed(texts)} is undetermined: {reason}"]

    def text_of(self, value: float) -> str:
        """Text of a value of the varied quantity: a speed, given in rad/s, or a value of a parameter."""
        return unit_of(self.system, self.over).text(value, ".6g")

    def record(self) -> dict[str, Any]:
        """JSON object of `solve modes --json`."""
        arrays = {
            "speeds": self.speeds,
            **self.parameters,
            "frequencies": self.frequencies,
            "damping": self.damping,
            "growth": np.real(self.exponents),
            "errors": self.errors,
            "harmonics": self.harmonics,
            "coordinates": self.system.coordinates,
            "participation": self.participation,
        }
        return {**super().record(), **to_json(arrays)}

    @property
    def columns(self) -> Columns:
        """Columns of the table, with one row per speed and mode."""
        axes = "point", "mode"
        columns = {
            "speed": Column(self.speeds, "rad/s", "speed of rotation", axes=("point",)),
            "label": Column(np.array(self.labels), "", "mode", axes=("mode",)),
            "frequency": Column(self.frequencies, "rad/s", "unfolded frequency", axes=axes),
            "damping": Column(self.damping, "1", "damping ratio", axes=axes),
            "growth": Column(np.real(self.exponents), "1/s", "real part of the exponent", axes=axes),
            "error": Column(self.errors, "1/s", "estimated error of the exponent", axes=axes),
        }
        if self.parameters:
            labels = self.system.labels.parameter_labels[self.over]
            columns = {self.over: Column(self.values, *labels, axes=("point",)), **columns}
        return columns

    def file_contents(self) -> FileContents:
        """Columns of the table, with one row per speed and mode. Files .nc, .npz and .mat also contain the
        participation of harmonics and coordinates."""
        axes = "point", "mode", "coordinate", "harmonic"
        others = {
            "coordinate": Column(np.array(self.system.coordinates), axes=("coordinate",)),
            "harmonic": Column(self.harmonics, "1", "harmonic of the mode", axes=("harmonic",)),
            "participation": Column(self.participation, "1", "fraction of the mode", axes=axes),
        }
        columns = {**self.columns, **others}
        arrays = {name: column.array for name, column in columns.items()}
        return FileContents(self.columns, others, self.metadata, arrays)

    def header_rows(self) -> HeaderRows:
        low, high = self.values.min(), self.values.max()
        span = unit_of(self.system, self.over).span(float(low), float(high))
        rows = [("over", f"{self.over}, {counted(len(self.values), 'value')} from {span}")]
        added = len(self.path) - len(self.values)
        rows.append(
            ("followed", f"{counted(len(self.labels), 'mode')}, {counted(added, 'further value')} added")
        )
        return rows


def damping_ratios(exponents: Array, resolution: float) -> Array:
    """Return the damping ratios -Re λ/|λ|; 0 where |λ| is at most `resolution`, as for rigid-body modes."""
    size = np.abs(exponents)
    with np.errstate(invalid="ignore"):
        is_zero = size <= resolution
        return np.where(is_zero, 0.0, -np.real(exponents) / np.where(is_zero, 1.0, size))
