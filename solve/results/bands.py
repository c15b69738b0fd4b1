"""Bands of speed in which the motion is unstable."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from solve.results.contents import Contents, model_record, plain, rows_contents
from solve.results.quantities import RPM
from solve.results.report import RenderableType, model_heading, stacked, table, text
from solve.results.result import Result
from solve.results.style import Figure
from solve.results.sweep import Sweep
from solve.results.sweep_plot import radius_figure
from solve.system import PeriodicSystem

_MEANINGS = {"+1": "period T", "-1": "period 2T", "complex": "combination"}


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


class Bands(list[Band], Result):
    """Bands, rising, within a range of speeds (rad/s). spacing: the largest distance in rad/s of neighbouring
    speeds that were solved; narrower bands may be missed. notes: how they were found, such as speeds without
    a result. warnings: about the equations themselves."""

    def __init__(
        self,
        found: Iterable[Band],
        system: PeriodicSystem,
        range_: tuple[float, float],
        spacing: float,
        notes: Sequence[str] = (),
    ):
        super().__init__(found)
        self.system, self.range, self.spacing, self.notes = system, range_, spacing, notes
        self.warnings = system.warnings(range_[1])

    def plot(self, sweep: Sweep) -> Figure:
        """The spectral radius of a sweep over speed with the bands shaded by their kind."""
        edges = [(band.low, band.high, band.kind) for band in self]
        return radius_figure(self.system, sweep.speeds, sweep.spectral_radius, edges)

    def record(self) -> dict[str, Any]:
        """Of `solve bands --json`."""
        within = {"range": self.range, "spacing": self.spacing, "notes": self.notes}
        return plain({**model_record(self.system), **within, "warnings": self.warnings, "bands": self._rows})

    @property
    def _rows(self) -> list[dict[str, Any]]:
        names = {"low": "from", "high": "to"}
        return [{names.get(name, name): value for name, value in vars(band).items()} for band in self]

    def report(self, choices: Sequence[str] = ()) -> RenderableType:
        """A row a band."""
        low, high = (speed * RPM for speed in self.range)
        head = model_heading(self.system, choices)
        width = f"{self.spacing * RPM:.3g} rpm"
        limit = text(f"solved at speeds up to {width} apart: narrower bands may be missed", "dim")
        if not self:
            return stacked(
                head, text(f"\nno unstable band found from {low:.6g} to {high:.6g} rpm", "bold green"), limit
            )
        title = f"Unstable between {low:.6g} and {high:.6g} rpm"
        made = table(title, "kind", "", "from (rpm)", "to (rpm)", "width (rpm)", "largest |ρ|", left=2)
        for band in self:
            edges = (
                f"{'< ' * open_}{speed * RPM:.3f}"
                for speed, open_ in ((band.low, band.open_low), (band.high, band.open_high))
            )
            width = f"{(band.high - band.low) * RPM:.3g}"
            made.add_row(band.kind, _MEANINGS[band.kind], *edges, width, f"{band.spectral_radius:.6g}")
        return stacked(head, made, limit)

    def contents(self) -> Contents:
        """A row a band, for a file."""
        columns = {
            "from": (None, "rad/s", "lower edge"),
            "to": (None, "rad/s", "upper edge"),
            "kind": (None, "", "multiplier that leaves the unit circle"),
            "spectral_radius": (None, "1", "largest in the band"),
        }
        return rows_contents(self._rows, columns, model_record(self.system))
