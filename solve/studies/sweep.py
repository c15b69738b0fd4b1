"""The periodic solution over many speeds and values of parameters, a row of figures a point; of one system,
or of several beside each other, such as one model with several lengths."""

import math
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

import numpy as np

from solve.arguments import NUMBERS_A_POINT, require_size, require_steps, unique_names
from solve.arrays import Array
from solve.batch.family import SPEED, SystemFamily
from solve.batch.store import made_folder
from solve.batch.task import task_of
from solve.errors import MissingValueError, ValueOutOfBoundsError, require_name
from solve.methods.choice import Rule
from solve.model.model import Model, of_model
from solve.results.points import Kept
from solve.results.sweep import Sweep
from solve.results.sweeps import Sweeps
from solve.studies.rigid import rigid_points
from solve.system import PeriodicSystem, of_any_system
from solve.terminal import progress
from solve.units import evenly, speeds_given

Over = str | Sequence[str] | Mapping[str, str | Sequence[float | str] | Array]
"""Values of parameters by name, or texts such as "k1=1e4:9e4:50" and "k1=10:90:50 kN m/rad"."""


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
) -> Sweep:
    """`periodic` at every speed (rad/s, texts with unit, or one text such as "100:900:81 rpm"), keeping the
    statistics of each orbit.

    over: values of parameters in the model's units, or texts with unit: {name: values}, or texts such as
    "k1=1e4:9e4:50" and "k1=10:90:50 kN m/rad". Every combination is solved, with the speed varying fastest;
    without speeds, at that of the case. quantities: coordinates and outputs to keep, by default all; bounds
    on outputs that are not kept are not checked. spectra: quantities whose amplitudes are kept too, up to
    `harmonics`. A speed without a periodic solution gives NaN and the reason, and the sweep continues. An
    executor computes parts of the sweep. store: a folder that keeps completed parts; the same call resumes
    from it. engine: "compiled", "numpy", or "auto" for compiled code if a C compiler is available. Raises
    SolveError subclasses for errors that affect all speeds.
    """
    values = _over(over, system)
    given = speeds_given(_speeds(system, speeds, over))
    system, omegas = system.shown_in(given[0]), np.array(given)
    names = system.known_quantities(quantities)
    kept = Kept(names, system.known_quantities(spectra), harmonics if spectra else 0)
    if steps is not None:
        require_steps(steps)
    require_size("points", math.prod(map(len, (omegas, *values.values()))), NUMBERS_A_POINT)
    family = SystemFamily(system, [*values, SPEED])
    points = np.column_stack([each.ravel() for each in np.meshgrid(*values.values(), omegas, indexing="ij")])
    for extreme in (points.min(axis=0), points.max(axis=0)) if values else ():
        system.require_bounds(dict(zip(values, extreme.tolist(), strict=False)))
    task, notes = task_of(family, method, rtol, engine, kept, steps)
    if system.vibrates:
        results = task.solved(task.batch(points), points, executor, store)
    elif store is None:
        results = rigid_points(family, points, kept)
    else:
        raise ValueOutOfBoundsError(
            f"{system.name} has no coordinates, and its sweep uses no store; omit the store"
        )
    parameters = dict(zip(values, points.T, strict=False))
    return Sweep(system, points[:, -1], results, task.request.engine, [*notes, *results.notes], parameters)


def _over(given: Over | None, system: PeriodicSystem) -> dict[str, Array]:
    """Values of parameters in their own units by name. Raises ValueOutOfBoundsError, UnitError."""
    texts = [given] if isinstance(given, str) else given or ()
    pairs = given.items() if isinstance(given, Mapping) else [_parted(text) for text in texts]
    found: dict[str, Array] = {}
    for name, values in pairs:
        if name in found:
            raise ValueOutOfBoundsError(f"over gives {name} twice; give it once")
        try:
            each = evenly(values, name) if isinstance(values, str) else values
            numbers = [system.in_own_unit(name, value) for value in each]
        except (TypeError, ValueError):
            numbers = []
        found[name] = np.array(numbers)
        if not numbers or not np.isfinite(found[name]).all():
            raise ValueOutOfBoundsError(
                f"over gives {name} = {values!r}; give finite numbers in the model's own units, or a text "
                "such as '1:9:5'"
            )
    return found


def _parted(text: str) -> tuple[str, str]:
    name, equals, values = text.partition("=")
    if not equals:
        raise ValueOutOfBoundsError(f"over is {text!r}; write NAME=A:B:N, such as 'k1=1e4:9e4:50'")
    return name.strip(), values.strip()


def _speeds(system: PeriodicSystem, speeds: Any, over: Over | None) -> Any:
    """The speeds given; where parameters vary, that of the case by default. Raises MissingValueError."""
    if speeds is not None or not over:
        return speeds
    if system.case_speed is None:
        raise MissingValueError(
            "no speeds given, and the case names none; give some, such as '100:900:81 rpm'"
        )
    return system.case_speed


@of_model
def variants(model: Model, name: str, values: Sequence[float | str]) -> dict[str, Model]:
    """The model with each of several values of a parameter (a number in its own unit, or a text with unit) or
    of an option, by value.

    Raises UnknownNameError, and ValueOutOfBoundsError for a value that the model does not allow.
    """
    require_name(f"parameter or option of {model.name}", name, [*model.parameters, *model.options])
    if name in model.options:
        made = {str(value): model.varied(options={name: value}) for value in values}
    else:
        numbers = [_number(model, name, value) for value in values]
        labels = [f"{number:g}" for number in numbers]
        if len(set(labels)) < len(labels):
            labels = [repr(number) for number in numbers]
        made = {label: model.varied({name: number}) for label, number in zip(labels, numbers, strict=True)}
    if len(made) < len(values):
        raise ValueOutOfBoundsError(f"{name} is given one value twice; give different ones")
    return made


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
    """Each of the systems over the speeds (rad/s, or texts with unit), keeping the figures of some
    coordinates and outputs that all of them have, or that names of `largest_of` stand for. executor, store:
    as in `sweep`, with a folder within for each of the systems. Raises SolveError subclasses for bad
    input."""
    if not systems:
        raise ValueOutOfBoundsError("no systems given; give one at least")
    given, quantities, found = speeds_given(speeds), unique_names(quantities), {}
    with progress.task("curves", len(systems)):
        for number, (label, system) in enumerate(systems.items()):
            names = [name for quantity in quantities for name in system.parts(quantity)]
            with progress.subtask("curves"):
                folder = None if store is None else made_folder(store) / str(number)
                found[label] = sweep(system, given, method, None, rtol, executor, names, store=folder)
    first = next(iter(systems.values())).shown_in(given[0])
    return Sweeps(title, np.array(given), found, quantities, first)


def _number(model: Model, name: str, value: float | str) -> float:
    try:
        return model.in_own_unit(name, value)
    except ValueError:
        raise ValueOutOfBoundsError(
            f"{name} is '{value}'; give a number in the model's unit or with a unit"
        ) from None
