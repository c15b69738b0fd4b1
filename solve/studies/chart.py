"""Stability as a function of two quantities: spectral radius, verdict, and stability boundaries."""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from solve.arguments import NUMBERS_A_POINT, checked_tolerance, matches_annotations, require_size
from solve.arrays import Array
from solve.batch.batch import Batch
from solve.batch.family import SPEED, BuiltFamily, Family, SystemFamily
from solve.batch.gathering import gathered
from solve.batch.task import task_of
from solve.contracts import Statistics
from solve.equations import exceeded_limits, judged_quantities, require_bounds
from solve.errors import LinearModelError, MissingValueError, NoResultError, ValueOutOfBoundsError, counted
from solve.labels import require_motion
from solve.loading import load
from solve.methods.choice import Rule
from solve.model.model import Model
from solve.period.named import EXPONENT, PHASE, RHO, Named
from solve.proof.prove import prove_boxes, require_provable
from solve.results.chart import BoundaryCurve, Chart, Cut
from solve.results.points import KINDS, Kept, PointResults
from solve.results.stability import Stability
from solve.single import floquet
from solve.studies.boundaries import BoundarySearch, Lines
from solve.studies.constant_coefficients import constant_coefficients
from solve.studies.contours import contours
from solve.studies.point_values import kept_for, values_of
from solve.studies.stability_samples import StabilitySamples, evaluator
from solve.studies.sweep import parameter_values
from solve.studies.tongues import find_narrow_tongues, near_ends
from solve.system import PeriodicSystem, multiplier_count, shown_in
from solve.terminal import progress
from solve.units import GivenSpeed, ShownUnit, speed_in_si, speeds_given

_OF_STABILITY = "multipliers", "errors", "verdicts", "steps", "methods", "rigid"
"""Names of the result arrays that describe stability."""

_PREDICTED = 0.3
"""A minimum of the distance from instability is searched for only if a parabola predicts a value below this
fraction of the distance at the grid point. Chosen by judgement: on a coarse grid, a larger fraction gives
more false minima."""


