"""Contribution of each mode to an output over a revolution (Fig. 6.4 of the thesis), and the output computed
without coupling of the modes (Fig. 6.3).

Natural frequencies over a revolution, computed with several types of elements and compared with the exact
ones (Figs. 4.6 and 5.3 of the thesis)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
import typer

import solve
from models.four_bar.studies.shared import AtOneSpeed, FourBar, Tolerance
from solve import frequencies
from solve.arrays import Array, uniform_phases
from solve.beams.element import EXACT
from solve.beams.observations import Contributions
from solve.beams.structure import StructureModel
from solve.commands.deliver import deliver_result
from solve.commands.groups import Flag, Results
from solve.equations import freedoms_of
from solve.errors import ValueOutOfBoundsError
from solve.results.contents import Column, Columns, digits, sized, to_json
from solve.results.result import Result
from solve.results.serialization import serializable
from solve.views.over_time import contributions_figure
from solve.views.show import tables
from solve.views.style import MANY, Figure, page
from solve.views.tables import RenderableType, table, table_of

_UNCOUPLED_STEPS = 720
"""Number of steps per revolution of the uncoupled solution. More steps do not change its error."""

serializable(Contributions)


@dataclass(frozen=True)
class Modes(AtOneSpeed):
    """Contributions of the modes to an output at k phases, and values (k,) of this output computed without
    coupling of the modes."""

    contributions: Contributions
    uncoupled: Array | None = None

    @property
    def error(self) -> float:
        """Largest error of the uncoupled solution, relative to the largest absolute value of the output."""
        assert self.uncoupled is not None
        total = self.contributions.total
        return float(np.abs(self.uncoupled - total).max() / np.abs(total).max())

    @property
    def summary_values(self) -> dict[str, Any]:
        output = self.contributions.output
        return {**super().summary_values, "quantity": output, "unit": self.system.labels.units[output]}

    @property
    def columns(self) -> Columns:
        """Columns of the table: phase, output, and contribution of each mode."""
        shares = self.contributions
        curves = {"all": (shares.total, "all modes")}
        curves |= {f"mode_{k}": (values, f"mode {k}") for k, values in enumerate(shares.values, 1)}
        if self.uncoupled is not None:
            curves["uncoupled"] = self.uncoupled, "uncoupled modes"
        columns = {"phase": Column(shares.phase, "rad", "phase of the drive", axes=("phase",))}
        for name, (values, meaning) in curves.items():
            unit = self.system.labels.units[shares.output]
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
        """Figure of the output, the contribution of each mode, and the uncoupled solution over the
        revolution."""
        return contributions_figure(self.system, self.contributions, self.orbit.speed, self.uncoupled)


@tables.register(Modes)
def modes_tables(result: Modes) -> Sequence[RenderableType]:
    """Table of the mean frequencies and largest contributions, with one row per mode."""
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
        "max_abs": sized(maxima, result.system.labels.units[shares.output], "", "max|…|", 5, largest),
        "share": Column(
            [maximum / largest for maximum in maxima], heading="share of max (%)", text=digits(".1f", 100.0)
        ),
    }
    return [table_of(shares.output, columns, left=1, caption=caption)]


def mode_contributions(
    model: StructureModel, speed: float | str, of: str, count: int, uncoupled: bool, rtol: float = 1e-6
) -> Modes:
    """Compute the contributions of the lowest `count` modes to a deflection or stress at a speed.

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
        str, Flag("Output, which must be a deflection or stress.", "NAME")
    ] = "follower_midpoint_deflection",
    count: Annotated[int, typer.Option(metavar="N", min=1, help="Number of modes.")] = 4,
    uncoupled: Annotated[bool, Flag("Add the solution with uncoupled modes, and its error.")] = False,
    rtol: Tolerance = 1e-6,
) -> None:
    """Contribution of each mode to a deflection or stress over one revolution."""
    result = mode_contributions(four_bar.loaded(), speed, of, count, uncoupled, rtol)
    deliver_result(results, result, four_bar.choices)


_MOST_COUNT, _MOST_TURN = 9, 3600
"""Maximum numbers of frequencies and of crank positions. Chosen by judgement, so that the size of the figure
and the computing time remain moderate."""

_KINDS = "cubic:1,cubic:2,cubic:3,internal:1,curvature:1,dynamic:1"


