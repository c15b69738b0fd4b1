"""`solve critical`: critical speeds three ways."""

import math
from typing import TYPE_CHECKING, Annotated, Any

import typer

from solve.commands.groups import Problem, Results, Settings
from solve.commands.parse import figure_kept, number, whole
from solve.commands.speeds import Speeds, progressing

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import RenderableType

    from solve.results.contents import Contents
    from solve.studies.critical_speeds import Critical, CriticalSpeeds

_RPM = 30 / math.pi
_MOST_COMBINATIONS = 20


def critical(
    problem: Problem,
    speeds: Speeds,
    settings: Settings,
    results: Results,
    of: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Coordinate or output; the first coordinate by default."),
    ] = None,
    figure: Annotated[
        str, typer.Option(metavar="max|rms", help="Of its modulus over a turn, what is to be largest.")
    ] = "max",
    orders: Annotated[
        int, typer.Option(metavar="K", parser=whole, help="Highest order of integer divisions.")
    ] = 20,
    campbell: Annotated[bool, typer.Option("--campbell", help="Draw the Campbell diagram alone.")] = False,
    method: Annotated[str, typer.Option(metavar="NAME", help="Method; auto chooses.")] = "auto",
    rtol: Annotated[
        float, typer.Option(metavar="R", parser=number, help="Relative error of each solution.")
    ] = 1e-8,
) -> None:
    """Critical speeds: largest response, dominant multiplier, integer divisions of frequencies."""
    results.files()
    omegas = speeds.omegas()
    kept = figure_kept(figure)
    model, _ = problem.loaded()

    import solve
    from solve.commands.deliver import deliver
    from solve.methods.choice import chosen

    rule = chosen(method, **vars(settings))
    with progressing("points") as progress:
        found = solve.critical_speeds(model, omegas, of, kept, orders, rule, rtol, progress=progress)
    deliver(
        results,
        [*found.notes, *model.doubts(float(found.speeds[-1]))],
        record=lambda: _record(found),
        report=lambda: _report(found, problem.choices),
        figure=lambda: found.plot(campbell),
        contents=lambda: _contents(found),
    )


def _record(found: "CriticalSpeeds") -> dict[str, Any]:
    from solve.results.record import model_record, plain

    return plain(
        {
            **model_record(found.system),
            "range": [found.speeds[0], found.speeds[-1]],
            "quantity": found.quantity,
            "figure": found.figure,
            "rows": [_row(row) for row in found.rows],
            "combinations": [vars(one) for one in found.combinations],
            "notes": found.notes,
            "warnings": found.system.doubts(float(found.speeds[-1])),
        }
    )


def _row(row: "Critical") -> dict[str, Any]:
    """One critical speed; speeds in rad/s."""
    return {
        "speed": row.speed,
        "response": row.response and row.response.speed,
        "response_height": row.response and row.response.height,
        "multiplier": row.multiplier and row.multiplier.speed,
        "multiplier_real_part": row.multiplier and row.multiplier.height,
        "division": row.division,
        "division_at_rest": row.at_rest,
        "mode": row.mode,
        "order": row.order,
        "ratios": row.ratios,
    }


def _report(found: "CriticalSpeeds", choices: "Sequence[str]") -> "RenderableType":
    from rich.console import Group

    from solve.results.quantities import fixed, prefixed
    from solve.results.report import model_heading, table

    head = model_heading(found.system, choices)
    low, high = (f"{speed * _RPM:.6g}" for speed in (found.speeds[0], found.speeds[-1]))
    heights = [row.response.height for row in found.rows if row.response]
    largest = max(map(abs, heights), default=0.0)
    factor, unit = prefixed(found.system.units.get(found.quantity, ""), largest)
    name = f"max|{found.quantity}|" if found.figure == "max_abs" else f"{found.figure} {found.quantity}"
    head.add_row("between", f"{low} and {high} rpm")
    made = table(
        f"Critical speeds in rpm; height: {name}",
        *(
            "response",
            f"height ({unit})" if unit else "height",
            "multiplier",
            "Re ρ",
            "ω̄/k",
            "at rest",
            "mode",
            "k",
        ),
        left=0,
    )
    for row in found.rows:
        made.add_row(
            _rpm(row.response and row.response.speed),
            fixed(row.response.height * factor, largest * factor, 5) if row.response else "–",
            _rpm(row.multiplier and row.multiplier.speed),
            f"{row.multiplier.height:.2e}" if row.multiplier else "–",
            _rpm(row.division),
            _rpm(row.at_rest),
            str(row.mode or "–"),
            str(row.order or "–"),
        )
    made.caption = "ω̄: mean of a natural frequency over the cycle, at the speed and at rest"
    if not found.combinations:
        return Group(head, made)
    sums = table("Combinations (ω̄i ± ω̄j)/k, rpm", "speed", "i", "j", "k", left=0)
    for one in found.combinations[:_MOST_COMBINATIONS]:
        sums.add_row(_rpm(one.speed), str(one.modes[0]), f"{one.sign * one.modes[1]:+d}", str(one.order))
    if len(found.combinations) > _MOST_COMBINATIONS:
        sums.caption = f"and {len(found.combinations) - _MOST_COMBINATIONS} at lower speeds"
    return Group(head, made, sums)


def _rpm(speed: float | None) -> str:
    return "–" if speed is None else f"{speed * _RPM:.3f}"


def _contents(found: "CriticalSpeeds") -> "Contents":
    from solve.results.contents import table_contents
    from solve.results.record import model_record

    rows = [_row(row) for row in found.rows]
    kinds = {
        "response": ("rad/s", "maximum of the response"),
        "response_height": (
            found.system.units.get(found.quantity, ""),
            f"{found.figure} of {found.quantity}",
        ),
        "multiplier": ("rad/s", "maximum of the dominant multiplier's real part"),
        "multiplier_real_part": ("1", "its height"),
        "division": ("rad/s", "integer division of the mean natural frequency at this speed"),
        "division_at_rest": ("rad/s", "the same of the frequency at rest"),
        "mode": ("", "of the division"),
        "order": ("", "of the division"),
    }
    columns = {
        name: ([math.nan if row[name] is None else row[name] for row in rows], *kind)
        for name, kind in kinds.items()
    }
    return table_contents(columns, model_record(found.system))
