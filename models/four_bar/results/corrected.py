"""One element a link corrected by dynamic stiffness, beside more elements, over a turn (thesis Fig. 7.9)."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

import solve
from models.four_bar.dynamic_correction import LOADS, Corrected
from solve.arrays import Array
from solve.beams.structure import StructureModel
from solve.contracts import Statistics
from solve.results.contents import Column, Columns, Contents, digits, model_record, sized
from solve.results.lasting import lasting
from solve.results.result import Result
from solve.results.stability import ErrorEstimate
from solve.system import PeriodicSystem
from solve.terminal import progress
from solve.views.show import tables
from solve.views.style import Figure
from solve.views.tables import RenderableType, table_of
from solve.views.turn import BEHIND, curves_figure, require_turn

_SAMPLES = 721
_REFERENCE = {"element": "internal", "elements": 2}
"""Quintic elements whose stresses are right to 0.2 % or so; what the others are held against."""

REFERENCE = "reference"


@lasting
@dataclass(frozen=True)
class OneModel:
    """drawn: the output that is largest of those asked for, with its figures; values (k,) of the output that
    the reference has drawn, over a turn with both ends."""

    drawn: str
    figures: Statistics
    values: Array
    spectral_radius: float
    error_estimate: ErrorEstimate
    warnings: Sequence[str]


@dataclass(frozen=True)
class Corrections(Result):
    """A quantity at a speed (rad/s) by several models of one mechanism, by their label."""

    _rows: ClassVar[str] = "models"

    system: PeriodicSystem
    speed: float
    quantity: str
    models: Mapping[str, OneModel]

    @cached_property
    def warnings(self) -> list[str]:
        return list(dict.fromkeys(text for model in self.models.values() for text in model.warnings))

    @property
    def whole(self) -> dict[str, Any]:
        unit = self.system.units.get(self.quantity, "")
        return {"speed": self.speed, "quantity": self.quantity, "unit": unit}

    @property
    def columns(self) -> Columns:
        """A row a model."""
        every, reference = list(self.models.values()), self.models[REFERENCE].figures.max_abs
        si = self.system.units.get(self.models[REFERENCE].drawn, "")
        figures = [model.figures for model in every]
        at = [each.max_phase if each.max >= -each.min else each.min_phase for each in figures]
        largest = [each.max_abs for each in figures]
        radii = [model.spectral_radius for model in every]
        excess = [each / reference - 1 for each in largest]
        further = (name for name in Statistics._fields if name != "max_abs")
        return {
            "name": Column(list(self.models), "", "elements a link", "elements a link"),
            "max_abs": sized(largest, si, "largest modulus", "max|…|", 5, reference),
            "at": Column(at, "rad", "where", "at", lambda phase: f"{math.degrees(phase):.1f}°"),
            "excess": Column(excess, "1", "over the reference", "excess (%)", digits("+.2f", 100.0)),
            "spectral_radius": Column(radii, "1", "largest modulus of a multiplier", "|ρ|", digits(".6f")),
            "error_estimate": Column([model.error_estimate for model in every], axes=()),
            **{name: Column([getattr(each, name) for each in figures], axes=()) for name in further},
        }

    def contents(self) -> Contents:
        """The quantity over the turn, a column a model; the rows as metadata."""
        first = self.models[REFERENCE]
        unit = self.system.units.get(first.drawn, "")
        columns = {"phase": Column(self._phase, "rad", "phase of the drive", axes=("phase",))}
        for label, model in self.models.items():
            columns[label] = Column(model.values, unit, f"{first.drawn}, {label}", axes=("phase",))
        return Contents(columns, {}, {**model_record(self.system), **self.record()})

    @property
    def _phase(self) -> Array:
        return np.linspace(0.0, self.system.period, _SAMPLES)

    def plot(self) -> Figure:
        """The quantity over the turn, a curve a model, the reference wide behind the others."""
        curves = {label: model.values for label, model in self.models.items()}
        name = self.models[REFERENCE].drawn
        styles = {REFERENCE: BEHIND}
        return curves_figure(self.system, self._phase, curves, name, "elements a link", styles=styles)


@tables.register(Corrections)
def corrections_tables(result: Corrections) -> Sequence[RenderableType]:
    caption = "reference: 2 quintic elements with an inner node a link"
    return [table_of(result.quantity, result.columns, left=1, caption=caption)]


def corrections(
    model: StructureModel, speed: float, of: str, elements: Sequence[str], rtol: float = 1e-6
) -> Corrections:
    """A coordinate or output, or the largest of those a name stands for, at a speed in rad/s: by the
    reference, by these numbers of cubic elements a link, and by one corrected, with both loads. Raises
    SolveError subclasses."""
    systems: dict[str, PeriodicSystem] = {REFERENCE: model.varied(options=_REFERENCE)}
    systems |= {count: model.varied(options={"element": "cubic", "elements": count}) for count in elements}
    one = model.varied(options={"elements": 1})
    systems |= {f"corrected, {load}": Corrected(one, load) for load in LOADS}
    for system in systems.values():
        require_turn(system, system.parts(of)[0], len(systems))
    phase = np.linspace(0.0, model.period, _SAMPLES)
    found: dict[str, OneModel] = {}
    drawn = ""
    with progress.task("solutions", len(systems)):
        for label, system in systems.items():
            with progress.subtask("solutions"):
                orbit = solve.periodic(system, speed, rtol=rtol)
                figures = {name: orbit.statistics(name) for name in system.parts(of)}
                largest = max(figures, key=lambda name: figures[name].max_abs)
                drawn = drawn or largest
                found[label] = OneModel(
                    largest,
                    figures[largest],
                    orbit.signal(drawn)(phase),
                    orbit.spectral_radius,
                    orbit.error_estimate,
                    orbit.warnings,
                )
    return Corrections(model, speed, of, found)
