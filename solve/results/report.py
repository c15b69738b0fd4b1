"""Results as tables for a terminal of 80 columns."""

import math
from collections.abc import Sequence

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.table import Table
from rich.text import Text

from solve.loading import Model
from solve.methods.method import Method
from solve.results.orbit import Orbit, Turn
from solve.results.quantities import fixed, prefixed
from solve.results.stability import Stability
from solve.system import PeriodicSystem

_LONGEST_NAME = 26
_RANKS = ("strongest", "second", "third")
_MOST_MULTIPLIERS = 8
_VERDICT_STYLE = {"asymptotically stable": "bold green", "stable": "bold yellow", "unstable": "bold red"}


def orbit_report(orbit: Orbit, choices: Sequence[str] = (), quasi_static: bool = False) -> RenderableType:
    """Everything that `solve periodic` has to say but its warnings."""
    parts = [_heading(orbit, choices), _extrema("Motion over one period", orbit), _orders(orbit)]
    if quasi_static:
        parts.append(_extrema("Quasi-static, without inertia and damping", orbit.quasi_static))
    return Group(*parts, _multipliers(orbit), _verdict(orbit))


def stability_report(result: Stability, choices: Sequence[str] = ()) -> RenderableType:
    """Everything that `solve floquet` has to say but its warnings."""
    return Group(_heading(result, choices), _multipliers(result), _verdict(result))


def described(method: Method) -> str:
    """A method's name and settings.

    >>> from solve.methods.newmark import Newmark
    >>> described(Newmark())
    'newmark (gamma 0.5, beta 0.25)'
    """
    settings = {name: getattr(method, name) for name in getattr(method, "__dataclass_fields__", {})}
    numbers = [f"{name} {value}" for name, value in settings.items() if isinstance(value, int | float)]
    return f"{method.name} ({', '.join(numbers)})" if numbers else method.name


class NumberTable(Table):
    """A table in which no number is cut: where the width is short, names go on in the next line."""

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        for column in self.columns:
            if column.justify == "right":
                column.min_width = max((console.measure(cell).maximum for cell in column.cells), default=0)
        yield from super().__rich_console__(console, options)


def table(title: str, *columns: str, left: int = 1) -> Table:
    """A table of this program: the first `left` columns are text, the others numbers."""
    made = NumberTable(
        title="\n" + title,
        title_justify="left",
        title_style="bold",
        box=SIMPLE_HEAD,
        show_edge=False,
        padding=(0, 1, 0, 1),
        collapse_padding=True,
        pad_edge=False,
        caption_justify="left",
    )
    for index, column in enumerate(columns):
        made.add_column(
            column, justify="left" if index < left else "right", no_wrap=index > 0, overflow="fold"
        )
    return made


def model_heading(system: PeriodicSystem, choices: Sequence[str]) -> Table:
    """Which model; further rows can be added."""
    grid = Table.grid(padding=(0, 2))
    grid.add_column(style="dim", no_wrap=True)
    grid.add_column()
    if isinstance(system, Model):
        case = f", case {system.case}" if system.case else ""
        grid.add_row("model", Text(system.name + case, style="bold"))
        grid.add_row("", Text(system.module.TITLE))
        options = [f"{name}={value}" for name, value in system.options.items()]
        chosen = dict.fromkeys([*options, *choices])
        if chosen:
            grid.add_row("with", Text(", ".join(chosen)))
    else:
        grid.add_row("model", Text(system.name, style="bold"))
    return grid


def heading(system: PeriodicSystem, speed: float, choices: Sequence[str]) -> Table:
    """Which model, at which speed; further rows can be added."""
    grid = model_heading(system, choices)
    period = system.period / speed
    factor, unit = prefixed("s", period)
    grid.add_row(
        "speed",
        f"{speed * 30 / math.pi:.6g} rpm = {speed:.7g} rad/s = {speed / (2 * math.pi):.6g} Hz; "
        f"period {period * factor:.6g} {unit}",
    )
    return grid


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


def _verdict(result: Stability) -> Text:
    radius = result.spectral_radius
    return (
        Text("\n")
        .append(result.verdict, _VERDICT_STYLE[result.verdict])
        .append(f": spectral radius {radius:.10g} ± {result.error_estimate.multipliers * radius:.0e}")
    )
