"""`solve sweep`: response and stability over many speeds."""

import itertools
import math
import re
from typing import TYPE_CHECKING, Annotated, Any

import typer

from solve.commands.groups import Accuracy, Problem, Results, Settings
from solve.commands.parse import harmonic_count, whole
from solve.commands.speeds import Speeds, progressing
from solve.errors import MissingValueError, ValueOutOfBoundsError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.figure import Figure
    from rich.console import RenderableType

    from solve.loading import Model
    from solve.results.contents import Contents
    from solve.studies.sweep import Point, Sweep

_WIDTH = 48
"""Characters of a line of 80 that columns of quantities may take, beside speed, radius and stability."""

_MOST_ROWS = 60
"""Rows of the table; of more speeds every k-th is shown."""

_NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(\.\d+)?(e[-+]?\d+)?")
"""A number in a warning, not the digits of a name such as q1."""


def sweep(
    problem: Problem,
    speeds: Speeds,
    accuracy: Accuracy,
    settings: Settings,
    results: Results,
    show: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME", help="Coordinate or output to show; repeatable; coordinates by default."
        ),
    ] = None,
    waterfall: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Draw this coordinate's or output's spectrum over speed instead."),
    ] = None,
    harmonics: Annotated[
        int | None, typer.Option(metavar="N", parser=whole, help="Orders of the spectrum.", show_default="60")
    ] = None,
    turn: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Draw its curve over one turn instead, a line a speed: up to 12."),
    ] = None,
) -> None:
    """Periodic vibration and stability over many speeds."""
    results.files()
    orders = harmonic_count(harmonics)
    omegas = speeds.omegas()
    model, _ = problem.loaded()

    import solve
    from solve.commands.deliver import deliver
    from solve.results.rows import shown

    names = shown(model, show)
    if turn is not None:
        _check_turn(model, turn, len(omegas), results, waterfall)
    with progressing("sweep", len(omegas)) as progress:
        found = solve.sweep(
            model,
            omegas,
            accuracy.chosen(settings),
            accuracy.steps,
            accuracy.rtol,
            progress=progress,
            spectra=[waterfall] if waterfall else [],
            harmonics=orders,
        )
    deliver(
        results,
        [*found.notes, *sweep_warnings(found)],
        record=lambda: _record(found),
        report=lambda: _report(found, names, problem.choices),
        figure=lambda: (
            _turns(found, turn, accuracy, settings)
            if turn
            else found.waterfall(waterfall)
            if waterfall
            else found.plot(show)
        ),
        contents=lambda: _contents(found),
    )


def _check_turn(model: "Model", name: str, count: int, results: Results, waterfall: str | None) -> None:
    """Raise before anything is calculated: for a picture that nobody asked for, or two in one file, or one
    that cannot be drawn."""
    from solve.results.turn_plot import checked_turn

    if results.plot is None:
        raise MissingValueError(f"--turn {name} draws a picture; add the file, such as --plot turn.png")
    if waterfall is not None:
        raise ValueOutOfBoundsError("--turn and --waterfall draw one picture each; give one of them")
    checked_turn(model, name, count)


def _turns(found: "Sweep", name: str, accuracy: Accuracy, settings: Settings) -> "Figure":
    """The curves of the speeds that have a result. Raises ValueOutOfBoundsError where none has."""
    from solve.results.turn_plot import turn_figure
    from solve.single import periodic

    speeds = [point.speed for point in found.points if point.error is None]
    if not speeds:
        raise ValueOutOfBoundsError(f"--turn {name}: no speed has a result to draw; {found.points[0].error}")
    method = accuracy.chosen(settings)
    orbits = [periodic(found.system, speed, method, accuracy.steps, accuracy.rtol) for speed in speeds]
    return turn_figure(orbits, name)


def sweep_warnings(found: "Sweep") -> list[str]:
    """One line a kind of warning or failure, with the speeds where it first and last stands. Texts of one
    kind differ in their numbers alone; the whole text of the first is shown."""
    groups: dict[str, tuple[str, list[float]]] = {}
    for point in found.points:
        for text in (*point.warnings, *([f"no result: {point.error}"] if point.error else [])):
            groups.setdefault(_NUMBER.sub("#", text), (text, []))[1].append(point.speed)
    return [f"{text} ({_span(at, len(found.points))})" for text, at in groups.values()]


