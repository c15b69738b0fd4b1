"""Stability over two quantities: spectral radius, verdict, and the boundaries between."""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from solve.arrays import Array
from solve.batch.batch import Batch
from solve.batch.engines import chosen_engine
from solve.batch.family import SPEED, Built, Family, variants
from solve.batch.results import FAILED, Results, Wish, gathered
from solve.batch.spectra import VERDICTS
from solve.batch.spread import Task, spread
from solve.errors import MissingValueError, NoResultError, UnknownNameError, ValueOutOfBoundsError
from solve.loading import Model, load
from solve.methods.choice import chosen
from solve.methods.method import Method
from solve.results.stability import Stability
from solve.single import floquet
from solve.studies.boundaries import KINDS, Judge, Judged, crossings, hidden, judge
from solve.studies.contours import Boundary, Crossings, contours
from solve.system import PeriodicSystem
from solve.units import checked_rtol, checked_tolerance, speed_in_si

_PROMISING = 0.3
"""Of a gap between grid points, the part to which a parabola must bring it down to be followed."""


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


@dataclass(frozen=True)
class Chart:
    """Stability at ny × nx points: y (ny,) over x (nx,), each a parameter in SI units or "speed" (rad/s).

    boundaries: curves between stable and unstable regions. engine: what solved; notes: what is doubtful
    about that.
    """

    x_name: str
    x: Array
    y_name: str
    y: Array
    family: Family
    results: Results
    boundaries: Sequence[Boundary]
    batch: Batch
    tolerance: float
    notes: Sequence[str] = ()

    @property
    def shape(self) -> tuple[int, int]:
        return len(self.y), len(self.x)

    @property
    def system(self) -> PeriodicSystem:
        """A system of the chart: the model as it was given, or the first that could be built."""
        return self.family.example

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
        """(ny, nx): 1 or 0, NaN where a point failed."""
        verdicts = self.results.verdicts
        found = np.where(verdicts == VERDICTS.index("unstable"), 0.0, 1.0)
        return np.where(verdicts == FAILED, np.nan, found).reshape(self.shape)

    @property
    def _judged(self) -> Judged:
        points = np.column_stack([part.ravel() for part in np.meshgrid(self.x, self.y)])
        return Judged.of(points, self.results)

    @property
    def verdicts(self) -> Array:
        """Texts (ny, nx): "asymptotically stable", "stable", "unstable" or "failed"."""
        return np.array([*VERDICTS, "failed"])[self.results.verdicts].reshape(self.shape)

    @property
    def kinds(self) -> Array:
        """Texts (ny, nx): the largest multiplier of unstable points, "+1", "-1" or "complex"."""
        known = self._judged
        return np.where(known.unstable, np.array(KINDS)[known.kinds], "").reshape(self.shape)

    @property
    def failures(self) -> dict[tuple[int, int], str]:
        """Reasons by row and column."""
        return {divmod(at, len(self.x)): text for at, text in self.results.failures.items()}

    def at(self, x: float, y: float) -> Stability:
        """The stability at a point anywhere, with its warnings."""
        system, speed = self.family.system(np.array([x, y]))
        return floquet(system, speed, self.batch.method, rtol=self.batch.rtol)

    def cut(self, x: float | None = None, y: float | None = None) -> Cut:
        """Stability along the line at that x or that y, crossings refined. Raises ValueOutOfBoundsError
        unless one of the two is given."""
        if (x is None) == (y is None):
            raise ValueOutOfBoundsError("a cut needs either x or y; give one of them")
        held, value = (0, float(x)) if x is not None else (1, float(y or 0.0))
        names, values = (self.x_name, self.y_name), (self.x, self.y)[1 - held]
        points = np.empty((len(values), 2))
        points[:, held], points[:, 1 - held] = value, values
        asked = judge(self.batch)
        known, inner = asked(points), np.arange(1, len(points) - 1)
        every = known + hidden(asked, known[inner - 1], known[inner], known[inner + 1])
        lines = np.zeros(len(every.points))
        _, places, kinds = crossings(asked, every, lines, 1 - held, self.scale, self.tolerance)
        found = [(float(place[1 - held]), KINDS[kind]) for place, kind in zip(places, kinds, strict=True)]
        radius = np.where(known.failed, np.nan, np.abs(known.multipliers[:, 0]))
        return Cut(names[1 - held], names[held], value, values, radius, _truth(known), found)

    def cut_at(self, name: str, value: float) -> Cut:
        """The same by the name of the quantity that is held. Raises UnknownNameError."""
        if name not in (self.x_name, self.y_name):
            raise UnknownNameError("quantity of the chart", name, (self.x_name, self.y_name))
        return self.cut(x=value) if name == self.x_name else self.cut(y=value)

    @property
    def scale(self) -> Array:
        """Ranges of x and y."""
        return np.array([np.ptp(self.x), np.ptp(self.y)])

    def plot(self) -> Any:
        """The spectral radius with the named boundaries (matplotlib Figure)."""
        from solve.results.chart_plot import Axis, Curve, chart_figure

        curves = [Curve(boundary.name, boundary.points) for boundary in self.boundaries]
        x, y = Axis(self.x_name, self.x), Axis(self.y_name, self.y)
        return chart_figure(self.system, x, y, self.spectral_radius, curves)


