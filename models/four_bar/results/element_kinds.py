"""Natural frequencies of the four-bar over a turn by several kinds of elements, beside the exact ones."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from solve import frequencies
from solve.arrays import Array
from solve.beams.elements import EXACT
from solve.beams.structure import StructureModel
from solve.errors import ValueOutOfBoundsError
from solve.results.contents import Column, Columns, to_json
from solve.results.result import Result
from solve.views.show import tables
from solve.views.style import MANY, Figure, page
from solve.views.tables import RenderableType, table

_MOST_COUNT, _MOST_TURN = 9, 3600


@dataclass(frozen=True)
class ElementKinds(Result):
    """kinds (r,) as "cubic:3", freedoms (r,); values (r, m, k) and exact (m, k): frequencies in rad/s at
    positions (m,), crank angles in rad."""

    system: StructureModel  # type: ignore[override]
    kinds: tuple[str, ...]
    freedoms: tuple[int, ...]
    positions: Array
    values: Array
    exact: Array

    @property
    def means(self) -> Array:
        """Over the turn (r, k), rad/s."""
        return self.values.mean(axis=1)

    @property
    def mean_errors(self) -> Array:
        """Of the means, relative to the exact ones (r, k)."""
        return self.means / self.exact.mean(axis=0) - 1

    @property
    def columns(self) -> Columns:
        """A row a position, a column a kind and frequency."""
        axes = ("position",)
        found = {"position": Column(self.positions, "rad", "crank angle", axes=axes)}
        for kind, values in zip(self.kinds, self.values, strict=True):
            for k, column in enumerate(values.T, start=1):
                meaning = f"frequency {k}, elements {kind}"
                found[f"{kind.replace(':', '_')}_f{k}"] = Column(column, "rad/s", meaning, axes=axes)
        return found

    @property
    def summary_values(self) -> dict[str, Any]:
        rows = zip(self.kinds, self.freedoms, self.means, self.mean_errors, strict=True)
        names = "kind", "freedoms", "means", "mean_errors"
        kinds = to_json(dict(zip(names, row, strict=True)) for row in rows)
        return {"positions": self.positions, "kinds": kinds}

    def plot(self) -> Figure:
        return _figure(self)


@tables.register(ElementKinds)
def element_kinds_tables(result: ElementKinds) -> Sequence[RenderableType]:
    """Means over the turn, and how far they are from the exact ones."""
    columns = [f"f{k}" for k in range(1, result.values.shape[2] + 1)]
    shown = table("Means over the turn (rad/s), and above the exact ones", "kind", "freedoms", *columns)
    rows = zip(result.kinds, result.freedoms, result.means, result.mean_errors, strict=True)
    for kind, freedoms, mean, error in rows:
        shown.add_row(kind, str(freedoms), *(f"{value:.3f}" for value in mean))
        shown.add_row("", "", *(f"{100 * part:+.3f} %" for part in error))
    return [shown]


def element_kinds(
    model: StructureModel, kinds: Sequence[str], count: int = 4, turn: int = 36
) -> ElementKinds:
    """Frequencies by kinds of elements, each with how many a link has: "cubic:3".

    Raises ValueOutOfBoundsError for what is no kind and number, or numbers out of bounds; UnknownNameError
    for an unknown kind.
    """
    if not (1 <= count <= _MOST_COUNT and 1 <= turn <= _MOST_TURN):
        raise ValueOutOfBoundsError(
            f"{count} frequencies at {turn} positions; allowed: 1 … {_MOST_COUNT} at 1 … {_MOST_TURN}"
        )
    positions = np.linspace(0.0, model.period, turn, endpoint=False)
    made = [_varied(model, kind) for kind in kinds]
    values = [frequencies(each, positions, count).values for each in made]
    exact = frequencies(model.varied(options={"element": EXACT, "elements": 1}), positions, count).values
    freedoms = tuple(each.freedoms for each in made)
    return ElementKinds(model, tuple(kinds), freedoms, positions, np.stack(values), exact)


def _varied(model: StructureModel, kind: str) -> StructureModel:
    element, colon, number = kind.strip().partition(":")
    if not colon or not number.isascii() or not number.isdigit():
        raise ValueOutOfBoundsError(f"kind '{kind}' of elements; allowed: KIND:N, such as cubic:3")
    return model.varied(options={"element": element, "elements": int(number)})


def _figure(made: ElementKinds) -> Figure:
    """A panel a frequency, a curve a kind (matplotlib Figure)."""
    count = made.values.shape[2]
    columns = 1 if count == 1 else 2
    rows = -(-count // columns)
    degrees = np.degrees(np.append(made.positions, made.positions[0] + made.system.period))
    with page(0.7 + 2.0 * rows, "Natural frequencies of the four-bar over a turn") as figure:
        axes = figure.subplots(rows, columns, sharex=True, squeeze=False)
        for k, place in enumerate(axes.flat):
            if k >= count:
                place.set_axis_off()
                continue
            for kind, values, colour in zip(made.kinds, made.values, MANY, strict=False):
                closed = np.append(values[:, k], values[0, k])
                style = "--" if kind.startswith(EXACT) else "-"
                place.plot(degrees, closed, color=colour, linestyle=style, linewidth=1.0, label=kind)
            place.set_title(f"frequency {k + 1} (rad/s)")
            place.set_xlim(degrees[0], degrees[-1])
        for place in axes[-1]:
            place.set_xlabel("crank angle (deg)")
        figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=6)
    return figure
