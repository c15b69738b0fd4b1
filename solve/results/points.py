"""Results of many points, in arrays: a point costs some hundred bytes."""

from dataclasses import dataclass, field

import numpy as np

from solve.arguments import NUMBERS_A_POINT, require_size
from solve.arrays import Array
from solve.errors import NoResultError
from solve.period.multipliers import UNDETERMINED, UNIT_CIRCLE
from solve.period.quantities import FIGURES
from solve.period.rigid_body import before_rigid
from solve.results.lasting import lasting

KINDS = ("+1", "-1", "complex")
"""Which multiplier leaves the unit circle: period T, period 2T, or a pair."""

_REAL = 1e-6
"""Imaginary part, relative to the modulus, up to which a multiplier counts as real."""

LEFT_OUT = "spectral radius and verdict exclude their multipliers +1"
"""Statement about rigid-body modes."""

FAILED = -1
"""Instead of the position of a verdict, where there is none."""

_NUMBERS_AN_AMPLITUDE = 64
"""At the peak, while many points are analysed together."""

_ARRAYS = (
    *("figures", "amplitudes", "multipliers", "errors", "verdicts", "steps", "methods"),
    *("reductions", "rigid"),
)


@lasting
@dataclass(frozen=True)
class Kept:
    """What is kept of a point beside its stability.

    names: quantities of which figures are kept. spectra: those of which the amplitudes of so many harmonics
    are kept too. warnings: whether the texts are. meetings: whether multipliers that meet on the unit circle
    are looked at; the verdict on these may be "unstable" though none is outside.
    """

    names: tuple[str, ...] = ()
    spectra: tuple[str, ...] = ()
    harmonics: int = 0
    warnings: bool = True
    meetings: bool = True


@lasting
@dataclass(frozen=True)
class PointResults:
    """Arrays over P points.

    figures (P, q, 7): the fields of `Statistics`; amplitudes (P, spectra, harmonics + 1); multipliers (P, N):
    zero where unresolved; the last rigid (P,) of them are zero placeholders for rigid-body modes; errors (P,
    2) of orbit and multipliers; reductions (P, 2): errors of the reduction of the system, NaN if it is not
    reduced or they are not stored; verdicts (P,): positions in VERDICTS, or FAILED; steps (P,); methods (P,):
    names. warnings and failures: texts by point.
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
    def blank(cls, count: int, n: int, kept: Kept) -> "PointResults":
        """Of points that are still to be solved. Raises ValueOutOfBoundsError for more than can be held."""
        each = len(FIGURES) * len(kept.names) + 4 * n
        spectra = len(kept.spectra) * (kept.harmonics + 1) * _NUMBERS_AN_AMPLITUDE
        require_size("points", count, max(each + spectra, NUMBERS_A_POINT))
        return cls(
            kept,
            np.full((count, len(kept.names), len(FIGURES)), np.nan),
            np.full((count, len(kept.spectra), kept.harmonics + 1), np.nan),
            np.full((count, 2 * n), np.nan, dtype=complex),
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
        """Multipliers (P, N) including the +1 of rigid-body modes, in descending order of modulus."""
        found = self.multipliers.copy()
        for at in np.flatnonzero(self.rigid).tolist():
            count, others = int(self.rigid[at]), self.multipliers[at, : -int(self.rigid[at])]
            found[at] = np.insert(others, np.full(count, before_rigid(others)), 1.0)
        return found

    @property
    def notes(self) -> list[str]:
        """Sentence on the number of points with rigid-body modes; empty if there are none."""
        count = int(np.count_nonzero(self.rigid))
        if not count:
            return []
        where = "all points" if count == len(self) else f"{count} of {len(self)} points"
        return [f"rigid-body modes at {where}: {LEFT_OUT}"]

    @property
    def spectral_radius(self) -> Array:
        """Largest |ρ| (P,) without rigid-body modes; NaN where the point failed or nothing vibrates."""
        none = self.multipliers.shape[1] == 0
        return np.full(len(self), np.nan) if none else np.abs(self.multipliers[:, 0])

    @property
    def leading(self) -> Array:
        """Which of the multipliers are the largest but for their errors (P, N); none where failed."""
        modulus, radius = np.abs(self.multipliers), self.spectral_radius[:, None]
        with np.errstate(invalid="ignore"):
            least = radius * (1 - 2 * self.errors[:, 1:] - UNIT_CIRCLE)
        return (modulus >= np.where(np.isnan(least), radius, least)) & ~self.failed[:, None]

    @property
    def failed(self) -> Array:
        """Where there is no result (P,)."""
        return self.verdicts == FAILED

    def require_any(self) -> None:
        """Raise NoResultError where every point failed."""
        if self.failed.all():
            reason = next(iter(self.failures.values()), "")
            raise NoResultError(f"none of the {len(self)} points gives a result: {reason}")

    @property
    def outside(self) -> Array:
        """Where a multiplier lies outside the unit circle by more than its error (P,)."""
        radius = self.spectral_radius
        # Where nothing is known of multipliers that underflow: an infinite part of 0.
        with np.errstate(invalid="ignore"):
            return ~self.failed & (radius - self.errors[:, 1] * radius > 1 + UNIT_CIRCLE)

    @property
    def undetermined(self) -> Array:
        """Where the errors leave the verdict open (P,)."""
        return self.verdicts == UNDETERMINED

    @property
    def kinds(self) -> Array:
        """The multiplier that is outside: texts (P,), one of KINDS or none."""
        return np.where(self.outside, np.array(KINDS)[kinds_of(self.multipliers)], "")

    def of_some(self, points: Array, kept: Kept) -> "PointResults":
        """Those of points at positions (k,), of which fewer quantities are kept, and no spectra."""
        made = PointResults.blank(len(points), self.multipliers.shape[1] // 2, kept)
        quantities = [self.kept.names.index(name) for name in kept.names]
        for name in _ARRAYS:
            if name not in ("figures", "amplitudes"):
                getattr(made, name)[:] = getattr(self, name)[points]
        made.figures[:] = self.figures[points][:, quantities]
        for at, point in enumerate(points.tolist()):
            if point in self.failures:
                made.failures[at] = self.failures[point]
        return made

    def insert(self, index: Array, part: "PointResults") -> None:
        """Take over the results of some of the points."""
        for name in _ARRAYS:
            getattr(self, name)[index] = getattr(part, name)
        self.warnings.update({int(index[at]): texts for at, texts in part.warnings.items()})
        self.failures.update({int(index[at]): text for at, text in part.failures.items()})


def kinds_of(multipliers: Array) -> Array:
    """Positions in KINDS (k,) of the first of the multipliers (k, N); 0 if there are none."""
    if not multipliers.shape[1]:
        return np.zeros(len(multipliers), dtype=int)
    leader = multipliers[:, 0]
    pair = np.abs(np.imag(leader)) > _REAL * np.abs(leader)
    return np.where(pair, 2, np.where(np.real(leader) > 0, 0, 1))
