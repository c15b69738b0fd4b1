"""Weights and covariances as functions of the phase, from arrays, diagonals by name, or functions."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from solve.arrays import Array
from solve.errors import ValueOutOfBoundsError, require_name

Weight = Array | Sequence[Sequence[float]] | Mapping[str, float] | Callable[[Array], Array]
"""Types of weights: a matrix (N, N); numbers by name; or a function of phases (k,) that returns (k, N, N)."""

_PHASES = 37
"""Number of phases per period at which definiteness is checked: a choice, odd so that the phases do not
coincide with symmetries."""

_NEGATIVE = 1e-10
"""Negative eigenvalue, relative to the largest, that counts as round-off. A choice."""


def matrix_function(
    name: str, given: Weight, size: int, period: float, definite: bool = False
) -> Callable[[Array], Array]:
    """Symmetric matrices (k, size, size) as a function of phases (k,), from an array or a function.

    Raises ValueOutOfBoundsError unless they are symmetric and positive semidefinite; with `definite`, they
    must be positive definite."""
    if callable(given):

        def function(phase: Array) -> Array:
            return _real(given(phase))

    else:
        try:
            matrix = _real(given)
        except (TypeError, ValueError):
            matrix = np.full((0,), np.nan)

        def function(phase: Array) -> Array:
            return np.broadcast_to(matrix, (len(phase), *matrix.shape))

    phase = np.arange(_PHASES) * (period / _PHASES)
    _require(name, function(phase), (_PHASES, size, size), definite)
    return function


def _real(values: object) -> Array:
    """Array of real numbers; NaN if they are complex."""
    array = np.asarray(values)
    return np.full(array.shape, np.nan) if np.iscomplexobj(array) else array.astype(float)


def _require(name: str, values: Array, shape: tuple[int, ...], definite: bool) -> None:
    """Raise ValueOutOfBoundsError unless the matrices are real, finite and symmetric with this shape, and
    positive (semi)definite."""
    kind = "positive definite" if definite else "positive semidefinite"
    allowed = (
        f"give a symmetric {kind} matrix of shape {shape[1:]}, a function of phases that returns such "
        "matrices, or a mapping of names to numbers"
    )
    if values.shape != shape:
        raise ValueOutOfBoundsError(f"{name} has shape {values.shape[1:]}; {allowed}")
    if not np.isfinite(values).all() or not np.allclose(values, np.swapaxes(values, 1, 2), rtol=1e-9):
        raise ValueOutOfBoundsError(f"{name} is not real, finite and symmetric; {allowed}")
    lowest, largest = np.linalg.eigvalsh(values).min(), np.abs(values).max()
    if lowest < -_NEGATIVE * largest or (definite and lowest <= 0):
        raise ValueOutOfBoundsError(f"{name} has the eigenvalue {lowest:.3g} and is not {kind}; {allowed}")


def named_numbers(
    name: str, given: Mapping[str, float], allowed: Sequence[str], positive: bool
) -> dict[str, float]:
    """Validate numbers by name. Raises UnknownNameError, and ValueOutOfBoundsError for negative numbers, or
    for zeros if `positive`."""
    numbers = {}
    for key, value in given.items():
        require_name(f"{name}: name", key, allowed)
        try:
            numbers[key] = float(value)
        except (TypeError, ValueError):
            numbers[key] = np.nan
        least = "positive numbers" if positive else "numbers of at least 0"
        if not (0 <= numbers[key] < np.inf) or (positive and numbers[key] == 0):
            raise ValueOutOfBoundsError(f"{name}: {key} is {value!r}; allowed: {least}")
    return numbers
