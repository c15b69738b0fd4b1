"""Results at many points, as arrays."""

from dataclasses import dataclass, field

import numpy as np

from solve.arguments import NUMBERS_A_POINT, require_size
from solve.arrays import SPLIT, Array
from solve.errors import NoResultError, counted
from solve.period.multipliers import UNIT_CIRCLE
from solve.period.rigid_body import before_rigid
from solve.period.signals import FIGURES
from solve.results.serialization import serializable

KINDS = ("+1", "-1", "complex")
"""Ways in which a multiplier leaves the unit circle: at +1 (period T), at -1 (period 2T), or as a complex
pair."""

LEFT_OUT = "spectral radius and verdict exclude their multipliers +1"
"""Text about points whose verdict excludes rigid-body modes."""

FAILED = -1
"""Value that replaces the index of a verdict at failed points."""

_NUMBERS_AN_AMPLITUDE = 64
"""Number of values in memory for each amplitude while many points are analysed together."""

_ARRAYS = (
    *("figures", "amplitudes", "multipliers", "errors", "verdicts", "steps", "methods"),
    *("reductions", "rigid"),
)


@serializable
@dataclass(frozen=True)
class Kept:
    """Selection of the values that are stored for each point in addition to its stability.

    Attributes
    ----------
    names : tuple of str
        Quantities whose statistics are stored.
    spectra, harmonics : tuple of str, int
        Quantities whose amplitudes are stored, and the number of harmonics.
    warnings : bool
        Whether texts of warnings are stored.
    meetings : bool
        Whether multipliers that coincide on the unit circle are examined. The verdict may then be "unstable"
        although no multiplier lies outside the circle.
    """

    names: tuple[str, ...] = ()
    spectra: tuple[str, ...] = ()
    harmonics: int = 0
    warnings: bool = True
    meetings: bool = True


