"""Unstable bands of speed, as a result."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from solve.arrays import Array
from solve.equations import warnings_of
from solve.errors import listed
from solve.results.contents import Column, Columns, HeaderRows, digits, speeds_of
from solve.results.result import Figure, Result
from solve.results.serialization import serializable, stored_property
from solve.results.sweep import Sweep
from solve.system import PeriodicSystem

_MEANINGS = {"+1": "period T", "-1": "period 2T", "complex": "combination"}


@serializable
@dataclass(frozen=True)
class Band:
    """Unstable band of speed.

    Attributes
    ----------
    low, high : float
        Edges in rad/s.
    kind : {"+1", "-1", "complex"}
        Way in which a multiplier leaves the unit circle: at +1 (period T), at -1 (period 2T), or as a complex
        pair.
    spectral_radius : float
        Largest spectral radius at any solved speed in the band.
    open_low, open_high : bool
        Whether the lower edge (`open_low`) or the upper edge (`open_high`) is unknown. An edge is unknown if
        it lies beyond the range or next to a speed without a result.
    """

    low: float
    high: float
    kind: str
    spectral_radius: float
    open_low: bool = False
    open_high: bool = False


@dataclass(frozen=True, eq=False)
class Bands(Sequence[Band], Result):
    """Sequence of unstable bands in ascending order, from `solve.bands`.

    Attributes
    ----------
    found : sequence of Band
        Unstable bands.
    range : tuple of float
        Lowest and highest speed in rad/s.
    spacing : float
        Largest distance in rad/s between neighbouring solved speeds. Bands narrower than this may be missed.
    notes : sequence of str
        Notes on the search, such as speeds without a result.
    speeds, spectral_radius : (P,) array
        Solved speeds in rad/s, ascending, and the spectral radii at these speeds; NaN without a result.
    constant_matrices : bool
        Whether M, C and K are constant over the period, so that their eigenvalues decide stability.
    """

    found: Sequence[Band]
    system: PeriodicSystem
    range: tuple[float, float]
    spacing: float
    notes: Sequence[str] = ()
    speeds: Array = field(default_factory=lambda: np.empty(0))
    spectral_radius: Array = field(default_factory=lambda: np.empty(0))
    constant_matrices: bool = False

    def __len__(self) -> int:
        return len(self.found)

    def __getitem__(self, index: Any) -> Any:
        return self.found[index]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Sequence) and list(self) == list(other)

    @stored_property
    def warnings(self) -> list[str]:
        """Warnings about the equations, one sentence each."""
        return warnings_of(self.system, self.range[1])

    def plot(self, sweep: Sweep | None = None) -> Figure:
        """Figure of the spectral radius versus the solved speeds, or versus the speeds of a sweep, with the
        bands shaded by kind. Raises ValueOutOfBoundsError if `sweep` is not a Sweep."""
        return super().plot(sweep)

    _rows: ClassVar[str] = "bands"
    _recorded: ClassVar[str] = "range spacing notes constant_matrices"

    @property
    def columns(self) -> Columns:
        """Columns of the table, with one row per band."""
        unit = self.system.labels.speed_unit
        low, high = [band.low for band in self], [band.high for band in self]
        lows = [f"{'< ' * band.open_low}{unit.from_si(band.low):.3f}" for band in self]
        highs = [f"{'< ' * band.open_high}{unit.from_si(band.high):.3f}" for band in self]
        widths, radii = [band.high - band.low for band in self], [band.spectral_radius for band in self]
        kinds, motions = [band.kind for band in self], [_MEANINGS[band.kind] for band in self]
        return {
            "kind": Column(kinds, "", "multiplier that leaves the unit circle", "kind"),
            "motion": Column(motions, "", "that grows", "motion"),
            "from": Column(low, "rad/s", "lower edge", f"from ({unit.name})", lows),
            "to": Column(high, "rad/s", "upper edge", f"to ({unit.name})", highs),
            "width": speeds_of(self.system, widths, "of the band", "width ({})", ".3g"),
            "spectral_radius": Column(radii, "1", "largest in the band", "largest |ρ|", digits(".6g")),
            "open_low": Column([band.open_low for band in self], "", "whether it continues below"),
            "open_high": Column([band.open_high for band in self], "", "whether it continues above"),
        }

    @property
    def summary(self) -> str:
        """Sentence on the ranges of the bands."""
        unit = self.system.labels.speed_unit
        if not self:
            return f"No unstable band found from {unit.span(*self.range)}."
        bands = listed([unit.span(band.low, band.high, form=".5g") for band in self])
        return f"Unstable between {unit.span(*self.range, word='and')}: from {bands}."

    def header_rows(self) -> HeaderRows:
        return [("M, C, K", "constant over the period")] * self.constant_matrices
