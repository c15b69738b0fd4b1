"""What the linkage does, as tables for a terminal of 80 columns."""

import math
from collections.abc import Mapping
from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from models.four_bar.rigid.record import JOINTS
from solve.results.formatting import fixed, prefixed
from solve.units import unit_given
from solve.views.tables import in_every_unit, table

_RATIOS = {
    "omega2": "ω2/ω1, coupler",
    "omega3": "ω3/ω1, follower",
    "alpha2": "α2/ω1², coupler",
    "alpha3": "α3/ω1², follower",
}


def linkage_report(record: Mapping[str, Any]) -> RenderableType:
    """Everything that the record has to say but its warnings; angles in degrees."""
    parts: list[RenderableType] = [_heading(record)]
    if "transmission_angle" in record:
        parts += [_turn(record), *_remarks(record)]
    if "joint_forces" in record:
        parts += [_peaks(record), _stresses(record)]
    if "position" in record:
        parts += _position(record["position"])
    return Group(*parts)


def _heading(record: Mapping[str, Any]) -> Table:
    grid = Table.grid(padding=(0, 2))
    grid.add_column(style="dim", no_wrap=True)
    grid.add_column()
    kind, space = record["class"], record["solution_space"]
    grid.add_row("linkage", Text(f"four_bar, case {record['case']}, {record['branch']} branch", style="bold"))
    lengths = ", ".join(f"{name} {record['parameters'][name]:g}" for name in ("L1", "L2", "L3", "L4"))
    grid.add_row("lengths", f"{lengths} m")
    grid.add_row("class", f"{kind['symbol']} ({kind['number']} of 14): {kind['name']}, {kind['mark']}")
    relation = {"Grashof": "s + l < p + q", "change point": "s + l = p + q"}.get(
        kind["category"], "s + l > p + q"
    )
    grid.add_row("Grashof", f"{relation}; mobility {record['mobility']}")
    grid.add_row(
        "λ2, λ3, λ4",
        f"{space['lambda2']:.5g}, {space['lambda3']:.5g}, {space['lambda4']:.5g}; "
        f"base plane λ = {space['base_plane']:.5g}",
    )
    least, greatest = record["crank_range"]
    within = f"{_degrees(least)} <= |t1| <= {_degrees(greatest)}"
    grid.add_row("crank", "turns fully" if record["turns_fully"] else f"cannot turn fully: {within}")
    if record["speed"] is None:
        grid.add_row("speed", 'none given, so no forces; with --speed "300 rpm" they follow')
    else:
        grid.add_row("speed", in_every_unit(record["speed"], unit_given(record["speed"])))
    return grid


def _turn(record: Mapping[str, Any]) -> Table:
    made = table("Over one turn", "quantity", "unit", "max", "at t1", "min", "at t1", "mean", left=2)
    gamma = record["transmission_angle"]
    made.add_row(
        "transmission angle γ",
        "°",
        f"{math.degrees(gamma['max']):.4f}",
        _degrees(gamma["max_position"]),
        f"{math.degrees(gamma['min']):.4f}",
        _degrees(gamma["min_position"]),
        "",
    )
    rows = [(label, "", record["ratios"][name]) for name, label in _RATIOS.items()]
    if "drive_torque" in record:
        rows.append(("drive torque", "N m", record["drive_torque"]))
    for label, unit, figures in rows:
        size = max(abs(figures["max"]), abs(figures["min"]))
        factor, unit = prefixed(unit, size)
        high, low, mean = (fixed(figures[key] * factor, size * factor, 5) for key in ("max", "min", "mean"))
        high_at, low_at = _degrees(figures["max_position"]), _degrees(figures["min_position"])
        made.add_row(label, unit, high, high_at, low, low_at, mean)
    return made


def _remarks(record: Mapping[str, Any]) -> list[Text]:
    advantage, follower = record["mechanical_advantage"], record["follower"]
    lines = [
        f"mechanical advantage |T3/T1| at least {advantage['least']:.5g}, at t1 = "
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
    for curve in record["coupler_curves"]:
        left, right, low, high = min(curve["x"]), max(curve["x"]), min(curve["y"]), max(curve["y"])
        lines.append(
            f"coupler point {_point(curve['point'])} m: x {left:.4f} … {right:.4f} m, "
            f"y {low:.4f} … {high:.4f} m"
        )
    return [Text("\n" + lines[0]), *map(Text, lines[1:])]


def _peaks(record: Mapping[str, Any]) -> RenderableType:
    made = table("Joint forces", "joint", "force", "unit", "peak", "at t1", left=3)
    for joint, peak in record["joint_forces"].items():
        factor, unit = prefixed("N", peak["peak"])
        made.add_row(
            joint, f"|{JOINTS[joint]}|", unit, f"{peak['peak'] * factor:.5g}", _degrees(peak["position"])
        )
    factor, unit = prefixed("J", record["energy_swing"])
    balance = (
        f"\nenergy balance: torque × ω1 = dT/dt within {record['energy_residual']:.1e} of its peak"
        f"\na flywheel takes and gives back {record['energy_swing'] * factor:.5g} {unit} in a turn"
    )
    return Group(made, Text(balance))


def _stresses(record: Mapping[str, Any]) -> Table:
    made = table("Stresses of rigid links", "link", "unit", "peak", "at t1", "at x/L", left=2)
    for link, peak in record["preliminary_stress"].items():
        factor, unit = prefixed("Pa", peak["peak"])
        made.add_row(
            link, unit, f"{peak['peak'] * factor:.5g}", _degrees(peak["position"]), f"{peak['fraction']:.2f}"
        )
    return made


def _position(record: Mapping[str, Any]) -> list[RenderableType]:
    links = table(f"At t1 = {_degrees(record['t'][0])}", "link", "angle t", "ω/ω1", "α/ω1²")
    ratios = record["ratios"]
    links.add_row("crank", _degrees(record["t"][0]), "1", "0")
    for name, k in (("coupler", 2), ("follower", 3)):
        omega, alpha = f"{ratios[f'omega{k}']:.6g}", f"{ratios[f'alpha{k}']:.6g}"
        links.add_row(name, _degrees(record["t"][k - 1]), omega, alpha)
    forces = record.get("joint_forces", {})
    columns = ("Fx (N)", "Fy (N)", "|F| (N)") if forces else ()
    points = table("Places and joint forces" if forces else "Places", "point", "x (m)", "y (m)", *columns)
    for name in JOINTS:
        force = [*forces[name], math.hypot(*forces[name])] if forces else []
        points.add_row(name, *(f"{x:.6f}" for x in record[name]), *(f"{value:.5g}" for value in force))
    for traced in record["coupler_points"]:
        points.add_row(f"coupler {_point(traced['point'])}", *(f"{x:.6f}" for x in traced["position"]))
    advantage = record["mechanical_advantage"]
    merits = f"\ntransmission angle {_degrees(record['transmission_angle'])}, mechanical advantage T3/T1 " + (
        f"{advantage:.5g}" if math.isfinite(advantage) else "infinite"
    )
    if "drive_torque" in record:
        merits += f"\ndrive torque {record['drive_torque']:.6g} N m"
    return [links, points, Text(merits)]


def _point(point: tuple[float, float]) -> str:
    return f"({point[0]:g}, {point[1]:g})"


def _degrees(angle: float) -> str:
    text = f"{math.degrees(angle):.2f}".rstrip("0").rstrip(".")
    return ("0" if text == "-0" else text) + "°"