def _span(speeds: list[float], total: int) -> str:
    first, low, high = (f"{speed * 30 / math.pi:.6g} rpm" for speed in (speeds[0], min(speeds), max(speeds)))
    if len(speeds) == 1:
        return f"at {first}"
    return f"at {first}; of this kind at {len(speeds)} of {total} speeds, from {low} to {high}"


def _record(found: "Sweep") -> dict[str, Any]:
    from solve.results.record import model_record, plain

    points = [_point(found, point) for point in found.points]
    return plain({**model_record(found.system), "speeds": found.speeds, "points": points})


def _point(found: "Sweep", point: "Point") -> dict[str, Any]:
    if point.error is not None:
        return {"speed": point.speed, "error": point.error}

    def quantities(names: "Sequence[str]") -> dict[str, Any]:
        units = found.system.units
        return {
            name: {"unit": units.get(name, ""), **vars(point.statistics[name])}
            for name in names
            if name in point.statistics
        }

    return {
        "speed": point.speed,
        "coordinates": quantities(found.system.coordinates),
        "outputs": quantities(found.system.outputs),
        "spectral_radius": point.spectral_radius,
        "verdict": point.verdict,
        "stable": point.stable,
        "method": point.method,
        "steps": point.steps,
        "error_estimate": point.error_estimate._asdict(),
        "warnings": point.warnings,
    }


def _report(found: "Sweep", names: "Sequence[str]", choices: "Sequence[str]") -> "RenderableType":
    import numpy as np
    from rich.console import Group

    from solve.results.quantities import fixed, prefixed
    from solve.results.report import model_heading, table

    sizes = {name: float(np.nanmax(found.figures(name), initial=0.0)) for name in names}
    scales = {name: prefixed(found.system.units.get(name, ""), size) for name, size in sizes.items()}
    columns = [f"max|{name}| ({unit})" if unit else f"max|{name}|" for name, (_, unit) in scales.items()]
    fitting = max(
        1, sum(width <= _WIDTH for width in itertools.accumulate(len(each) + 2 for each in columns))
    )
    scales = dict(itertools.islice(scales.items(), fitting))
    every = math.ceil(len(found.points) / _MOST_ROWS)
    title = "Over speed" if every == 1 else f"Over speed: one in {every} of {len(found.points)}"
    made = table(title, "rpm", *columns[:fitting], "|ρ|", "stability", left=0)
    if fitting < len(names):
        made.caption = "others by --show NAME, all by --json"
    for point in found.points[::every]:
        row = [
            fixed(point.statistics[name].max_abs * factor, sizes[name] * factor, 6)
            if name in point.statistics
            else "–"
            for name, (factor, _) in scales.items()
        ]
        verdict = "failed" if point.error else point.verdict.removesuffix("ally stable")
        radius = "–" if point.error else f"{point.spectral_radius:.6g}"
        made.add_row(f"{point.speed * 30 / math.pi:.7g}", *row, radius, verdict)
    return Group(model_heading(found.system, choices), made)


def _contents(found: "Sweep") -> "Contents":
    from solve.results.contents import table_contents
    from solve.results.record import model_record

    system = found.system
    columns: dict[str, tuple[Any, str, str]] = {"speed": (found.speeds, "rad/s", "speed of rotation")}
    for name in (*system.coordinates, *system.outputs):
        for figure in ("max", "min", "max_abs", "mean", "rms"):
            meaning = f"{figure} of {system.meanings.get(name, name)}"
            columns[f"{name}_{figure}"] = (found.figures(name, figure), system.units.get(name, ""), meaning)
    points = found.points
    columns["spectral_radius"] = (found.spectral_radius, "1", "largest modulus of a Floquet multiplier")
    columns["verdict"] = ([point.verdict for point in points], "", "stability")
    columns["steps"] = ([point.steps for point in points], "", "a period")
    columns["error"] = ([point.error or "" for point in points], "", "why there is no result")
    return table_contents(columns, model_record(system))
