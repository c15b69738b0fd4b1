"""The periodic solution over many speeds, a row of figures a speed; of one system, or of several."""

import itertools
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from solve.arrays import Array
from solve.errors import require_name
from solve.labels import SPEED
from solve.period.multipliers import VERDICTS
from solve.period.quantities import Statistics
from solve.results.contents import Column, Columns, HeaderRows, require_different_names, speeds_of, to_json
from solve.results.points import FAILED, FIGURES, PointResults
from solve.results.result import Figure, Result, views
from solve.results.serialization import stored_property
from solve.results.stability import ErrorEstimate, short_verdict
from solve.system import PeriodicSystem

_NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(\.\d+)?(e[-+]?\d+)?")
"""A number in a warning, not the digits of a name such as q1."""

_UNKNOWN = ErrorEstimate(float("nan"), float("nan"))
"""Errors of a point that failed."""


@dataclass(frozen=True)
class SweepPoint:
    """One point of a sweep: the stored values of its orbit, or the reason why there is none.

    parameters: those that vary besides the speed. statistics: of coordinates and outputs by name.
    multipliers: all 2n in descending order of modulus, 0 if below the round-off of the monodromy matrix.
    error: reason of a failure; statistics are then NaN. reduction_error: error of the reduction of the
    system, None for a full system.
    """

    speed: float
    statistics: Mapping[str, Statistics] = field(default_factory=dict)
    spectral_radius: float = float("nan")
    verdict: str = ""
    method: str = ""
    steps: int = 0
    error_estimate: ErrorEstimate = _UNKNOWN
    warnings: Sequence[str] = ()
    error: str | None = None
    multipliers: Sequence[complex] = ()
    parameters: Mapping[str, float] = field(default_factory=dict)
    reduction_error: ErrorEstimate | None = None

    @property
    def stable(self) -> bool | None:
        """None where the point failed or its verdict is undetermined."""
        return None if self.verdict in {"", "undetermined"} else self.verdict != "unstable"

    @property
    def stability(self) -> str:
        """The verdict in few characters."""
        return "failed" if self.error else short_verdict(self.verdict)

    def record(self, system: PeriodicSystem) -> dict[str, Any]:
        """As plain data; the system is that of the sweep."""
        where = {"speed": self.speed, **({"parameters": self.parameters} if self.parameters else {})}
        if self.error is not None:
            return {**where, "error": self.error}
        names = ["spectral_radius", "verdict", "stable", "method", "steps", "error_estimate", "warnings"]
        if self.reduction_error is not None:
            names.append("reduction_error")
        return {
            **where,
            "coordinates": self._figures(system, system.coordinates),
            "outputs": self._figures(system, system.outputs),
            **{name: getattr(self, name) for name in names},
            "verdict": self.verdict or None,
        }

    def _figures(self, system: PeriodicSystem, names: Sequence[str]) -> dict[str, Any]:
        kept = {name: self.statistics[name] for name in names if name in self.statistics}
        return {name: {"unit": system.units.get(name, ""), **kept[name]._asdict()} for name in kept}


