"""Comparison of one corrected element per link with finer models, over a revolution (Fig. 7.9 of the
thesis)."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np

import solve
from models.four_bar.dynamic_correction import LOADS, Corrected
from models.four_bar.studies.shared import EachTolerance, FourBar, SpeedText
from solve.arrays import Array
from solve.beams.structure import StructureModel
from solve.commands.deliver import deliver_result
from solve.commands.groups import Flag, Results
from solve.contracts import Statistics
from solve.errors import ValueOutOfBoundsError
from solve.labels import parts_of
from solve.results.contents import HALF_DEGREES, Column, Columns, FileContents, digits, model_info, sized
from solve.results.result import Result
from solve.results.serialization import serializable, stored_property
from solve.results.stability import ErrorEstimate
from solve.system import PeriodicSystem
from solve.terminal import progress
from solve.units import speed_in_si
from solve.views.over_time import BEHIND, curves_figure, require_turn
from solve.views.show import tables
from solve.views.style import Figure
from solve.views.tables import RenderableType, table_of

REFERENCE = "reference"
_REFERENCE_OPTIONS = {"element": "internal", "elements": 2}
"""Elements of the reference model: quintic elements, with which its stresses are accurate to about 0.2 %."""


@serializable
@dataclass(frozen=True)
class OneModel:
    """Result computed with one model.

    `drawn` is the name of the output with the largest value, and `figures` are the statistics of this output.
    `values` (k,) are those of the plotted output, which is `drawn` of the reference model, at phases over a
    revolution including both ends.
    """

    drawn: str
    figures: Statistics
    values: Array
    spectral_radius: float
    error_estimate: ErrorEstimate
    warnings: Sequence[str]


@dataclass(frozen=True)
class Corrections(Result):
    """Values of a quantity at a speed (rad/s), computed with several models of one mechanism. `models` maps
    labels to results."""

    _rows: ClassVar[str] = "models"

    system: PeriodicSystem
    speed: float
    quantity: str
    models: Mapping[str, OneModel]

    @property
    def reference(self) -> OneModel:
        return self.models[REFERENCE]

    @stored_property
    def warnings(self) -> list[str]:
        return list(dict.fromkeys(text for model in self.models.values() for text in model.warnings))

    @property
    def summary_values(self) -> dict[str, Any]:
        unit = self.system.labels.units.get(self.quantity, "")
        return {"speed": self.speed, "quantity": self.quantity, "unit": unit}

    @property
    def columns(self) -> Columns:
        """Columns of the table, with one row per model."""
        models, reference = list(self.models.values()), self.reference.figures.max_abs
        unit = self.system.labels.units.get(self.reference.drawn, "")
        figures = [model.figures for model in models]
        phases = [figure.max_phase if figure.max >= -figure.min else figure.min_phase for figure in figures]
        maxima = [figure.max_abs for figure in figures]
        radii = [model.spectral_radius for model in models]
        excess = [maximum / reference - 1 for maximum in maxima]
        further = (name for name in Statistics._fields if name != "max_abs")
        return {
            "name": Column(list(self.models), "", "elements per link", "elements per link"),
            "max_abs": sized(maxima, unit, "largest absolute value", "max|…|", 5, reference),
            "at": Column(phases, "rad", "where", "at", lambda phase: f"{math.degrees(phase):.1f}°"),
            "excess": Column(excess, "1", "over the reference", "excess (%)", digits("+.2f", 100.0)),
            "spectral_radius": Column(radii, "1", "largest modulus of a multiplier", "|ρ|", digits(".6f")),
            "error_estimate": Column([model.error_estimate for model in models], axes=()),
            **{name: Column([getattr(figure, name) for figure in figures], axes=()) for name in further},
        }

    def file_contents(self) -> FileContents:
        """Content of files: the quantity over the revolution, with one column per model. The rows of the
        table are part of the metadata."""
        unit = self.system.labels.units.get(self.reference.drawn, "")
        columns = {"phase": Column(self._phase, "rad", "phase of the drive", axes=("phase",))}
        for label, model in self.models.items():
            columns[label] = Column(model.values, unit, f"{self.reference.drawn}, {label}", axes=("phase",))
        return FileContents(columns, {}, {**model_info(self.system), **self.record()})

    @property
    def _phase(self) -> Array:
        return np.linspace(0.0, self.system.period, HALF_DEGREES)

    def plot(self) -> Figure:
        """Figure of the quantity over the revolution, with one curve per model. The curve of the reference is
        a wide line behind the others."""
        curves = {label: model.values for label, model in self.models.items()}
        return curves_figure(
            self.system,
            self._phase,
            curves,
            self.reference.drawn,
            "elements per link",
            styles={REFERENCE: BEHIND},
        )


@tables.register(Corrections)
def corrections_tables(result: Corrections) -> Sequence[RenderableType]:
    """Table of the reference model and of the compared models."""
    caption = "reference: 2 quintic elements per link, each with an inner node"
    return [table_of(result.quantity, result.columns, left=1, caption=caption)]


def corrections(
    model: StructureModel, speed: float, of: str, elements: Sequence[str], rtol: float = 1e-6
) -> Corrections:
    """Compute a quantity at a speed (rad/s) with three kinds of models: the reference, cubic elements, and
    one corrected element per link.

    `of` is a coordinate or output, or the common name of several outputs, of which the largest is used.
    `elements` are numbers of cubic elements per link. The model with corrected elements is solved with each
    of the two inertia loads. Raises SolveError subclasses.
    """
    systems: dict[str, PeriodicSystem] = {REFERENCE: model.varied(options=_REFERENCE_OPTIONS)}
    systems |= {count: model.varied(options={"element": "cubic", "elements": count}) for count in elements}
    single = model.varied(options={"elements": 1})
    systems |= {f"corrected, {load}": Corrected(single, load) for load in LOADS}
    for system in systems.values():
        require_turn(system, parts_of(system, of)[0], len(systems))
    models: dict[str, OneModel] = {}
    with progress.task("solutions", len(systems)):
        for label, system in systems.items():
            with progress.subtask("solutions"):
                drawn = models[REFERENCE].drawn if models else None
                models[label] = _solved(system, speed, of, drawn, rtol)
    return Corrections(model, speed, of, models)


def _solved(system: PeriodicSystem, speed: float, quantity: str, drawn: str | None, rtol: float) -> OneModel:
    """Solve one model. `drawn` is the output to sample, by default the one with the largest value."""
    orbit = solve.periodic(system, speed, rtol=rtol)
    figures = {name: orbit.statistics(name) for name in parts_of(system, quantity)}
    largest = max(figures, key=lambda name: figures[name].max_abs)
    phase = np.linspace(0.0, system.period, HALF_DEGREES)
    return OneModel(
        largest,
        figures[largest],
        orbit.signal(drawn or largest)(phase),
        orbit.spectral_radius,
        orbit.error_estimate,
        orbit.warnings,
    )


def corrected(
    four_bar: FourBar,
    results: Results,
    speed: SpeedText = "30 rad/s",
    of: Annotated[
        str, Flag("Coordinate or output to compare, or PLACE_stress on either surface.", "NAME")
    ] = "follower_midpoint_stress",
    elements: Annotated[str, Flag("Numbers of cubic elements per link to compare.", "A,B,C")] = "1,2,3,4",
    rtol: EachTolerance = 1e-6,
) -> None:
    """One element per link with corrected dynamic stiffness, compared with more elements."""
    model = four_bar.loaded("element", "elements")
    counts = [text.strip() for text in elements.split(",")]
    if not all(count.isdigit() for count in counts):
        raise ValueOutOfBoundsError(
            f"--elements is '{elements}'; write numbers of elements per link, such as --elements 1,2,3"
        )
    result = corrections(model, speed_in_si(speed), of, counts, rtol)
    deliver_result(results, result, four_bar.choices)
