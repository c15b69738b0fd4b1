"""Natural frequencies of the mechanism at rest: at one position, at positions over the period, or versus a
parameter."""

import math
from collections.abc import Sequence

import numpy as np

from solve.arguments import NUMBERS_A_POINT, described, require_size
from solve.arrays import Array, uniform_phases
from solve.contracts import Matrices
from solve.equations import freedoms_of, most_frequencies, require_desired_motion
from solve.errors import (
    DesiredMotionError,
    MatricesError,
    NoMotionError,
    NoResultError,
    SolveError,
    ValueOutOfBoundsError,
    counted,
    require_name,
)
from solve.labels import in_own_unit
from solve.matrices import require_inertia
from solve.period.natural import NaturalFrequencies, natural_frequencies
from solve.period.rigid_body import rigid_body_modes
from solve.results.frequencies import Frequencies, Variation
from solve.results.rigid_body import RigidBodyMode, rigid_body_modes_of
from solve.system import PeriodicSystem, check, of_system
from solve.units import require_size_of_number, speed_in_si, with_unit

USUAL_COUNT = 4

TURN = 36
"""Default number of positions per period. Chosen by judgement."""

_RUNNING = 1.0
"""If matrices do not exist at speed 0 and no case states a speed, their existence is tested at this speed in
rad/s. Chosen by judgement."""


@of_system
def frequencies(
    system: PeriodicSystem, position: float | str | Sequence[float] | Array = 0.0, count: int | None = None
) -> Frequencies:
    """Compute the natural frequencies of M and K at speed 0, with the drive held at a position.

    Parameters
    ----------
    system : PeriodicSystem
        System to solve.
    position : float, str or sequence of float
        Angle in rad, a string with a unit such as "70 deg", or several angles in rad.
    count : int, optional
        Number of modes, by default 4.

    Returns
    -------
    Frequencies
        Natural frequencies in ascending order of λ in K v = λ M v: first the modes with λ < 0, which grow at
        the rate √−λ, then the rigid-body modes, whose frequency is exactly 0, then the vibrating modes.

    Raises
    ------
    ValueOutOfBoundsError, UnitError, StructureError
        For bad input.
    MatricesError
        If M is singular, or if there are no matrices at speed 0.

    Examples
    --------
    >>> import solve
    >>> found = frequencies(solve.load("portal_frame"), count=2)
    >>> found.values.shape
    (1, 2)
    """
    positions = _angles(position)
    require_size("positions", len(positions), freedoms_of(system) ** 2 + NUMBERS_A_POINT)
    natural_frequencies = natural(system, positions, _checked_count(system, count))
    return Frequencies(system, positions, *natural_frequencies, _rigid_body_modes(system, positions[:1]))


def _angles(position: float | str | Sequence[float] | Array) -> Array:
    """Return positions (m,) in rad. Raises ValueOutOfBoundsError, UnitError."""
    phase = with_unit(position, "rad") if isinstance(position, str) else position
    positions = np.atleast_1d(np.asarray(phase, dtype=float))
    if positions.ndim != 1 or positions.size == 0 or not np.isfinite(positions).all():
        raise ValueOutOfBoundsError(
            f"position is {described(position)}; allowed: finite angles in rad, or '70 deg'"
        )
    for value in positions:
        require_size_of_number("position", float(value))
    return positions


def natural(system: PeriodicSystem, positions: Array, count: int) -> NaturalFrequencies:
    """Return the frequencies of the `count` lowest modes at positions (m,). Raises MatricesError if M is
    singular, or if M or K does not exist at speed 0."""
    if system.capabilities.structure is not None:
        omegas = system.capabilities.structure.frequencies(positions, count)
        return NaturalFrequencies(omegas, np.full(omegas.shape, np.nan))
    if len(system.states):
        raise MatricesError(
            f"{system.labels.name} has first-order states, such as {system.states[0]}, and no natural "
            "frequencies of M and K; use floquet, whose modes have frequencies"
        )
    M, _, K, _ = at_speed_zero(system, positions)
    require_inertia(M)
    return natural_frequencies(M, K, count)