@matches_annotations
def chart(
    model: str | PeriodicSystem | Callable[..., PeriodicSystem],
    x: str | Mapping[str, str | Sequence[float | str] | Array],
    y: str | Mapping[str, str | Sequence[float | str] | Array],
    speed: float | str | None = None,
    case: str | int | None = None,
    method: str | Rule = "auto",
    rtol: float = 1e-8,
    tolerance: float = 1e-9,
    boundaries: bool = True,
    engine: str = "auto",
    executor: Executor | None = None,
    store: str | Path | None = None,
    of: str | None = None,
    prove: bool = False,
) -> Chart:
    """Compute stability as a function of two quantities, with the boundaries between stable and unstable
    regions.

    Parameters
    ----------
    model : str, PeriodicSystem or callable
        Name or path of a model; a system; or a function that builds a system from the two values, which are
        its keyword arguments. The parameters of a system can be varied only if its equations are generated;
        of any other system, only the speed can be varied.
    x, y : str or mapping of str to values
        Parameter, or "speed", with its values: a mapping {name: values}, with values in the model's unit or
        as strings with a unit; or a string such as "delta=0:10:60", "k1=10:90:50 kN m/rad" or
        "speed=100:400:40 rpm".
    speed : float or str, optional
        Speed, if neither `x` nor `y` is the speed; by default the speed of the case.
    case : str or int, optional
        Case of a model given by name.
    method, rtol : optional
        As in `periodic`.
    tolerance : float
        Tolerance of boundaries, relative to the range of the values.
    boundaries : bool
        Whether to locate boundaries, including thin unstable tongues between stable points.
    engine : str
        "auto", "compiled" or "numpy".
    executor : concurrent.futures.Executor, optional
        Executor that computes chunks of the grid.
    store : str or Path, optional
        Folder that keeps completed chunks; the same call resumes from it.
    of : str, optional
        Quantity shown in the chart, such as "q3.max_abs" or "rho1.re".
    prove : bool
        Whether to prove verdicts on boxes that cover the chart. This requires a model with generated
        matrices, and python-flint.

    Returns
    -------
    Chart
        Verdicts, spectral radii and boundaries. Points without a result, for example because a linkage cannot
        rotate fully, are NaN with the reason. Boundaries end next to these points.

    Raises
    ------
    SolveError
        A subclass for bad input.

    Examples
    --------
    >>> found = chart("mathieu", "delta=0.5:1.5:5", "epsilon=0:1:3", boundaries=False)
    >>> found.shape
    (3, 5)
    """
    if isinstance(model, str):
        loaded: PeriodicSystem = load(model, case)
        model, case = loaded, None
    labels = model if isinstance(model, PeriodicSystem) else None
    (x_name, across), (y_name, upwards) = _axis("x", x, labels), _axis("y", y, labels)
    xs, ys = np.array(across), np.array(upwards)
    provable = _provable(model) if prove else None
    if isinstance(model, PeriodicSystem):
        model = shown_in(shown_in(model, across[0]), upwards[0])
    if x_name == y_name:
        raise ValueOutOfBoundsError(f"x and y are both {x_name}; vary two different quantities")
    require_size("points", len(xs) * len(ys), NUMBERS_A_POINT)
    points = np.column_stack([coordinate.ravel() for coordinate in np.meshgrid(xs, ys)])
    family = _family(model, (x_name, y_name), points, speed, case)
    quantity = None if of is None else _shown_quantity(family.example, of)
    of_orbit = quantity is not None and quantity.of_orbit
    stability, notes = task_of(family, method, rtol, engine, Kept(warnings=False), orbit=False)
    task = stability
    if quantity is not None and of_orbit:
        kept = kept_for([quantity], judged_quantities(family.example))
        task, _ = task_of(family, method, rtol, engine, kept)
    batch = stability.batch(points)
    with progress.steps(3) as step:
        step("the grid")
        solved_points = task.solved(task.batch(points), points, executor, store)
        results = _stability(solved_points, batch, points) if of_orbit else solved_points
        results.require_any()
        solved_points.require_any()
        constant = constant_coefficients(batch)
        evaluate = constant.evaluate if constant else evaluator(batch)
        search = BoundarySearch(evaluate, np.array([np.ptp(xs), np.ptp(ys)]), checked_tolerance(tolerance))
        solve_cut = partial(_cut, search, (x_name, y_name), (xs, ys))
        system = shown_in(shown_in(family.example, across[0]), upwards[0])
        at = partial(_stability_at, batch, system.labels.speed_unit)
        solved = Chart(x_name, xs, y_name, ys, system, results, [], at, solve_cut, [*notes, *results.notes])
        if quantity is not None:
            values = values_of(quantity, solved_points, family.speeds(points), system.period)
            beyond = _orbit_warnings(system, solved_points, results) if of_orbit else []
            solved = replace(solved, of=quantity, values=values.reshape(solved.shape), beyond=beyond)
        if provable is not None and isinstance(family, SystemFamily):
            ranges = (float(xs[0]), float(xs[-1])), (float(ys[0]), float(ys[-1]))
            boxes = prove_boxes(provable, (x_name, y_name), ranges, family.speed, executor)
            solved = replace(solved, proved=boxes)
        if not boundaries:
            return solved
        samples = constant.evaluate(points) if constant else StabilitySamples.from_results(points, results)
        return replace(solved, boundaries=_boundaries(search, solved, samples, step))


def _provable(model: object) -> Model:
    """Return `model` if verdicts on boxes of parameters can be proved for it. Raises LinearModelError
    otherwise."""
    if not isinstance(model, PeriodicSystem):
        raise LinearModelError("'prove' requires a model, not a function that builds systems")
    require_provable(model)
    if not isinstance(model, Model):
        raise LinearModelError(
            f"{model.labels.name} has no generated equations, which 'prove' requires; omit 'prove'"
        )
    return model


def _stability(orbits: PointResults, batch: Batch, points: Array) -> PointResults:
    """Return the stability at points (P, 2), taken from the orbits. Points without an orbit, for example at
    resonance, are solved for stability alone."""
    results = PointResults.blank(len(points), multiplier_count(batch.family.example), Kept(warnings=False))
    for name in _OF_STABILITY:
        getattr(results, name)[:] = getattr(orbits, name)
    failed = np.flatnonzero(orbits.failed)
    if len(failed):
        results.insert(failed, gathered(batch, points[failed], results.kept))
    return results


