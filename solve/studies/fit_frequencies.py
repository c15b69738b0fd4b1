"""Natural frequencies of a fit and their derivatives with respect to its parameters."""

import math
from collections.abc import Callable, Sequence

import numpy as np

from solve.approximation import slope
from solve.arrays import Array
from solve.errors import ValueOutOfBoundsError
from solve.model.model import Model
from solve.period.natural import slopes
from solve.studies.frequencies import at_speed_zero, natural
from solve.studies.measured import Measured

_STEP = 1e-3
"""Largest step of the finite differences of matrices, relative to the parameter. Extrapolation is exact to
round-off for entries that are polynomials of degree 8 or less."""


def natural_frequencies(model: Model, data: Measured, names: Sequence[str]) -> tuple[Array, Array]:
    """Natural frequencies (k,) at rest in rad/s and their derivatives (r, k). A growth rate counts as a
    negative frequency, so that a trial with negative stiffness has a large residual instead of none."""
    places, position = _places(data), np.array([data.position])
    count = int(places.max()) + 1
    values = natural(model, position, count).signed[0, places]
    if model.structure is None:
        found = _exact(model, position, names)[:, places]
        moving = values != 0
        return values, np.where(moving, found / np.where(moving, 2 * np.abs(values), 1.0), 0.0)

    def of_elements(varied: Model) -> Array:
        return natural(varied, position, count).signed[0, places]

    return values, np.array([_slope(of_elements, model, name) for name in names])


def require_elastic_modes(model: Model, sets: Sequence[Measured]) -> None:
    """Raise ValueOutOfBoundsError if a measured frequency is assigned to a rigid-body mode."""
    for data in sets:
        if data.position is None:
            continue
        places, (measured,) = _places(data), data.channels.values()
        found = natural(model, np.array([data.position]), int(places.max()) + 1).signed[0]
        rigid = np.flatnonzero((found[places] == 0) & (measured != 0))
        if len(rigid):
            first, count = int(rigid[0]), np.count_nonzero(found == 0)
            modes = "1 rigid-body mode" if count == 1 else f"{count} rigid-body modes"
            raise ValueOutOfBoundsError(
                f"mode {places[first] + 1} was measured at {measured[first] / (2 * math.pi):.6g} Hz, but is "
                f"a rigid-body mode of frequency 0: {model.name} has {modes}, counted first; number the "
                f"elastic modes in the file from {count + 1} on"
            )


def _places(data: Measured) -> Array:
    return np.round(data.at).astype(int) - 1


def _exact(model: Model, position: Array, names: Sequence[str]) -> Array:
    """Derivatives (r, n) of λ from those of M and K, independent of the order of the modes."""

    def matrices(varied: Model) -> Array:
        M, _, K, _ = at_speed_zero(varied, position)
        return np.stack((M[0], K[0]))

    by = np.array([_slope(matrices, model, name) for name in names])
    M, K = matrices(model)
    return slopes(M, K, by[:, 0], by[:, 1])


def _slope(values: Callable[[Model], Array], model: Model, name: str) -> Array:
    """Derivative of values of a model with respect to one of its parameters."""
    at = model.parameters[name]
    return slope(lambda number: values(model.varied({name: number})), at, _STEP * (abs(at) or 1.0))
