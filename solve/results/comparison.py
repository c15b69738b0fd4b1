"""Methods side by side on one problem: at equal steps and at equal accuracy."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

from solve.results.contents import Column, Columns, HeaderRows, digits
from solve.results.orbit import Orbit
from solve.results.result import Result
from solve.results.serialization import serializable, stored_property
from solve.results.stability import short_verdict
from solve.system import PeriodicSystem

ORBIT, MULTIPLIERS = "orbit", "multipliers"
"""Whose error is brought to a target; that of the multipliers where there is no load and so no orbit."""


@serializable
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

    @stored_property
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

    _rows: ClassVar[str] = "rows"

    @property
    def system(self) -> PeriodicSystem:  # type: ignore[override]
        return self.reference.system

    @property
    def summary_values(self) -> dict[str, Any]:
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
        return self.columns_of(self.rows)

    def columns_of(self, rows: Sequence[Row]) -> dict[str, Column]:
        """A row each of some rows."""
        about: dict[str, tuple[Any, ...]] = {
            "method": ("", "", "method"),
            "order": ("", ""),
            "steps": ("", "a period", "steps"),
            "orbit_error": ("1", "relative", "q error", digits(".1e")),
            "multiplier_error": ("1", "relative", "ρ error", digits(".1e")),
            "time": ("s", "of the processor, shortest of some runs", "time (ms)", digits(".2f", 1e3)),
            "verdict": ("", "", "stability", short_verdict),
            "at": ("", "what the methods are compared at"),
            "followed": ("", "whether the steps follow the fastest mode"),
            "target": ("1", f"error of the {self.judged_by} to reach"),
            "reason": ("", "why there is no result"),
            "asked": ("", "steps that were asked for"),
            "warnings": ("", "", "", str, ()),
        }
        return {name: Column([getattr(row, name) for row in rows], *of) for name, of in about.items()}

    def header_rows(self) -> HeaderRows:
        """What the methods are held against."""
        reference, (orbit, multipliers) = self.reference, self.reference.error_estimate
        return [
            ("truth", f"{reference.method}, {reference.steps} steps a period"),
            ("", f"known to: orbit {orbit:.1e}, multipliers {multipliers:.1e} (relative)"),
        ]


def grouped(pairs: Iterable[tuple[str, Any]]) -> dict[str, list[Any]]:
    """The values of equal keys together."""
    groups: dict[str, list[Any]] = {}
    for key, value in pairs:
        groups.setdefault(key, []).append(value)
    return groups
