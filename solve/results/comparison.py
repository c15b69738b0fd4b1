"""Comparison of methods on one problem, at equal steps and at equal accuracy."""

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
"""Kinds of errors to which targets refer: the error of the orbit or, if there is no load and thus no orbit,
the error of the multipliers."""


@serializable
@dataclass(frozen=True)
class Row:
    """Result of one method for one number of steps per period.

    Attributes
    ----------
    method, order : str, float
        Name of the method, and its order of convergence.
    steps, asked : int or None
        Number of steps of the grid, and the requested number.
    at : {"equal steps", "equal accuracy"}
        Kind of comparison to which the row belongs.
    orbit_error, multiplier_error : float
        Relative differences from the reference solution; NaN without a result. The error of the orbit is also
        NaN if there is no load.
    time : float
        Processor time in s, the shortest of several runs; NaN without a result.
    verdict : str or None
        Stability verdict.
    followed : bool
        Whether the steps resolve the fastest mode, or the method damps this mode. Otherwise, multipliers may
        be wrong.
    target : float or None
        Target error, for rows at equal accuracy.
    reason : str or None
        Reason why there is no result.
    warnings : list of str
        Warnings of the result.
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

    def error(self, kind: str) -> float:
        """Relative error of the orbit, if `kind` is ORBIT, or of the multipliers, if it is MULTIPLIERS."""
        return self.orbit_error if kind == ORBIT else self.multiplier_error


@dataclass(frozen=True)
class Comparison(Result):
    """Comparison of methods, from `solve.compare`.

    Attributes
    ----------
    reference : Orbit
        Converged solution.
    judged_by : {"orbit", "multipliers"}
        Kind of error to which the targets refer.
    targets : sequence of float
        Target errors.
    rows : list of Row
        Results at equal steps and at equal accuracy.
    measured : list of Row
        Further results of each method, in ascending order of the number of steps, for the work–precision
        diagram.
    """

    reference: Orbit
    judged_by: str
    targets: Sequence[float]
    rows: list[Row]
    measured: list[Row]

    @stored_property
    def warnings(self) -> list[str]:
        """Warning about targets for which the reference solution is not accurate enough."""
        error = max(self.reference.error_estimate)
        targets = {row.target for row in self.rows if row.target is not None}
        close = ", ".join(f"{target:g}" for target in sorted(targets) if target < 10 * error)
        if not close:
            return self._reduction
        reason = f"the error of the reference is {error:.0e}, too close to the target {close}"
        return [*self._reduction, reason]

    _rows: ClassVar[str] = "rows"

    @property
    def system(self) -> PeriodicSystem:  # type: ignore[override]
        """System of the reference solution."""
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
        """Columns of the table, with one row per method and number of steps."""
        return self.columns_of(self.rows)

    def columns_of(self, rows: Sequence[Row]) -> dict[str, Column]:
        """Columns of the table for the given rows."""
        labels: dict[str, tuple[Any, ...]] = {
            "method": ("", "", "method"),
            "order": ("", ""),
            "steps": ("", "per period", "steps"),
            "orbit_error": ("1", "relative", "q error", digits(".1e")),
            "multiplier_error": ("1", "relative", "ρ error", digits(".1e")),
            "time": ("s", "processor time, shortest of several runs", "time (ms)", digits(".2f", 1e3)),
            "verdict": ("", "", "stability", short_verdict),
            "at": ("", "kind of comparison"),
            "followed": ("", "whether the steps resolve the fastest mode"),
            "target": ("1", f"target error of the {self.judged_by}"),
            "reason": ("", "reason of the failure"),
            "asked": ("", "requested steps"),
            "warnings": ("", "", "", str, ()),
        }
        return {
            name: Column([getattr(row, name) for row in rows], *arguments)
            for name, arguments in labels.items()
        }

    def header_rows(self) -> HeaderRows:
        """Rows of the heading that describe the reference solution and its errors."""
        reference, (orbit, multipliers) = self.reference, self.reference.error_estimate
        return [
            ("reference", f"{reference.method}, {reference.steps} steps per period"),
            ("", f"errors: orbit {orbit:.1e}, multipliers {multipliers:.1e} (relative)"),
        ]


def grouped(pairs: Iterable[tuple[str, Any]]) -> dict[str, list[Any]]:
    """Convert pairs of a key and a value to a mapping from each key to the list of its values."""
    groups: dict[str, list[Any]] = {}
    for key, value in pairs:
        groups.setdefault(key, []).append(value)
    return groups
