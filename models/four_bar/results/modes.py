"""What each mode gives to a deflection or stress over one turn (thesis Fig. 6.4), and what modes that do not
couple would give (thesis Fig. 6.3)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import solve
from models.four_bar.results.at_one_speed import AtOneSpeed
from solve.arrays import Array
from solve.beams.observations import Contributions
from solve.beams.structure import StructureModel
from solve.results.contents import Column, Columns, digits, sized, to_json
from solve.results.serialization import serializable
from solve.views.over_time import contributions_figure
from solve.views.show import tables
from solve.views.style import Figure
from solve.views.tables import RenderableType, table_of

_UNCOUPLED_STEPS = 720
"""Steps a turn from which on more change nothing of what uncoupling errs by."""

serializable(Contributions)


@dataclass(frozen=True)
class Modes(AtOneSpeed):
    """contributions: of each mode; uncoupled (k,): the output at their phases if modes did not couple."""

    contributions: Contributions
    uncoupled: Array | None = None

    @property
    def error(self) -> float:
        """Largest error of uncoupled modes over the turn beside the largest value."""
        assert self.uncoupled is not None
        total = self.contributions.total
        return float(np.abs(self.uncoupled - total).max() / np.abs(total).max())

    @property
    def summary_values(self) -> dict[str, Any]:
        output = self.contributions.output
        return {**super().summary_values, "quantity": output, "unit": self.system.units[output]}

    @property
    def columns(self) -> Columns:
        """The output over the turn, and each mode's part of it."""
        found = self.contributions
        unit = self.system.units[found.output]
        curves = {"all": (found.total, "all modes")}
        curves |= {f"mode_{k}": (values, f"mode {k}") for k, values in enumerate(found.values, 1)}
        if self.uncoupled is not None:
            curves["uncoupled"] = self.uncoupled, "modes that do not couple"
        made = {
            name: Column(values, unit, f"{found.output}, {what}", axes=("phase",))
            for name, (values, what) in curves.items()
        }
        return {"phase": Column(found.phase, "rad", "phase of the drive", axes=("phase",)), **made}

    def record(self) -> dict[str, Any]:
        found = self.contributions
        modes = [
            {"frequency": frequencies, "contribution": values, "max_abs": np.abs(values).max()}
            for frequencies, values in zip(found.frequencies, found.values, strict=True)
        ]
        curves = {"phase": found.phase, "total": found.total, "modes": modes}
        if self.uncoupled is not None:
            curves["uncoupled"] = {"values": self.uncoupled, "error": self.error}
        return {**super().record(), **to_json(curves)}

    def plot(self) -> Figure:
        """The output over the turn, each mode's part of it, and that of uncoupled modes."""
        return contributions_figure(self.system, self.contributions, self.orbit.speed, self.uncoupled)


@tables.register(Modes)
def modes_tables(modes: Modes) -> Sequence[RenderableType]:
    """A row a mode: its mean frequency and its largest part."""
    found, caption = modes.contributions, None
    curves = {**{str(k): values for k, values in enumerate(found.values, 1)}, "all": found.total}
    if modes.uncoupled is not None:
        curves["uncoupled"] = modes.uncoupled
        caption = f"uncoupled modes miss by up to {100 * modes.error:.1f} % of the maximum"
    sizes = [float(np.abs(values).max()) for values in curves.values()]
    largest = float(np.abs(found.total).max())
    means = [f"{frequencies[:-1].mean():.3f}" for frequencies in found.frequencies]
    shares = [size / largest for size in sizes]
    columns = {
        "mode": Column([*curves], heading="mode"),
        "frequency": Column([*means, "", ""][: len(curves)], heading="mean ω (rad/s)"),
        "max_abs": sized(sizes, modes.system.units[found.output], "", "max|…|", 5, largest),
        "share": Column(shares, heading="share of max (%)", text=digits(".1f", 100.0)),
    }
    return [table_of(found.output, columns, left=1, caption=caption)]


def modes(
    model: StructureModel, speed: float | str, of: str, count: int, uncoupled: bool, rtol: float = 1e-6
) -> Modes:
    """Of the lowest modes to a deflection or stress at a speed. Raises SolveError subclasses."""
    model.require_part_of_modes(of)
    orbit = solve.periodic(model, speed, rtol=rtol)
    found = model.modal_contributions(orbit, of, count)
    alone = None
    if uncoupled:
        alone = solve.periodic(model, speed, "modal", _UNCOUPLED_STEPS).signal(of)(found.phase)
    return Modes(orbit, found, alone)
