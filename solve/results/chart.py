"""Stability as a function of two quantities: spectral radius, verdict and stability boundaries."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from solve.arguments import matches_annotations
from solve.arrays import Array
from solve.errors import ValueOutOfBoundsError, counted, require_name
from solve.labels import unit_of
from solve.period.multipliers import ASYMPTOTICALLY_STABLE, STABLE, UNDETERMINED, UNSTABLE, VERDICTS
from solve.period.named import Named
from solve.results.contents import Column, Columns, HeaderRows, columns_by_name, to_json
from solve.results.formatting import greek
from solve.results.points import PointResults
from solve.results.result import Result
from solve.results.serialization import NOT_STORED, serializable, stored_property
from solve.results.stability import Stability
from solve.system import PeriodicSystem


@serializable
class BoundaryCurve(NamedTuple):
    """Curve that separates a stable and an unstable region.

    Attributes
    ----------
    name : {"+1", "-1", "complex"}
        Way in which a multiplier leaves the unit circle on this curve: at +1, at -1, or as a complex pair.
    points : (k, 2) array
        x and y of the points on the curve.
    """

    name: str
    points: Array


@serializable
@dataclass(frozen=True)
class Cut:
    """Stability along a line through a chart: the quantity `along` varies, and the quantity `across` has the
    constant value `value`.

    Attributes
    ----------
    values : (k,) array
        Values of the quantity `along`.
    spectral_radius, stable : (k,) array
        Spectral radius; and stability, 1 if stable and 0 if unstable. NaN where a point failed.
    crossings : sequence of tuple
        Values at which stability changes, each with the way in which a multiplier leaves the unit circle.
    """

    along: str
    across: str
    value: float
    values: Array
    spectral_radius: Array
    stable: Array
    crossings: Sequence[tuple[float, str]]

    def record(self) -> dict[str, Any]:
        """JSON object of the cut."""
        return {
            "along": self.along,
            "values": self.values,
            "at": {self.across: self.value},
            "spectral_radius": self.spectral_radius,
            "stable": [None if math.isnan(value) else bool(value) for value in self.stable],
            "crossings": [{"at": value, "kind": kind} for value, kind in self.crossings],
        }


@serializable
@dataclass(frozen=True)
class ProvedBoxes:
    """Rectangles ("boxes") that cover the ranges of a chart, with proved verdicts.

    Attributes
    ----------
    ends : (k, 4) array
        Lower and upper end of x, then of y, rounded to double precision.
    verdicts : (k,) array of int
        Index in VERDICTS of the verdict that is proved everywhere on the box.
    assumed : str
        Assumption of the proof about the numbers of the model.
    seconds : float
        Elapsed time of the proof in s.
    """

    ends: Array
    verdicts: Array
    assumed: str
    seconds: float

    def fraction(self, *verdicts: int) -> float:
        """Fraction of the area of the chart whose verdict is one of `verdicts`."""
        areas = (self.ends[:, 1] - self.ends[:, 0]) * (self.ends[:, 3] - self.ends[:, 2])
        return float(areas[np.isin(self.verdicts, verdicts)].sum() / areas.sum())

    def at(self, x: Array, y: Array) -> Array:
        """Indices (ny, nx) in VERDICTS of the verdicts at the points of a grid. A point on a common edge of
        two boxes has the verdict of one of the two boxes."""
        verdicts = np.full((len(y), len(x)), UNDETERMINED)
        first = np.stack([np.searchsorted(axis, self.ends[:, k]) for axis, k in ((x, 0), (y, 2))], axis=1)
        last = np.stack(
            [np.searchsorted(axis, self.ends[:, k], side="right") for axis, k in ((x, 1), (y, 3))], axis=1
        )
        inside = np.flatnonzero((last > first).all(axis=1) & (self.verdicts != UNDETERMINED))
        for (i, j), (right, up), verdict in zip(
            first[inside], last[inside], self.verdicts[inside], strict=True
        ):
            verdicts[j:up, i:right] = verdict
        return verdicts

    def record(self) -> dict[str, Any]:
        """Values of the JSON keys `proved` and `boxes`."""
        return {
            "proved": {
                "stable": self.fraction(ASYMPTOTICALLY_STABLE, STABLE),
                "unstable": self.fraction(UNSTABLE),
                "undecided": self.fraction(UNDETERMINED),
                "assumed": self.assumed,
                "seconds": self.seconds,
            },
            "boxes": [
                {"x": ends[:2], "y": ends[2:], "verdict": VERDICTS[verdict]}
                for ends, verdict in zip(self.ends.tolist(), self.verdicts.tolist(), strict=True)
            ],
        }


@dataclass(frozen=True)
class ChartPoints(Result):
    """Stability at the ny × nx points of a chart.

    Attributes
    ----------
    x_name, y_name : str
        Names of the two quantities: parameters, in their own units, or "speed", in rad/s.
    x, y : (nx,), (ny,) array
        Values of the two quantities.
    system : PeriodicSystem
        The model, or the first system that could be built.
    results : PointResults
        Results of the ny × nx points, row by row.
    """

    x_name: str
    x: Array
    y_name: str
    y: Array
    system: PeriodicSystem
    results: PointResults

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers (ny, nx) of values of y and of x."""
        return len(self.y), len(self.x)

    @property
    def spectral_radius(self) -> Array:
        """Largest |ρ| (ny, nx); NaN where a point failed."""
        return self.results.spectral_radius.reshape(self.shape)

    @property
    def multipliers(self) -> Array:
        """Multipliers (ny, nx, 2n) in order of decreasing modulus; 0 if unresolved, NaN where a point
        failed."""
        return self.results.all_multipliers.reshape(*self.shape, -1)

    @property
    def error_estimate(self) -> Array:
        """Estimated errors (ny, nx) of the multipliers, relative to the spectral radius."""
        return self.results.errors[:, 1].reshape(self.shape)

    @property
    def stable(self) -> Array:
        """Stability (ny, nx): 1 if stable, 0 if unstable; NaN where a point failed or its verdict is
        undetermined."""
        return np.array([1.0, 1.0, 0.0, np.nan, np.nan])[self.results.verdicts].reshape(self.shape)

    @property
    def verdicts(self) -> Array:
        """Verdicts (ny, nx), as strings: "asymptotically stable", "stable", "unstable", "undetermined" or
        "failed"."""
        return np.array([*VERDICTS, "failed"])[self.results.verdicts].reshape(self.shape)

    @property
    def kinds(self) -> Array:
        """Kind (ny, nx) of the largest multiplier of unstable points, as a string: "+1", "-1" or
        "complex"."""
        return self.results.kinds.reshape(self.shape)

    @property
    def failures(self) -> dict[tuple[int, int], str]:
        """Mapping from the row and column of each failed point to the reason."""
        return {divmod(at, len(self.x)): reason for at, reason in self.results.failures.items()}

    def span(self, name: str, values: Array) -> str:
        """Text that states the range of values of a quantity."""
        unit = unit_of(self.system, name)
        low, high = values.min(), values.max()
        return unit.text(high) if unit.text(low) == unit.text(high) else unit.span(low, high, "…")


