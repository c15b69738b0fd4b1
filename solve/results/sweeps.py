"""Sweeps of several systems over the same speeds, and the linearisation error versus speed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from solve.arguments import matches_annotations
from solve.arrays import ROUND_OFF, Array
from solve.errors import NoResultError, counted
from solve.labels import parts_of
from solve.results.contents import MOST_SHOWN, Column, Columns, HeaderRows, digits, speeds_of, to_json
from solve.results.result import Figure, Result
from solve.results.serialization import stored_property
from solve.results.sweep import Sweep
from solve.system import PeriodicSystem

_PROMINENT = 1e-3
"""Smallest prominence of a peak or quiet speed, relative to its height. It excludes ripple that is due to
errors of the points. Chosen by judgement."""

PEAK, QUIET = "peak", "quiet"


class Extreme(NamedTuple):
    """Local extremum of the first system's response at a speed (rad/s). `kind` states whether it is a peak
    (maximum) or a quiet speed (minimum). `responses` contains the responses of all systems at this speed."""

    speed: float
    kind: str
    responses: tuple[float, ...]


@dataclass(frozen=True)
class Sweeps(Result):
    """Sweeps of several systems over the same speeds, from `solve.sweeps`.

    Attributes
    ----------
    title : str
        Text that states the meaning of the labels.
    speeds : (P,) array
        Speeds in rad/s.
    sweeps : mapping of str to Sweep
        Sweep for each label of a system.
    quantities : sequence of str
        Coordinates and outputs, or names for groups of outputs.
    system : PeriodicSystem
        First of the systems, whose labels and units are shown.
    figure : str
        Statistic; see `Sweep.figures`.
    """

    title: str
    speeds: Array
    sweeps: Mapping[str, Sweep]
    quantities: Sequence[str]
    system: PeriodicSystem
    figure: str = "max_abs"

    @matches_annotations
    def figures(self, quantity: str, figure: str | None = None) -> Array:
        """Statistics (systems, P) of a coordinate or output, or maxima over a group of outputs; NaN where a
        point failed. Raises UnknownNameError."""
        figure = figure or self.figure
        names = parts_of(next(iter(self.sweeps.values())).system, quantity)
        return np.max(
            [[sweep.figures(name, figure) for name in names] for sweep in self.sweeps.values()], axis=1
        )

    @matches_annotations
    def extremes(self, quantity: str, figure: str | None = None) -> list[Extreme]:
        """Peaks and quiet speeds of the first system in ascending order, with the responses of all systems.
        Raises UnknownNameError."""
        from scipy.signal import find_peaks

        responses = self.figures(quantity, figure)
        order = np.argsort(self.speeds)
        order = order[np.isfinite(responses[0, order])]
        speeds, responses = self.speeds[order], responses[:, order]
        first, extremes = responses[0], []
        for kind, sign in ((PEAK, 1.0), (QUIET, -1.0)):
            peaks, properties = find_peaks(sign * first, prominence=0.0)
            peaks = peaks[properties["prominences"] > _PROMINENT * np.abs(first[peaks])]
            extremes += [Extreme(float(speeds[k]), kind, tuple(responses[:, k].tolist())) for k in peaks]
        return sorted(extremes)

    @stored_property
    def warnings(self) -> list[str]:
        """Warnings about the results, each with the label of its system."""
        return [f"{label}: {text}" for label, sweep in self.sweeps.items() for text in sweep.warnings]

    @matches_annotations
    def plot(self, quantities: Sequence[str] | None = None, figure: str | None = None) -> Figure:
        """Figure with one panel per quantity and one curve per system. Raises UnknownNameError."""
        return super().plot(quantities, figure)

    @property
    def columns(self) -> Columns:
        """Columns of the table, with one row per speed and one column per quantity and system."""
        columns = {"speed": speeds_of(self.system, self.speeds, axes=("speed",))}
        for name in self.quantities:
            unit = self.system.labels.units.get(name, "")
            for label, values in zip(self.sweeps, self.figures(name), strict=True):
                meaning = f"{self.figure} of {name}, {self.title} {label}"
                columns[f"{name} {label}"] = Column(values, unit, meaning, axes=("speed",))
        return columns

    @property
    def summary_values(self) -> dict[str, Any]:
        extremes = {name: self.extremes(name) for name in self.quantities}
        return {"over": self.title, "figure": self.figure, "extremes": extremes}

    def record(self) -> dict[str, Any]:
        """JSON object with the responses and spectral radii of each system."""
        values = {name: self.figures(name) for name in self.quantities}
        systems = [
            {
                "value": label,
                "responses": {name: values[name][number] for name in self.quantities},
                "spectral_radius": sweep.spectral_radius,
            }
            for number, (label, sweep) in enumerate(self.sweeps.items())
        ]
        return {**super().record(), **to_json({"speeds": self.speeds, "systems": systems})}

    def header_rows(self) -> HeaderRows:
        span = self.system.labels.speed_unit.span(self.speeds.min(), self.speeds.max())
        return [("over", f"{counted(len(self.speeds), 'speed')} from {span}")]


ACCEPTABLE_ERROR = 0.05
"""Default linearisation error up to which the linear model counts as valid, and nonlinear orbits count as
confirming an optimum. Chosen by judgement."""


@dataclass(frozen=True)
class Validity(Result):
    """Linearisation error versus speed, from `solve.validity`.

    Attributes
    ----------
    speeds : (P,) array
        Speeds in rad/s, ascending.
    errors : (P, n) array
        Relative linearisation error of each coordinate; NaN at failed speeds.
    allowed : float
        Error up to which the linear model counts as valid.
    failures : mapping of int to str
        Mapping from indices of failed speeds to reasons.
    """

    system: PeriodicSystem
    speeds: Array
    errors: Array
    allowed: float
    failures: Mapping[int, str]

    @property
    def trusted_to(self) -> float | None:
        """Speed (rad/s) up to which all errors are within the allowed limit; None if the errors at the lowest
        speed exceed the limit."""
        within = [*(row.max() <= self.allowed for row in self.errors), False]
        count = within.index(False)
        return float(self.speeds[count - 1]) if count else None

    @stored_property
    def warnings(self) -> list[str]:
        """Reasons why speeds have no result, one sentence per reason."""
        unit, speeds = self.system.labels.speed_unit, dict[str, list[float]]()
        for index, reason in self.failures.items():
            speeds.setdefault(reason, []).append(float(self.speeds[index]))
        return [
            f"no result {unit.spans((speed, speed) for speed in failed)}: {reason}"
            for reason, failed in speeds.items()
        ]

    def require_any(self) -> None:
        """Raise NoResultError if no speed has a result."""
        if len(self.failures) == len(self.speeds):
            reason = next(iter(self.failures.values()))
            raise NoResultError(f"{counted(len(self.speeds), 'speed')}, none with a result: {reason}")

    @property
    def summary_values(self) -> dict[str, Any]:
        return {"at": self.allowed, "trusted_to": self.trusted_to}

    @property
    def columns(self) -> Columns:
        """Columns of the table, with one row per speed."""
        columns = {"speed": speeds_of(self.system, self.speeds, heading="{}", axes=("speed",))}
        for number, (name, row) in enumerate(zip(self.system.coordinates, self.errors.T, strict=True)):
            meaning = f"error of the linear orbit in {name}, relative"
            heading = name if number < MOST_SHOWN else ""
            columns[f"{name}_error"] = Column(row, "1", meaning, heading, digits(".3g", 100), ("speed",))
        return columns

    def record(self) -> dict[str, Any]:
        """JSON object of `solve validity --json`."""
        names = self.system.coordinates
        points = [
            {"speed": speed, "error": self.failures[index]}
            if index in self.failures
            else {"speed": speed, "linearisation_error": dict(zip(names, row, strict=True))}
            for index, (speed, row) in enumerate(zip(self.speeds, self.errors, strict=True))
        ]
        return {**super().record(), "points": to_json(points)}

    @property
    def limit(self) -> str:
        """Text that states the speed up to which the linear model is valid."""
        limit, highest = f"{100 * self.allowed:g} %", self.trusted_to
        if highest is None:
            return f"errors exceed {limit} at the lowest of these speeds and above it"
        speed = self.system.labels.speed_unit.text(highest)
        if self.errors.max() <= ROUND_OFF:
            return f"no error above round-off up to {speed}"
        return f"errors of all coordinates are at most {limit} up to {speed}"

    @property
    def summary(self) -> str:
        """Sentence on the speed up to which the linear model is valid."""
        return f"Linear equations compared with the nonlinear ones: {self.limit}."
