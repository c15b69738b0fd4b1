"""Contribution of each mode to an output over a revolution (thesis Fig. 6.4), and the output computed without
coupling of the modes (thesis Fig. 6.3)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
import typer

import solve
from models.four_bar.studies.shared import AtOneSpeed, FourBar, Tolerance
from solve.arrays import Array
from solve.beams.observations import Contributions
from solve.beams.structure import StructureModel
from solve.commands.deliver import deliver_result
from solve.commands.groups import Flag, Results
from solve.results.contents import Column, Columns, digits, sized, to_json
from solve.results.serialization import serializable
from solve.views.over_time import contributions_figure
from solve.views.show import tables
from solve.views.style import Figure
from solve.views.tables import RenderableType, table_of

_UNCOUPLED_STEPS = 720
"""Steps per revolution of the uncoupled solution; with more steps, its error remains the same."""

serializable(Contributions)


@dataclass(frozen=True)
class Modes(AtOneSpeed):
    """Contributions of the modes to an output, and the output (k,) without coupling of the modes at the same
    phases."""

    contributions: Contributions
    uncoupled: Array | None = None

    @property
    def error(self) -> float:
        """Largest error of the uncoupled solution, relative to the largest modulus of the output."""
        assert self.uncoupled is not None
        total = self.contributions.total
        return float(np.abs(self.uncoupled - total).max() / np.abs(total).max())

    @property
    def summary_values(self) -> dict[str, Any]:
        output = self.contributions.output
        return {**super().summary_values, "quantity": output, "unit": self.system.units[output]}

    @property
    def columns(self) -> Columns:
        """Phase, output and contribution of each mode."""
        shares = self.contributions
        curves = {"all": (shares.total, "all modes")}
        curves |= {f"mode_{k}": (values, f"mode {k}") for k, values in enumerate(shares.values, 1)}
        if self.uncoupled is not None:
            curves["uncoupled"] = self.uncoupled, "uncoupled modes"
        columns = {"phase": Column(shares.phase, "rad", "phase of the drive", axes=("phase",))}
        for name, (values, meaning) in curves.items():
            unit = self.system.units[shares.output]
            columns[name] = Column(values, unit, f"{shares.output}, {meaning}", axes=("phase",))
        return columns

    def record(self) -> dict[str, Any]:
        shares = self.contributions
        modes = [
            {"frequency": frequencies, "contribution": values, "max_abs": np.abs(values).max()}
            for frequencies, values in zip(shares.frequencies, shares.values, strict=True)
        ]
        curves = {"phase": shares.phase, "total": shares.total, "modes": modes}
        if self.uncoupled is not None:
            curves["uncoupled"] = {"values": self.uncoupled, "error": self.error}
        return {**super().record(), **to_json(curves)}

    def plot(self) -> Figure:
        """Output, contribution of each mode and uncoupled solution over the revolution."""
        return contributions_figure(self.system, self.contributions, self.orbit.speed, self.uncoupled)


@tables.register(Modes)
def modes_tables(result: Modes) -> Sequence[RenderableType]:
    """Table of mean frequencies and largest contributions, one row per mode."""
    shares, caption = result.contributions, None
    curves = {**{str(k): values for k, values in enumerate(shares.values, 1)}, "all": shares.total}
    if result.uncoupled is not None:
        curves["uncoupled"] = result.uncoupled
        caption = f"error of uncoupled modes: up to {100 * result.error:.1f} % of the maximum"
    maxima = [float(np.abs(values).max()) for values in curves.values()]
    largest = float(np.abs(shares.total).max())
    means = [f"{frequencies[:-1].mean():.3f}" for frequencies in shares.frequencies]
    columns = {
        "mode": Column([*curves], heading="mode"),
        "frequency": Column([*means, "", ""][: len(curves)], heading="mean ω (rad/s)"),
        "max_abs": sized(maxima, result.system.units[shares.output], "", "max|…|", 5, largest),
        "share": Column(
            [maximum / largest for maximum in maxima], heading="share of max (%)", text=digits(".1f", 100.0)
        ),
    }
    return [table_of(shares.output, columns, left=1, caption=caption)]


def mode_contributions(
    model: StructureModel, speed: float | str, of: str, count: int, uncoupled: bool, rtol: float = 1e-6
) -> Modes:
    """Contributions of the lowest `count` modes to a deflection or stress at a speed.

    Raises SolveError subclasses.
    """
    model.require_part_of_modes(of)
    orbit = solve.periodic(model, speed, rtol=rtol)
    contributions = model.modal_contributions(orbit, of, count)
    values = None
    if uncoupled:
        values = solve.periodic(model, speed, "modal", _UNCOUPLED_STEPS).signal(of)(contributions.phase)
    return Modes(orbit, contributions, values)


def modes(
    four_bar: FourBar,
    results: Results,
    speed: Annotated[str, Flag("Speed with unit: rpm, rad/s or Hz.", '"35 rad/s"')] = "35 rad/s",
    of: Annotated[
        str, Flag("A deflection or stress among the outputs.", "NAME")
    ] = "follower_midpoint_deflection",
    count: Annotated[int, typer.Option(metavar="N", min=1, help="Number of modes.")] = 4,
    uncoupled: Annotated[bool, Flag("Add the solution with uncoupled modes, and its error.")] = False,
    rtol: Tolerance = 1e-6,
) -> None:
    """Contribution of each mode to a deflection or stress over one revolution."""
    result = mode_contributions(four_bar.loaded(), speed, of, count, uncoupled, rtol)
    deliver_result(results, result, four_bar.choices)
