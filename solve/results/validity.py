"""How far the linear orbit is from the nonlinear one over speed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from solve.arrays import Array
from solve.results.contents import Contents, model_record, plain, table_contents
from solve.results.plot import MOST_ROWS, label_speeds, shades, title_of
from solve.results.quantities import RPM
from solve.results.report import RenderableType, model_heading, stacked, table, text
from solve.results.result import Result
from solve.results.style import GREY, Figure, page
from solve.system import PeriodicSystem


@dataclass(frozen=True)
class Validity(Result):
    """At speeds (P,) in rad/s, rising, the linearisation error (P, n) of each coordinate, relative, NaN
    where there is none; allowed: the error up to which the linear model is trusted; failures: why a speed
    has none, by position."""

    system: PeriodicSystem
    speeds: Array
    errors: Array
    allowed: float
    failures: Mapping[int, str]

    @property
    def trusted_to(self) -> float | None:
        """The last of the speeds, from the slowest on, up to which no coordinate is off by more than is
        allowed; None where the slowest is."""
        within = [*(row.max() <= self.allowed for row in self.errors), False]
        count = within.index(False)
        return float(self.speeds[count - 1]) if count else None

    @property
    def warnings(self) -> list[str]:
        """Why speeds have no result, a sentence each."""
        return [
            f"no result: {reason} (at {self.speeds[at] * RPM:.6g} rpm)"
            for at, reason in self.failures.items()
        ]

    def record(self) -> dict[str, Any]:
        """Of `solve validity --json`."""
        names = self.system.coordinates
        points = [
            {"speed": speed, "error": self.failures[at]}
            if at in self.failures
            else {"speed": speed, "linearisation_error": dict(zip(names, row, strict=True))}
            for at, (speed, row) in enumerate(zip(self.speeds, self.errors, strict=True))
        ]
        found = {"at": self.allowed, "points": points, "trusted_to": self.trusted_to}
        return plain({**model_record(self.system), **found})

    def report(self, choices: Sequence[str] = ()) -> RenderableType:
        """A row a speed."""
        names = self.system.coordinates[:MOST_ROWS]
        made = table("Linearisation error, %", "rpm", *names, left=0)
        for speed, row in zip(self.speeds, self.errors, strict=True):
            cells = [f"{100 * error:.3g}" if np.isfinite(error) else "–" for error in row[: len(names)]]
            made.add_row(f"{speed * RPM:.6g}", *cells)
        upto = self.trusted_to
        limit = f"more than {100 * self.allowed:g} %"
        words = f"off by {limit} from the slowest of these speeds on"
        if upto is not None:
            words = f"no coordinate is off by {limit} up to {upto * RPM:.6g} rpm = {upto:.6g} rad/s"
        return stacked(model_heading(self.system, choices), made, text("\n" + words))

    def plot(self) -> Figure:
        """The errors over speed (matplotlib Figure)."""
        rpm, names = self.speeds * RPM, self.system.coordinates[:MOST_ROWS]
        with page(3.4, f"{title_of(self.system)}: error of the linear orbit") as figure:
            axes = figure.subplots()
            for name, row, shade in zip(names, self.errors.T, shades(len(names)), strict=False):
                axes.semilogy(rpm, 100 * row, marker="o", label=name, **shade)
            limit = {"color": GREY, "linewidth": 0.8}
            axes.axhline(100 * self.allowed, linestyle="--", label=f"{100 * self.allowed:g} %", **limit)
            if self.trusted_to is not None:
                axes.axvline(self.trusted_to * RPM, linestyle=":", label="trusted to here", **limit)
            label_speeds(axes, rpm)
            axes.set_ylabel("max|difference| / max|q| (%)")
            axes.legend()
        return figure

    def contents(self) -> Contents:
        """A row a speed, for a file."""
        columns: dict[str, tuple[Any, str, str]] = {"speed": (self.speeds, "rad/s", "speed of rotation")}
        for name, row in zip(self.system.coordinates, self.errors.T, strict=True):
            columns[f"{name}_error"] = row, "1", f"error of the linear orbit in {name}, relative"
        found = {"at": self.allowed, "trusted_to": self.trusted_to}
        return table_contents(columns, {**model_record(self.system), **found}, ("speed",))