def chart(
    model: str | PeriodicSystem | Callable[..., PeriodicSystem],
    x: Mapping[str, Sequence[float | str] | Array],
    y: Mapping[str, Sequence[float | str] | Array],
    speed: float | str | None = None,
    case: str | None = None,
    method: str | Method = "auto",
    rtol: float = 1e-8,
    tolerance: float = 1e-9,
    boundaries: bool = True,
    progress: Callable[[int], None] | None = None,
    engine: str = "auto",
    executor: Executor | None = None,
) -> Chart:
    """Stability over two quantities, each {name: values}: parameters in SI units, or "speed".

    model: a name or path, a system (a generated one varies in its parameters, any other in its speed), or
    a function that builds a system from the two values by name. speed: where it is not among the two, by
    default that of the case. Boundaries are found between the points to `tolerance` of the range of the
    values, thin unstable tongues between stable points among them. progress is told the number of points
    solved so far. engine: as in `sweep`. With an executor parts of the grid are handed to it. Raises
    SolveError subclasses for bad input; a point that fails, such as a linkage that cannot turn, is NaN with
    its reason, and boundaries end beside it.
    """
    (x_name, xs), (y_name, ys) = _axis("x", x), _axis("y", y)
    if x_name == y_name:
        raise ValueOutOfBoundsError(f"x and y are both {x_name}; vary two different quantities")
    points = np.column_stack([part.ravel() for part in np.meshgrid(xs, ys)])
    family = _family(model, (x_name, y_name), points, speed, case)
    _, notes = chosen_engine(engine)
    task = Task(family, chosen(method), engine, checked_rtol(rtol), Wish(warnings=False))
    batch = task.batch(points)
    if executor is None:
        results = gathered(batch, points, task.wish, progress)
    else:
        results = spread(task, points, executor, progress)
    if (results.verdicts == FAILED).all():
        reason = next(iter(results.failures.values()))
        raise NoResultError(f"none of the {len(points)} points gives a result: {reason}")
    made = Chart(x_name, xs, y_name, ys, family, results, [], batch, checked_tolerance(tolerance), notes)
    if not boundaries:
        return made
    solved = [len(points)]

    def count(more: int) -> None:
        solved[0] += more
        if progress:
            progress(solved[0])

    return replace(made, boundaries=_boundaries(made, made._judged, judge(batch, count)))


def _truth(known: Judged) -> Array:
    """Stability (k,) as 1 or 0, NaN where a point failed."""
    return np.where(known.failed, np.nan, known.stable)


def _axis(which: str, given: Mapping[str, Sequence[float | str] | Array]) -> tuple[str, Array]:
    if len(given) != 1:
        raise ValueOutOfBoundsError(
            f"{which} has {len(given)} quantities; give one, such as {{'speed': speeds}}"
        )
    ((name, values),) = given.items()
    numbers = (
        [speed_in_si(value) for value in values] if name == SPEED else [float(value) for value in values]
    )
    found = np.array(numbers)
    if found.ndim != 1 or len(found) < 2 or not np.isfinite(found).all() or (np.diff(found) <= 0).any():
        raise ValueOutOfBoundsError(
            f"values of {name} must be at least two finite numbers, each larger than the one before"
        )
    return name, found


def _family(
    model: str | PeriodicSystem | Callable[..., PeriodicSystem],
    names: tuple[str, str],
    points: Array,
    speed: float | str | None,
    case: str | None,
) -> Family:
    if isinstance(model, str):
        model = load(model, case)
    elif case is not None:
        raise ValueOutOfBoundsError(
            f"case '{case}' is for the name of a model; a system has its numbers already"
        )
    omega = speed if speed is not None or not isinstance(model, Model) else model.case_speed
    if omega is None and SPEED not in names:
        raise MissingValueError("no speed given; give one, or make it one of the two quantities")
    omega = None if omega is None else speed_in_si(omega)
    if isinstance(model, Model):
        model.require_motion()
        found = variants(model, names, omega)
        for extreme in (points[0], points[-1]):
            values = dict(zip(names, map(float, extreme), strict=True))
            model.require_bounds({name: value for name, value in values.items() if name != SPEED})
        return found
    if isinstance(model, PeriodicSystem):
        raise UnknownNameError(f"quantity of {model.name}", next(n for n in names if n != SPEED), [SPEED])
    return Built(model, names, points, omega)


def _boundaries(chart: Chart, known: Judged, asked: Judge) -> list[Boundary]:
    ny, nx = chart.shape
    index = np.arange(ny * nx).reshape(ny, nx)
    return contours(
        (chart.x, chart.y),
        _truth(known).reshape(ny, nx),
        _lines(chart, known, asked, index, along=0),
        _lines(chart, known, asked, index.T, along=1),
        lambda points: ~asked(points).unstable,
    )


def _lines(chart: Chart, known: Judged, asked: Judge, index: Array, along: int) -> Crossings:
    """Crossings of the lines whose points the rows of the index name."""
    inner = (index[:, :-2].ravel(), index[:, 1:-1].ravel(), index[:, 2:].ravel())
    further = hidden(asked, *(known[part] for part in inner), promising=_PROMISING)
    across = (chart.y, chart.x)[along]
    every = known + further
    lines = np.searchsorted(across, every.points[:, 1 - along])
    line, places, kinds = crossings(asked, every, lines, along, chart.scale, chart.tolerance)
    return Crossings(line, places[:, along], kinds)