@dataclass(frozen=True)
class Sweep(Result):
    """The results of many speeds (rad/s), in the order given. engine: what solved them; notes: how it
    was chosen, where that is not as asked; parameters: values (P,) of those that vary too, a point each, as
    the speeds then are."""

    system: PeriodicSystem
    speeds: Array
    results: PointResults
    engine: str = ""
    notes: Sequence[str] = ()
    parameters: Mapping[str, Array] = field(default_factory=dict)

    @cached_property
    def points(self) -> Sequence[SweepPoint]:
        """One a speed."""
        return [self._point(at) for at in range(len(self.speeds))]

    def _point(self, at: int) -> SweepPoint:
        results, speed = self.results, float(self.speeds[at])
        parameters = {name: float(values[at]) for name, values in self.parameters.items()}
        if results.verdicts[at] == FAILED:
            return SweepPoint(speed, error=results.failures[at], parameters=parameters)
        figures = (Statistics(*row.tolist()) for row in results.figures[at])
        every = self.multipliers
        return SweepPoint(
            speed,
            dict(zip(results.kept.names, figures, strict=True)),
            float(results.spectral_radius[at]),
            VERDICTS[results.verdicts[at]] if self.system.vibrates else "",
            results.methods[at],
            int(results.steps[at]),
            ErrorEstimate(*results.errors[at].tolist()),
            results.warnings.get(at, ()),
            multipliers=every[at].tolist(),
            parameters=parameters,
            reduction_error=ErrorEstimate(*self.reductions[at]) if "reduce" in self.system.options else None,
        )

    @property
    def reductions(self) -> Array:
        """Errors (P, 2) of orbit and multipliers due to the reduction of the system; NaN for a full system
        and for failed points."""
        unknown = np.full((len(self.speeds), 2), np.nan)
        return getattr(self.results, "reductions", unknown)

    @property
    def spectral_radius(self) -> Array:
        """Largest |ρ| a speed; NaN where the point failed."""
        return self.results.spectral_radius

    @property
    def multipliers(self) -> Array:
        """(P, 2n), falling in modulus; zero where unresolved, NaN where the point failed."""
        return self._every_multiplier

    @cached_property
    def _every_multiplier(self) -> Array:
        return self.results.all_multipliers

    def figures(self, name: str, figure: str = "max_abs") -> Array:
        """max, min, max_abs, mean or rms of a coordinate or output a speed; NaN where the point failed.

        Raises UnknownNameError.
        """
        kept = self.results.kept.names
        require_name("coordinate or output", name, kept)
        require_name("figure", figure, FIGURES)
        return self.results.figures[:, kept.index(name), FIGURES.index(figure)]

    def spectrum(self, name: str) -> Array:
        """Amplitudes (P, harmonics + 1) of a quantity whose spectrum the sweep was asked for.

        Raises UnknownNameError.
        """
        known = self.results.kept.spectra
        require_name("spectrum", name, known)
        return self.results.amplitudes[:, known.index(name)]

    @property
    def unstable(self) -> list[tuple[float, float, str]]:
        """Runs of neighbouring unstable speeds: from, to (rad/s, half way to stable neighbours, not beyond
        the last known speed beside failed ones) and the kind of the largest multiplier; `bands` refines
        their edges. None where parameters vary too."""
        if self.parameters:
            return []
        order = np.argsort(self.speeds)
        speeds, kinds, failed = self.speeds[order], self.results.kinds[order], self.results.failed[order]
        between = np.where(failed[:-1], speeds[1:], (speeds[1:] + speeds[:-1]) / 2)
        between = np.where(failed[1:], speeds[:-1], between)
        middles = np.concatenate((speeds[:1], between, speeds[-1:]))
        starts = [0, *(np.flatnonzero(kinds[1:] != kinds[:-1]) + 1).tolist(), len(kinds)]
        return [
            (float(middles[first]), float(middles[last]), str(kinds[first]))
            for first, last in itertools.pairwise(starts)
            if kinds[first]
        ]

    @stored_property
    def warnings(self) -> list[str]:
        """What is doubtful about the equations; then one line a kind of warning or failure, with the speeds
        where it first and last stands. Texts of one kind differ in their numbers alone; the whole text of the
        first is shown."""
        of_equations = list(self.system.equation_warnings)
        reasons = {at: [f"no result: {text}"] for at, text in self.results.failures.items()}
        texts = {**self.results.warnings, **reasons}
        groups: dict[str, tuple[str, list[float]]] = {}
        for at in sorted(texts):
            for text in (text for text in texts[at] if text not in of_equations):
                groups.setdefault(_NUMBER.sub("#", text), (text, []))[1].append(float(self.speeds[at]))
        of_points = [f"{text} ({self._where(at)})" for text, at in groups.values()]
        return [*of_equations, *self._reduced, *of_points]

    @property
    def _reduced(self) -> list[str]:
        """Sentence on the largest error of the reduction."""
        if np.isnan(self.reductions).all():
            return []
        most = [float(np.nanmax(column, initial=0.0)) for column in self.reductions.T]
        errors = f"up to {most[0]:.1e} of the orbits and {most[1]:.1e} of the multipliers"
        return [f"reduce={self.system.options['reduce']}: relative errors of {errors}"]

    def _where(self, speeds: Sequence[float]) -> str:
        """Of points with these speeds, in words."""
        if self.parameters:
            return f"at {len(speeds)} of {len(self.speeds)} points"
        unit = self.system.speed_unit
        first, span = f"at {unit.text(speeds[0])}", unit.span(min(speeds), max(speeds))
        if len(speeds) == 1:
            return first
        return f"{first}; of this kind at {len(speeds)} of {len(self.speeds)} speeds, from {span}"

    @property
    def summary_values(self) -> dict[str, Any]:
        return {"notes": self.notes}

    def record(self) -> dict[str, Any]:
        """Of `solve sweep --json`."""
        points = [point.record(self.system) for point in self.points]
        return {**super().record(), **to_json({"speeds": self.speeds, "points": points})}

    def plot(self, names: Sequence[str] | None = None, figure: str = "max_abs") -> Figure:
        """Response over speed with its maxima, the spectral radius below, unstable speeds shaded; where
        parameters vary, over what runs fastest, a line for each value of the rest (matplotlib Figure). Raises
        UnknownNameError, and ValueOutOfBoundsError for more lines than can be distinguished."""
        return super().plot(names, figure)

    def waterfall(self, name: str) -> Figure:
        """The spectrum of a quantity over the speed, or over the parameter that varies instead (matplotlib
        Figure). Raises UnknownNameError for one whose spectrum the sweep was not asked for,
        ValueOutOfBoundsError where several quantities vary."""
        return views().waterfall_figure(self, name)

    @property
    def varied(self) -> dict[str, Array]:
        """Values (P,) of the parameters and of the speed by name."""
        return {**self.parameters, SPEED: self.speeds}

    @property
    def shown(self) -> Sequence[str]:
        """The coordinates that are kept, or else the outputs."""
        kept = self.results.kept.names
        return [name for name in kept if name in self.system.coordinates] or kept

    @property
    def columns(self) -> Columns:
        """A row a point."""
        system, points, axes = self.system, self.points, ("row" if self.parameters else "speed",)
        columns = [("speed", speeds_of(system, self.speeds, axes=axes))]
        for name, values in self.parameters.items():
            columns.append((name, Column(values, *system.parameter_labels[name], axes=axes)))
        for name in self.results.kept.names:
            unit, meaning = system.units.get(name, ""), system.meanings.get(name, name)
            for figure in ("max", "min", "max_abs", "mean", "rms"):
                values = self.figures(name, figure)
                columns.append(
                    (f"{name}_{figure}", Column(values, unit, f"{figure} of {meaning}", axes=axes))
                )
        radius = "largest modulus of a Floquet multiplier"
        texts = {
            "verdict": ([point.verdict for point in points], "stability"),
            "method": ([point.method for point in points], ""),
            "steps": ([point.steps for point in points], "a period"),
            "error": ([point.error or "" for point in points], "why there is no result"),
        }
        columns.append(("spectral_radius", Column(self.spectral_radius, "1", radius, axes=axes)))
        for name, (values, meaning) in texts.items():
            columns.append((name, Column(values, "", meaning, axes=axes)))
        require_different_names(columns)
        return dict(columns)