def _orbit_warnings(system: PeriodicSystem, orbits: PointResults, stability: PointResults) -> list[str]:
    """Return warnings about the orbits: the number of points that have a verdict but no orbit, with the
    reason; and the bounds of the model that orbits violate, with the largest excess."""
    names, valid_figures = orbits.kept.names, orbits.figures[~orbits.failed]
    reasons = [text for at, text in orbits.failures.items() if at not in stability.failures]
    of = f"of {len(orbits)} points"
    without = [f"{counted(len(reasons), f'{of} has', f'{of} have')} no orbit: {text}" for text in reasons[:1]]
    if not len(valid_figures):
        return without
    least, largest = valid_figures.min(axis=0), valid_figures.max(axis=0)
    figures = {name: Statistics(*largest[k])._replace(min=least[k][1]) for k, name in enumerate(names)}
    return [*without, *(f"at some points {text}" for text in exceeded_limits(system, figures))]


def _shown_quantity(system: PeriodicSystem, text: str) -> Named:
    """Quantity whose value a chart shows at each point. Raises ValueOutOfBoundsError if it is a phase angle
    or a complex number."""
    quantity = Named.parse(system, text)
    if quantity.figure == PHASE or (quantity.subject in (RHO, EXPONENT) and not quantity.figure):
        raise ValueOutOfBoundsError(
            f"a chart cannot show {quantity.text}; give a quantity with one real value per point, such as "
            "spectral_radius, rho1.re or a coordinate's max_abs or harmonic5"
        )
    return quantity


def _stability_at(batch: Batch, unit: ShownUnit, x: float, y: float) -> Stability:
    system, speed = batch.family.system(np.array([x, y]))
    return floquet(system, GivenSpeed(speed, unit), batch.method, rtol=batch.request.rtol)


def _cut(
    search: BoundarySearch, names: tuple[str, str], axes: tuple[Array, Array], held: int, value: float
) -> Cut:
    """Return a cut along one axis. The quantity with the index `held` is fixed at `value`. Raises
    ValueOutOfBoundsError if `value` is not finite, and NoResultError if no point has a result."""
    if not np.isfinite(value):
        raise ValueOutOfBoundsError(f"the cut is at {names[held]} = {value:g}; give a finite number")
    along, values = 1 - held, axes[1 - held]
    points = np.empty((len(values) + 2, 2))
    points[:, held], points[:, along] = value, np.append(values, near_ends(values))
    samples = search.evaluate(points)
    evaluated, samples = samples[: len(values)], samples[np.argsort(points[:, along])]
    if evaluated.failed.all():
        raise NoResultError(
            f"no point of the cut at {names[held]} = {value:g} has a result; choose another value"
        )
    samples += find_narrow_tongues(search.evaluate, samples, np.arange(1, len(samples) - 1))
    (crossings,) = search.crossings(Lines(samples, np.zeros(len(samples.points)), along))
    found = [(at, KINDS[kind]) for at, kind in zip(crossings.place.tolist(), crossings.kind, strict=True)]
    radius = np.where(evaluated.failed, np.nan, np.abs(evaluated.multipliers[:, 0]))
    return Cut(names[along], names[held], value, values, radius, _stable_as_number(evaluated), found)


def _stable_as_number(known: StabilitySamples) -> Array:
    """Return 1 for each stable sample (k,), 0 for each unstable one, and NaN for each failed one."""
    return np.where(known.failed, np.nan, known.stable)


