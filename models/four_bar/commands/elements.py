"""`python -m models.four_bar elements`: frequencies by several kinds of elements (thesis Figs. 4.6, 5.3)."""

from typing import TYPE_CHECKING, Annotated, Any

from models.four_bar.commands.groups import FourBar
from solve.commands.groups import Flag, Results

if TYPE_CHECKING:
    from rich.console import RenderableType

    from models.four_bar.element_kinds import ElementKinds
    from solve.results.contents import Contents

_KINDS = "cubic:1,cubic:2,cubic:3,internal:1,curvature:1,dynamic:1"


def elements(
    four_bar: FourBar,
    results: Results,
    kinds: Annotated[str, Flag("Kinds of elements and how many a link.", "KIND:N,…")] = _KINDS,
    count: Annotated[int, Flag("Frequencies, from the lowest: up to 9.", "N")] = 4,
    turn: Annotated[int, Flag("Crank positions, evenly over the turn.", "N")] = 36,
) -> None:
    """Natural frequencies over a turn by several kinds of elements, beside the exact ones."""
    results.files()
    model = four_bar.loaded()

    from models.four_bar.element_kinds import element_kinds, kinds_figure
    from solve.commands.deliver import deliver

    made = element_kinds(model, kinds.split(","), count, turn)
    deliver(
        results,
        [],
        record=lambda: _record(made),
        report=lambda: _report(made, four_bar.choices),
        figure=lambda: kinds_figure(made),
        contents=lambda: _contents(made),
    )


def _record(made: "ElementKinds") -> dict[str, Any]:
    from solve.results.contents import model_record, plain

    means, errors = made.means, made.mean_errors
    rows = [
        {"kind": kind, "freedoms": freedoms, "means": mean, "mean_errors": error}
        for kind, freedoms, mean, error in zip(made.kinds, made.freedoms, means, errors, strict=True)
    ]
    return plain({**model_record(made.system), "positions": made.positions, "kinds": rows})


def _report(made: "ElementKinds", choices: "list[str]") -> "RenderableType":
    from solve.results.report import model_heading, stacked, table

    columns = [f"f{k}" for k in range(1, made.values.shape[2] + 1)]
    shown = table("Means over the turn (rad/s), and above the exact ones", "kind", "freedoms", *columns)
    for kind, freedoms, mean, error in zip(
        made.kinds, made.freedoms, made.means, made.mean_errors, strict=True
    ):
        shown.add_row(kind, str(freedoms), *(f"{value:.3f}" for value in mean))
        shown.add_row("", "", *(f"{100 * part:+.3f} %" for part in error))
    return stacked(model_heading(made.system, choices), shown)


def _contents(made: "ElementKinds") -> "Contents":
    from solve.results.contents import model_record, table_contents

    columns: dict[str, tuple[Any, str, str]] = {"position": (made.positions, "rad", "crank angle")}
    for kind, values in zip(made.kinds, made.values, strict=True):
        for k, column in enumerate(values.T, start=1):
            name = f"{kind.replace(':', '_')}_f{k}"
            columns[name] = (column, "rad/s", f"frequency {k}, elements {kind}")
    return table_contents(columns, model_record(made.system))