@dataclass(frozen=True)
class Chart(ChartPoints):
    """Stability for ny × nx combinations of two quantities, from `solve.chart`.

    Attributes
    ----------
    boundaries : sequence of BoundaryCurve
        Stability boundaries.
    at : callable
        Function of x and y that computes the `Stability` at any point.
    solve_cut : callable
        Function of the index (0 or 1) and the value of a quantity that computes the `Cut` at this value.
    notes : sequence of str
        Notes on the selection of the engine.
    cuts : sequence of Cut
        Stability along lines.
    of, values : Named, (ny, nx) array
        Requested quantity and its values; NaN at points without a value.
    beyond : sequence of str
        Sentences on points without an orbit, and on orbits beyond the bounds of the model.
    proved : ProvedBoxes
        Boxes with proved verdicts, if they were requested.
    """

    boundaries: Sequence[BoundaryCurve]
    at: Callable[[float, float], Stability] = field(metadata=NOT_STORED)
    solve_cut: Callable[[int, float], Cut] = field(metadata=NOT_STORED)
    notes: Sequence[str] = ()
    cuts: Sequence[Cut] = ()
    of: Named | None = None
    values: Array | None = None
    beyond: Sequence[str] = ()
    proved: ProvedBoxes | None = None

    @stored_property
    def warnings(self) -> list[str]:
        """Warnings about failed points and about violated bounds of the model, one sentence each."""
        warnings = [*self.system.labels.equation_warnings, *self.beyond]
        if not self.failures:
            return warnings
        reason, total = next(iter(self.failures.values())), len(self.results)
        failed = (
            f"{counted(len(self.failures), f'of {total} points has', f'of {total} points have')} no result, "
            "and boundaries end near these points"
        )
        return [*warnings, f"{failed}: {reason}"]

    @matches_annotations
    def cut(self, x: float | None = None, y: float | None = None) -> Cut:
        """Stability along the line of constant x or y, with refined crossings. Raises ValueOutOfBoundsError
        unless exactly one of x and y is given."""
        if (x is None) == (y is None):
            raise ValueOutOfBoundsError("a cut requires exactly one of x and y; give one of them")
        return self.solve_cut(0, float(x)) if x is not None else self.solve_cut(1, float(y or 0.0))

    @matches_annotations
    def with_cuts(self, held: Sequence[tuple[str, float]]) -> "Chart":
        """Return the chart with cuts at constant values of its quantities. `held` contains pairs of a
        quantity's name and its value. Raises UnknownNameError."""
        names = self.x_name, self.y_name
        for name, _ in held:
            require_name("quantity of the chart", name, names)
        return replace(self, cuts=[self.solve_cut(names.index(name), value) for name, value in held])

    @property
    def summary_values(self) -> dict[str, Any]:
        cuts = [cut.record() for cut in self.cuts]
        quantity = {} if self.of is None else {"of": self.of.text, "unit": self.of.unit}
        proved = {} if self.proved is None else self.proved.record()
        return {**quantity, **proved, "boundaries": self._boundary_records, "cuts": cuts, "notes": self.notes}

    def record(self) -> dict[str, Any]:
        """JSON object of `solve chart --json`."""
        names = "spectral_radius", "verdicts", "kinds", "error_estimate"
        failures = [{"row": j, "column": i, "error": reason} for (j, i), reason in self.failures.items()]
        axes = {"x": {"name": self.x_name, "values": self.x}, "y": {"name": self.y_name, "values": self.y}}
        points = {name: getattr(self, name) for name in names}
        values = {} if self.of is None else {"values": self.values}
        return {**super().record(), **to_json({**axes, **points, **values, "failures": failures})}

    @property
    def contradicted(self) -> int:
        """Number of grid points whose verdict contradicts the proved verdict."""
        if self.proved is None:
            return 0
        proved, ordinary = self.proved.at(self.x, self.y), self.results.verdicts.reshape(self.shape)
        stable = (proved == ASYMPTOTICALLY_STABLE) | (proved == STABLE)
        return int(
            (
                stable & (ordinary == UNSTABLE) | (proved == UNSTABLE) & (ordinary == ASYMPTOTICALLY_STABLE)
            ).sum()
        )

    @property
    def _boundary_records(self) -> list[dict[str, Any]]:
        return [{"kind": kind, **dict(zip("xy", points.T, strict=True))} for kind, points in self.boundaries]

    def header_rows(self) -> HeaderRows:
        """Rows of the heading: the quantities, the requested values, and the fraction of stable points."""
        radius, decided = self.spectral_radius, self.stable[np.isfinite(self.stable)]
        share, open_ = (
            100 * float(decided.sum()) / max(decided.size, 1),
            int((self.results.verdicts == UNDETERMINED).sum()),
        )
        rows = [("over", ", ".join(map(self._range, (self.x_name, self.y_name), (self.x, self.y))))]
        if self.of is not None and self.values is not None:
            low, high = np.nanmin(self.values), np.nanmax(self.values)
            rows.append((self.of.text, f"{low:.7g} … {high:.7g} {self.of.unit}".removesuffix(" 1")))
        rows.append(
            ("stable", f"{share:.4g} % of {decided.size} points; largest |ρ| {np.nanmax(radius):.6g}")
        )
        if self.proved is not None:
            proved_areas = self.proved.record()["proved"]
            parts = (
                f"{100 * proved_areas[name]:.4g} % {name}" for name in ("stable", "unstable", "undecided")
            )
            rows.append(("proved", f"{', '.join(parts)}, of the area"))
        if open_:
            rows.append(
                (
                    "undetermined",
                    f"{counted(open_, 'point, within its', 'points, within their')} error of the unit circle",
                )
            )
        return rows

    @property
    def columns(self) -> Columns:
        """Columns of the table, with one row per point."""
        errors = [[self.failures.get((j, i), "") for i in range(len(self.x))] for j in range(len(self.y))]
        plane = self.y_name, self.x_name
        radius = "largest modulus of a Floquet multiplier"
        requested = {}
        if self.of is not None:
            requested[self.of.text] = Column(self.values, self.of.unit, "requested quantity", axes=plane)
        varied = {
            self.x_name: Column(self.x, *self._labels(self.x_name), axes=(self.x_name,)),
            self.y_name: Column(self.y, *self._labels(self.y_name), axes=(self.y_name,)),
        }
        columns = {
            "spectral_radius": Column(self.spectral_radius, "1", radius, axes=plane),
            "verdict": Column(self.verdicts, "", "stability", axes=plane),
            "kind": Column(self.kinds, "", "largest multiplier of unstable points", axes=plane),
            "error_estimate": Column(self.error_estimate, "1", "of the multipliers, relative", axes=plane),
            "error": Column(np.array(errors), "", "reason of the failure", axes=plane),
        }
        named = columns_by_name([*varied.items(), *columns.items()])
        return {**named, **requested}

    def _range(self, name: str, values: Array) -> str:
        return f"{greek(name)} {self.span(name, values)} ({len(values)})"

    def _labels(self, name: str) -> tuple[str, str]:
        """Unit and meaning of a quantity on an axis."""
        if name == "speed":
            return "rad/s", "speed of rotation"
        return self.system.labels.parameter_labels.get(name, ("", ""))
