"""Stability over two quantities: spectral radius, verdict, and the boundaries between."""

import math
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from solve.arrays import Array
from solve.errors import ValueOutOfBoundsError, require_name
from solve.period.multipliers import VERDICTS
from solve.period.named import Named
from solve.results.contents import Contents, model_record, plain, table_contents
from solve.results.plot import draw_map, title_of
from solve.results.points import PointResults
from solve.results.quantities import RPM, prefixed
from solve.results.report import RenderableType, model_heading, stacked, table, text
from solve.results.result import Result
from solve.results.stability import Stability
from solve.results.style import BLACK, Axes, Figure, page
from solve.results.sweep_plot import KIND_NAMES
from solve.system import PeriodicSystem

_MOST_CURVES = 20

_LINES = {"+1": "-", "-1": (0, (5, 2)), "complex": (0, (1, 1.2))}
_COLORS = ["#1F4E79", "#5B9BD5", "#C9DFF2", "#FFFFFF", "#FBCDB0", "#DD6B20", "#8A2A06"]
_MOST_DECAY = 4.0
"""Growth exponents a period below minus this, and above it, look alike."""

_LABEL = 48
"""Characters a line of a label."""


class BoundaryCurve(NamedTuple):
    """A curve between a stable and an unstable region: the multiplier that leaves the unit circle, "+1", "-1"
    or "complex", and points (k, 2), x and y."""

    name: str
    points: Array


@dataclass(frozen=True)
class Cut:
    """A line through a chart: values (k,) of the quantity `along`, `across` held at `value`.

    spectral_radius and stable (k,): 1 or 0, NaN where a point failed. crossings: where stability is lost or
    won, and the multiplier that leaves the unit circle.
    """

    along: str
    across: str
    value: float
    values: Array
    spectral_radius: Array
    stable: Array
    crossings: Sequence[tuple[float, str]]

    def record(self) -> dict[str, Any]:
        return {
            "along": self.along,
            "values": self.values,
            "at": {self.across: self.value},
            "spectral_radius": self.spectral_radius,
            "stable": [None if math.isnan(one) else bool(one) for one in self.stable],
            "crossings": [{"at": at, "kind": kind} for at, kind in self.crossings],
        }

    def table(self) -> RenderableType:
        """A row a crossing."""
        where = f"Along {self.along} at {_span(self.across, np.array([self.value]))}"
        if not self.crossings:
            return text(f"\n{where}: no boundary")
        made = table(where, "at", "kind", left=0)
        for at, kind in self.crossings:
            made.add_row(_span(self.along, np.array([at]), 9), kind)
        return made