@dataclass(frozen=True)
class ElementKinds(Result):
    """Natural frequencies (rad/s) for several types of elements, at crank angles `positions` (m,) in rad.

    `kinds` (r,) state the type of the elements and their number per link, such as "cubic:3". `freedoms` (r,)
    are the numbers of degrees of freedom. `values` (r, m, k) are the frequencies, and `exact` (m, k) the
    exact ones.
    """

    system: StructureModel  # type: ignore[override]
    kinds: tuple[str, ...]
    freedoms: tuple[int, ...]
    positions: Array
    values: Array
    exact: Array

    @property
    def means(self) -> Array:
        """Means (r, k) over the revolution, in rad/s."""
        return self.values.mean(axis=1)

    @property
    def mean_errors(self) -> Array:
        """Relative errors of the means (r, k)."""
        return self.means / self.exact.mean(axis=0) - 1

    @property
    def columns(self) -> Columns:
        """Columns of the table, with one row per position, and one column per element type and frequency."""
        columns = {"position": Column(self.positions, "rad", "crank angle", axes=("position",))}
        for kind, values in zip(self.kinds, self.values, strict=True):
            for k, column in enumerate(values.T, start=1):
                meaning = f"frequency {k}, elements {kind}"
                name = f"{kind.replace(':', '_')}_f{k}"
                columns[name] = Column(column, "rad/s", meaning, axes=("position",))
        return columns

    @property
    def summary_values(self) -> dict[str, Any]:
        rows = zip(self.kinds, self.freedoms, self.means, self.mean_errors, strict=True)
        names = "kind", "freedoms", "means", "mean_errors"
        kinds = to_json(dict(zip(names, row, strict=True)) for row in rows)
        return {"positions": self.positions, "kinds": kinds}

    def plot(self) -> Figure:
        """Figure with one panel per frequency and one curve per element type."""
        return _figure(self)


@tables.register(ElementKinds)
def element_kinds_tables(result: ElementKinds) -> Sequence[RenderableType]:
    """Table of the means over the revolution, with their relative errors."""
    columns = [f"f{k}" for k in range(1, result.values.shape[2] + 1)]
    means = table("Means over the revolution (rad/s), and errors", "kind", "freedoms", *columns)
    rows = zip(result.kinds, result.freedoms, result.means, result.mean_errors, strict=True)
    for kind, freedoms, mean, error in rows:
        means.add_row(kind, str(freedoms), *(f"{value:.3f}" for value in mean))
        means.add_row("", "", *(f"{100 * value:+.3f} %" for value in error))
    return [means]


def element_kinds(
    model: StructureModel, kinds: Sequence[str], count: int = 4, turn: int = 36
) -> ElementKinds:
    """Compute the lowest `count` frequencies at `turn` positions. `kinds` are types of elements with their
    number per link, such as "cubic:3".

    Raises ValueOutOfBoundsError for strings of another form and for numbers out of bounds, and
    UnknownNameError for an unknown type of element.
    """
    if not (1 <= count <= _MOST_COUNT and 1 <= turn <= _MOST_TURN):
        raise ValueOutOfBoundsError(
            f"{count} frequencies at {turn} positions; allowed: 1 … {_MOST_COUNT} at 1 … {_MOST_TURN}"
        )
    positions = uniform_phases(turn, model.period)
    models = [_with_elements(model, kind) for kind in kinds]
    values = [frequencies(varied, positions, count).values for varied in models]
    exact = frequencies(model.varied(options={"element": EXACT, "elements": 1}), positions, count).values
    freedoms = tuple(freedoms_of(varied) for varied in models)
    return ElementKinds(model, tuple(kinds), freedoms, positions, np.stack(values), exact)


def _with_elements(model: StructureModel, kind: str) -> StructureModel:
    element, colon, number = kind.strip().partition(":")
    if not colon or not number.isascii() or not number.isdigit():
        raise ValueOutOfBoundsError(f"element type is '{kind}'; allowed: KIND:N, such as cubic:3")
    return model.varied(options={"element": element, "elements": int(number)})


def _figure(result: ElementKinds) -> Figure:
    count = result.values.shape[2]
    columns = min(count, 2)
    rows = -(-count // columns)
    degrees = np.degrees(np.append(result.positions, result.positions[0] + result.system.period))
    with page(0.7 + 2.0 * rows, "Natural frequencies of the four-bar over a revolution") as figure:
        panels = figure.subplots(rows, columns, sharex=True, squeeze=False)
        for k, axes in enumerate(panels.flat):
            if k >= count:
                axes.set_axis_off()
                continue
            for kind, values, colour in zip(result.kinds, result.values, MANY, strict=False):
                closed = np.append(values[:, k], values[0, k])
                style = "--" if kind.startswith(EXACT) else "-"
                axes.plot(degrees, closed, color=colour, linestyle=style, linewidth=1.0, label=kind)
            axes.set_title(f"frequency {k + 1} (rad/s)")
            axes.set_xlim(degrees[0], degrees[-1])
        for axes in panels[-1]:
            axes.set_xlabel("crank angle (deg)")
        figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=6)
    return figure


def elements(
    four_bar: FourBar,
    results: Results,
    kinds: Annotated[str, Flag("Element types and their number per link.", "KIND:N,…")] = _KINDS,
    count: Annotated[int, Flag("Number of frequencies, starting from the lowest, up to 9.", "N")] = 4,
    turn: Annotated[int, Flag("Number of equidistant crank positions.", "N")] = 36,
) -> None:
    """Natural frequencies over a revolution by element type, compared with exact frequencies."""
    result = element_kinds(four_bar.loaded("element", "elements"), kinds.split(","), count, turn)
    deliver_result(results, result, four_bar.choices)
