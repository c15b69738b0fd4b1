"""The periodic solution over many speeds, a row of figures a speed."""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from solve.arrays import Array
from solve.errors import SolveError, UnknownNameError
from solve.floquet import ErrorEstimate
from solve.methods.method import Method
from solve.periodic import periodic
from solve.signal import Statistics
from solve.system import PeriodicSystem
from solve.units import speed_in_si

NOTHING = Statistics(*7 * (float("nan"),))
UNKNOWN = ErrorEstimate(float("nan"), float("nan"))
"""Figures and errors of a point that failed."""


@dataclass(frozen=True)
class Point:
    """One speed of a sweep: what is kept of its orbit, or the reason why there is none.

    statistics: of coordinates and outputs by name. error: the reason; figures are then NaN.
    """

    speed: float
    statistics: Mapping[str, Statistics] = field(default_factory=dict)
    spectral_radius: float = float("nan")
    verdict: str = ""
    method: str = ""
    steps: int = 0
    error_estimate: ErrorEstimate = UNKNOWN
    warnings: Sequence[str] = ()
    error: str | None = None

    @property
    def stable(self) -> bool | None:
        return None if self.error else self.verdict != "unstable"


@dataclass(frozen=True)
class Sweep:
    """points: one a speed, in the order given."""

    system: PeriodicSystem
    points: Sequence[Point]

    @property
    def speeds(self) -> Array:
        """Speeds in rad/s."""
        return np.array([point.speed for point in self.points])

    @property
    def spectral_radius(self) -> Array:
        """Largest |ρ| a speed; NaN where the point failed."""
        return np.array([point.spectral_radius for point in self.points])

    def figures(self, name: str, figure: str = "max_abs") -> Array:
        """max, min, max_abs, mean or rms of a coordinate or output a speed; NaN where the point failed.

        Raises UnknownNameError.
        """
        known = (*self.system.coordinates, *self.system.outputs)
        if name not in known:
            raise UnknownNameError("coordinate or output", name, known)
        if figure not in Statistics.__dataclass_fields__:
            raise UnknownNameError("figure", figure, Statistics.__dataclass_fields__)
        return np.array([getattr(point.statistics.get(name, NOTHING), figure) for point in self.points])

    def plot(self, names: Sequence[str] | None = None) -> Any:
        """Response over speed with the spectral radius below (matplotlib Figure)."""
        from solve.output.sweep_plot import sweep_figure

        shown = names or self.system.coordinates
        responses = {name: self.figures(name) for name in shown}
        return sweep_figure(self.system, self.speeds, responses, self.spectral_radius)


def sweep(
    system: PeriodicSystem,
    speeds: Sequence[float | str] | Array,
    method: str | Method = "auto",
    steps: int | None = None,
    rtol: float = 1e-8,
    executor: Executor | None = None,
    progress: Callable[[int], None] | None = None,
) -> Sweep:
    """`periodic` at every speed (rad/s, or texts with unit), keeping the figures of each.

    A speed at which no periodic solution is found gives NaN and the reason; the sweep goes on. With an
    executor the speeds are handed to it; progress is told the number of points done. Raises SolveError
    subclasses for what no speed could mend.
    """
    omegas = [speed_in_si(speed) for speed in speeds]
    solve_point = partial(_point, system, method=method, steps=steps, rtol=rtol)
    results = executor.map(solve_point, omegas) if executor else map(solve_point, omegas)
    points = []
    for done, point in enumerate(results, start=1):
        points.append(point)
        if progress:
            progress(done)
    return Sweep(system, points)


def _point(
    system: PeriodicSystem, speed: float, method: str | Method, steps: int | None, rtol: float
) -> Point:
    try:
        orbit = periodic(system, speed, method, steps, rtol)
        statistics = {name: orbit.statistics(name) for name in (*system.coordinates, *system.outputs)}
    except SolveError as failure:
        return Point(speed, error=str(failure))
    return Point(
        speed,
        statistics,
        orbit.spectral_radius,
        orbit.verdict,
        orbit.method,
        orbit.steps,
        orbit.error_estimate,
        orbit.warnings,
    )