@dataclass(frozen=True)
class Chart(Result):
    """Stability at ny × nx points: y (ny,) over x (nx,), each a parameter in SI units or "speed" (rad/s).

    system: the model as it was given, or the first that could be built. boundaries: curves between stable
    and unstable regions. at(x, y): the stability at a point anywhere, with its warnings. solve_cut (position
    of the quantity that is held, its value): stability along a line. notes: how the engine was chosen,
    where that is not as asked. of: a quantity that was asked for, values (ny, nx): what it is, NaN where
    it has none.
    """

    x_name: str
    x: Array
    y_name: str
    y: Array
    system: PeriodicSystem
    results: PointResults
    boundaries: Sequence[BoundaryCurve]
    at: Callable[[float, float], Stability]
    solve_cut: Callable[[int, float], Cut]
    notes: Sequence[str] = ()
    cuts: Sequence[Cut] = ()
    of: Named | None = None
    values: Array | None = None

    @property
    def shape(self) -> tuple[int, int]:
        return len(self.y), len(self.x)

    @property
    def spectral_radius(self) -> Array:
        """Largest |ρ| (ny, nx); NaN where a point failed."""
        return self.results.spectral_radius.reshape(self.shape)

    @property
    def multipliers(self) -> Array:
        """(ny, nx, 2n), falling in modulus; zero where unresolved, NaN where a point failed."""
        return self.results.multipliers.reshape(*self.shape, -1)

    @property
    def error_estimate(self) -> Array:
        """Of the multipliers, relative to the spectral radius (ny, nx)."""
        return self.results.errors[:, 1].reshape(self.shape)

    @property
    def stable(self) -> Array:
        """(ny, nx): 1 or 0, NaN where a point failed or its verdict is undetermined."""
        return np.array([1.0, 1.0, 0.0, np.nan, np.nan])[self.results.verdicts].reshape(self.shape)

    @property
    def verdicts(self) -> Array:
        """Texts (ny, nx): "asymptotically stable", "stable", "unstable", "undetermined" or "failed"."""
        return np.array([*VERDICTS, "failed"])[self.results.verdicts].reshape(self.shape)

    @property
    def kinds(self) -> Array:
        """Texts (ny, nx): the largest multiplier of unstable points, "+1", "-1" or "complex"."""
        return self.results.kinds.reshape(self.shape)

    @property
    def failures(self) -> dict[tuple[int, int], str]:
        """Reasons by row and column."""
        return {divmod(at, len(self.x)): reason for at, reason in self.results.failures.items()}

    @property
    def warnings(self) -> list[str]:
        """How many points failed, and why the first did."""
        if not self.failures:
            return list(self.system.ignored)
        reason, total = next(iter(self.failures.values())), len(self.results)
        return [
            *self.system.ignored,
            f"{len(self.failures)} of {total} points give no result, and boundaries end beside them: "
            + reason,
        ]

    def cut(self, x: float | None = None, y: float | None = None) -> Cut:
        """Stability along the line at that x or that y, crossings refined. Raises ValueOutOfBoundsError
        unless one of the two is given."""
        if (x is None) == (y is None):
            raise ValueOutOfBoundsError("a cut needs either x or y; give one of them")
        return self.solve_cut(0, float(x)) if x is not None else self.solve_cut(1, float(y or 0.0))

    def with_cuts(self, held: Sequence[tuple[str, float]]) -> "Chart":
        """With cuts at values of quantities by their names, for the record and the report. Raises
        UnknownNameError."""
        names = self.x_name, self.y_name
        for name, _ in held:
            require_name("quantity of the chart", name, names)
        return replace(self, cuts=[self.solve_cut(names.index(name), value) for name, value in held])

    def plot(self) -> Figure:
        """Growth ln|ρ| a period, or the quantity that was asked for, and the boundaries between stable and
        unstable; speeds in rpm."""
        from matplotlib.lines import Line2D

        factors = _factor(self.x_name), _factor(self.y_name)
        kinds = [kind for kind in KIND_NAMES if any(curve.name == kind for curve in self.boundaries)]
        styles = {kind: {"color": BLACK, "linestyle": _LINES[kind], "linewidth": 1.1} for kind in kinds}
        shown = "stability" if self.of is None else self.of.text
        with page(4.6, f"{title_of(self.system)}: {shown}") as figure:
            axes = figure.subplots()
            _draw_values(figure, axes, self) if self.of else _draw_growth(figure, axes, self)
            for kind, points in self.boundaries:
                axes.plot(*(points * factors).T, **styles[kind])
            if kinds:
                keys = [Line2D([], [], **styles[kind]) for kind in kinds]
                names = [f"boundary {KIND_NAMES[kind]}" for kind in kinds]
                figure.legend(keys, names, loc="outside lower center", ncols=len(keys), handlelength=3)
            axes.set_xlabel(_label(self.system, self.x_name))
            axes.set_ylabel(_label(self.system, self.y_name))
            axes.set_xlim(*(self.x[[0, -1]] * factors[0]))
            axes.set_ylim(*(self.y[[0, -1]] * factors[1]))
        return figure

    def record(self) -> dict[str, Any]:
        """Of `solve chart --json`."""
        names = "spectral_radius", "verdicts", "kinds", "error_estimate"
        failures = [{"row": j, "column": i, "error": reason} for (j, i), reason in self.failures.items()]
        return plain(
            {
                **model_record(self.system),
                "x": {"name": self.x_name, "values": self.x},
                "y": {"name": self.y_name, "values": self.y},
                **{name: getattr(self, name) for name in names},
                **(
                    {}
                    if self.of is None
                    else {"of": self.of.text, "unit": self.of.unit, "values": self.values}
                ),
                "boundaries": self._boundary_records,
                "cuts": [cut.record() for cut in self.cuts],
                "failures": failures,
            }
        )

    @property
    def _boundary_records(self) -> list[dict[str, Any]]:
        return [{"kind": kind, **dict(zip("xy", points.T, strict=True))} for kind, points in self.boundaries]

    def report(self, choices: Sequence[str] = ()) -> RenderableType:
        """The share of stable points, the boundaries, and where the cuts cross them."""
        radius, known = self.spectral_radius, self.stable[np.isfinite(self.stable)]
        share, open_ = 100 * float(known.sum()) / max(known.size, 1), int(self.results.undetermined.sum())
        head = model_heading(self.system, choices)
        head.add_row("over", f"{_range(self.x_name, self.x)}, {_range(self.y_name, self.y)}")
        if self.of is not None and self.values is not None:
            low, high = np.nanmin(self.values), np.nanmax(self.values)
            head.add_row(self.of.text, f"{low:.7g} … {high:.7g} {self.of.unit}".removesuffix(" 1"))
        head.add_row("stable", f"{share:.4g} % of {radius.size} points; largest |ρ| {np.nanmax(radius):.6g}")
        if open_:
            head.add_row("undetermined", f"{open_} points, within their error of the unit circle")
        return stacked(head, self._boundary_table(), *(cut.table() for cut in self.cuts))

    def _boundary_table(self) -> RenderableType:
        if not self.boundaries:
            return text("\nno boundary in this range")
        names = self.x_name, self.y_name
        made = table("Boundaries between stable and unstable", "kind", "points", *names, left=1)
        for curve in sorted(self.boundaries, key=lambda curve: -len(curve.points))[:_MOST_CURVES]:
            spans = map(_span, names, curve.points.T)
            made.add_row(curve.name, str(len(curve.points)), *spans)
        if len(self.boundaries) > _MOST_CURVES:
            made.caption = f"and {len(self.boundaries) - _MOST_CURVES} shorter ones"
        return made

    def contents(self) -> Contents:
        """A row a point, for a file."""
        errors = [[self.failures.get((j, i), "") for i in range(len(self.x))] for j in range(len(self.y))]
        columns: dict[str, tuple[Any, str, str]] = {
            self.x_name: (self.x, *self._labels(self.x_name)),
            self.y_name: (self.y, *self._labels(self.y_name)),
            "spectral_radius": (self.spectral_radius, "1", "largest modulus of a Floquet multiplier"),
            "verdict": (self.verdicts, "", "stability"),
            "kind": (self.kinds, "", "largest multiplier of unstable points"),
            "error": (errors, "", "why there is no result"),
        }
        if self.of is not None:
            columns[self.of.text] = self.values, self.of.unit, "the quantity that was asked for"
        metadata = {**model_record(self.system), "boundaries": self._boundary_records}
        return table_contents(columns, metadata, (self.y_name, self.x_name))

    def _labels(self, name: str) -> tuple[str, str]:
        """Unit and meaning of a quantity."""
        if name == "speed":
            return "rad/s", "speed of rotation"
        return self.system.parameter_labels.get(name, ("", ""))


