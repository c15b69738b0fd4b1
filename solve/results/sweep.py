"""Periodic solutions at many speeds and parameter values."""

import itertools
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from solve.arguments import matches_annotations
from solve.arrays import Array
from solve.contracts import Statistics
from solve.errors import require_name
from solve.labels import SPEED
from solve.period.multipliers import VERDICTS
from solve.results.contents import Column, Columns, columns_by_name, speeds_of, to_json
from solve.results.points import FAILED, FIGURES, PointResults
from solve.results.result import Figure, Result, views
from solve.results.serialization import stored_property
from solve.results.stability import ErrorEstimate, short_verdict
from solve.system import PeriodicSystem

_NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(\.\d+)?(e[-+]?\d+)?")
"""Pattern that matches a number in a warning, but not the digits in a name such as q1."""

_UNKNOWN = ErrorEstimate(float("nan"), float("nan"))
"""Error estimates of a failed point."""


@dataclass(frozen=True)
class SweepPoint:
    """Result at one point of a sweep.

    Attributes
    ----------
    speed : float
        Speed in rad/s.
    statistics : mapping of str to Statistics
        Statistics of coordinates and outputs.
    spectral_radius, verdict : float, str
        Largest |ρ|, and the stability verdict.
    method, steps : str, int
        Method and number of steps per period.
    error_estimate : ErrorEstimate
        Estimated relative errors.
    warnings : sequence of str
        Sentences on what is doubtful.
    error : str or None
        Reason why the point failed; the other values are then NaN or empty.
    multipliers : sequence of complex
        Multipliers (2n,) in descending order of modulus; 0 if below the round-off of the monodromy matrix.
    parameters : mapping of str to float
        Values of the parameters that vary in addition to the speed.
    reduction_error : ErrorEstimate or None
        Error of the reduction of the system; None for a full system.
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
        """Whether the motion is stable; None if the point failed or the verdict is undetermined."""
        return None if self.verdict in {"", "undetermined"} else self.verdict != "unstable"

    @property
    def stability(self) -> str:
        """Short text of the verdict for narrow columns."""
        return "failed" if self.error else short_verdict(self.verdict)

    def record(self, system: PeriodicSystem) -> dict[str, Any]:
        """JSON object of the point. `system` is the system of the sweep."""
        point = {"speed": self.speed, **({"parameters": self.parameters} if self.parameters else {})}
        if self.error is not None:
            return {**point, "error": self.error}
        names = ["spectral_radius", "verdict", "stable", "method", "steps", "error_estimate", "warnings"]
        if self.reduction_error is not None:
            names.append("reduction_error")
        return {
            **point,
            "coordinates": self._figures(system, system.coordinates),
            "outputs": self._figures(system, system.outputs),
            **{name: getattr(self, name) for name in names},
            "verdict": self.verdict or None,
        }

    def _figures(self, system: PeriodicSystem, names: Sequence[str]) -> dict[str, Any]:
        return {
            name: {"unit": system.labels.units.get(name, ""), **self.statistics[name]._asdict()}
            for name in names
            if name in self.statistics
        }


@dataclass(frozen=True)
class Sweep(Result):
    """Periodic solutions at P speeds, from `solve.sweep`.

    Attributes
    ----------
    speeds : (P,) array
        Speeds in rad/s, in the order given.
    results : PointResults
        Results of the points.
    engine, notes : str, sequence of str
        Engine that solved the points, and notes on its selection.
    parameters : mapping of str to (P,) array
        Values, at each point, of the parameters that vary in addition to the speed.
    """

    _recorded: ClassVar[str] = "notes"

    system: PeriodicSystem
    speeds: Array
    results: PointResults
    engine: str = ""
    notes: Sequence[str] = ()
    parameters: Mapping[str, Array] = field(default_factory=dict)

    @cached_property
    def points(self) -> Sequence[SweepPoint]:
        """Points of the sweep in the order of the speeds."""
        return [self._point(index) for index in range(len(self.speeds))]

    def _point(self, index: int) -> SweepPoint:
        results, speed = self.results, float(self.speeds[index])
        parameters = {name: float(values[index]) for name, values in self.parameters.items()}
        if results.verdicts[index] == FAILED:
            return SweepPoint(speed, error=results.failures[index], parameters=parameters)
        figures = (Statistics(*row.tolist()) for row in results.figures[index])
        reduced = "reduce" in self.system.labels.options
        return SweepPoint(
            speed,
            dict(zip(results.kept.names, figures, strict=True)),
            float(results.spectral_radius[index]),
            VERDICTS[results.verdicts[index]] if self.system.labels.vibrates else "",
            results.methods[index],
            int(results.steps[index]),
            ErrorEstimate(*results.errors[index].tolist()),
            results.warnings.get(index, ()),
            multipliers=self.multipliers[index].tolist(),
            parameters=parameters,
            reduction_error=ErrorEstimate(*self.reductions[index]) if reduced else None,
        )

    @property
    def reductions(self) -> Array:
        """Errors (P, 2) of orbit and multipliers due to the reduction of the system; NaN for a full system,
        and for failed points."""
        unknown = np.full((len(self.speeds), 2), np.nan)
        return getattr(self.results, "reductions", unknown)

    @property
    def spectral_radius(self) -> Array:
        """Spectral radii (P,); NaN where the point failed."""
        return self.results.spectral_radius

    @cached_property
    def multipliers(self) -> Array:
        """Multipliers (P, 2n) in order of decreasing modulus; 0 if unresolved, NaN where the point failed."""
        return self.results.all_multipliers

    @matches_annotations
    def figures(self, name: str, figure: str = "max_abs") -> Array:
        """Values (P,) of a statistic of a coordinate or output.

        Parameters
        ----------
        name : str
            Name of a coordinate or output.
        figure : {"max_abs", "max", "min", "mean", "rms"}
            Statistic.

        Returns
        -------
        (P,) array
            Values in SI units; NaN where the point failed.

        Raises
        ------
        UnknownNameError
        """
        stored = self.results.kept.names
        require_name("coordinate or output", name, stored)
        require_name("figure", figure, FIGURES)
        return self.results.figures[:, stored.index(name), FIGURES.index(figure)]

    @matches_annotations
    def spectrum(self, name: str) -> Array:
        """Amplitudes (P, harmonics + 1) of a quantity whose spectrum was requested. Raises
        UnknownNameError."""
        stored = self.results.kept.spectra
        require_name("spectrum", name, stored)
        return self.results.amplitudes[:, stored.index(name)]

    @property
    def unstable(self) -> list[tuple[float, float, str]]:
        """Ranges of neighbouring unstable speeds: edges in rad/s, and the kind of the largest multiplier.

        An edge lies halfway between an unstable speed and its stable neighbour. If the neighbour has failed,
        the edge is the unstable speed itself. `solve.bands` refines the edges. The list is empty if
        parameters vary too.
        """
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
        """Warnings about the equations, followed by one sentence, with the speeds, for each kind of warning
        or failure. Texts that differ only in their numbers count as one kind; the first text of each kind is
        shown."""
        of_equations = list(self.system.labels.equation_warnings)
        reasons = {index: [f"no result: {text}"] for index, text in self.results.failures.items()}
        texts = {**self.results.warnings, **reasons}
        groups: dict[str, tuple[str, list[float]]] = {}
        for index in sorted(texts):
            for text in (text for text in texts[index] if text not in of_equations):
                groups.setdefault(_NUMBER.sub("#", text), (text, []))[1].append(float(self.speeds[index]))
        of_points = [f"{text} ({self._where(speeds)})" for text, speeds in groups.values()]
        return [*of_equations, *self._reduced, *of_points]

    @property
    def _reduced(self) -> list[str]:
        """Sentence on the largest error of the reduction; an empty list for a full system."""
        if np.isnan(self.reductions).all():
            return []
        most = [float(np.nanmax(column, initial=0.0)) for column in self.reductions.T]
        errors = f"up to {most[0]:.1e} of the orbits and {most[1]:.1e} of the multipliers"
        return [f"reduce={self.system.labels.options['reduce']}: relative errors of {errors}"]

    def _where(self, speeds: Sequence[float]) -> str:
        """Text that describes the points with these speeds."""
        if self.parameters:
            return f"at {len(speeds)} of {len(self.speeds)} points"
        unit = self.system.labels.speed_unit
        first, span = f"at {unit.text(speeds[0])}", unit.span(min(speeds), max(speeds))
        if len(speeds) == 1:
            return first
        return f"{first}; similar warnings at {len(speeds)} of {len(self.speeds)} speeds, from {span}"

    def record(self) -> dict[str, Any]:
        """JSON object of `solve sweep --json`."""
        points = [point.record(self.system) for point in self.points]
        return {**super().record(), **to_json({"speeds": self.speeds, "points": points})}

    @matches_annotations
    def plot(self, names: Sequence[str] | None = None, figure: str = "max_abs") -> Figure:
        """Figure of the response versus speed, with its maxima, and of the spectral radius. Unstable speeds
        are shaded.

        If parameters vary, the horizontal axis is the quantity that varies fastest, and there is one curve
        for each combination of the other quantities.

        Parameters
        ----------
        names : sequence of str, optional
            Coordinates and outputs; by default the coordinates.
        figure : str
            Statistic; see `figures`.

        Returns
        -------
        matplotlib.figure.Figure

        Raises
        ------
        UnknownNameError
            For an unknown name.
        ValueOutOfBoundsError
            For more curves than can be distinguished.
        """
        return super().plot(names, figure)

    @matches_annotations
    def waterfall(self, name: str) -> Figure:
        """Figure of the spectra of a quantity versus speed, or versus the parameter that varies instead.

        Raises UnknownNameError if the spectrum was not requested, ValueOutOfBoundsError if several quantities
        vary.
        """
        return views().waterfall(self, name)

    @property
    def varied(self) -> dict[str, Array]:
        """Mapping from the names of the parameters, and "speed", to values (P,)."""
        return {**self.parameters, SPEED: self.speeds}

    @property
    def columns(self) -> Columns:
        """Columns of the table, with one row per point."""
        system, points, axes = self.system, self.points, ("row" if self.parameters else "speed",)
        columns = [("speed", speeds_of(system, self.speeds, axes=axes))]
        for name, values in self.parameters.items():
            columns.append((name, Column(values, *system.labels.parameter_labels[name], axes=axes)))
        for name in self.results.kept.names:
            unit, meaning = system.labels.units.get(name, ""), system.labels.meanings.get(name, name)
            for figure in ("max", "min", "max_abs", "mean", "rms"):
                values = self.figures(name, figure)
                columns.append(
                    (f"{name}_{figure}", Column(values, unit, f"{figure} of {meaning}", axes=axes))
                )
        radius = "largest modulus of a Floquet multiplier"
        texts = {
            "verdict": ([point.verdict for point in points], "stability"),
            "method": ([point.method for point in points], ""),
            "steps": ([point.steps for point in points], "per period"),
            "error": ([point.error or "" for point in points], "reason of the failure"),
        }
        columns.append(("spectral_radius", Column(self.spectral_radius, "1", radius, axes=axes)))
        for name, (values, meaning) in texts.items():
            columns.append((name, Column(values, "", meaning, axes=axes)))
        return columns_by_name(columns)
