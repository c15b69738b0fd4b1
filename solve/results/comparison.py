"""Methods side by side on one problem: at equal steps and at equal accuracy."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from solve.results.contents import Column, Columns
from solve.results.lasting import lasting
from solve.results.orbit import Orbit
from solve.results.plot import titled
from solve.results.report import Facts, RenderableType, digits, table_of, text
from solve.results.result import Result
from solve.results.stability import in_short
from solve.results.style import GREY, LIGHT, MANY, Figure, page
from solve.system import PeriodicSystem

ORBIT, MULTIPLIERS = "orbit", "multipliers"
"""Whose error is brought to a target; that of the multipliers where there is no load and so no orbit."""

_UNRESOLVED, _OTHER_VERDICT = "*", "≠"
_LEGEND = {
    _UNRESOLVED: "ω_max h is beyond what the method follows or damps: multipliers may be false",
    _OTHER_VERDICT: "not the truth's verdict",
}

_MARKERS = "osD^vPXph*<>"
_DOTS: dict[str, Any] = {"markeredgecolor": "white", "markeredgewidth": 0.4, "markersize": 5.5}
_LINES = ("-", "--", ":")
"""Past the last colour the next kind of line begins."""

_WORST = 3.0
"""Relative error above which a result is no result; not drawn."""


@lasting
@dataclass(frozen=True)
class Row:
    """One method on one number of steps a period: those `asked` for, and those of its grid.

    Errors are relative, against the reference; NaN, as is time (s of the processor, the shortest of some
    runs), where there is no result: `reason` says why. The orbit's is NaN without a load too. at: "equal
    steps" or "equal accuracy"; target: the error to reach in the latter. followed: whether the steps
    follow the fastest mode, or the method damps what they do not; otherwise the multipliers may be false.
    """

    method: str
    order: float
    steps: int | None
    at: str
    asked: int | None = None
    orbit_error: float = math.nan
    multiplier_error: float = math.nan
    time: float = math.nan
    verdict: str | None = None
    followed: bool = True
    target: float | None = None
    reason: str | None = None
    warnings: list[str] = field(default_factory=list)

    def error(self, of: str) -> float:
        """Of ORBIT or MULTIPLIERS."""
        return self.orbit_error if of == ORBIT else self.multiplier_error


@dataclass(frozen=True)
class Comparison(Result):
    """reference: the converged orbit. judged_by: ORBIT or MULTIPLIERS, whose errors the targets are. rows:
    the comparison. measured: further points of each method, rising in steps, for a work–precision picture."""

    reference: Orbit
    judged_by: str
    targets: Sequence[float]
    rows: list[Row]
    measured: list[Row]

    @cached_property
    def warnings(self) -> list[str]:
        """Targets that the reference cannot judge."""
        error = max(self.reference.error_estimate)
        targets = {row.target for row in self.rows if row.target is not None}
        blurred = [f"{target:g}" for target in sorted(targets) if target < 10 * error]
        if not blurred:
            return self._reduction
        return [
            *self._reduction,
            f"the reference is accurate to {error:.0e} only; the target {', '.join(blurred)} is too close to "
            "it",
        ]

    def plot(self) -> Figure:
        """Error over time, a line a method."""
        methods = _grouped((row.method, row) for row in self.measured if row.reason is None)
        kinds = [ORBIT, MULTIPLIERS] if self.judged_by == ORBIT else [MULTIPLIERS]
        known_to = {kind: getattr(self.reference.error_estimate, kind) for kind in kinds}
        title = f"{titled(self.reference.system, self.reference.speed)}: work and precision"
        return work_precision_figure(title, methods, known_to, {self.judged_by: self.targets})

    _rows: ClassVar[str] = "rows"

    @property
    def system(self) -> PeriodicSystem:  # type: ignore[override]
        return self.reference.system

    @property
    def whole(self) -> dict[str, Any]:
        reference = self.reference
        names = "method", "steps", "spectral_radius", "verdict", "error_estimate"
        return {
            "speed": reference.speed,
            "period": reference.period,
            "reference": {name: getattr(reference, name) for name in names},
            "judged_by": self.judged_by,
            "targets": self.targets,
            "measured": self.measured,
        }

    @property
    def columns(self) -> Columns:
        """A row a method and number of steps."""
        return self._columns(self.rows)

    def _columns(self, rows: Sequence[Row]) -> dict[str, Column]:
        about: dict[str, tuple[Any, ...]] = {
            "method": ("", "", "method"),
            "order": ("", ""),
            "steps": ("", "a period", "steps"),
            "orbit_error": ("1", "relative", "q error", digits(".1e")),
            "multiplier_error": ("1", "relative", "ρ error", digits(".1e")),
            "time": ("s", "of the processor, shortest of some runs", "time (ms)", digits(".2f", 1e3)),
            "verdict": ("", "", "stability", in_short),
            "at": ("", "what the methods are compared at"),
            "followed": ("", "whether the steps follow the fastest mode"),
            "target": ("1", f"error of the {self.judged_by} to reach"),
            "reason": ("", "why there is no result"),
            "asked": ("", "steps that were asked for"),
            "warnings": ("", "", "", str, ()),
        }
        return {name: Column([getattr(row, name) for row in rows], *of) for name, of in about.items()}

    def facts(self) -> Facts:
        """What the methods are held against."""
        reference, (orbit, multipliers) = self.reference, self.reference.error_estimate
        return [
            ("truth", f"{reference.method}, {reference.steps} steps a period"),
            ("", f"known to: orbit {orbit:.1e}, multipliers {multipliers:.1e} (relative)"),
        ]

    def tables(self) -> Sequence[RenderableType]:
        """One for each number of steps and each target."""
        groups = _grouped((f"At {row.at}: {self._goal(row)}", row) for row in self.rows)
        return [part for group in groups.items() for part in self._parts(*group)]

    def _goal(self, row: Row) -> str:
        if row.target is None:
            return f"{row.asked} steps a period"
        return f"{self.judged_by} right to {row.target:g}"

    def _parts(self, title: str, rows: Sequence[Row]) -> list[RenderableType]:
        """A table of the rows that have a result, and what is to be said of them."""
        done = [row for row in rows if row.reason is None]
        if rows[0].target is not None:
            done.sort(key=lambda row: row.time)
        quickest, columns = min((row.time for row in done), default=0.0), self._columns(done)
        ratios = [row.time / quickest if quickest else None for row in done]
        other, truth = columns.pop("verdict"), self.reference.verdict
        marks = [_UNRESOLVED * (not row.followed) + _OTHER_VERDICT * (row.verdict != truth) for row in done]
        columns["ratio"] = Column(ratios, heading="ratio", text=digits(".2f"))
        columns |= {"verdict": other, "mark": Column(marks, heading=" ")}
        notes = [f"{mark} {text}" for mark, text in _LEGEND.items() if any(mark in each for each in marks)]
        dim = (text(note, "dim") for note in (*notes, *_reasons(rows)))
        return [table_of(title, columns, left=1), *dim]


def _reasons(rows: Sequence[Row]) -> list[str]:
    """Why methods have no result, or what is doubtful about their own settings; methods of one kind
    together."""
    # The last warning of a method that does not follow is said by its mark.
    said = [(row.warnings if row.followed else row.warnings[:-1], row) for row in rows]
    reasons = _grouped(
        (reason, row.method)
        for warnings, row in said
        for reason in (warnings if row.reason is None else [row.reason])
    )
    return [f"{', '.join(names)}: {reason}" for reason, names in reasons.items()]


def _grouped(pairs: Iterable[tuple[str, Any]]) -> dict[str, list[Any]]:
    """The values of equal keys together."""
    groups: dict[str, list[Any]] = {}
    for key, value in pairs:
        groups.setdefault(key, []).append(value)
    return groups


def work_precision_figure(
    title: str,
    methods: Mapping[str, Sequence[Row]],
    known_to: Mapping[str, float],
    targets: Mapping[str, Sequence[float]],
) -> Figure:
    """Error over time, a panel a kind of error, a line a method, its points rising in steps; targets dashed.

    known_to: the reference's own error of each kind, shaded, as nothing below it can be seen. Errors
    above 3 and below a tenth of the reference's are not drawn.
    """
    from cycler import cycler
    from matplotlib.ticker import LogLocator

    with page(4.2, title) as figure:
        panels = figure.subplots(1, len(known_to), sharey=True, sharex=True, squeeze=False)[0]
        floor = min(*known_to.values(), _WORST)
        for axes, (kind, error) in zip(panels, known_to.items(), strict=True):
            axes.set_prop_cycle(cycler(linestyle=_LINES) * (cycler(color=MANY) + cycler(marker=_MARKERS)))
            for name, rows in methods.items():
                shown = [
                    (1e3 * row.time, row.error(kind))
                    for row in rows
                    if floor / 10 <= row.error(kind) <= _WORST
                ]
                axes.loglog(*np.reshape(shown, (-1, 2)).T, label=name, **_DOTS)
            for target in targets.get(kind, ()):
                axes.axhline(target, color=GREY, linewidth=0.8, linestyle="--", zorder=1)
            axes.set_ylim(floor / 10, _WORST)
            axes.axhspan(floor / 10, min(error, _WORST), color=LIGHT, zorder=0.5, linewidth=0)
            below = "below the reference's own error"
            axes.annotate(below, (0.02, 0.02), xycoords="axes fraction", color=GREY)
            axes.yaxis.set_major_locator(LogLocator(numticks=9))
            axes.set_xlabel("processor time of a solution (ms)")
            axes.set_title(kind)
        panels[0].set_ylabel("relative error")
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=5, handlelength=3)
    return figure