def _range(name: str, values: Array) -> str:
    return f"{name} {_span(name, values)} ({len(values)})"


def _span(name: str, values: Array, digits: int = 6) -> str:
    unit = " rpm" if name == "speed" else ""
    low, high = (f"{value * _factor(name):.{digits}g}" for value in (values.min(), values.max()))
    return f"{low}{unit}" if low == high else f"{low} … {high}{unit}"


def _draw_growth(figure: Figure, axes: Axes, chart: Chart) -> None:
    from matplotlib.colors import LinearSegmentedColormap, TwoSlopeNorm

    with np.errstate(divide="ignore"):
        growth = np.clip(np.log(chart.spectral_radius), -_MOST_DECAY, _MOST_DECAY)
    low, high = min(np.nanmin(growth), -1e-3), max(np.nanmax(growth), 1e-3)
    axes.set_facecolor("#EEEEEE")
    x, y = chart.x * _factor(chart.x_name), chart.y * _factor(chart.y_name)
    colours = {
        "cmap": LinearSegmentedColormap.from_list("stability", _COLORS),
        "norm": TwoSlopeNorm(0.0, low if low < -1e-2 else -high, high),
    }
    bar = draw_map(figure, axes, x, y, growth, "growth a period, ln |ρ|", **colours)
    if low >= -1e-2:
        bar.ax.set_ylim(0.0, high)
    else:
        bar.set_ticks([*_ticks(low)[:-1], *_ticks(high)])
    bar.outline.set_linewidth(0.5)


def _draw_values(figure: Figure, axes: Axes, chart: Chart) -> None:
    assert chart.of is not None
    assert chart.values is not None
    factor, unit = prefixed(chart.of.unit, float(np.nanmax(np.abs(chart.values))))
    x, y = chart.x * _factor(chart.x_name), chart.y * _factor(chart.y_name)
    axes.set_facecolor("#EEEEEE")
    draw_map(figure, axes, x, y, factor * chart.values, f"{chart.of.text} ({unit})".removesuffix(" ()"))


def _ticks(end: float) -> list[float]:
    """Round values between 0 and the end of one side of the colours, rising."""
    from matplotlib.ticker import MaxNLocator

    values = MaxNLocator(4, steps=[1, 2, 5, 10]).tick_values(min(end, 0.0), max(end, 0.0))
    return [float(value) for value in values if min(end, 0.0) <= value <= max(end, 0.0)]


def _factor(name: str) -> float:
    """From SI units to those shown."""
    return RPM if name == "speed" else 1.0


def _label(system: PeriodicSystem, name: str) -> str:
    if name == "speed":
        return "speed (rpm)"
    if name not in system.parameter_labels:
        return name
    unit, meaning = system.parameter_labels[name]
    label = f"{name} ({unit.replace('^2', '²')})" if unit != "1" else name
    return "\n".join(textwrap.wrap(f"{label}: {meaning}", _LABEL))
