"""Periodic orbits of one or several systems at many speeds and parameter values; and the speed up to which
the linear model is valid."""

import math
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from solve.arguments import (
    NUMBERS_A_POINT,
    checked_rtol,
    matches_annotations,
    require_integer,
    require_size,
    require_steps,
    unique_names,
)
from solve.arrays import Array
from solve.batch.family import SPEED, SystemFamily
from solve.batch.store import made_folder
from solve.batch.task import task_of
from solve.equations import is_nonlinear, require_bounds
from solve.errors import LinearModelError, MissingValueError, SolveError, ValueOutOfBoundsError, require_name
from solve.labels import in_own_unit, known_quantities, parts_of
from solve.methods.choice import Rule, chosen
from solve.model.model import Model, of_model
from solve.results.points import Kept
from solve.results.sweep import Sweep
from solve.results.sweeps import ACCEPTABLE_ERROR, Sweeps, Validity
from solve.single import periodic
from solve.studies.orbit_sweep import nonlinear_points, rigid_points
from solve.system import PeriodicSystem, of_any_system, of_system, shown_in
from solve.terminal import progress
from solve.units import evenly, speeds_given

Over = str | Sequence[str] | Mapping[str, str | Sequence[float | str] | Array]
"""Type of varied parameters: a mapping from names to values, or strings such as "k1=1e4:9e4:50" and
"k1=10:90:50 kN m/rad"."""


@of_any_system
def sweep(
    system: PeriodicSystem,
    speeds: float | str | Sequence[float | str] | Array | None = None,
    method: str | Rule = "auto",
    steps: int | None = None,
    rtol: float = 1e-8,
    executor: Executor | None = None,
    quantities: Sequence[str] | None = None,
    spectra: Sequence[str] = (),
    harmonics: int = 60,
    engine: str = "auto",
    over: Over | None = None,
    store: str | Path | None = None,
    nonlinear: bool = False,
) -> Sweep:
    """Solve for the periodic orbit at every speed, and store the statistics of each orbit.

    Parameters
    ----------
    system : PeriodicSystem
        System to solve.
    speeds : float, str or sequence of float or str, optional
        Speeds in rad/s, strings with a unit, or one string such as "100:900:81 rpm". If `over` is given, the
        default is the speed of the case.
    method, steps, rtol : optional
        As in `periodic`.
    executor : concurrent.futures.Executor, optional
        Executor that computes chunks of the sweep.
    quantities : sequence of str, optional
        Coordinates and outputs whose statistics are stored, by default all. The model's bounds are checked
        only for these.
    spectra : sequence of str
        Quantities whose amplitudes are stored too.
    harmonics : int
        Highest harmonic of the amplitudes.
    engine : str
        "compiled", "numpy", or "auto" for compiled code if a C compiler is available.
    over : str, sequence of str or mapping of str to values, optional
        Mapping from names of parameters to values, in the model's units or as strings with a unit; or strings
        such as "k1=1e4:9e4:50" and "k1=10:90:50 kN m/rad". Every combination is solved; the speed varies
        fastest.
    store : str or Path, optional
        Folder that keeps completed chunks; the same call resumes from it.
    nonlinear : bool
        Whether to solve the nonlinear equations. The iteration for each orbit starts from the nearest orbit
        already found.

    Returns
    -------
    Sweep
        Statistics of the orbits; NaN with the reason at speeds without a periodic solution.

    Raises
    ------
    SolveError
        A subclass for errors that affect all speeds.

    Examples
    --------
    >>> import solve
    >>> found = sweep(solve.load("cam"), "300:320:3 rpm", quantities=["q3"])
    >>> len(found.speeds)
    3
    """
    require_integer("harmonics", harmonics, 0)
    values = varied_values(over, system)
    given_speeds = speeds_given(_speeds(system, speeds, over))
    system, omegas = shown_in(system, given_speeds[0]), np.array(given_speeds)
    names = known_quantities(system, quantities)
    selection = Kept(names, known_quantities(system, spectra), harmonics if spectra else 0)
    if steps is not None:
        require_steps(steps)
    require_size("points", math.prod(map(len, (omegas, *values.values()))), NUMBERS_A_POINT)
    family = SystemFamily(system, [*values, SPEED])
    points = np.column_stack(
        [coordinate.ravel() for coordinate in np.meshgrid(*values.values(), omegas, indexing="ij")]
    )
    for extreme in (points.min(axis=0), points.max(axis=0)) if values else ():
        require_bounds(system, dict(zip(values, extreme.tolist(), strict=False)))
    task, notes = task_of(family, method, rtol, engine, selection, steps)
    if nonlinear and executor is not None:
        raise ValueOutOfBoundsError(
            "a nonlinear sweep starts each orbit from a neighbouring one, in one process; omit the executor"
        )
    if nonlinear:
        results = nonlinear_points(task, points, store)
    elif system.labels.vibrates:
        results = task.solved(task.batch(points), points, executor, store)
    elif store is None:
        results = rigid_points(family, points, selection)
    else:
        raise ValueOutOfBoundsError(
            f"{system.labels.name} has no coordinates, so that its sweep cannot use a store; omit the store"
        )
    parameters = dict(zip(values, points.T, strict=False))
    return Sweep(system, points[:, -1], results, task.request.engine, [*notes, *results.notes], parameters)


