"""`solve compare`: methods side by side on one problem."""

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Annotated, Any

import typer

from solve.commands.groups import Problem, Results, Settings, Speed
from solve.commands.parse import number, whole

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.console import RenderableType

    from solve.methods.method import Method
    from solve.results.contents import Contents
    from solve.studies.compare import Comparison, Row


def compare(
    problem: Problem,
    speed: Speed,
    settings: Settings,
    results: Results,
    method: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Method to compare; repeatable; all by default.")
    ] = None,
    steps: Annotated[
        list[int] | None,
        typer.Option(metavar="N", parser=whole, help="Equal number of steps a period; repeatable."),
    ] = None,
    rtol: Annotated[
        list[float] | None,
        typer.Option(
            metavar="R",
            parser=number,
            help="Error to reach, of the orbit (multipliers, where there is no load); repeatable; 1e-3 "
            "and 1e-6 by default.",
        ),
    ] = None,
) -> None:
    """Methods side by side: error, steps and time."""
    results.files()
    model, of_case = problem.loaded()

    from solve.commands.deliver import deliver
    from solve.studies.compare import TARGETS
    from solve.studies.compare import compare as compared

    omega, methods, targets = speed.omega(model, of_case), _methods(method, settings), rtol or TARGETS
    with _progress() as progress:
        comparison = compared(model, omega, methods, steps, targets, progress)

    deliver(
        results,
        comparison.warnings,
        record=lambda: _record(comparison, targets),
        report=lambda: _report(comparison, problem.choices),
        figure=lambda: _figure(comparison, targets),
        contents=lambda: _contents(comparison),
    )


def _methods(names: Sequence[str] | None, settings: Settings) -> list["Method"]:
    """The methods, each with those of the settings that it knows. Raises UnknownNameError, and
    ValueOutOfBoundsError for a setting that none of them knows."""
    from solve.methods.choice import METHODS, chosen

    contestants = list(dict.fromkeys(names or [name for name in METHODS if name != "auto"]))
    known = {name: METHODS[name].__dataclass_fields__ for name in contestants if name in METHODS}
    for setting, value in vars(settings).items():
        if value is not None and not any(setting in fields for fields in known.values()):
            chosen(contestants[0], **{setting: value})
    return [
        chosen(name, **{key: value for key, value in vars(settings).items() if key in known.get(name, ())})
        for name in contestants
    ]


@contextmanager
def _progress() -> Iterator[Callable[[str], None]]:
    """Tell a person at a terminal which method is under way."""
    from rich.console import Console

    with Console(stderr=True).status("comparing") as status:
        yield lambda name: status.update(f"comparing: {name}")


def _figure(comparison: "Comparison", targets: Sequence[float]) -> "Figure":
    import numpy as np

    from solve.results.plot import titled
    from solve.results.work_precision import Work, work_precision_figure
    from solve.studies.compare import MULTIPLIERS, ORBIT

    points: dict[str, list[Row]] = {}
    for row in comparison.measured:
        if row.reason is None:
            points.setdefault(row.method, []).append(row)
    kinds = [ORBIT, MULTIPLIERS] if comparison.judged_by == ORBIT else [MULTIPLIERS]
    lines = {
        name: Work(
            np.array([row.time for row in rows]),
            {kind: np.array([row.error(kind) for row in rows]) for kind in kinds},
        )
        for name, rows in points.items()
    }
    known_to = {kind: getattr(comparison.reference.error_estimate, kind) for kind in kinds}
    title = f"{titled(comparison.reference)}: work and precision"
    return work_precision_figure(title, lines, known_to, {comparison.judged_by: targets})


def _record(comparison: "Comparison", targets: Sequence[float]) -> dict[str, Any]:
    from solve.results.record import model_record, plain

    reference = comparison.reference
    return plain(
        {
            **model_record(reference.system),
            "speed": reference.speed,
            "period": reference.period,
            "reference": {
                "method": reference.method,
                "steps": reference.steps,
                "error_estimate": reference.error_estimate._asdict(),
                "spectral_radius": reference.spectral_radius,
                "verdict": reference.verdict,
            },
            "judged_by": comparison.judged_by,
            "targets": targets,
            "rows": [vars(row) for row in comparison.rows],
            "measured": [vars(row) for row in comparison.measured],
            "warnings": comparison.warnings,
        }
    )


