"""The design method's answer as tables for a terminal of 80 columns, and as a file's contents."""

from collections.abc import Sequence

import numpy as np
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from models.four_bar.results.outcome import Outcome
from solve.results.report import model_heading, table


def outcome_report(result: Outcome, choices: Sequence[str]) -> RenderableType:
    """Limits, quiet bands, damping, plan and simulations; stresses in MPa."""
    parts: list[RenderableType] = [_heading(result, choices), _critical(result)]
    if result.design.quiet:
        parts.append(_quiet(result))
    if result.design.quiet_above:
        parts.append(_quiet_above(result))
    if result.plan is not None:
        parts += [_plan(result), _trials(result)]
    return Group(*parts, Text("\n" + result.text))


def _heading(result: Outcome, choices: Sequence[str]) -> Table:
    stresses = result.design.map
    grid = model_heading(stresses.model, choices)
    allowable = ", ".join(
        f"{link} {stress / 1e6:.5g}" for link, stress in zip(stresses.links, stresses.allowable, strict=True)
    )
    grid.add_row("allowable", f"{allowable} MPa")
    grid.add_row("L4", f"{stresses.L4[0]:.4f} … {stresses.L4[-1]:.4f} m, its own {stresses.own_L4:.4f} m")
    grid.add_row(
        "map",
        f"{len(stresses.speeds)} speeds "
        f"{stresses.model.speed_unit.span(stresses.speeds[0], stresses.speeds[-1], '…', '.4g')} times "
        f"{len(stresses.L4)} lengths, error {np.nanmax(stresses.error):.1e}, between speeds "
        f"{stresses.interpolation_error:.1e}",
    )
    return grid


def _critical(result: Outcome) -> RenderableType:
    design, stresses = result.design, result.design.map
    unit = stresses.model.speed_unit
    rates = {each.speed: each.sensitivity for each in result.damping}
    made = table(
        f"Critical speeds at L4 = {stresses.own_L4:.4f} m",
        f"speed ({unit.name})",
        "link",
        "stress/allowable",
        "",
        *stresses.links,
    )
    for peak in design.peaks:
        helps = [f"{rates[peak.speed][link]:+.2f}" for link in stresses.links]
        made.add_row(
            f"{unit.of(peak.speed):.2f}",
            peak.link,
            f"{peak.ratio:.3f}",
            "limiting" if peak.ratio > 1 else "",
            *helps,
        )
    return Group(made, Text("links: % of stress that one % more ζ brings; damping helps where negative"))


def _quiet(result: Outcome) -> RenderableType:
    design, stresses = result.design, result.design.map
    unit = stresses.model.speed_unit
    rates = {each.speed: each.sensitivity for each in result.damping}
    made = table(
        f"Quiet bands there ({unit.name})",
        "from",
        "to",
        "quietest",
        "stress/allowable",
        "damping",
        *stresses.links,
    )
    for band in design.quiet:
        known = rates.get(band.quietest)
        cells = [f"{known[link]:+.2f}" for link in stresses.links] if known else [""] * len(stresses.links)
        worst = stresses.worst_link(band.quietest)
        hurts = "" if known is None else "hurts" if known[worst] > 0 else "helps"
        made.add_row(
            *(f"{unit.of(speed):.2f}" for speed in (band.start, band.end, band.quietest)),
            f"{band.ratio:.3f}",
            hurts,
            *cells,
        )
    return made


def _quiet_above(result: Outcome) -> RenderableType:
    unit = result.design.map.model.speed_unit
    made = table(
        f"Quiet speeds above critical ones ({unit.name})",
        "above",
        "speed",
        "allowable needed",
        "with L4 fixed",
        left=0,
    )
    for each in result.design.quiet_above:
        made.add_row(
            *(f"{value:.3f}" for value in (*map(unit.of, (each.peak, each.speed)), each.needed, each.fixed))
        )
    return Group(made, Text("as a multiple of the allowable stress; L4 changes on the way and returns"))


def _plan(result: Outcome) -> RenderableType:
    plan = result.plan
    assert plan is not None
    unit = result.design.map.model.speed_unit
    made = table("Run-up plan", f"speed ({unit.name})", "L4 (m)", left=0)
    for speed, L4 in zip(plan.speed, plan.L4, strict=True):
        made.add_row(f"{unit.of(speed):.3f}", f"{L4:.4f}")
    if result.returns:
        made.add_row("then", f"{result.design.map.own_L4:.4f}")
    return Group(
        made,
        Text(f"L4 is linear between these; steady stress at most {result.steady.max():.3f} of the allowable"),
    )


def _trials(result: Outcome) -> RenderableType:
    unit = result.design.map.model.speed_unit
    made = table(
        "Simulated", "within", "acceleration", "stress/allowable", f"at speed ({unit.name})", "", left=0
    )
    for trial in result.trials:
        made.add_row(
            f"{trial.run_up.duration:.4g} s",
            unit.per_second.text(trial.run_up.acceleration, ".3g"),
            f"{trial.worst:.4f}",
            f"{unit.of(trial.worst_speed):.2f}",
            "below" if trial.worst < 1 else "too high",
        )
    return made