def varied_values(given: Over | None, system: PeriodicSystem) -> dict[str, Array]:
    """Return a mapping from names of parameters to their values, in the units of the parameters. Raises
    ValueOutOfBoundsError, UnitError."""
    texts = [given] if isinstance(given, str) else given or ()
    pairs = given.items() if isinstance(given, Mapping) else [_name_and_values(text) for text in texts]
    numbers: dict[str, Array] = {}
    for name, values in pairs:
        if name in numbers:
            raise ValueOutOfBoundsError(f"'over' gives {name} twice; give it once")
        numbers[name] = np.array(parameter_values(name, values, system))
        if not len(numbers[name]) or not np.isfinite(numbers[name]).all():
            raise ValueOutOfBoundsError(
                f"'over' gives {name} = {values!r}; give finite numbers in the model's own units, or a text "
                "such as '1:9:5'"
            )
    return numbers


def parameter_values(
    name: str, values: str | Sequence[float | str] | Array, system: PeriodicSystem | None
) -> list[float]:
    """Return the values of a parameter, in its unit or, without a system, as plain numbers. Return an empty
    list if the values are invalid."""
    texts: Any = ()
    numbers: list[float] = []
    with suppress(ValueError):
        texts = evenly(values, name) if isinstance(values, str) else values
    with suppress(TypeError, ValueError, ValueOutOfBoundsError):
        numbers = [float(value) if system is None else in_own_unit(system, name, value) for value in texts]
    return numbers


def _name_and_values(text: str) -> tuple[str, str]:
    name, equals, values = text.partition("=")
    if not equals:
        raise ValueOutOfBoundsError(f"over is {text!r}; write NAME=A:B:N, such as 'k1=1e4:9e4:50'")
    return name.strip(), values.strip()


def _speeds(system: PeriodicSystem, speeds: Any, over: Over | None) -> Any:
    """Return the speeds of a sweep. If no speeds are given and parameters vary, return the speed of the case.
    Raises MissingValueError."""
    if speeds is not None or not over:
        return speeds
    if system.labels.case_speed is None:
        raise MissingValueError(
            "no speeds given, and the case states none; give speeds, such as '100:900:81 rpm'"
        )
    return system.labels.case_speed


@of_model
def variants(model: Model, name: str, values: Sequence[float | str]) -> dict[str, Model]:
    """Build variants of a model with several values of a parameter or of an option.

    Parameters
    ----------
    model : Model
        Model to vary.
    name : str
        Name of the parameter or option.
    values : sequence of float or str
        Values of a parameter, in its unit or as strings with a unit; or values of an option.

    Returns
    -------
    dict
        Mapping from the string of each value to the model.

    Raises
    ------
    UnknownNameError
        For an unknown name.
    ValueOutOfBoundsError
        For a value that the model does not allow, or that is given twice.

    Examples
    --------
    >>> import solve
    >>> list(variants(solve.load("cam"), "k1", [1e4, 2e4]))
    ['10000', '20000']
    """
    require_name(
        f"parameter or option of {model.labels.name}", name, [*model.parameters, *model.labels.options]
    )
    values = [values] if isinstance(values, str) else list(values)
    if name in model.labels.options:
        models = {str(value): model.varied(options={name: value}) for value in values}
    else:
        numbers = [in_own_unit(model, name, value) for value in values]
        labels = [f"{number:g}" for number in numbers]
        if len(set(labels)) < len(labels):
            labels = [repr(number) for number in numbers]
        models = {label: model.varied({name: number}) for label, number in zip(labels, numbers, strict=True)}
    if len(models) < len(values):
        raise ValueOutOfBoundsError(f"{name} is given the same value twice; give different values")
    return models


