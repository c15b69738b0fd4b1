"""`python -m models.four_bar modes`: what each mode gives to a deflection or stress (thesis Fig. 6.4), and
what modes that do not couple would give (thesis Fig. 6.3)."""

from typing import TYPE_CHECKING, Annotated, Any

import typer

from models.four_bar.commands.groups import FourBar
from solve.commands.groups import Flag, Results

if TYPE_CHECKING:
    from rich.console import RenderableType

    from solve.arrays import Array
    from solve.beams.observations import Contributions
    from solve.results.contents import Contents
    from solve.results.orbit import Orbit

_UNCOUPLED_STEPS = 720
"""Steps a turn from which on more change nothing of what uncoupling errs by."""


def modes(
    four_bar: FourBar,
    results: Results,
    speed: Annotated[str, Flag("Speed with unit: rpm, rad/s or Hz.", '"35 rad/s"')] = "35 rad/s",
    of: Annotated[
        str, Flag("A deflection or stress among the outputs.", "NAME")
    ] = "follower_midpoint_deflection",
    count: Annotated[int, typer.Option(metavar="N", min=1, help="Number of modes.")] = 4,
    uncoupled: Annotated[bool, Flag("Add the solution of modes that do not couple, and its error.")] = False,
    rtol: Annotated[float, Flag("Relative error of the solution.", "R")] = 1e-6,
) -> None:
    """What the modes of each position give to a deflection or stress over one turn."""
    results.files()
    model = four_bar.loaded()

    import solve
    from solve.commands.deliver import deliver

    model.require_part_of_modes(of)
    orbit = solve.periodic(model, speed, rtol=rtol)
    contributions = model.modal_contributions(orbit, of, count)
    alone = None
    if uncoupled:
        alone = solve.periodic(model, speed, "modal", _UNCOUPLED_STEPS).signal(of)(contributions.phase)

    def figure() -> Any:
        from solve.results.turn_plot import contributions_figure

        return contributions_figure(model, contributions, orbit.speed, alone)

    deliver(
        results,
        orbit.warnings,
        record=lambda: _record(orbit, contributions, alone),
        report=lambda: _report(orbit, contributions, alone, four_bar.choices),
        figure=figure,
        contents=lambda: _contents(orbit, contributions, alone),
    )


def _record(orbit: "Orbit", contributions: "Contributions", alone: "Array | None") -> dict[str, Any]:

    beside = {} if alone is None else {"uncoupled": {"values": alone, "error": _error(contributions, alone)}}
    from solve.results.contents import model_record, plain

    return plain(
        {
            **model_record(orbit.system),
            "speed": orbit.speed,
            "quantity": contributions.output,
            "unit": orbit.system.units[contributions.output],
            "phase": contributions.phase,
            "total": contributions.total,
            "modes": [
                {"frequency": frequencies, "contribution": values, "max_abs": abs(values).max()}
                for frequencies, values in zip(contributions.frequencies, contributions.values, strict=True)
            ],
            "error_estimate": orbit.error_estimate._asdict(),
            **beside,
        }
    )


def _error(contributions: "Contributions", alone: "Array") -> float:
    """Largest error over the turn beside the largest value."""
    return float(abs(alone - contributions.total).max() / abs(contributions.total).max())


def _report(
    orbit: "Orbit", contributions: "Contributions", alone: "Array | None", choices: "list[str]"
) -> "RenderableType":
    from rich.console import Group

    from solve.results.quantities import fixed, prefixed
    from solve.results.report import heading, table

    largest = abs(contributions.total).max()
    factor, unit = prefixed(orbit.system.units[contributions.output], largest)
    made = table(contributions.output, "mode", "mean ω (rad/s)", f"max|…| ({unit})", "share of max (%)")
    for number_, (frequencies, values) in enumerate(
        zip(contributions.frequencies, contributions.values, strict=True), 1
    ):
        size = abs(values).max()
        made.add_row(
            str(number_),
            f"{frequencies[:-1].mean():.3f}",
            fixed(size * factor, largest * factor, 5),
            f"{100 * size / largest:.1f}",
        )
    made.add_row("all", "", fixed(largest * factor, largest * factor, 5), "100.0")
    if alone is not None:
        size, error = abs(alone).max(), _error(contributions, alone)
        made.add_row(
            "uncoupled", "", fixed(size * factor, largest * factor, 5), f"{100 * size / largest:.1f}"
        )
        made.caption = f"uncoupled modes miss by up to {100 * error:.1f} % of the maximum"
    return Group(heading(orbit.system, orbit.speed, choices), made)


def _contents(orbit: "Orbit", contributions: "Contributions", alone: "Array | None") -> "Contents":
    from solve.results.contents import model_record, table_contents

    unit = orbit.system.units[contributions.output]
    columns: dict[str, tuple[Any, str, str]] = {
        "phase": (contributions.phase, "rad", "phase of the drive"),
        "all": (contributions.total, unit, f"{contributions.output}, all modes"),
    }
    for number_, values in enumerate(contributions.values, 1):
        columns[f"mode_{number_}"] = (values, unit, f"{contributions.output}, mode {number_}")
    if alone is not None:
        columns["uncoupled"] = (alone, unit, f"{contributions.output}, modes that do not couple")
    return table_contents(columns, {**model_record(orbit.system), "speed": orbit.speed})
