"""A periodic solution and its stability as plain data and as tables."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from solve.results.orbit import Orbit, Turn
from solve.results.points import FIGURES
from solve.results.quantities import fixed, prefixed
from solve.results.record import plain
from solve.results.report import RenderableType, Table, described, heading, table
from solve.results.stability import Stability

_LONGEST_NAME = 26
_RANKS = ("strongest", "second", "third")
_MOST_MULTIPLIERS = 8
_VERDICT_STYLE = {
    "asymptotically stable": "bold green",
    "stable": "bold yellow",
    "unstable": "bold red",
    "undetermined": "bold magenta",
}


def stability_record(result: Stability) -> dict[str, Any]:
    """Of `solve floquet`."""
    further = {"residual": None, "warnings": result.warnings}
    return plain({**result.problem, **_verdict_record(result), **further})


def orbit_record(orbit: Orbit, harmonics: int = 60, quasi_static: bool = False) -> dict[str, Any]:
    """Of `solve periodic`, with `harmonics` amplitudes above the mean for every quantity."""
    record = {
        **orbit.problem,
        **_turn_record(orbit, harmonics),
        **_verdict_record(orbit),
        "residual": orbit.residual,
        "warnings": orbit.warnings,
    }
    if quasi_static:
        record["quasi_static"] = _turn_record(orbit.quasi_static, harmonics)
    return plain(record)


def _verdict_record(result: Stability) -> dict[str, Any]:
    return {
        "multipliers": result.multipliers,
        "unresolved": result.unresolved,
        "exponents": result.exponents,
        "spectral_radius": result.spectral_radius,
        "verdict": result.verdict,
        "stable": result.stable,
        "error_estimate": result.error_estimate._asdict(),
        "distance_from_one": result.distance_from_one,
        "liouville": result.liouville,
        "condition": result.condition,
        "notes": result.notes,
    }


def _turn_record(turn: Turn, harmonics: int) -> dict[str, Any]:
    system = turn.system
    return {
        "coordinates": {name: _quantity_record(turn, name, harmonics) for name in system.coordinates},
        "outputs": {name: _quantity_record(turn, name, harmonics) for name in system.outputs},
    }


def _quantity_record(turn: Turn, name: str, count: int) -> dict[str, Any]:
    amplitudes, phases = turn.harmonics(name, count)
    system, found = turn.system, turn.statistics(name)
    return {
        "unit": system.units.get(name, ""),
        "meaning": system.meanings.get(name, ""),
        **{figure: getattr(found, figure) for figure in FIGURES},
        "harmonics": amplitudes,
        "phases": phases,
    }


def orbit_report(orbit: Orbit, choices: Sequence[str] = (), quasi_static: bool = False) -> RenderableType:
    """Everything that `solve periodic` has to say but its warnings."""
    from rich.console import Group

    parts = [_heading(orbit, choices), _extrema("Motion over one period", orbit), _orders(orbit)]
    if quasi_static:
        parts.append(_extrema("Quasi-static, without inertia and damping", orbit.quasi_static))
    return Group(*parts, _multipliers(orbit), _verdict(orbit))


def stability_report(result: Stability, choices: Sequence[str] = ()) -> RenderableType:
    """Everything that `solve floquet` has to say but its warnings."""
    from rich.console import Group

    return Group(_heading(result, choices), _multipliers(result), _verdict(result))


def _heading(result: Stability, choices: Sequence[str]) -> Table:
    grid = heading(result.system, result.speed, choices)
    grid.add_row("method", f"{described(result.certified.method)}, {result.steps} steps a period")
    orbit, multipliers = result.error_estimate
    errors = f"multipliers {multipliers:.1e}"
    if isinstance(result, Orbit):
        errors = f"orbit {orbit:.1e}, {errors}, residual {result.residual:.1e}"
    grid.add_row("errors", f"{errors} (relative)")
    checks = [f"Liouville {result.liouville:.1e}", f"nearest ρ to +1 at {result.distance_from_one:.2g}"]
    if isinstance(result, Orbit):
        checks.append(f"condition {result.condition:.1e}")
    grid.add_row("checks", ", ".join(checks))
    for note in result.notes:
        grid.add_row("note", note)
    return grid


def _names(turn: Turn) -> tuple[str, ...]:
    return (*turn.system.coordinates, *turn.system.outputs)


def _extrema(title: str, turn: Turn) -> Table:
    made = table(title, "quantity", "unit", "max", "at", "min", "at", "mean", left=2)
    for name in _names(turn):
        found = turn.statistics(name)
        factor, unit = prefixed(turn.system.units.get(name, ""), found.max_abs)
        high, low, mean = (
            fixed(value * factor, found.max_abs * factor) for value in (found.max, found.min, found.mean)
        )
        high_at, low_at = (_degrees(phase, turn) for phase in (found.max_phase, found.min_phase))
        made.add_row(_broken(name), unit, high, high_at, low, low_at, mean)
    return made


def _broken(name: str) -> str:
    """A long name on two lines, parted at an underscore: 80 columns leave it no more than these."""
    place = name.rfind("_", 0, _LONGEST_NAME) + 1
    return name if len(name) <= _LONGEST_NAME or not place else f"{name[:place]}\n{name[place:]}"


def _degrees(phase: float, turn: Turn) -> str:
    """A phase of the drive, the end of the turn as its beginning."""
    rounded = round(math.degrees(phase), 1)
    return f"{rounded if rounded < round(math.degrees(turn.system.period), 1) else 0.0:.1f}°"


def _orders(turn: Turn) -> Table:
    title = "Strongest orders: amplitude in that unit, phase angle"
    made = table(title, "quantity", *_RANKS)
    rotation = 2 * math.pi / turn.system.period
    for name in _names(turn):
        amplitudes, angles = turn.harmonics(name, turn.samples // 8)
        factor, _ = prefixed(turn.system.units.get(name, ""), turn.statistics(name).max_abs)
        strongest = 1 + np.argsort(-amplitudes[1:], kind="stable")[: len(_RANKS)]
        sizes = amplitudes[strongest] * factor
        cells = (
            f"{k * rotation:g}: {fixed(size, size, 4)} ∠{round(math.degrees(angles[k])):4d}°" if size else "–"
            for k, size in zip(strongest, sizes, strict=True)
        )
        made.add_row(_broken(name), *cells)
    return made


def _multipliers(result: Stability) -> Table:
    made = table("Floquet multipliers ρ", "Re ρ", "Im ρ", "|ρ|", "growth (1/s)", "frequency (Hz)", left=0)
    pairs = [
        (rho, exponent)
        for rho, exponent in zip(result.multipliers, result.exponents, strict=True)
        if rho.imag >= 0
    ]
    for rho, exponent in pairs[:_MOST_MULTIPLIERS]:
        made.add_row(
            f"{rho.real:.7g}",
            f"± {rho.imag:.7g}" if rho.imag else "0",
            f"{abs(rho):.7g}",
            f"{exponent.real:.5g}",
            f"{exponent.imag / (2 * math.pi):.5g}",
        )
    smaller = len(pairs) - _MOST_MULTIPLIERS
    rest = [f"{smaller} smaller"] * (smaller > 0)
    rest += [f"{result.unresolved} lost in rounding: practically 0"] * (result.unresolved > 0)
    if rest:
        made.caption = "and " + ", ".join(rest)
    return made


def _verdict(result: Stability) -> RenderableType:
    from rich.text import Text

    radius = result.spectral_radius
    return (
        Text("\n")
        .append(result.verdict, _VERDICT_STYLE[result.verdict])
        .append(f": spectral radius {radius:.10g} ± {result.error_estimate.multipliers * radius:.0e}")
    )