def at_speed_zero(system: PeriodicSystem, positions: Array) -> Matrices:
    """Return M, C, K, d at positions (m,), for speed 0. Raises DesiredMotionError if the fundamental motion
    is undefined at speed 0, and MatricesError if the matrices are undefined. The message names speed 0 as the
    cause if the matrices exist at another speed."""
    unit = system.labels.speed_unit
    elsewhere = f'for mean frequencies at running speeds use solve critical --speeds "A:B:N {unit.name}"'
    try:
        require_desired_motion(system, np.zeros(1))
    except DesiredMotionError as error:
        cause, _, _ = str(error).partition("; change ")
        raise DesiredMotionError(
            "natural frequencies are evaluated at speed 0, where the fundamental motion does not exist: "
            f"{cause}; {elsewhere}"
        ) from None
    try:
        return system.at(positions, 0.0)
    except (MatricesError, ZeroDivisionError) as error:
        running = speed_in_si(system.labels.case_speed) if system.labels.case_speed else _RUNNING
        try:
            check(system, running)
            system.at(positions, running)
        except (SolveError, ZeroDivisionError):
            raise error from None
        raise MatricesError(
            f"{system.labels.name} has no finite M, C, K at speed 0, where natural frequencies are "
            f"evaluated, but at {unit.text(running, '.4g')} they are finite: a term "
            f"divides by the speed; {elsewhere}"
        ) from None


def _rigid_body_modes(system: PeriodicSystem, position: Array) -> Sequence[RigidBodyMode]:
    """Return the rigid-body modes of K at a position (1,); an empty list for beam structures."""
    if system.labels.links:
        return []
    _, C, K, _ = system.at(position, 0.0)
    return rigid_body_modes_of(rigid_body_modes(K[None], C[None]))


def require_position(system: PeriodicSystem, given: object, flag: str = "position") -> None:
    """Raise NoMotionError if the system is a structure at rest and `given`, the value of the option `flag`,
    is not None."""
    if given is not None and not system.labels.moves:
        raise NoMotionError(f"{system.labels.name} is a structure at rest; omit {flag}")


def turn(system: PeriodicSystem, count: int = TURN) -> Array:
    """Return `count` evenly spaced positions over a period, from 0. Raises ValueOutOfBoundsError if `count`
    is below 2."""
    require_position(system, count, "turn")
    if count < 2:
        raise ValueOutOfBoundsError(
            f"turn is {count}; allowed: 2 or more positions per period, such as {TURN}"
        )
    require_size("positions", count, NUMBERS_A_POINT)
    return uniform_phases(count, system.period)


@of_system
def frequencies_over(
    system: PeriodicSystem,
    parameter: str,
    values: Sequence[float | str] | Array,
    positions: Array,
    count: int | None = None,
) -> Variation:
    """Compute natural frequencies versus a parameter, at one or several positions.

    Parameters
    ----------
    system : Model
        Model with the parameter.
    parameter : str
        Name of the parameter.
    values : sequence of float or str
        Values in the parameter's own unit, or strings with a unit.
    positions : ndarray, shape (m,)
        Angles in rad.
    count : int, optional
        Number of modes, by default 4, in the order of `frequencies`.

    Returns
    -------
    Variation
        Natural frequencies at each value. At values that the system rejects, the frequencies are NaN, with
        the reason.

    Raises
    ------
    UnknownNameError, UnitError
        For bad input.
    NoResultError
        If the system rejects all values.
    """
    require_name(f"parameter of {system.labels.name}", parameter, system.labels.parameters)
    if len(values) == 0 or np.size(positions) == 0:
        raise ValueOutOfBoundsError(
            f"{len(values)} values at {np.size(positions)} positions; give at least one of each"
        )
    positions = _angles(positions)
    k = _checked_count(system, count)
    require_size(
        "values at all positions", len(values) * len(positions), freedoms_of(system) ** 2 + NUMBERS_A_POINT
    )
    numbers = np.array([in_own_unit(system, parameter, value) for value in values])
    roots = np.full((2, len(values), len(positions), k), math.nan)
    pinned = {link.name: np.full(len(values), math.nan) for link in system.labels.links}
    errors: list[str | None] = []
    for number, value in enumerate(numbers.tolist()):
        try:
            varied = system.varied({parameter: value})
            roots[:, number] = natural(varied, positions, _checked_count(varied, k))
        except SolveError as error:
            errors.append(str(error))
            continue
        errors.append(None)
        pinned_links = (
            varied.capabilities.structure.pinned_frequencies() if varied.capabilities.structure else {}
        )
        for link, frequency in pinned_links.items():
            pinned[link][number] = frequency
    if all(errors):
        raise NoResultError(
            f"{counted(len(errors), 'value')} of {parameter}, none with a result: {errors[0]}"
        )
    return Variation(system, parameter, numbers, positions, roots[0], pinned, tuple(errors), roots[1])


def _checked_count(system: PeriodicSystem, count: int | None) -> int:
    most = most_frequencies(system)
    if count is None:
        return min(USUAL_COUNT, most)
    if not (isinstance(count, int | np.integer) and 1 <= count <= most):
        raise ValueOutOfBoundsError(
            f"count is {count}; allowed for {system.labels.name} with these options: 1 … {most}"
        )
    return count