_PROMINENT = 1e-3
"""Part of its height by which an extreme must stand out from its surroundings."""

PEAK, QUIET = "peak", "quiet"


class Extreme(NamedTuple):
    """A speed (rad/s) where the first system's response is largest or least among its neighbours, which of
    the two, and the responses of all the systems there."""

    speed: float
    kind: str
    responses: tuple[float, ...]


@dataclass(frozen=True)
class Sweeps(Result):
    """Sweeps over the same speeds (rad/s), by the label of their system. title: what the labels are
    values of; quantities: coordinates and outputs, or names that stand for several, of which a figure was
    asked for; system: the one that was varied."""

    title: str
    speeds: Array
    sweeps: Mapping[str, Sweep]
    quantities: Sequence[str]
    system: PeriodicSystem
    figure: str = "max_abs"

    def figures(self, quantity: str, figure: str | None = None) -> Array:
        """A figure of a coordinate or output (systems, speeds), as `Sweep.figures`, or the largest of those
        that the quantity stands for; NaN where a point failed. Raises UnknownNameError."""
        figure = figure or self.figure
        parts = next(iter(self.sweeps.values())).system.parts(quantity)
        found = [[each.figures(part, figure) for part in parts] for each in self.sweeps.values()]
        return np.max(found, axis=1)

    def extremes(self, quantity: str, figure: str | None = None) -> list[Extreme]:
        """Peaks and quiet speeds of the first system among the given speeds, rising, with what the others
        do there. Raises UnknownNameError."""
        from scipy.signal import find_peaks

        responses = self.figures(quantity, figure)
        order = np.argsort(self.speeds)
        order = order[np.isfinite(responses[0, order])]
        speeds, responses = self.speeds[order], responses[:, order]
        first = responses[0]
        found = []
        for kind, sign in ((PEAK, 1.0), (QUIET, -1.0)):
            at, properties = find_peaks(sign * first, prominence=0.0)
            at = at[properties["prominences"] > _PROMINENT * np.abs(first[at])]
            found += [Extreme(float(speeds[k]), kind, tuple(responses[:, k].tolist())) for k in at]
        return sorted(found)

    @stored_property
    def warnings(self) -> list[str]:
        """What is doubtful or has no result, by the system."""
        return [f"{label}: {text}" for label, each in self.sweeps.items() for text in each.warnings]

    def plot(self, quantities: Sequence[str] | None = None, figure: str | None = None) -> Figure:
        """A row a quantity, a curve a system (matplotlib Figure). Raises UnknownNameError."""
        return super().plot(quantities, figure)

    @property
    def columns(self) -> Columns:
        """A row a speed: each figure of each system."""
        columns = {"speed": speeds_of(self.system, self.speeds, axes=("speed",))}
        for name in self.quantities:
            unit = self.system.units.get(name, "")
            for label, values in zip(self.sweeps, self.figures(name), strict=True):
                meaning = f"{self.figure} of {name}, {self.title} {label}"
                columns[f"{name} {label}"] = Column(values, unit, meaning, axes=("speed",))
        return columns

    @property
    def summary_values(self) -> dict[str, Any]:
        extremes = {name: self.extremes(name) for name in self.quantities}
        return {"over": self.title, "figure": self.figure, "extremes": extremes}

    def record(self) -> dict[str, Any]:
        """The same with every figure of each system."""
        values = {name: self.figures(name) for name in self.quantities}
        systems = [
            {
                "value": label,
                "responses": {name: values[name][at] for name in self.quantities},
                "spectral_radius": each.spectral_radius,
            }
            for at, (label, each) in enumerate(self.sweeps.items())
        ]
        return {**super().record(), **to_json({"speeds": self.speeds, "systems": systems})}

    def header_rows(self) -> HeaderRows:
        span = self.system.speed_unit.span(self.speeds.min(), self.speeds.max())
        return [("over", f"{len(self.speeds)} speeds from {span}")]
