"""The periodic solution over many speeds, a row of figures a speed; of one system, or of several beside each
other, such as one model with several lengths."""

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor

import numpy as np

from solve.arrays import Array
from solve.batch.family import over_speed
from solve.batch.gathering import task_of
from solve.errors import StepsError, ValueOutOfBoundsError, require_name
from solve.methods.choice import Rule
from solve.model.model import Model
from solve.progress import part, stage
from solve.results.points import Kept
from solve.results.sweep import Sweep, Sweeps
from solve.system import PeriodicSystem
from solve.units import speeds_given


def sweep(
    system: PeriodicSystem,
    speeds: float | str | Sequence[float | str] | Array,
    method: str | Rule = "auto",
    steps: int | None = None,
    rtol: float = 1e-8,
    executor: Executor | None = None,
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
    parts of the sweep are handed to it. engine: "compiled", "numpy", or "auto" for the first where there is a
    C compiler. Raises SolveError subclasses for what no speed could mend.
    """
    omegas = np.array(speeds_given(speeds))
    names = system.known_quantities(quantities)
    kept = Kept(names, system.known_quantities(spectra), harmonics if spectra else 0)
    if steps is not None and not (isinstance(steps, int | np.integer) and steps >= 1):
        raise StepsError(
            f"steps is {steps!r}; allowed: whole numbers of at least 1; leave steps out to have their number "
            "chosen"
        )
    task, notes = task_of(over_speed(system), method, rtol, engine, kept, steps)
    points = omegas[:, None]
    results = task.solved(task.batch(points), points, executor)
    return Sweep(system, omegas, results, task.request.engine, notes)


def variants(model: Model, name: str, values: Sequence[float | str]) -> dict[str, Model]:
    """The model with each of several values of a parameter (SI units) or an option, by the value.

    Raises UnknownNameError, and ValueOutOfBoundsError for a value that the model does not allow.
    """
    if len(set(values)) < len(values):
        raise ValueOutOfBoundsError(f"{name} is given one value twice; give different ones")
    if name in model.options:
        return {str(value): model.varied(options={name: value}) for value in values}
    require_name(f"parameter or option of {model.name}", name, [*model.parameters, *model.options])
    return {f"{_number(name, value):g}": model.varied({name: _number(name, value)}) for value in values}


def sweeps(
    systems: Mapping[str, PeriodicSystem],
    speeds: float | str | Sequence[float | str] | Array,
    quantities: Sequence[str],
    title: str = "",
    method: str | Rule = "auto",
    rtol: float = 1e-6,
) -> Sweeps:
    """Each of the systems over the speeds (rad/s, or texts with unit), keeping the figures of some
    coordinates and outputs that all of them have, or that names of `largest_of` stand for. Raises SolveError
    subclasses for bad input."""
    if not systems:
        raise ValueOutOfBoundsError("no systems given; give one at least")
    omegas = np.array(speeds_given(speeds))
    found = {}
    with stage("curves", len(systems)):
        for label, system in systems.items():
            names = [name for quantity in quantities for name in system.parts(quantity)]
            with part("curves"):
                found[label] = sweep(system, omegas, method, rtol=rtol, quantities=names)
    return Sweeps(title, omegas, found)


def _number(name: str, value: float | str) -> float:
    try:
        return float(value)
    except ValueError:
        raise ValueOutOfBoundsError(f"{name} is '{value}'; give a number in SI units") from None
