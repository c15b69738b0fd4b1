"""Conversion of initial guesses for Newton's iteration to motions over a period. A guess is an orbit, a
transient, a state, a function or a file."""

import reprlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from solve.arguments import described
from solve.arrays import Array
from solve.contracts import Motion
from solve.errors import FileError, ResultKindError, ValueOutOfBoundsError, counted
from solve.newton.iteration import Task, joined
from solve.newton.strategies import linear_sizes, motion_from
from solve.period.curve import Curve
from solve.results import save
from solve.results.orbit import Orbit
from solve.results.transient import Transient

Start = Orbit | Transient | Motion | tuple[Array, Array] | Callable[[Array], Array] | str | Path

FILES = ".nc", ".npz"

_SAMPLES = 256
"""Number of phases per model period at which a start function is evaluated. A cubic spline interpolates
between the values. Chosen by judgement."""

_STATES, _RTOL = 128, 1e-6
"""Number of states per period of the motion that is integrated from a given state, and tolerance of the
integration. Chosen by judgement: Newton's iteration removes the remaining error."""


class _NotRealError(TypeError):
    """Raised for values that are not real numbers."""


def motion_of(start: Start, task: Task) -> Motion:
    """Convert a `start` of `solve.nonlinear` to a motion. Raises ValueOutOfBoundsError for an invalid start,
    FileError for a file that contains neither an orbit nor a transient, and TransientError for a state from
    which the motion cannot be integrated."""
    given = _opened(start, task) if isinstance(start, str | Path) else start
    if isinstance(given, Orbit | Transient):
        _require_coordinates(given.system.coordinates, task)
        return given.curve if isinstance(given, Orbit) else _last_periods(given, task)
    if callable(given):
        return _checked(given, task) if hasattr(given, "nodes") else _spline_through(given, task)
    return _from_state(given, task)


def _allowed(task: Task) -> str:
    n = task.system.n
    return (
        f"an orbit, a transient, a saved {' or '.join(FILES)} file of either, q and q̇ ({n},) at phase 0, or a"
        f" function of phases (k,) that returns q ({n}, k); omit it to start from the linear orbit"
    )


def _refused(start: object, allowed: str) -> ValueOutOfBoundsError:
    return ValueOutOfBoundsError(f"start is {described(start)}; allowed: {allowed}")


def _opened(path: str | Path, task: Task) -> Orbit | Transient:
    if Path(path).suffix.lower() not in FILES:
        raise _refused(path, _allowed(task))
    try:
        result = save.open(path)
        kind = type(result).__name__
    except ResultKindError as error:
        result, kind = None, error.kind
    if not isinstance(result, Orbit | Transient):
        raise FileError(f"start '{path}' is a {kind}; give a file of an orbit or of a transient")
    return result


def _require_coordinates(names: tuple[str, ...], task: Task) -> None:
    system = task.system
    if names != system.coordinates:
        raise ValueOutOfBoundsError(
            f"the start has coordinates {', '.join(names)}; {system.labels.name} has "
            f"{', '.join(system.coordinates)}"
        )


def _checked(motion: Any, task: Task) -> Motion:
    """Return `motion` unchanged if it has the right number of coordinates. Raises ValueOutOfBoundsError."""
    count = len(motion(np.zeros(1)))
    if count != task.system.n:
        raise ValueOutOfBoundsError(
            f"start has {counted(count, 'coordinate')}; {task.system.labels.name} has {task.system.n}"
        )
    return motion


def _last_periods(transient: Transient, task: Task) -> Curve:
    """Return the last part of a transient, over the number of periods of the orbit. If the transient is
    shorter, return its last period only."""
    count = task.periods if transient.turns >= task.periods else 1
    return joined([*transient.motions[-count:]], count * task.system.period, task.rigid)


def _spline_through(function: Callable[[Array], Array], task: Task) -> Curve:
    """Return the periodic cubic spline through the values of a function of the phase."""
    from scipy.interpolate import CubicSpline

    phase = np.linspace(0.0, task.period, _SAMPLES * task.periods + 1)
    shape = task.system.n, len(phase) - 1
    try:
        values = _real(function(phase[:-1]))
    except _NotRealError as reason:
        raise ValueOutOfBoundsError(
            f"'start' returns {reason}; it must return finite q of shape {shape}"
        ) from None
    except Exception as reason:  # A user function may raise any exception.
        raise ValueOutOfBoundsError(
            f"'start' raises {type(reason).__name__} for {shape[1]} phases ({reason}); it must return q "
            f"of shape {shape}"
        ) from None
    if values.shape != shape:
        raise ValueOutOfBoundsError(
            f"'start' returns shape {values.shape} for {shape[1]} phases; it must return finite q of "
            f"shape {shape}"
        )
    if not np.isfinite(values).all():
        raise ValueOutOfBoundsError(
            f"'start' returns NaN or infinite values; it must return finite q of shape {shape}"
        )
    spline = CubicSpline(phase, np.column_stack((values, values[:, 0])), axis=1, bc_type="periodic")
    q, v, a = (spline(phase, order).T for order in range(3))
    return Curve.quintic(phase, q, v, a[:-1], a[1:])


def _real(values: Any) -> Array:
    """Convert values to floats. Raises _NotRealError for complex numbers and for values that are not numbers,
    and ValueError for rows of different lengths."""
    array = np.asarray(values)
    if not np.can_cast(array.dtype, float, casting="same_kind"):
        raise _NotRealError(reprlib.repr(values))
    return array.astype(float)


def state_of(given: Any, n: int, allowed: str) -> tuple[Array, Array]:
    """Convert a start to q and q̇ (n,). Raises ValueOutOfBoundsError unless it consists of two arrays of n
    finite real numbers. allowed: phrase of the message that states the permitted starts."""
    try:
        q, qd = map(_real, given)
    except (TypeError, ValueError):
        raise _refused(given, allowed) from None
    if q.shape != (n,) or qd.shape != (n,):
        raise ValueOutOfBoundsError(
            f"the start has shapes {q.shape} and {qd.shape}; give finite q and q̇ of shape ({n},) each"
        )
    if not np.isfinite([q, qd]).all():
        raise ValueOutOfBoundsError(
            f"the start has NaN or infinite values; give finite q and q̇ of shape ({n},) each"
        )
    return q, qd


def _from_state(given: Any, task: Task) -> Curve:
    """Integrate the motion over the period of the orbit from q and q̇ (n,) at phase 0, and return it."""
    n = task.system.n
    q, qd = state_of(given, n, _allowed(task))
    state = np.concatenate((q, qd / task.speed))
    sizes = np.maximum(
        linear_sizes(task, task.grid(_STATES * task.periods)), np.abs(state.reshape(2, n)).max(axis=0)
    )
    return motion_from(task, state, sizes, _STATES, _RTOL)
