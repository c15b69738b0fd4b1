"""Response over speed for several systems beside each other, such as one model with several lengths."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from solve.arrays import Array
from solve.errors import UnknownNameError, ValueOutOfBoundsError
from solve.loading import Model
from solve.methods.method import Method
from solve.studies.sweep import Sweep, sweep
from solve.system import PeriodicSystem
from solve.units import speeds_given

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
class Sweeps:
    """Sweeps over the same speeds (rad/s), by the label of their system. title: what the labels are
    values of."""

    title: str
    speeds: Array
    sweeps: Mapping[str, Sweep]

    def figures(self, quantity: str, figure: str = "max_abs") -> Array:
        """A figure of a coordinate or output (systems, speeds), as `Sweep.figures`; NaN where a point
        failed. Raises UnknownNameError."""
        return np.array([each.figures(quantity, figure) for each in self.sweeps.values()])

    def extremes(self, quantity: str, figure: str = "max_abs") -> list[Extreme]:
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

    def plot(self, quantities: Sequence[str], figure: str = "max_abs") -> Any:
        """A row a quantity, a curve a system (matplotlib Figure). Raises UnknownNameError."""
        from solve.results.sweeps_plot import sweeps_figure

        responses = {name: self.figures(name, figure) for name in quantities}
        system = next(iter(self.sweeps.values())).system
        return sweeps_figure(system, self.title, list(self.sweeps), self.speeds, responses, figure)


def variants(model: Model, name: str, values: Sequence[float | str]) -> dict[str, Model]:
    """The model with each of several values of a parameter (SI units) or an option, by the value.

    Raises UnknownNameError, and ValueOutOfBoundsError for a value that the model does not allow.
    """
    if len(set(values)) < len(values):
        raise ValueOutOfBoundsError(f"{name} is given one value twice; give different ones")
    if name in model.options:
        return {str(value): model.varied(options={name: value}) for value in values}
    if name not in model.parameters:
        raise UnknownNameError(
            f"parameter or option of {model.name}", name, [*model.parameters, *model.options]
        )
    return {f"{_number(name, value):g}": model.varied({name: _number(name, value)}) for value in values}


def sweeps(
    systems: Mapping[str, PeriodicSystem],
    speeds: float | str | Sequence[float | str] | Array,
    quantities: Sequence[str],
    title: str = "",
    method: str | Method = "auto",
    rtol: float = 1e-6,
    progress: Callable[[int], None] | None = None,
) -> Sweeps:
    """Each of the systems over the speeds (rad/s, or texts with unit), keeping the figures of some
    coordinates and outputs that all of them have. progress is told the number of points done. Raises
    SolveError subclasses for bad input."""
    if not systems:
        raise ValueOutOfBoundsError("no systems given; give one at least")
    omegas = np.array(speeds_given(speeds))
    found: dict[str, Sweep] = {}
    for number, (label, system) in enumerate(systems.items()):
        before = number * len(omegas)
        told = None if progress is None else lambda done, before=before: progress(before + done)
        found[label] = sweep(system, omegas, method, rtol=rtol, progress=told, quantities=tuple(quantities))
    return Sweeps(title, omegas, found)


def _number(name: str, value: float | str) -> float:
    try:
        return float(value)
    except ValueError:
        raise ValueOutOfBoundsError(f"{name} is '{value}'; give a number in SI units") from None
