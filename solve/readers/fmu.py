"""Linearisation of a functional mock-up unit along a periodic motion."""

import math
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from solve.arguments import matches_annotations
from solve.array_files import require_file
from solve.arrays import Array, uniform_phases
from solve.errors import FileError, SolveError, ValueOutOfBoundsError, require_name
from solve.first_order import Signals
from solve.readers.files import checked_path
from solve.readers.fmi import Unit
from solve.readers.sampled import SampledStates, Source
from solve.readers.shooting import Motion, closed_motion
from solve.readers.unit_system import UnitSystem
from solve.samples import checked_period
from solve.units import speed_in_si

_FEWEST_AZIMUTHS, _MOST_AZIMUTHS = 64, 4096
"""Smallest and largest number of azimuths. Chosen by judgement."""

_NEGLIGIBLE = 1e-9
"""Threshold for negligible derivatives, relative to the largest derivative. It applies to the upper quarter
of the harmonics, and to the coupling of an excluded state with a remaining one. Chosen by judgement: it is
several times the error of the motion."""


@matches_annotations
def read_fmu(
    path: str | Path,
    speed: float | str | None = None,
    exclude: Sequence[str] = (),
    values: Mapping[str, float] | None = None,
    motion: Mapping[str, Array] | None = None,
    period: float = 2 * np.pi,
    drive: str | None = None,
) -> SampledStates | UnitSystem:
    """Linearise a functional mock-up unit (FMI 2 or 3, model exchange) along a periodic motion.

    The compiled code in the unit is executed. Read only units from sources that you trust.

    Parameters
    ----------
    path : str or Path
        File (.fmu) with directional derivatives. Requires the extra `fmu` (FMPy).
    speed : float or str, optional
        Speed Ω in rad/s or with unit. The motion has the period `period`/Ω in time. If the speed is omitted,
        the motion is found at each speed at which the system is used, as in a sweep.
    exclude : sequence of str
        States with a prescribed motion, such as the angle and the speed of the drive. Their motion need not
        be periodic. Their rows and columns are omitted.
    values : mapping of str to float, optional
        Mapping from names to values of parameters, and to start values, in the units that the FMU declares.
    motion : mapping of str to (k,) array, optional
        Periodic motion of all states at k ≥ 3 uniform times from 0, without the end of the period. By
        default, it is found by shooting from the start values of the FMU.
    period : float
        Period in phase.
    drive : str, optional
        Variable of the FMU that is set to the speed in rad/s: a parameter, or a state with a prescribed
        motion. For a state, the start value is set.

    Returns
    -------
    FirstOrderSystem
        System of small deviations from the motion, without load, with the inputs and outputs of the unit.
        The motion is in `source.operating_points`; if `speed` is omitted, it is in the result of
        `at_speed(speed)`.

    Raises
    ------
    FileError
        If the FMU cannot be read or run, has no directional derivatives, switches its equations within the
        period, or has no periodic motion near its start values.
    UnknownNameError, ValueOutOfBoundsError
        If a name is unknown, or a value is not allowed.
    MissingLibraryError
        If FMPy is not installed.

    Notes
    -----
    The number of azimuths is doubled from 64 to at most 4096, until the highest harmonics of the matrices are
    negligible. Shooting is Newton's method for x(T) = x(0), with the monodromy matrix from directional
    derivatives.

    Examples
    --------
    >>> read_fmu("no_such_file.fmu", 40.0)
    Traceback (most recent call last):
    solve.errors.FileError: there is no file 'no_such_file.fmu'; give the path of a file that exists
    """
    file = Path(checked_path(path))
    require_file(file)
    linearised = partial(
        _linearised,
        file=file,
        exclude=exclude,
        values={**(values or {}), **({} if drive is None else {drive: math.nan})},
        motion=motion,
        period=checked_period(period),
    )
    if speed is not None:
        return linearised(float(speed_in_si(speed)))[0]
    if motion is not None:
        raise ValueOutOfBoundsError("'motion' applies to one speed; also give 'speed'")
    with Unit(file, values or {}) as unit:
        kept = _kept(unit, exclude)
        states, inputs, outputs = _names(unit, kept)
        return UnitSystem(linearised, states, (inputs, outputs), period, _source(unit, file))


def _require_speed(unit: Unit, name: str) -> None:
    """Raise FileError if a variable that is set to the speed has a unit of speed other than rad/s."""
    given = unit.labels[name][0]
    try:
        factor = float(speed_in_si(f"1 {given}")) if given else 1.0
    except SolveError:
        return
    if factor != 1.0:
        raise FileError(f"'{unit.path}': the drive {name} has the unit {given}; give a variable in rad/s")


def _linearised(
    speed: float,
    file: Path,
    exclude: Sequence[str],
    values: Mapping[str, float],
    motion: Mapping[str, Array] | None,
    period: float,
) -> tuple[SampledStates, bool]:
    """Return the linearisation at a speed in rad/s, and whether its azimuths resolve the matrices. values:
    values of the variables that are set; NaN stands for the speed."""
    duration = period / speed
    with Unit(file, {name: speed if math.isnan(value) else value for name, value in values.items()}) as unit:
        for name in (name for name, value in values.items() if math.isnan(value)):
            _require_speed(unit, name)
        kept, is_resolved = _kept(unit, exclude), True
        if motion is None:
            function = closed_motion(unit, kept, duration)
            states, jacobians, is_resolved = _sampled(unit, function, duration, kept)
        else:
            states = _given(unit, motion)
            jacobians = _jacobians(unit, states, duration)
        _require_one_set_of_equations(unit, states, duration)
        _require_prescribed(unit, jacobians, kept)
        system = _system(unit, jacobians, kept, period)
        system.of_source(_source(unit, file, speed, states))
    return system, is_resolved


