"""`python -m models.four_bar modes`: what each mode gives to a deflection or stress (thesis Fig. 6.4), and
what modes that do not couple would give (thesis Fig. 6.3)."""

from typing import TYPE_CHECKING, Annotated, Any

import typer

from models.four_bar.commands.groups import FourBar
from solve.commands.groups import Results
from solve.commands.parse import number

if TYPE_CHECKING:
    from rich.console import RenderableType

    from solve.arrays import Array
    from solve.beams.contributions import Contributions
    from solve.results.contents import Contents
    from solve.results.orbit import Orbit

_UNCOUPLED_STEPS = 720
"""Steps a turn from which on more change nothing of what uncoupling errs by."""


def modes(
    four_bar: FourBar,
    results: Results,
    speed: Annotated[
        str, typer.Option(metavar='"35 rad/s"', help="Speed with unit: rpm, rad/s or Hz.")
    ] = "35 rad/s",
    of: Annotated[
        str, typer.Option(metavar="NAME", help="A deflection or stress among the outputs.")
    ] = "follower_midpoint_deflection",
    count: Annotated[int, typer.Option(metavar="N", min=1, help="Number of modes.")] = 4,
    uncoupled: Annotated[
        bool, typer.Option("--uncoupled", help="Add the solution of modes that do not couple, and its error.")
    ] = False,
    rtol: Annotated[
        float, typer.Option(metavar="R", parser=number, help="Relative error of the solution.")
    ] = 1e-6,
) -> None:
    """What the modes of each position give to a deflection or stress over one turn."""
    results.files()
    model = four_bar.loaded()

    import solve
    from solve.commands.deliver import deliver

    model.require_part_of_modes(of)
    orbit = solve.periodic(model, speed, rtol=rtol)
    found = model.modal_contributions(orbit, of, count)
    alone = None
    if uncoupled:
        alone = solve.periodic(model, speed, "modal", _UNCOUPLED_STEPS).signal(of)(found.phase)

    def figure() -> Any:
        from solve.results.contributions_plot import contributions_figure

        return contributions_figure(model, found, orbit.speed, alone)

    deliver(
        results,
        orbit.warnings,
        record=lambda: _record(orbit, found, alone),
        report=lambda: _report(orbit, found, alone, four_bar.choices),
        figure=figure,
        contents=lambda: _contents(orbit, found, alone),
    )


def _record(orbit: "Orbit", found: "Contributions", alone: "Array | None") -> dict[str, Any]:
    from solve.results.record import model_record, plain

    beside = {} if alone is None else {"uncoupled": {"values": alone, "error": _error(found, alone)}}
    return plain(
        {
            **model_record(orbit.system),
            "speed": orbit.speed,
            "quantity": found.output,
            "unit": orbit.system.units[found.output],
            "phase": found.phase,
            "total": found.total,
            "modes": [
                {"frequency": frequencies, "contribution": values, "max_abs": abs(values).max()}
                for frequencies, values in zip(found.frequencies, found.values, strict=True)
            ],
            "error_estimate": orbit.error_estimate._asdict(),
            **beside,
        }
    )


def _error(found: "Contributions", alone: "Array") -> float:
    """Largest error over the turn beside the largest value."""
    return float(abs(alone - found.total).max() / abs(found.total).max())


def _report(
    orbit: "Orbit", found: "Contributions", alone: "Array | None", choices: "list[str]"
) -> "RenderableType":
    from rich.console import Group

    from solve.results.quantities import fixed, prefixed
    from solve.results.report import heading, table

    largest = abs(found.total).max()
    factor, unit = prefixed(orbit.system.units[found.output], largest)
    made = table(found.output, "mode", "mean ω (rad/s)", f"max|…| ({unit})", "share of max (%)")
    for number_, (frequencies, values) in enumerate(zip(found.frequencies, found.values, strict=True), 1):
        size = abs(values).max()
        made.add_row(
            str(number_),
            f"{frequencies[:-1].mean():.3f}",
            fixed(size * factor, largest * factor, 5),
            f"{100 * size / largest:.1f}",
        )
    made.add_row("all", "", fixed(largest * factor, largest * factor, 5), "100.0")
    if alone is not None:
        size, error = abs(alone).max(), _error(found, alone)
        made.add_row(
            "uncoupled", "", fixed(size * factor, largest * factor, 5), f"{100 * size / largest:.1f}"
        )
        made.caption = f"uncoupled modes miss by up to {100 * error:.1f} % of the maximum"
    return Group(heading(orbit.system, orbit.speed, choices), made)


def _contents(orbit: "Orbit", found: "Contributions", alone: "Array | None") -> "Contents":
    from solve.results.contents import table_contents
    from solve.results.record import model_record

    unit = orbit.system.units[found.output]
    columns: dict[str, tuple[Any, str, str]] = {
        "phase": (found.phase, "rad", "phase of the drive"),
        "all": (found.total, unit, f"{found.output}, all modes"),
    }
    for number_, values in enumerate(found.values, 1):
        columns[f"mode_{number_}"] = (values, unit, f"{found.output}, mode {number_}")
    if alone is not None:
        columns["uncoupled"] = (alone, unit, f"{found.output}, modes that do not couple")
    return table_contents(columns, {**model_record(orbit.system), "speed": orbit.speed})
