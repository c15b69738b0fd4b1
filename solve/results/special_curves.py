"""Curves of folds, or of period doublings, in the plane of two parameters."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from solve.arrays import Array
from solve.labels import unit_of
from solve.results.contents import Column, Columns, columns_by_name, digits, peak_columns, varied_column
from solve.results.result import Result
from solve.results.serialization import stored_property
from solve.system import PeriodicSystem

CUSP = "cusp"
"""Kind of point at which two curves of folds meet."""


@dataclass(frozen=True)
class SpecialCurves(Result):
    """P points on curves of folds, or of period doublings, in the plane of two parameters, from
    `solve.special_curves`.

    Attributes
    ----------
    kind : str
        "fold" or "doubling".
    names : tuple of str
        Names of the two parameters, one of which may be "speed".
    values : (P, 2) array
        Values of the two parameters; speeds in rad/s.
    peaks : (P, n) array
        Largest absolute values of the coordinates.
    radius : (P,) array
        Spectral radii.
    errors : (P,) array
        Estimated relative errors of the orbits.
    cusps : (P,) array of bool
        Whether two curves of folds meet at each point.
    numbers : (P,) array of int
        Number, from 0, of the curve to which each point belongs.
    rtol : float
        Relative tolerance of the orbits.
    ended : str
        Reasons why curves end within the ranges.
    notes : sequence of str
        Notes on the selection of the engine.
    periods : int
        Number of model periods per period of the orbits.
    """

    _rows: ClassVar[str] = "points"

    system: PeriodicSystem
    kind: str
    names: tuple[str, str]
    values: Array
    peaks: Array
    radius: Array
    errors: Array
    cusps: Array
    numbers: Array
    rtol: float
    ended: str
    notes: Sequence[str] = ()
    periods: int = 1

    @stored_property
    def warnings(self) -> list[str]:
        """Warnings about the result, one sentence each."""
        sentences, worst = [*self.notes, *filter(None, [self.ended])], float(self.errors.max(initial=0.0))
        if worst > self.rtol:
            sentences.append(f"relative errors of the orbits are up to {worst:.1e}, above rtol {self.rtol:g}")
        if not len(self.values):
            sentences.append(f"the branch over {self.names[0]} has no {self.kind}")
        return sentences

    @property
    def at_cusps(self) -> list[dict[str, float]]:
        """Values of both parameters at the cusps."""
        return [dict(zip(self.names, map(float, row), strict=True)) for row in self.values[self.cusps]]

    @property
    def summary_values(self) -> dict[str, Any]:
        return {"kind": self.kind, "cusps": self.at_cusps, "rtol": self.rtol, "periods": self.periods}

    @property
    def columns(self) -> Columns:
        """Columns of the table, with one row per point."""
        columns = [("curve", Column(self.numbers, "", "number of the curve", "curve"))]
        for name, values in zip(self.names, self.values.T, strict=True):
            columns.append((name, varied_column(self.system, name, values)))
        columns += peak_columns(self.system, self.peaks, len(columns))
        radius = Column(self.radius, "1", "spectral radius", "radius", digits(".5g"))
        kinds = np.where(self.cusps, CUSP, self.kind)
        columns += [
            ("spectral_radius", radius),
            ("kind", Column(kinds, "", "kind of the point", "kind")),
            ("error", Column(self.errors, "1", "estimated relative error of the orbit")),
        ]
        return columns_by_name(columns)

    @property
    def summary(self) -> str:
        """Sentences on the number of curves and on their cusps."""
        count = len(set(self.numbers.tolist()))
        text = f"{count} curve{'s' * (count != 1)} of {self.kind}s."
        units = [unit_of(self.system, name) for name in self.names]
        for row in self.values[self.cusps]:
            at = (
                f"{name} = {unit.text(float(value), '.6g')}"
                for name, unit, value in zip(self.names, units, row, strict=True)
            )
            text += f" Two meet in a cusp at {', '.join(at)}."
        return text
