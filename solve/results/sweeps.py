"""Sweeps of several systems over the same speeds, side by side: what a parameter or an option changes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from solve.arrays import Array
from solve.results.contents import Column, Columns, Facts, plain, speeds_of
from solve.results.result import Figure, Result
from solve.results.sweep import Sweep
from solve.system import PeriodicSystem

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

    @cached_property
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
    def whole(self) -> dict[str, Any]:
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
        return {**super().record(), **plain({"speeds": self.speeds, "systems": systems})}

    def facts(self) -> Facts:
        span = self.system.speed_unit.span(self.speeds.min(), self.speeds.max())
        return [("over", f"{len(self.speeds)} speeds from {span}")]