@serializable
@dataclass(frozen=True)
class PointResults:
    """Results of P points.

    Attributes
    ----------
    figures : (P, q, 7) array
        Statistics of q quantities: the fields of `Statistics`.
    amplitudes : (P, spectra, harmonics + 1) array
        Amplitudes of the spectra.
    multipliers : (P, N) array
        Multipliers, 0 if unresolved. The last `rigid` entries are zero; they are placeholders for the
        multipliers of rigid-body modes.
    errors : (P, 2) array
        Relative errors of the orbits and of the multipliers.
    verdicts : (P,) array
        Indices in VERDICTS, or FAILED.
    steps, methods : (P,) array
        Numbers of steps and names of the methods.
    reductions : (P, 2) array
        Errors of orbits and multipliers due to the reduction of the system; NaN if it is not reduced.
    warnings, failures : dict
        Mapping from indices of points to strings.
    rigid : (P,) array
        Number of multipliers of rigid-body modes.
    """

    kept: Kept
    figures: Array
    amplitudes: Array
    multipliers: Array
    errors: Array
    verdicts: Array
    steps: Array
    methods: Array
    reductions: Array
    warnings: dict[int, list[str]] = field(default_factory=dict)
    failures: dict[int, str] = field(default_factory=dict)
    rigid: Array = field(default_factory=lambda: np.zeros(0, dtype=np.int8))

    @classmethod
    def blank(cls, count: int, multipliers: int, kept: Kept) -> "PointResults":
        """Results of `count` points that are not yet solved, with `multipliers` multipliers per point. Raises
        ValueOutOfBoundsError if the results exceed the memory limit."""
        numbers = len(FIGURES) * len(kept.names) + 2 * multipliers
        spectra = len(kept.spectra) * (kept.harmonics + 1) * _NUMBERS_AN_AMPLITUDE
        require_size("points", count, max(numbers + spectra, NUMBERS_A_POINT))
        return cls(
            kept,
            np.full((count, len(kept.names), len(FIGURES)), np.nan),
            np.full((count, len(kept.spectra), kept.harmonics + 1), np.nan),
            np.full((count, multipliers), np.nan, dtype=complex),
            np.full((count, 2), np.nan),
            np.full(count, FAILED, dtype=np.int8),
            np.zeros(count, dtype=np.int32),
            np.full(count, "", dtype=object),
            np.full((count, 2), np.nan),
            rigid=np.zeros(count, dtype=np.int8),
        )

    def __len__(self) -> int:
        return len(self.steps)

    @property
    def all_multipliers(self) -> Array:
        """Multipliers (P, N), including the multipliers +1 of rigid-body modes, in descending order of
        modulus."""
        multipliers = self.multipliers.copy()
        for point in np.flatnonzero(self.rigid).tolist():
            count = int(self.rigid[point])
            vibrating = self.multipliers[point, :-count]
            multipliers[point] = np.insert(vibrating, np.full(count, before_rigid(vibrating)), 1.0)
        return multipliers

    @property
    def notes(self) -> list[str]:
        """Sentence on the number of points with rigid-body modes; an empty list if there are none."""
        count = int(np.count_nonzero(self.rigid))
        if not count:
            return []
        where = "all points" if count == len(self) else f"{count} of {len(self)} points"
        return [f"rigid-body modes at {where}: {LEFT_OUT}"]

    @property
    def spectral_radius(self) -> Array:
        """Largest |ρ| (P,) without rigid-body modes; NaN where the point failed, or if the system does not
        vibrate."""
        none = self.multipliers.shape[1] == 0
        return np.full(len(self), np.nan) if none else np.abs(self.multipliers[:, 0])

    @property
    def failed(self) -> Array:
        """Mask (P,) of the points without a result."""
        return self.verdicts == FAILED

    def require_any(self) -> None:
        """Raise NoResultError if every point failed."""
        if self.failed.all():
            reason = next(iter(self.failures.values()), "")
            raise NoResultError(f"{counted(len(self), 'point')}, none with a result: {reason}")

    @property
    def _outside(self) -> Array:
        """Mask (P,) of the points with a multiplier outside the unit circle by more than its error."""
        radius = self.spectral_radius
        # For multipliers that underflow, the error may be infinite, and its product with 0 is NaN.
        with np.errstate(invalid="ignore"):
            return ~self.failed & (radius - self.errors[:, 1] * radius > 1 + UNIT_CIRCLE)

    @property
    def kinds(self) -> Array:
        """Kinds (P,), elements of KINDS, of the largest multiplier; an empty string if no multiplier is
        outside the unit circle."""
        return np.where(self._outside, np.array(KINDS)[kinds_of(self.multipliers)], "")

    def insert(self, index: Array, part: "PointResults") -> None:
        """Insert the results `part` of points at the indices `index`."""
        for name in _ARRAYS:
            getattr(self, name)[index] = getattr(part, name)
        self.warnings.update({int(index[point]): texts for point, texts in part.warnings.items()})
        self.failures.update({int(index[point]): text for point, text in part.failures.items()})


def selected(results: PointResults, points: Array, kept: Kept) -> PointResults:
    """Return the results of the points with the indices (k,), with the quantities of `kept` only and without
    spectra."""
    selection = PointResults.blank(len(points), results.multipliers.shape[1], kept)
    quantities = [results.kept.names.index(name) for name in kept.names]
    for name in _ARRAYS:
        if name not in ("figures", "amplitudes"):
            getattr(selection, name)[:] = getattr(results, name)[points]
    selection.figures[:] = results.figures[points][:, quantities]
    for number, point in enumerate(points.tolist()):
        if point in results.failures:
            selection.failures[number] = results.failures[point]
    return selection


def kinds_of(multipliers: Array) -> Array:
    """Return the indices (k,) in KINDS that describe the first multiplier of each row of `multipliers` (k,
    N); 0 if there are no multipliers."""
    if not multipliers.shape[1]:
        return np.zeros(len(multipliers), dtype=int)
    leader = multipliers[:, 0]
    pair = np.abs(np.imag(leader)) > SPLIT * np.abs(leader)
    return np.where(pair, 2, np.where(np.real(leader) > 0, 0, 1))