def _contents(comparison: "Comparison") -> "Contents":
    from solve.results.contents import table_contents
    from solve.results.record import model_record

    def column(name: str, missing: Any, unit: str = "", meaning: str = "") -> tuple[list[Any], str, str]:
        values = (getattr(row, name) for row in comparison.rows)
        return [missing if value is None else value for value in values], unit, meaning

    columns = {
        "method": column("method", ""),
        "order": column("order", 0),
        "steps": column("steps", 0, meaning="a period; 0: none"),
        "orbit_error": column("orbit_error", math.nan, "1", "relative"),
        "multiplier_error": column("multiplier_error", math.nan, "1", "relative"),
        "time": column("time", math.nan, "s", "of the processor, shortest of some runs"),
        "verdict": column("verdict", ""),
        "at": column("at", ""),
        "followed": column("followed", True, meaning="whether the steps follow the fastest mode"),
        "target": column("target", math.nan, "1", f"error of the {comparison.judged_by} to reach"),
        "reason": column("reason", "", meaning="why there is no result"),
    }
    reference = comparison.reference
    metadata = {**model_record(reference.system), "speed": reference.speed}
    return table_contents(columns, metadata)


def _report(comparison: "Comparison", choices: Sequence[str]) -> "RenderableType":
    from rich.console import Group

    from solve.results.report import heading

    reference = comparison.reference
    head = heading(reference.system, reference.speed, choices)
    orbit, multipliers = reference.error_estimate
    head.add_row("truth", f"{reference.method}, {reference.steps} steps a period")
    head.add_row("", f"known to: orbit {orbit:.1e}, multipliers {multipliers:.1e} (relative)")
    groups: dict[str, list[Row]] = {}
    for row in comparison.rows:
        alike = f"{row.asked} steps a period"
        if row.target is not None:
            alike = f"{comparison.judged_by} right to {row.target:g}"
        groups.setdefault(f"At {row.at}: {alike}", []).append(row)
    return Group(head, *(_table(title, rows, reference.verdict) for title, rows in groups.items()))


_UNRESOLVED, _OTHER_VERDICT = "*", "≠"
_LEGEND = {
    _UNRESOLVED: "ω_max h is beyond what the method follows or damps: multipliers may be false",
    _OTHER_VERDICT: "not the truth's verdict",
}


def _table(title: str, rows: Sequence["Row"], truth: str) -> "RenderableType":
    from rich.console import Group
    from rich.text import Text

    from solve.results.report import table

    made = table(title, "method", "steps", "q error", "ρ error", "time (ms)", "ratio", "stability", "")
    done = [row for row in rows if row.reason is None]
    if rows[0].target is not None:
        done.sort(key=lambda row: row.time)
    quickest = min((row.time for row in done), default=math.nan)
    marks = [_marks(row, truth) for row in done]
    for row, mark in zip(done, marks, strict=True):
        made.add_row(
            row.method,
            str(row.steps),
            "–" if math.isnan(row.orbit_error) else f"{row.orbit_error:.1e}",
            f"{row.multiplier_error:.1e}",
            f"{1e3 * row.time:.2f}",
            f"{row.time / quickest:.2f}" if quickest else "–",
            (row.verdict or "").removesuffix("ally stable"),
            mark,
        )
    notes = [f"{mark} {text}" for mark, text in _LEGEND.items() if any(mark in each for each in marks)]
    notes += _reasons(rows)
    return Group(made, *(Text(note, "dim") for note in notes))


def _marks(row: "Row", truth: str) -> str:
    return _UNRESOLVED * (not row.followed) + _OTHER_VERDICT * (row.verdict != truth)


def _reasons(rows: Sequence["Row"]) -> list[str]:
    """Why methods have no result, or what is doubtful about their own settings; methods of one kind
    together."""
    reasons: dict[str, list[str]] = {}
    for row in rows:
        concerns = row.warnings if row.followed else row.warnings[:-1]
        for reason in concerns if row.reason is None else [row.reason]:
            reasons.setdefault(reason, []).append(row.method)
    return [f"{', '.join(names)}: {reason}" for reason, names in reasons.items()]