@matches_annotations
def sweeps(
    systems: Mapping[str, PeriodicSystem],
    speeds: float | str | Sequence[float | str] | Array,
    quantities: Sequence[str],
    title: str = "",
    method: str | Rule = "auto",
    rtol: float = 1e-6,
    executor: Executor | None = None,
    store: str | Path | None = None,
) -> Sweeps:
    """Sweep several systems over the same speeds, such as variants of one model.

    Parameters
    ----------
    systems : mapping of str to PeriodicSystem
        Mapping from labels to systems.
    speeds : float, str or sequence of float or str
        Speeds in rad/s, strings with a unit, or one string such as "100:900:81 rpm".
    quantities : sequence of str
        Quantities whose statistics are stored: coordinates and outputs that all systems have, or names formed
        by `largest_of`.
    title : str
        Title of the figure.
    method, rtol, executor : optional
        As in `sweep`.
    store : str or Path, optional
        As in `sweep`, with a subfolder for each system.

    Returns
    -------
    Sweeps
        One sweep for each label.

    Raises
    ------
    SolveError
        A subclass for bad input.
    """
    if not systems:
        raise ValueOutOfBoundsError("no systems given; give at least one")
    given_speeds, quantities, by_label = speeds_given(speeds), unique_names(quantities), {}
    with progress.task("curves", len(systems)):
        for number, (label, system) in enumerate(systems.items()):
            names = [name for quantity in quantities for name in parts_of(system, quantity)]
            with progress.subtask("curves"):
                folder = None if store is None else made_folder(store) / str(number)
                by_label[label] = sweep(
                    system, given_speeds, method, None, rtol, executor, names, store=folder
                )
    first = shown_in(next(iter(systems.values())), given_speeds[0])
    return Sweeps(title, np.array(given_speeds), by_label, quantities, first)


@of_system
def validity(
    system: PeriodicSystem,
    speeds: float | str | Sequence[float | str] | Array,
    at: float = ACCEPTABLE_ERROR,
    method: str | Rule = "auto",
    rtol: float = 1e-6,
) -> Validity:
    """Estimate the linearisation error at every speed, and the speed up to which the error is acceptable.

    Parameters
    ----------
    system : Model
        Model with nonlinear equations.
    speeds : float, str or sequence of float or str
        Speeds in rad/s, strings with a unit, or one string such as "100:900:81 rpm".
    at : float
        Largest acceptable relative error.
    method, rtol : optional
        As in `periodic`.

    Returns
    -------
    Validity
        Errors as from `Orbit.linearisation_error`. At speeds without a linear orbit, or at which the
        correction diverges, the error is NaN and the model counts as invalid.

    Raises
    ------
    LinearModelError
        For systems without nonlinear equations.
    SolveError
        Other subclasses for bad input.
    """
    if not 0 < at <= 1:
        raise ValueOutOfBoundsError(
            f"'at' is {at}; allowed: a fraction > 0 and up to 1, such as 0.05 for 5 %"
        )
    if not is_nonlinear(system):
        raise LinearModelError(
            f"{system.labels.name} is linear by construction; validity requires a model with "
            "nonlinear equations"
        )
    given_speeds, rtol, rule = speeds_given(speeds), checked_rtol(rtol), chosen(method)
    system, omegas = shown_in(system, given_speeds[0]), np.sort(given_speeds)
    errors, failures = np.full((len(omegas), system.n), np.nan), {}
    with progress.task("speeds", len(omegas)):
        for position, omega in enumerate(omegas.tolist()):
            with progress.subtask("speeds"):
                try:
                    by_coordinate = periodic(system, omega, rule, rtol=rtol).linearisation_error
                    assert by_coordinate is not None
                    errors[position] = list(by_coordinate.values())
                except SolveError as reason:
                    failures[position] = str(reason)
    return Validity(system, omegas, errors, at, failures)
