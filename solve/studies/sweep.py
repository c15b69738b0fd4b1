"""The periodic solution over many speeds, a row of figures a speed."""

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from typing import Any, overload

import numpy as np

from solve.arrays import Array
from solve.batch.engines import chosen_engine
from solve.batch.family import over_speed
from solve.batch.figures import FIGURES
from solve.batch.results import FAILED, METHODS, Results, Wish, gathered
from solve.batch.spectra import VERDICTS
from solve.batch.spread import Task, spread
from solve.errors import StepsError, UnknownNameError
from solve.methods.choice import chosen
from solve.methods.method import Method
from solve.period.signal import Statistics
from solve.results.stability import ErrorEstimate
from solve.studies.boundaries import KINDS, Judged
from solve.system import PeriodicSystem
from solve.units import checked_rtol, speeds_given

NOTHING = Statistics(*7 * (float("nan"),))
UNKNOWN = ErrorEstimate(float("nan"), float("nan"))
"""Figures and errors of a point that failed."""


@dataclass(frozen=True)
class Point:
    """One speed of a sweep: what is kept of its orbit, or the reason why there is none.

    statistics: of coordinates and outputs by name. multipliers: resolved ones, falling in modulus.
    error: the reason; figures are then NaN.
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
    multipliers: Sequence[complex] = ()

    @property
    def stable(self) -> bool | None:
        return None if self.error else self.verdict != "unstable"


@dataclass(frozen=True)
class Sweep:
    """The results of many speeds (rad/s), in the order given. engine: what solved them; notes: what is
    doubtful about that."""

    system: PeriodicSystem
    speeds: Array
    results: Results
    engine: str = ""
    notes: Sequence[str] = ()

    @property
    def points(self) -> Sequence[Point]:
        """One a speed, made when it is looked at."""
        return _Points(self.speeds, self.results)

    @property
    def spectral_radius(self) -> Array:
        """Largest |ρ| a speed; NaN where the point failed."""
        return self.results.spectral_radius

    @property
    def multipliers(self) -> Array:
        """(P, 2n), falling in modulus; zero where unresolved, NaN where the point failed."""
        return self.results.multipliers

    def figures(self, name: str, figure: str = "max_abs") -> Array:
        """max, min, max_abs, mean or rms of a coordinate or output a speed; NaN where the point failed.

        Raises UnknownNameError.
        """
        if name not in self.results.wish.names:
            raise UnknownNameError("coordinate or output", name, self.results.wish.names)
        if figure not in FIGURES:
            raise UnknownNameError("figure", figure, FIGURES)
        return self.results.figures[:, self.results.wish.names.index(name), FIGURES.index(figure)]

    def spectrum(self, name: str) -> Array:
        """Amplitudes (P, harmonics + 1) of a quantity whose spectrum the sweep was asked for.

        Raises UnknownNameError.
        """
        known = self.results.wish.spectra
        if name not in known:
            raise UnknownNameError("spectrum", name, known)
        return self.results.amplitudes[:, known.index(name)]

    @property
    def unstable(self) -> list[tuple[float, float, str]]:
        """Runs of neighbouring unstable speeds: from, to (rad/s, half way to stable neighbours, not beyond
        the last known speed beside failed ones) and the kind of the largest multiplier; `bands` refines
        their edges."""
        order = np.argsort(self.speeds)
        speeds, known = self.speeds[order], Judged.of(self.speeds[order, None], self.results[order])
        kinds = np.where(known.unstable, known.kinds, -1)
        between = np.where(known.failed[:-1], speeds[1:], (speeds[1:] + speeds[:-1]) / 2)
        between = np.where(known.failed[1:], speeds[:-1], between)
        middles = np.concatenate((speeds[:1], between, speeds[-1:]))
        starts = np.concatenate(([0], np.flatnonzero(np.diff(kinds)) + 1, [len(kinds)]))
        return [
            (float(middles[first]), float(middles[last]), KINDS[kinds[first]])
            for first, last in itertools.pairwise(starts)
            if kinds[first] >= 0
        ]

    def plot(self, names: Sequence[str] | None = None, figure: str = "max_abs") -> Any:
        """Response over speed with its maxima, the spectral radius below, unstable speeds shaded
        (matplotlib Figure). Raises UnknownNameError."""
        from solve.results.sweep_plot import sweep_figure

        responses = {name: self.figures(name, figure) for name in names or self.system.coordinates}
        return sweep_figure(self.system, self.speeds, responses, self.spectral_radius, figure, self.unstable)

    def waterfall(self, name: str) -> Any:
        """The spectrum of a quantity over speed (matplotlib Figure). Raises UnknownNameError for one whose
        spectrum the sweep was not asked for."""
        from solve.results.sweep_plot import waterfall_figure

        return waterfall_figure(self.system, self.speeds, name, self.spectrum(name))


@dataclass(frozen=True)
class _Points(Sequence[Point]):
    speeds: Array
    results: Results

    def __len__(self) -> int:
        return len(self.speeds)

    def __iter__(self) -> Iterator[Point]:
        return map(self._point, range(len(self)))

    @overload
    def __getitem__(self, at: int) -> Point: ...

    @overload
    def __getitem__(self, at: slice) -> list[Point]: ...

    def __getitem__(self, at: int | slice) -> Point | list[Point]:
        chosen = range(len(self))[at]
        return self._point(chosen) if isinstance(chosen, int) else list(map(self._point, chosen))

    def _point(self, at: int) -> Point:
        results, speed = self.results, float(self.speeds[at])
        if results.verdicts[at] == FAILED:
            return Point(speed, error=results.failures[at])
        figures = (Statistics(*row.tolist()) for row in results.figures[at])
        multipliers = results.multipliers[at]
        return Point(
            speed,
            dict(zip(results.wish.names, figures, strict=True)),
            float(results.spectral_radius[at]),
            VERDICTS[results.verdicts[at]],
            METHODS[results.methods[at]],
            int(results.steps[at]),
            ErrorEstimate(*results.errors[at].tolist()),
            results.warnings.get(at, ()),
            multipliers=multipliers[multipliers != 0].tolist(),
        )


def sweep(
    system: PeriodicSystem,
    speeds: float | str | Sequence[float | str] | Array,
    method: str | Method = "auto",
    steps: int | None = None,
    rtol: float = 1e-8,
    executor: Executor | None = None,
    progress: Callable[[int], None] | None = None,
    quantities: Sequence[str] | None = None,
    spectra: Sequence[str] = (),
    harmonics: int = 60,
    engine: str = "auto",
) -> Sweep:
    """`periodic` at every speed (rad/s, texts with unit, or one text such as "100:900:81 rpm"), keeping
    the figures of each.

    quantities: the coordinates and outputs to keep, by default all; bounds on outputs that are not kept
    are not checked. spectra: those whose amplitudes are kept too, of so many `harmonics`. A speed at
    which no periodic solution is found gives NaN and the reason; the sweep goes on. With an executor
    parts of the sweep are handed to it; progress is told the number of points done. engine: "compiled",
    "numpy", or "auto" for the first where there is a C compiler. Raises SolveError subclasses for what no
    speed could mend.
    """
    omegas = np.array(speeds_given(speeds))
    known = (*system.coordinates, *system.outputs)
    for name in (*(quantities or ()), *spectra):
        if name not in known:
            raise UnknownNameError(f"coordinate or output of {system.name}", name, known)
    names = tuple(known if quantities is None else dict.fromkeys(quantities))
    wish = Wish(names, tuple(spectra), harmonics if spectra else 0)
    if steps is not None and not (isinstance(steps, int | np.integer) and steps >= 1):
        raise StepsError(
            f"steps is {steps!r}; allowed: whole numbers of at least 1; leave --steps out to have it chosen"
        )
    used, notes = chosen_engine(engine)
    points, family = omegas[:, None], over_speed(system)
    task = Task(family, chosen(method), engine, checked_rtol(rtol), wish, steps, orbit=True)
    if executor is None:
        results = gathered(task.batch(points), points, wish, progress)
    else:
        results = spread(task, points, executor, progress)
    return Sweep(system, omegas, results, used.name, notes)
