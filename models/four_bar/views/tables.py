"""Tables of the rigid linkage and of the design method, for a terminal of 80 columns."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from models.four_bar.forces import JOINTS
from models.four_bar.outcome import Outcome
from solve.results.contents import Column, Columns, digits, speeds_of
from solve.results.formatting import fixed, prefixed
from solve.units import unit_given
from solve.views.tables import heading, in_every_unit, table, table_of

_RATIOS = {
    "omega2": "ω2/ω1, coupler",
    "omega3": "ω3/ω1, follower",
    "alpha2": "α2/ω1², coupler",
    "alpha3": "α3/ω1², follower",
}
_GRASHOF = {"Grashof": "s + l < p + q", "change point": "s + l = p + q", "non-Grashof": "s + l > p + q"}


def linkage_report(record: Mapping[str, Any]) -> RenderableType:
    """Return the printout of the record of a rigid motion, without its warnings. Angles are in degrees."""
    parts: list[RenderableType] = [_linkage_heading(record)]
    if "transmission_angle" in record:
        parts += [_extremes(record), *map(Text, _remarks(record))]
    if "joint_forces" in record:
        parts += _forces(record)
    if "position" in record:
        parts += _position(record["position"])
    return Group(*parts)


def _linkage_heading(record: Mapping[str, Any]) -> Table:
    kind, space, speed = record["class"], record["solution_space"], record["speed"]
    lengths = ", ".join(f"{name} {record['parameters'][name]:g}" for name in ("L1", "L2", "L3", "L4"))
    least, greatest = map(_degrees, record["crank_range"])
    reach = f"{least} <= |t1| <= {greatest}"
    turns = "turns fully" if record["turns_fully"] else f"cannot turn fully; reachable: {reach}"
    lambdas = ", ".join(f"{space[name]:.5g}" for name in ("lambda2", "lambda3", "lambda4"))
    no_speed = 'none, so no forces; add --speed "300 rpm"'
    grid = Table.grid(padding=(0, 2))
    grid.add_column(style="dim", no_wrap=True)
    grid.add_column()
    grid.add_row("linkage", Text(f"four_bar, case {record['case']}, {record['branch']} branch", style="bold"))
    grid.add_row("lengths", f"{lengths} m")
    grid.add_row("class", f"{kind['symbol']} ({kind['number']} of 14): {kind['name']}, {kind['mark']}")
    grid.add_row("Grashof", f"{_GRASHOF[kind['category']]}; mobility {record['mobility']}")
    grid.add_row("λ2, λ3, λ4", f"{lambdas}; base plane λ = {space['base_plane']:.5g}")
    grid.add_row("crank", turns)
    grid.add_row("speed", no_speed if speed is None else in_every_unit(speed, unit_given(speed)))
    return grid


def _extremes(record: Mapping[str, Any]) -> Table:
    extremes = table(
        "Over one revolution", "quantity", "unit", "max", "at t1", "min", "at t1", "mean", left=2
    )

    def add(label: str, unit: str, figures: Mapping[str, float], high: str, low: str, mean: str) -> None:
        positions = _degrees(figures["max_position"]), _degrees(figures["min_position"])
        extremes.add_row(label, unit, high, positions[0], low, positions[1], mean)

    gamma = record["transmission_angle"]
    high, low = (f"{math.degrees(gamma[key]):.4f}" for key in ("max", "min"))
    add("transmission angle γ", "°", gamma, high, low, "")
    rows = [(label, "", record["ratios"][name]) for name, label in _RATIOS.items()]
    if "drive_torque" in record:
        rows.append(("drive torque", "N m", record["drive_torque"]))
    for label, unit, figures in rows:
        size = max(abs(figures["max"]), abs(figures["min"]))
        factor, unit = prefixed(unit, size)
        texts = (fixed(figures[key] * factor, size * factor, 5) for key in ("max", "min", "mean"))
        add(label, unit, figures, *texts)
    return extremes


def _remarks(record: Mapping[str, Any]) -> list[str]:
    advantage, follower = record["mechanical_advantage"], record["follower"]
    lines = [
        f"\nmechanical advantage |T3/T1| at least {advantage['least']:.5g}, at t1 = "
        f"{_degrees(advantage['least_position'])}"
    ]
    if follower["dead_points"]:
        stretched, folded = (_degrees(angle) for angle in follower["dead_points"])
        lines += [
            f"infinite at the follower's dead points, t1 = {stretched} (crank and coupler in line,",
            f"stretched) and {folded} (folded); between them it swings through {_degrees(follower['swing'])}",
        ]
    else:
        lines.append("the follower turns fully and has no dead points")
    for path in record["coupler_curves"]:
        x, y = (f"{axis} {min(path[axis]):.4f} … {max(path[axis]):.4f} m" for axis in "xy")
        lines.append(f"coupler point {_point(path['point'])} m: {x}, {y}")
    return lines


def _forces(record: Mapping[str, Any]) -> list[RenderableType]:
    """Return tables of the peaks of the joint forces, of the energy balance and of the preliminary
    stresses."""
    forces = table("Joint forces", "joint", "force", "unit", "peak", "at t1", left=3)
    for joint, peak in record["joint_forces"].items():
        factor, unit = prefixed("N", peak["peak"])
        value = f"{peak['peak'] * factor:.5g}"
        forces.add_row(joint, f"|{JOINTS[joint]}|", unit, value, _degrees(peak["position"]))
    factor, unit = prefixed("J", record["energy_swing"])
    swing = f"{record['energy_swing'] * factor:.5g} {unit}"
    balance = (
        f"\nenergy balance: torque × ω1 = dT/dt within {record['energy_residual']:.1e} of its peak"
        f"\nenergy stored and released by a flywheel per revolution: {swing}"
    )
    stresses = table("Stresses of rigid links", "link", "unit", "peak", "at t1", "at x/L", left=2)
    for link, peak in record["preliminary_stress"].items():
        factor, unit = prefixed("Pa", peak["peak"])
        value = f"{peak['peak'] * factor:.5g}"
        stresses.add_row(link, unit, value, _degrees(peak["position"]), f"{peak['fraction']:.2f}")
    return [forces, Text(balance), stresses]


def _position(record: Mapping[str, Any]) -> list[RenderableType]:
    ratios, angles = record["ratios"], [_degrees(angle) for angle in record["t"]]
    links = table(f"At t1 = {angles[0]}", "link", "angle t", "ω/ω1", "α/ω1²")
    links.add_row("crank", angles[0], "1", "0")
    for number, name in enumerate(("coupler", "follower"), start=2):
        omega, alpha = (f"{ratios[f'{field}{number}']:.6g}" for field in ("omega", "alpha"))
        links.add_row(name, angles[number - 1], omega, alpha)
    forces = record.get("joint_forces", {})
    columns = ("Fx (N)", "Fy (N)", "|F| (N)") if forces else ()
    points = table("Positions and joint forces" if forces else "Places", "point", "x (m)", "y (m)", *columns)
    for name in JOINTS:
        force = [*forces[name], math.hypot(*forces[name])] if forces else []
        points.add_row(name, *(f"{x:.6f}" for x in record[name]), *(f"{value:.5g}" for value in force))
    for traced in record["coupler_points"]:
        points.add_row(f"coupler {_point(traced['point'])}", *(f"{x:.6f}" for x in traced["position"]))
    advantage = record["mechanical_advantage"]
    summary = (
        f"\ntransmission angle {_degrees(record['transmission_angle'])}, mechanical advantage T3/T1 "
        + (f"{advantage:.5g}" if math.isfinite(advantage) else "infinite")
    )
    if "drive_torque" in record:
        summary += f"\ndrive torque {record['drive_torque']:.6g} N m"
    return [links, points, Text(summary)]


def _point(point: tuple[float, float]) -> str:
    return f"({point[0]:g}, {point[1]:g})"


def _degrees(angle: float) -> str:
    text = f"{math.degrees(angle):.2f}".rstrip("0").rstrip(".")
    return ("0" if text == "-0" else text) + "°"


def design_report(result: Outcome, choices: Sequence[str] = ()) -> RenderableType:
    """Return the printout of critical speeds, quiet bands, effects of damping, plan and simulations. Stresses
    are in MPa."""
    parts: list[RenderableType] = [_design_heading(result, choices), *_critical(result)]
    if result.design.quiet:
        parts.append(_quiet(result))
    if result.design.quiet_above:
        parts += _quiet_above(result)
    if result.plan is not None:
        parts += [*_plan(result), table_of("Simulated", result.trial_columns)]
    return Group(*parts, Text("\n" + result.text))


def _design_heading(result: Outcome, choices: Sequence[str]) -> Table:
    stresses = result.map
    allowable = ", ".join(
        f"{link} {stress / 1e6:.5g}" for link, stress in zip(stresses.links, stresses.allowable, strict=True)
    )
    speeds = stresses.model.labels.speed_unit.span(stresses.speeds[0], stresses.speeds[-1], "…", ".4g")
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
    return speeds_of(result.map.model, speeds, "", heading, form)


def _numbers(values: Sequence[float], heading: str) -> Column:
    return Column(values, heading=heading, text=digits(".3f"))


def _damping(result: Outcome, speeds: Sequence[float]) -> Columns:
    """Return columns, one per link, with the effect of damping on the stress at these speeds; empty if the
    effect was not computed."""
    effects = {effect.speed: effect.sensitivity for effect in result.damping}
    effects_at = [effects.get(speed) for speed in speeds]
    return {
        link: Column(
            speeds, heading=link, text=[f"{effect[link]:+.2f}" if effect else "" for effect in effects_at]
        )
        for link in result.map.links
    }


def _critical(result: Outcome) -> list[RenderableType]:
    peaks = result.design.peaks
    speeds = [peak.speed for peak in peaks]
    columns = {
        "speed": _speeds(result, speeds, "speed ({})"),
        "link": Column([peak.link for peak in peaks], heading="link"),
        "ratio": _numbers([peak.ratio for peak in peaks], "stress/allowable"),
        "limit": Column(["limiting" if peak.ratio > 1 else "" for peak in peaks], heading=" "),
        **_damping(result, speeds),
    }
    remark = "links: change of stress in % per 1 % of ζ; negative where damping lowers the stress"
    return [table_of(f"Critical speeds at L4 = {result.map.own_L4:.4f} m", columns, left=1), Text(remark)]


def _quiet(result: Outcome) -> RenderableType:
    bands, stresses = result.design.quiet, result.map
    quietest = [band.quietest for band in bands]
    effects = {effect.speed: effect.sensitivity for effect in result.damping}

    def effect(speed: float) -> str:
        if speed not in effects:
            return ""
        return "hurts" if effects[speed][stresses.worst_link(speed)] > 0 else "helps"

    columns = {
        "from": _speeds(result, [band.start for band in bands], "from"),
        "to": _speeds(result, [band.end for band in bands], "to"),
        "quietest": _speeds(result, quietest, "quietest"),
        "ratio": _numbers([band.ratio for band in bands], "stress/allowable"),
        "damping": Column([effect(speed) for speed in quietest], heading="damping"),
        **_damping(result, quietest),
    }
    return table_of(f"Quiet bands at this L4 ({stresses.model.labels.speed_unit.name})", columns, left=1)


def _quiet_above(result: Outcome) -> list[RenderableType]:
    quiet = result.design.quiet_above
    columns = {
        "above": _speeds(result, [quiet_speed.peak for quiet_speed in quiet], "above", ".3f"),
        "speed": _speeds(result, [quiet_speed.speed for quiet_speed in quiet], "speed", ".3f"),
        "needed": _numbers([quiet_speed.needed for quiet_speed in quiet], "allowable needed"),
        "fixed": _numbers([quiet_speed.fixed for quiet_speed in quiet], "with L4 fixed"),
    }
    title = f"Quiet speeds above critical ones ({result.map.model.labels.speed_unit.name})"
    remark = "in multiples of the allowable stress; L4 changes during the run-up and returns to its own value"
    return [table_of(title, columns), Text(remark)]


def _plan(result: Outcome) -> list[RenderableType]:
    assert result.plan is not None
    columns = {
        "speed": _speeds(result, result.plan.speed, "speed ({})", ".3f"),
        "L4": Column(result.plan.L4, heading="L4 (m)", text=digits(".4f")),
    }
    plan = table_of("Run-up plan", columns)
    if result.returns:
        plan.add_row("then", f"{result.map.own_L4:.4f}")
    steady = f"steady stress at most {result.steady.max():.3f} of the allowable"
    return [plan, Text(f"L4 is linear between these; {steady}")]