def _axis(
    which: str,
    given: str | Mapping[str, str | Sequence[float | str] | Array],
    system: PeriodicSystem | None,
) -> tuple[str, Sequence[float]]:
    """Return the name and the ascending values of the quantity on an axis, in the unit of the parameter.
    Without a system, which declares units, values must be plain numbers. Raises ValueOutOfBoundsError,
    UnitError."""
    if isinstance(given, str):
        name, _, text = given.partition("=")
        given = {name.strip(): text.strip()}
    if not isinstance(given, Mapping) or len(given) != 1:
        raise ValueOutOfBoundsError(
            f"{which} is {given!r}; give one quantity, such as {{'speed': speeds}} or 'delta=0:10:60'"
        )
    ((name, values),) = given.items()
    numbers = speeds_given(values) if name == SPEED else parameter_values(name, values, system)
    array = np.array(numbers)
    if array.ndim != 1 or len(array) < 2 or not np.isfinite(array).all() or (np.diff(array) <= 0).any():
        raise ValueOutOfBoundsError(
            f"values of {name} must be at least two finite numbers, in increasing order; strings with a unit "
            "require a model that declares units"
        )
    return name, numbers


def _family(
    model: PeriodicSystem | Callable[..., PeriodicSystem],
    names: tuple[str, str],
    points: Array,
    speed: float | str | None,
    case: str | int | None,
) -> Family:
    """Return the family of systems at the points (P, 2): variations of one model, or systems built by a
    function."""
    if case is not None:
        raise ValueOutOfBoundsError(
            f"case is '{case}', but a system already has values of its parameters; omit the case"
        )
    if not isinstance(model, PeriodicSystem):
        return BuiltFamily(model, names, points, _speed_unless_varied(speed, names))
    omega = _speed_unless_varied(model.labels.case_speed if speed is None else speed, names)
    require_motion(model)
    family = SystemFamily(model, names, omega)
    for extreme in (points[0], points[-1]):
        values = dict(zip(names, map(float, extreme), strict=True))
        require_bounds(model, {name: value for name, value in values.items() if name != SPEED})
    return family


def _speed_unless_varied(speed: float | str | None, names: tuple[str, str]) -> float | None:
    if speed is None and SPEED not in names:
        raise MissingValueError("no speed given; give one, or make it one of the two quantities")
    return None if speed is None else speed_in_si(speed)


def _continuations(found: Array, axes: tuple[Array, Array], along: int, searched: Array) -> Array:
    """Return the indices of the grid points at which a tongue found at the points `found` (k, 2) may continue
    on neighbouring lines. Grid points at the ends of a line are excluded. `searched` (lines, points) marks
    the points at which tongues were searched for or found, and is updated in place."""
    line = np.searchsorted(axes[1 - along], found[:, 1 - along])
    right = np.searchsorted(axes[along], found[:, along]) - 1
    at, near = np.zeros_like(searched), np.zeros_like(searched)
    for across in range(-2, 2):
        at[line, np.clip(right + across, 0, searched.shape[1] - 1)] = True
    near[1:] |= at[:-1]
    near[:-1] |= at[1:]
    near &= ~(searched | at)
    searched |= at | near
    return np.flatnonzero(near)


def _boundaries(
    search: BoundarySearch, chart: Chart, known: StabilitySamples, step: Callable[[str], None]
) -> list[BoundaryCurve]:
    axes, index = (chart.x, chart.y), np.arange(len(known.points)).reshape(chart.shape)

    def lines(index: Array, along: int) -> Lines:
        """Return the lines through the grid points with the indices `index`. Unstable points that are found
        between grid points are included in the lines."""
        middle, stride = index[:, 1:-1], (1, len(chart.x))[along]
        tongues = find_narrow_tongues(search.evaluate, known, middle.ravel(), stride, _PREDICTED)
        samples, searched = known + tongues, np.zeros(middle.shape, dtype=bool)
        while len(tongues.points):
            near = _continuations(tongues.points, axes, along, searched)
            tongues = find_narrow_tongues(search.evaluate, known, middle.ravel()[near], stride)
            samples = samples + tongues
        return Lines(samples, np.searchsorted(axes[1 - along], samples.points[:, 1 - along]), along)

    step("narrow tongues")
    across, upwards = lines(index, 0), lines(index.T, 1)
    step("boundaries")
    rows, columns = search.crossings(across, upwards)
    stable = _stable_as_number(known).reshape(chart.shape)
    return contours(axes, stable, rows, columns, lambda points: ~search.evaluate(points).unstable)
