"""The design method's answer as tables for a terminal of 80 columns, and as a file's contents."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from models.four_bar.results.outcome import Outcome
from solve.results.contents import Column, Columns, digits, speeds_of
from solve.views.tables import heading, table_of


def outcome_report(result: Outcome, choices: Sequence[str] = ()) -> RenderableType:
    """Limits, quiet bands, damping, plan and simulations; stresses in MPa."""
    parts: list[RenderableType] = [_heading(result, choices), _critical(result)]
    if result.design.quiet:
        parts.append(_quiet(result))
    if result.design.quiet_above:
        parts.append(_quiet_above(result))
    if result.plan is not None:
        parts += [_plan(result), table_of("Simulated", trial_columns(result))]
    return Group(*parts, Text("\n" + result.text))


def _heading(result: Outcome, choices: Sequence[str]) -> Table:
    stresses = result.design.map
    allowable = ", ".join(
        f"{link} {stress / 1e6:.5g}" for link, stress in zip(stresses.links, stresses.allowable, strict=True)
    )
    speeds = stresses.model.speed_unit.span(stresses.speeds[0], stresses.speeds[-1], "…", ".4g")
    facts = [
        ("allowable", f"{allowable} MPa"),
        ("L4", f"{stresses.L4[0]:.4f} … {stresses.L4[-1]:.4f} m, its own {stresses.own_L4:.4f} m"),
        (
            "map",
            f"{len(stresses.speeds)} speeds {speeds} times {len(stresses.L4)} lengths, error "
            f"{np.nanmax(stresses.error):.1e}, between speeds {stresses.interpolation_error:.1e}",
        ),
    ]
    return heading(stresses.model, None, choices, facts)


def _speeds(result: Outcome, speeds: Any, heading: str, form: str = ".2f") -> Column:
    return speeds_of(result.design.map.model, speeds, "", heading, form)


def _rates(result: Outcome, speeds: Sequence[float]) -> Columns:
    """A column a link: how damping changes its stress at these speeds, empty where that was not asked."""
    rates = {each.speed: each.sensitivity for each in result.damping}
    known = [rates.get(speed) for speed in speeds]
    return {
        link: Column(speeds, heading=link, text=[f"{rate[link]:+.2f}" if rate else "" for rate in known])
        for link in result.design.map.links
    }


def _critical(result: Outcome) -> RenderableType:
    peaks = result.design.peaks
    speeds = [peak.speed for peak in peaks]
    columns = {
        "speed": _speeds(result, speeds, "speed ({})"),
        "link": Column([peak.link for peak in peaks], heading="link"),
        "ratio": Column([peak.ratio for peak in peaks], heading="stress/allowable", text=digits(".3f")),
        "limit": Column(["limiting" if peak.ratio > 1 else "" for peak in peaks], heading=" "),
    }
    title = f"Critical speeds at L4 = {result.design.map.own_L4:.4f} m"
    made = table_of(title, {**columns, **_rates(result, speeds)}, left=1)
    return Group(made, Text("links: % of stress that one % more ζ brings; damping helps where negative"))


def _quiet(result: Outcome) -> RenderableType:
    bands, stresses = result.design.quiet, result.design.map
    quietest = [band.quietest for band in bands]
    rates = {each.speed: each.sensitivity for each in result.damping}
    worst = [rates[at][stresses.worst_link(at)] if at in rates else 0.0 for at in quietest]
    effects = [
        "hurts" if rate > 0 else "helps" if at in rates else ""
        for at, rate in zip(quietest, worst, strict=True)
    ]
    columns = {
        "from": _speeds(result, [band.start for band in bands], "from"),
        "to": _speeds(result, [band.end for band in bands], "to"),
        "quietest": _speeds(result, quietest, "quietest"),
        "ratio": Column([band.ratio for band in bands], heading="stress/allowable", text=digits(".3f")),
        "damping": Column(effects, heading="damping"),
    }
    title = f"Quiet bands there ({stresses.model.speed_unit.name})"
    return table_of(title, {**columns, **_rates(result, quietest)}, left=1)


def _quiet_above(result: Outcome) -> RenderableType:
    above = result.design.quiet_above
    columns = {
        "above": _speeds(result, [each.peak for each in above], "above", ".3f"),
        "speed": _speeds(result, [each.speed for each in above], "speed", ".3f"),
        "needed": Column([each.needed for each in above], heading="allowable needed", text=digits(".3f")),
        "fixed": Column([each.fixed for each in above], heading="with L4 fixed", text=digits(".3f")),
    }
    made = table_of(f"Quiet speeds above critical ones ({result.design.map.model.speed_unit.name})", columns)
    return Group(made, Text("as a multiple of the allowable stress; L4 changes on the way and returns"))


def _plan(result: Outcome) -> RenderableType:
    plan = result.plan
    assert plan is not None
    columns = {
        "speed": _speeds(result, plan.speed, "speed ({})", ".3f"),
        "L4": Column(plan.L4, heading="L4 (m)", text=digits(".4f")),
    }
    made = table_of("Run-up plan", columns)
    if result.returns:
        made.add_row("then", f"{result.design.map.own_L4:.4f}")
    steady = f"steady stress at most {result.steady.max():.3f} of the allowable"
    return Group(made, Text(f"L4 is linear between these; {steady}"))


def trial_columns(result: Outcome) -> Columns:
    """A row a simulated run-up."""
    trials, unit = result.trials, result.design.map.model.speed_unit.per_second
    accelerations, worst = [trial.run_up.acceleration for trial in trials], [trial.worst for trial in trials]
    return {
        "duration": Column([trial.run_up.duration for trial in trials], "s", "", "within", "{:.4g} s".format),
        "acceleration": Column(
            accelerations, "rad/s^2", "", "acceleration", lambda each: unit.text(each, ".3g")
        ),
        "greatest_ratio": Column(worst, "1", "", "stress/allowable", digits(".4f")),
        "at_speed": _speeds(result, [trial.worst_speed for trial in trials], "at speed ({})"),
        "at_time": Column([trial.worst_time for trial in trials], "s"),
        "turns": Column([trial.run_up.turns for trial in trials]),
        "verdict": Column(["below" if ratio < 1 else "too high" for ratio in worst], heading=" "),
    }
