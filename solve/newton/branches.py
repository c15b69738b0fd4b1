"""Branches of nonlinear orbits in the speed or another parameter."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from solve.arguments import checked_rtol, require_integer
from solve.arrays import Array
from solve.certify.coefficients import compared_phases
from solve.equations import require_bounds, warnings_of
from solve.errors import MissingValueError, ValueOutOfBoundsError, require_name
from solve.kernel.engines import chosen_engine
from solve.labels import SPEED, in_own_unit, speed_or_usual
from solve.methods.radau import Radau
from solve.newton.branch_points import DAMPING, ContinuationParameters, Point
from solve.newton.branch_starts import first_value, orbit_starts, scattered_or, start_digest
from solve.newton.branch_store import description_of, opened_branches
from solve.newton.iteration import Task
from solve.newton.several_branches import follow_orbits
from solve.newton.starts import Start
from solve.newton.switching import Followed, follow_doublings
from solve.newton.unforced import energy, follow_modes_of
from solve.period.curve import Curve
from solve.period.grid import Grid
from solve.results.branch import KINDS, Branch
from solve.results.scatter import Scatter
from solve.system import PeriodicSystem, in_phase, of_system, shown_in
from solve.units import apart, ramp_in_si

_FIELDS = "figures", "figure_errors", "multipliers", "radius", "errors", "repeats"

_SAMPLES = 127
"""Number of phases at which orbits are stored. Chosen by judgement: the number resolves 63 harmonics, which
are accurate enough as a start of Newton's iteration. It is odd, so that the highest harmonic has both a
cosine and a sine."""


_ROUNDOFF = 1e-12
"""Relative difference of coefficients up to which they count as equal. Chosen by judgement."""

_SIZES = 3.0 ** np.arange(2, -13, -1)
"""Sizes of the motions along which coefficients are compared, in the units of the coordinates. Chosen by
judgement: each motion grows from one size to the next, so that it reaches forces that act over a small range
only."""


@of_system
def branch(
    system: PeriodicSystem,
    speeds: float | str | tuple[float | str, float | str] | None = None,
    over: str | None = None,
    switch: bool = False,
    periods: int = 1,
    start: Start | Scatter | None = None,
    points: int = 200,
    rtol: float = 1e-3,
    engine: str = "auto",
    unforced: bool = False,
    begin: float | str | None = None,
    store: str | Path | None = None,
) -> Branch:
    """Continue nonlinear orbits in the speed or another parameter, also through folds and along isolated
    branches.

    Folds, period doublings, tori (Neimark–Sacker points) and branching points are located to `rtol`.

    Parameters
    ----------
    system : Model
        Model with nonlinear equations.
    speeds : str or (float or str, float or str), optional
        First and last speed of the range: a string such as "300:600 rpm", or a pair of speeds (numbers in
        rad/s or strings with a unit). The branch starts at the first speed, and ends where it leaves the
        range. If `over` is given, `speeds` is the constant speed; by default, the speed of the case.
    over : str, optional
        Parameter that varies instead of the speed, with its first and last value, such as "k1=1e4:9e4".
    switch : bool
        Whether to follow the branches of twice the period that start at period doublings, for up to three
        successive doublings.
    periods : int
        Number of model periods per period of the orbits.
    start : Orbit, Transient, Scatter, (q, q̇), callable or path, optional
        `start` of `solve.nonlinear` for the first orbit; or a result of `solve.scatter`, or the path of its
        file. For a scatter result, the branches through all its orbits are followed from the speed or
        parameter value of this result.
    points : int
        Maximum number of orbits per branch and direction.
    rtol : float
        Largest permitted error of the orbits, relative to the scale of each coordinate.
    engine : str
        "auto", "compiled" or "numpy".
    unforced : bool
        Whether to follow the nonlinear modes of equations without load or damping. The speed is the frequency
        of the mode. Each branch starts at a frequency of small vibrations within the range `speeds`. Two
        multipliers, due to phase shift and energy, are exactly +1; the spectral radius is that of the other
        multipliers.
    begin : float or str, optional
        Value of the speed or the parameter at the first orbit, within the range. From a value between the
        ends, the branch is followed in both directions. By default, the first value of the range.
    store : str or Path, optional
        Folder in which finished steps are stored; the same call resumes from them, even if `points` is
        larger.

    Returns
    -------
    Branch
        Orbits in the order of the branch; `energies` if unforced. A closed branch ends with its first orbit.

    Raises
    ------
    ValueOutOfBoundsError, MissingValueError
        For bad input.
    LinearModelError
        For linear systems.
    NoOrbitError
        If there is no orbit at the first value.
    NoDerivativeError
        If the equations have no derivative with respect to the parameter.

    Notes
    -----
    Each orbit is computed by Newton's iteration on one grid, and corrected once by the method with one more
    stage. The corrected orbit is returned. Its difference from the uncorrected orbit is the error estimate;
    the grid is refined if the estimate exceeds rtol.
    """
    require_integer("points", points, 2)
    require_integer("periods", periods)
    parameters, notes = continuation(system, speeds, over, periods, rtol, engine)
    if unforced and (over is not None or switch or start is not None or begin is not None or periods != 1):
        raise ValueOutOfBoundsError(
            "unforced modes are followed as functions of speed; omit 'over', 'switch', 'start', 'begin' and "
            "'periods'"
        )
    if switch and _is_linear(parameters.task):
        raise ValueOutOfBoundsError(
            f"{system.labels.name} is linear in its coordinates: where its period doubles, all orbits of "
            f"twice the period have the same {parameters.names[0]} and form no branch; omit switch"
        )
    start, most = scattered_or(start), int(points)
    value = first_value(parameters, start, begin)
    task = parameters.task_at(np.array([value]))
    description = description_of(
        parameters, begin=value, start=start_digest(start, task), switch=switch, unforced=unforced
    )
    with opened_branches(store, description) as steps:
        if unforced:
            return _result(
                parameters, follow_modes_of(parameters.task, parameters.ranges[0], most, steps), notes
            )
        followed = follow_orbits(parameters, orbit_starts(task, start), value, most, steps)
        if switch:
            for one, found, _ in tuple(followed):
                followed += follow_doublings(one, found, most, steps)
    return _result(parameters, followed, notes)


def _is_linear(task: Task) -> bool:
    """Whether the equations have no switches, and M, C and K are the same along rest and along other
    motions."""
    system, speed = task.system, task.speed
    if warnings_of(system, speed) != warnings_of(system, speed, linear=False):
        return False
    rest, phase = task.rest(Grid.uniform(1, system.period)), compared_phases(system.period, system.breaks)
    at_rest = in_phase(task.along(rest), phase, speed)[:3]
    for size in np.outer([1.0, -1.0], _SIZES).ravel():
        motion = Curve(rest.nodes, np.full((system.n, 1, 3), size))
        pairs = zip(in_phase(task.along(motion), phase, speed)[:3], at_rest, strict=True)
        if not all(np.abs(one - other).max() <= _ROUNDOFF * np.abs(other).max() for one, other in pairs):
            return False
    return True


def continuation(
    system: PeriodicSystem,
    speeds: float | str | tuple[float | str, float | str] | None,
    over: str | None,
    periods: int,
    rtol: float,
    engine: str,
) -> tuple[ContinuationParameters, Sequence[str]]:
    """Validate the input. Return the parameters of the continuation, and notes on the engine. Raises
    SolveError subclasses for invalid input."""
    rtol, (used, notes) = checked_rtol(rtol), chosen_engine(engine)
    if over is None:
        if speeds is None or isinstance(speeds, float | int):
            raise MissingValueError("no speeds given; give a range, such as '300:600 rpm', or a parameter")
        name, (first, last) = SPEED, ramp_in_si(speeds)
        if not (first > 0 and last > 0) or first == last:
            raise ValueOutOfBoundsError(
                f"speeds are {speeds!r}; give two different speeds above 0, such as '300:600 rpm'"
            )
        speed = first
    else:
        name, first, last = range_of(system, over)
        if isinstance(speeds, tuple):
            raise ValueOutOfBoundsError(f"speeds are {speeds!r}; give one speed, since {name} varies")
        speed = speed_or_usual(system, speeds)
    system = shown_in(system, speed)
    task = Task(system, float(speed), int(periods), Radau(13), used, rtol)
    return ContinuationParameters(task, (name,), np.array([[first, last]], dtype=float)), notes


def range_of(system: PeriodicSystem, over: str) -> tuple[str, float, float]:
    """Parse the string NAME=A:B, in which a unit may follow the values. Return the name, and the first and
    last value in the declared unit of the parameter (rad/s for the speed). Raises SolveError."""
    usage = f"over is {over!r}; write NAME=A:B, two different values, such as 'k1=1e4:9e4'"
    name, equals, values = over.partition("=")
    name, (limits, _, unit) = name.strip(), apart(values.strip()).partition(" ")
    ends = limits.split(":")
    if not equals or len(ends) != 2:
        raise ValueOutOfBoundsError(usage)
    if name == SPEED:
        return name, *ramp_in_si(values)
    require_name(f"parameter of {system.labels.name}", name, system.labels.parameters)
    try:
        first, last = (in_own_unit(system, name, f"{end} {unit}".strip()) for end in ends)
    except ValueOutOfBoundsError:
        raise ValueOutOfBoundsError(usage) from None
    if first == last:
        raise ValueOutOfBoundsError(usage)
    for value in (first, last):
        require_bounds(system, {name: value})
    return name, float(first), float(last)


def _result(parameters: ContinuationParameters, followed: Sequence[Followed], notes: Sequence[str]) -> Branch:
    task, name = parameters.task, parameters.names[0]
    points = [point for _, found, _ in followed for point in found]
    values, at_speed = np.array([point.value for point in points]), name == SPEED
    fields = {name: np.array([getattr(point.orbit, name) for point in points]) for name in _FIELDS}
    ended = [
        text if not number else f"branch {number + 1}: {text}"
        for number, (_, _, text) in enumerate(followed)
        if text
    ]
    return Branch(
        task.system,
        values if at_speed else np.full(len(points), task.speed),
        kinds=np.array([KINDS.index(point.kind or KINDS[0]) for point in points]),
        numbers=np.repeat(np.arange(len(followed)), [len(found) for _, found, _ in followed]),
        counts=np.array([point.periods for point in points]),
        rtol=task.rtol,
        ended="; ".join(ended),
        notes=notes,
        periods=task.periods,
        parameters={} if at_speed else {name: values},
        curves=np.array([_sampled(point) for point in points]),
        energies=_energies(task, followed),
        **fields,
    )


def _energies(task: Task, followed: Sequence[Followed]) -> Array:
    """Return the energies (P,) of unforced orbits; empty for other orbits."""
    return np.array(
        [
            energy(task.system, point.unknowns.curve, point.value)
            for parameters, found, _ in followed
            if DAMPING in parameters.names
            for point in found
        ]
    )


def _sampled(point: Point) -> Array:
    """Return the coordinates (n, k) of an orbit at k uniform phases of its period."""
    end = float(point.grid.nodes[-1])
    return point.unknowns.curve(np.arange(_SAMPLES) * (end / _SAMPLES))
