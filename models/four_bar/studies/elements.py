"""Natural frequencies over a revolution by several element types, compared with the exact ones (thesis
Figs. 4.6, 5.3)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from models.four_bar.studies.shared import FourBar
from solve import frequencies
from solve.arrays import Array
from solve.beams.elements import EXACT
from solve.beams.structure import StructureModel
from solve.commands.deliver import deliver_result
from solve.commands.groups import Flag, Results
from solve.errors import ValueOutOfBoundsError
from solve.results.contents import Column, Columns, to_json
from solve.results.result import Result
from solve.views.show import tables
from solve.views.style import MANY, Figure, page
from solve.views.tables import RenderableType, table

_MOST_COUNT, _MOST_TURN = 9, 3600
"""Maximum number of frequencies and of crank positions. Choices that limit the size of the figure and the run
time."""

_KINDS = "cubic:1,cubic:2,cubic:3,internal:1,curvature:1,dynamic:1"


@dataclass(frozen=True)
class ElementKinds(Result):
    """Frequencies (rad/s) at crank angles `positions` (m,), in rad.

    kinds (r,): element type and number per link, such as "cubic:3"; freedoms (r,); values (r, m, k); exact
    (m, k).
    """

    system: StructureModel  # type: ignore[override]
    kinds: tuple[str, ...]
    freedoms: tuple[int, ...]
    positions: Array
    values: Array
    exact: Array

    @property
    def means(self) -> Array:
        """Means over the revolution (r, k), rad/s."""
        return self.values.mean(axis=1)

    @property
    def mean_errors(self) -> Array:
        """Relative errors of the means (r, k)."""
        return self.means / self.exact.mean(axis=0) - 1

    @property
    def columns(self) -> Columns:
        """Columns of the table: one row per position, one column per element type and frequency."""
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
        """Figure with a panel per frequency and a curve per element type."""
        return _figure(self)


@tables.register(ElementKinds)
def element_kinds_tables(result: ElementKinds) -> Sequence[RenderableType]:
    """Means over the revolution, and their relative errors."""
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
    """Lowest `count` frequencies at `turn` positions for element types given with their number per link, such
    as "cubic:3".

    Raises ValueOutOfBoundsError for another form and for numbers out of bounds, UnknownNameError for an
    unknown element type.
    """
    if not (1 <= count <= _MOST_COUNT and 1 <= turn <= _MOST_TURN):
        raise ValueOutOfBoundsError(
            f"{count} frequencies at {turn} positions; allowed: 1 … {_MOST_COUNT} at 1 … {_MOST_TURN}"
        )
    positions = np.linspace(0.0, model.period, turn, endpoint=False)
    models = [_with_elements(model, kind) for kind in kinds]
    values = [frequencies(varied, positions, count).values for varied in models]
    exact = frequencies(model.varied(options={"element": EXACT, "elements": 1}), positions, count).values
    freedoms = tuple(varied.freedoms for varied in models)
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
    with page(0.7 + 2.0 * rows, "Natural frequencies of the four-bar over a turn") as figure:
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
    count: Annotated[int, Flag("Number of frequencies, from the lowest: up to 9.", "N")] = 4,
    turn: Annotated[int, Flag("Number of equidistant crank positions.", "N")] = 36,
) -> None:
    """Natural frequencies over a revolution by element type, compared with the exact ones."""
    result = element_kinds(four_bar.loaded(), kinds.split(","), count, turn)
    deliver_result(results, result, four_bar.choices)
