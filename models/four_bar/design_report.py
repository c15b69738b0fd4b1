"""The design method's answer as tables for a terminal of 80 columns, and as a file's contents."""

from collections.abc import Sequence

import numpy as np
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from models.four_bar.verdict import Verdict, verdict_record
from solve.results.contents import Contents, Variable
from solve.results.record import plain
from solve.results.report import model_heading, table


def verdict_report(found: Verdict, choices: Sequence[str]) -> RenderableType:
    """Limits, quiet bands, damping, plan and simulations; speeds in rad/s, stresses in MPa."""
    parts: list[RenderableType] = [_heading(found, choices), _critical(found)]
    if found.design.quiet:
        parts.append(_quiet(found))
    if found.design.beyond:
        parts.append(_beyond(found))
    if found.plan is not None:
        parts += [_plan(found), _trials(found)]
    return Group(*parts, Text("\n" + found.text))


def _heading(found: Verdict, choices: Sequence[str]) -> Table:
    design = found.design
    grid = model_heading(design.model, choices)
    allowable = ", ".join(
        f"{link} {stress / 1e6:.5g}" for link, stress in zip(design.links, design.allowable, strict=True)
    )
    grid.add_row("allowable", f"{allowable} MPa")
    grid.add_row("L4", f"{design.L4[0]:.4f} … {design.L4[-1]:.4f} m, its own {design.own_L4:.4f} m")
    grid.add_row(
        "map",
        f"{len(design.speeds)} speeds {design.speeds[0]:.4g} … {design.speeds[-1]:.4g} rad/s times "
        f"{len(design.L4)} lengths, error {np.nanmax(design.error):.1e}, between speeds {design.missed:.1e}",
    )
    return grid


def _critical(found: Verdict) -> RenderableType:
    design = found.design
    rates = {each.speed: each.sensitivity for each in found.damping}
    made = table(
        f"Critical speeds at L4 = {design.own_L4:.4f} m",
        "speed",
        "link",
        "stress/allowable",
        "",
        *design.links,
    )
    for peak in design.peaks:
        helps = [f"{rates[peak.speed][link]:+.2f}" for link in design.links]
        made.add_row(
            f"{peak.speed:.2f}", peak.link, f"{peak.ratio:.3f}", "limiting" if peak.ratio > 1 else "", *helps
        )
    return Group(made, Text("links: % of stress that one % more ζ brings; damping helps where negative"))


def _quiet(found: Verdict) -> RenderableType:
    design = found.design
    rates = {each.speed: each.sensitivity for each in found.damping}
    made = table("Quiet bands there", "from", "to", "quietest", "stress/allowable", "damping", *design.links)
    for band in design.quiet:
        known = rates.get(band.quietest)
        cells = [f"{known[link]:+.2f}" for link in design.links] if known else [""] * len(design.links)
        worst = design.worst_link(band.quietest)
        hurts = "" if known is None else "hurts" if known[worst] > 0 else "helps"
        made.add_row(
            f"{band.start:.2f}", f"{band.end:.2f}", f"{band.quietest:.2f}", f"{band.ratio:.3f}", hurts, *cells
        )
    return made


def _beyond(found: Verdict) -> RenderableType:
    made = table(
        "Quiet speeds above critical ones", "above", "speed", "allowable needed", "with L4 fixed", left=0
    )
    for each in found.design.beyond:
        made.add_row(*(f"{value:.3f}" for value in (each.peak, each.speed, each.needed, each.fixed)))
    return Group(made, Text("as a multiple of the allowable stress; L4 changes on the way and returns"))


def _plan(found: Verdict) -> RenderableType:
    plan = found.plan
    assert plan is not None
    made = table("Run-up plan", "speed", "L4 (m)", left=0)
    for speed, L4 in zip(plan.speed, plan.L4, strict=True):
        made.add_row(f"{speed:.3f}", f"{L4:.4f}")
    if found.returns:
        made.add_row("then", f"{found.design.own_L4:.4f}")
    return Group(
        made,
        Text(f"L4 is linear between these; steady stress at most {found.steady.max():.3f} of the allowable"),
    )


def _trials(found: Verdict) -> RenderableType:
    made = table("Simulated", "within", "acceleration", "stress/allowable", "at speed", "", left=0)
    for trial in found.trials:
        made.add_row(
            f"{trial.run_up.duration:.4g} s",
            f"{trial.run_up.acceleration:.3g} rad/s²",
            f"{trial.worst:.4f}",
            f"{trial.worst_speed:.2f}",
            "below" if trial.worst < 1 else "too high",
        )
    return made


def verdict_contents(found: Verdict) -> Contents:
    """The map by speed at the mechanism's own L4, with what a run-up to each speed needs; in .npz
    and .mat the whole map and the slowest simulation besides; .nc has the map in its metadata."""
    design = found.design
    columns = {"speed": Variable("speed", design.speeds, "rad/s", "speed of the crank")}
    for number, link in enumerate(design.links):
        own = design.stress[:, design.own, number]
        columns[f"{link}_stress"] = Variable("speed", own, "Pa", f"largest of the {link} at its own L4")
    for name, values, meaning in (
        ("fixed", design.without_pivot, "with L4 fixed"),
        ("moving", design.with_pivot, "with L4 changing"),
        ("returning", design.with_return, "with L4 changing and returning"),
    ):
        columns[f"least_ratio_{name}"] = Variable(
            "speed", values, "1", f"part of the allowable stress to reach the speed {meaning}"
        )
    arrays = {name: column.values for name, column in columns.items()}
    arrays |= {"L4": design.L4, "stress": design.stress, "links": np.array(design.links)}
    if found.plan is not None:
        first = found.trials[0]
        arrays |= {"plan_speed": found.plan.speed, "plan_L4": found.plan.L4}
        arrays |= {f"simulated_{name}": part for name, part in vars(first.simulated).items()}
    return Contents(columns, {}, arrays, plain(verdict_record(found)))
