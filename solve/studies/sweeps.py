"""Response over speed for several systems beside each other, such as one model with several lengths."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from solve.arrays import Array
from solve.batch.gathering import Count
from solve.errors import ValueOutOfBoundsError, require_name
from solve.methods.auto import Rule
from solve.model.model import Model
from solve.results.sweeps import Sweeps
from solve.studies.sweep import sweep
from solve.system import PeriodicSystem
from solve.units import speeds_given


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
    progress: Callable[[int], None] | None = None,
) -> Sweeps:
    """Each of the systems over the speeds (rad/s, or texts with unit), keeping the figures of some
    coordinates and outputs that all of them have. progress is told the number of points done. Raises
    SolveError subclasses for bad input."""
    if not systems:
        raise ValueOutOfBoundsError("no systems given; give one at least")
    omegas = np.array(speeds_given(speeds))
    found, count = {}, Count(progress)
    for label, system in systems.items():
        found[label] = sweep(
            system, omegas, method, rtol=rtol, progress=count.onward(), quantities=tuple(quantities)
        )
    return Sweeps(title, omegas, found)


def _number(name: str, value: float | str) -> float:
    try:
        return float(value)
    except ValueError:
        raise ValueOutOfBoundsError(f"{name} is '{value}'; give a number in SI units") from None