def _kept(unit: Unit, exclude: Sequence[str]) -> Array:
    """Indices of the states that are not excluded. Raises UnknownNameError, ValueOutOfBoundsError."""
    for name in exclude:
        require_name(f"state of '{unit.path}'", name, unit.states)
    kept = np.array([k for k, name in enumerate(unit.states) if name not in exclude], dtype=int)
    if not len(kept):
        raise ValueOutOfBoundsError("'exclude' contains all states; omit at least one")
    return kept


def _sampled(unit: Unit, motion: Motion, duration: float, kept: Array) -> tuple[Array, Array, bool]:
    """Return the states (k, N), the Jacobians (k, …), and whether the azimuths resolve the harmonics. The
    number k of azimuths is doubled until it suffices or reaches its maximum."""
    count = _FEWEST_AZIMUTHS
    while True:
        states = motion(uniform_phases(count, duration)).T
        jacobians = _jacobians(unit, states, duration)
        N = len(unit.states)
        rows, columns = np.r_[kept, N : jacobians.shape[1]], np.r_[kept, N : jacobians.shape[2]]
        amplitudes = np.abs(np.fft.rfft(jacobians[:, rows][:, :, columns], axis=0)).reshape(
            count // 2 + 1, -1
        )
        tail = amplitudes[3 * count // 8 :].max(axis=0)
        is_resolved = bool((tail <= _NEGLIGIBLE * amplitudes[0].max()).all())
        if is_resolved or 2 * count > _MOST_AZIMUTHS:
            return states, jacobians, is_resolved
        count *= 2


def _jacobians(unit: Unit, states: Array, duration: float) -> Array:
    """Jacobians (k, N + y, N + r) at k uniform times. Raises FileError."""
    times = np.arange(len(states)) * (duration / len(states))
    found = np.array([unit.jacobian(t, x) for t, x in zip(times, states, strict=True)])
    if not np.isfinite(found).all():
        raise FileError(f"'{unit.path}' has NaN or infinite derivatives along its motion; check its values")
    return found


def _given(unit: Unit, motion: Mapping[str, Array]) -> Array:
    """States (k, N) of the motion that the user provides. Raises UnknownNameError, ValueOutOfBoundsError."""
    for name in motion:
        require_name(f"state of '{unit.path}'", name, unit.states)
    missing = [name for name in unit.states if name not in motion]
    lengths = {np.shape(values) for values in motion.values()}
    if missing or len(lengths) != 1 or len(shape := min(lengths)) != 1 or shape[0] < 3:
        reason = f"{missing[0]} has none" if missing else f"shapes are {sorted(lengths)}"
        raise ValueOutOfBoundsError(
            f"'motion' requires the same number of values, 3 or more, for each state; {reason}"
        )
    states = np.stack([np.asarray(motion[name], dtype=float) for name in unit.states], axis=1)
    if not np.isfinite(states).all():
        raise ValueOutOfBoundsError("'motion' has NaN or infinite values; give finite values")
    return states


def _require_one_set_of_equations(unit: Unit, states: Array, duration: float) -> None:
    """Raise FileError if the equations switch within the period."""
    times = np.arange(len(states)) * (duration / len(states))
    signs = np.array([unit.indicators(t, x) for t, x in zip(times, states, strict=True)])
    switches = np.flatnonzero((signs.max(axis=0, initial=0.0) > 0) & (signs.min(axis=0, initial=0.0) < 0))
    if unit.event < duration or len(switches):
        raise FileError(f"'{unit.path}' has events within the period; allowed: equations without events")


def _require_prescribed(unit: Unit, jacobians: Array, kept: Array) -> None:
    """Raise ValueOutOfBoundsError if the rate of an excluded state depends on a remaining state."""
    others = np.setdiff1d(np.arange(len(unit.states)), kept)
    influence = np.abs(jacobians[:, others][:, :, kept]).max(axis=0)
    acting = np.argwhere(influence > _NEGLIGIBLE * np.abs(jacobians).max())
    if len(acting):
        first, second = unit.states[others[acting[0, 0]]], unit.states[kept[acting[0, 1]]]
        raise ValueOutOfBoundsError(
            f"'exclude' contains {first}, whose rate depends on {second}; list only states with a "
            "prescribed motion"
        )


def _names(unit: Unit, kept: Array) -> tuple[list[str], list[str], list[str]]:
    """Return unique names of the remaining states, of the inputs and of the outputs."""
    states = [unit.states[k] for k in kept]
    return states, unit.inputs, [f"{name}_output" if name in states else name for name in unit.outputs]


def _system(unit: Unit, jacobians: Array, kept: Array, period: float) -> SampledStates:
    """System for the states that are not excluded."""
    N = len(unit.states)
    A, B = jacobians[:, kept][:, :, kept], jacobians[:, kept, N:]
    names, inputs, outputs = _names(unit, kept)
    signals: Signals | None = None
    if inputs or outputs:
        signals = B, jacobians[:, N:][:, :, kept], jacobians[:, N:, N:], inputs, outputs
    system = SampledStates.from_samples(A, np.zeros(A.shape[:2]), names, period=period, signals=signals)
    assert isinstance(system, SampledStates)
    return system


def _source(unit: Unit, file: Path, speed: float | None = None, states: Array | None = None) -> Source:
    """Origin of the samples: the FMU. states (k, N): motion about which the FMU was linearised, if known."""
    units, meanings = ({name: pair[k] for name, pair in unit.labels.items()} for k in (0, 1))
    points = {} if states is None else dict(zip(unit.states, states.T, strict=True))
    return Source(file.name, unit.description.description or "", speed, units, meanings, (), points)
