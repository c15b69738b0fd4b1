"""Weights and covariances as functions of the phase, from arrays, named diagonal entries, or functions."""

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise

import numpy as np

from solve.arguments import number_or_nan
from solve.arrays import EPS, Array, uniform_phases
from solve.errors import ValueOutOfBoundsError, require_name
from solve.model.domain import BISECTIONS
from solve.system import PeriodicSystem

Weight = Array | Sequence[Sequence[float]] | Mapping[str, float] | Callable[[Array], Array]
"""Type of weights: a matrix (N, N); a mapping from names to numbers; or a function of phases (k,) that
returns matrices (k, N, N)."""

_PHASES = 37
"""Number of phases per period at which definiteness is checked. Chosen by judgement: it is odd, so that the
phases do not coincide with symmetries."""

_JUMP = 1e-3
"""An interval is halved repeatedly. If a matrix changes by more than this fraction of its largest entry
within the last interval, the change counts as a jump: a continuous function would need a slope of 1e9 times
its size per radian. Chosen by judgement."""

_INSIDE = 1e-9
"""Distance from the jumps of the system, relative to the period, within which jumps of weights are allowed.
Chosen by judgement."""

_BESIDE = 4 * EPS
"""Distance, relative to the period, from the ends of the period at which functions are evaluated instead of
at the ends, where they may jump. It is a few units of round-off."""

_NEGATIVE = 1e-10
"""Modulus of a negative eigenvalue, relative to the largest entry, up to which it counts as round-off. Chosen
by judgement."""


def matrix_function(
    name: str, given: Weight, size: int, system: PeriodicSystem, definite: bool = False
) -> Callable[[Array], Array]:
    """Return a function of phases (k,) that returns symmetric matrices (k, size, size), from an array or a
    function.

    Raises ValueOutOfBoundsError unless the matrices are symmetric and positive semidefinite. If `definite` is
    True, they must be positive definite. The matrices may jump only at jumps of the system, which are nodes
    of every grid."""
    if callable(given):
        # At either end of the period, a function of the phase modulo the period may return its value at the
        # other end.
        inside = _BESIDE * system.period

        def function(phase: Array) -> Array:
            return _real(given(np.clip(phase, inside, system.period - inside)))

    else:
        matrix = _real(given)

        def function(phase: Array) -> Array:
            return np.broadcast_to(matrix, (len(phase), *matrix.shape))

    phase = uniform_phases(_PHASES, system.period)
    _require(name, function(phase), (_PHASES, size, size), definite)
    if callable(given):
        _require_continuous(name, function, system)
    return function


def _require_continuous(name: str, function: Callable[[Array], Array], system: PeriodicSystem) -> None:
    """Raise ValueOutOfBoundsError if the function jumps where the system does not. Between two jumps of the
    system, the interval in which the function changes most is tested. If the system has no jumps, the end of
    the period is tested too."""
    period, inside = system.period, _INSIDE * system.period

    def refused(phase: float) -> ValueOutOfBoundsError:
        return ValueOutOfBoundsError(
            f"{name} jumps at the phase {phase:.6g} rad, where the system does not; give a continuous "
            "function, or a system that declares this phase in `breaks`"
        )

    for low, high in pairwise(sorted({0.0, *system.breaks, period})):
        ends = np.linspace(low + inside, high - inside, _PHASES)
        values = function(ends)
        scale = np.abs(values).max()
        for _ in range(BISECTIONS):
            changes = np.abs(np.diff(function(ends), axis=0)).max(axis=(1, 2))
            first = int(np.argmax(changes))
            ends = np.linspace(ends[first], ends[first + 1], 3)
        if np.abs(np.diff(function(ends), axis=0)).max() > _JUMP * scale:
            raise refused(ends[1])
        if not system.breaks and np.abs(values[-1] - values[0]).max() > _JUMP * scale:
            raise refused(0.0)


def _real(values: object) -> Array:
    """Return values as an array of real numbers. Complex numbers become NaN; values that are not numbers give
    an empty array."""
    try:
        array = np.asarray(values)
        return np.full(array.shape, np.nan) if np.iscomplexobj(array) else array.astype(float)
    except (TypeError, ValueError):
        return np.full((0,), np.nan)


def _require(name: str, values: Array, shape: tuple[int, ...], definite: bool) -> None:
    """Raise ValueOutOfBoundsError unless the matrices have this shape and are real, finite, symmetric and
    positive semidefinite. If `definite` is True, they must be positive definite."""
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
    """Return the mapping `given` after its names and numbers are checked. Raises UnknownNameError, and
    ValueOutOfBoundsError for negative numbers and, if `positive` is True, for zeros."""
    numbers = {}
    for key, value in given.items():
        require_name(f"{name}: name", key, allowed)
        numbers[key] = number_or_nan(value)
        least = "real numbers > 0" if positive else "real numbers of at least 0"
        if not (0 <= numbers[key] < np.inf) or (positive and numbers[key] == 0):
            raise ValueOutOfBoundsError(f"{name}: {key} is {value!r}; allowed: {least}")
    return numbers
