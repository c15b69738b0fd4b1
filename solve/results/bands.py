"""Bands of speed in which the motion is unstable."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from solve.arrays import Array
from solve.results.contents import Column, Columns, HeaderRows, digits, speeds_of
from solve.results.result import Figure, Result
from solve.results.serialization import serializable, stored_property
from solve.results.sweep import Sweep
from solve.system import PeriodicSystem

_MOST_NAMED = 4
"""Bands that the summary names."""

_MEANINGS = {"+1": "period T", "-1": "period 2T", "complex": "combination"}


@serializable
@dataclass(frozen=True)
class Band:
    """low, high: edges in rad/s; open: the band goes on beyond the range there, or up to a speed without a
    result.

    kind: the multiplier that leaves the unit circle: "+1" (period T), "-1" (period 2T) or "complex".
    spectral_radius: the largest that was met inside.
    """

    low: float
    high: float
    kind: str
    spectral_radius: float
    open_low: bool = False
    open_high: bool = False


@dataclass(frozen=True, eq=False)
class Bands(Sequence[Band], Result):
    """Unstable bands in ascending order within a range of speeds (rad/s). spacing: largest distance in rad/s
    of neighbouring solved speeds; narrower bands may be missed. notes: how the bands were found, such as
    speeds without a result. speeds, spectral_radius (P,): solved speeds in ascending order and their spectral
    radii, NaN without a result. constant_matrices: whether M, C and K are constant over the period; then
    eigenvalues decide."""

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

    def __getitem__(self, at: Any) -> Any:
        return self.found[at]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Sequence) and list(self) == list(other)

    @stored_property
    def warnings(self) -> list[str]:
        """About the equations themselves."""
        return self.system.warnings(self.range[1])

    def plot(self, sweep: Sweep | None = None) -> Figure:
        """The spectral radius over the speeds that were solved, or over those of a sweep, with the bands
        shaded by their kind. Raises ValueOutOfBoundsError for what is no sweep."""
        return super().plot(sweep)

    _rows: ClassVar[str] = "bands"

    @property
    def summary_values(self) -> dict[str, Any]:
        about = {"range": self.range, "spacing": self.spacing, "notes": self.notes}
        return {**about, "constant_matrices": self.constant_matrices}

    @property
    def columns(self) -> Columns:
        """A row a band."""
        unit = self.system.speed_unit
        low, high = [band.low for band in self], [band.high for band in self]
        lows = [f"{'< ' * band.open_low}{unit.of(band.low):.3f}" for band in self]
        highs = [f"{'< ' * band.open_high}{unit.of(band.high):.3f}" for band in self]
        widths, radii = [band.high - band.low for band in self], [band.spectral_radius for band in self]
        kinds, motions = [band.kind for band in self], [_MEANINGS[band.kind] for band in self]
        return {
            "kind": Column(kinds, "", "multiplier that leaves the unit circle", "kind"),
            "motion": Column(motions, "", "that grows", "motion"),
            "from": Column(low, "rad/s", "lower edge", f"from ({unit.name})", lows),
            "to": Column(high, "rad/s", "upper edge", f"to ({unit.name})", highs),
            "width": speeds_of(self.system, widths, "of the band", "width ({})", ".3g"),
            "spectral_radius": Column(radii, "1", "largest in the band", "largest |ρ|", digits(".6g")),
            "open_low": Column([band.open_low for band in self], "", "whether it goes on below"),
            "open_high": Column([band.open_high for band in self], "", "whether it goes on above"),
        }

    @property
    def summary(self) -> str:
        """Whether there are any, and where."""
        unit = self.system.speed_unit
        if not self:
            return f"No unstable band found from {unit.span(*self.range)}."
        bands = ", ".join(unit.span(band.low, band.high, form=".5g") for band in self[:_MOST_NAMED])
        more = f" and {len(self) - _MOST_NAMED} more" if len(self) > _MOST_NAMED else ""
        return f"Unstable between {unit.span(*self.range, word='and')}: from {bands}{more}."

    def header_rows(self) -> HeaderRows:
        return [("M, C, K", "constant over the period")] * self.constant_matrices
