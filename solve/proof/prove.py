"""The function `prove`, which encloses the multipliers, the verdict and the orbit of a system."""

from concurrent.futures import Executor

from solve.arguments import first_is
from solve.errors import LinearModelError, MissingValueError, ValueOutOfBoundsError
from solve.labels import require_vibration
from solve.model.model import LinearisedModel, Model
from solve.model.sampling import MatrixSampler
from solve.proof.result import Proof
from solve.results.chart import ProvedBoxes
from solve.results.special_orbits import NonlinearOrbit
from solve.results.stability import Stability
from solve.single import floquet, periodic
from solve.system import PeriodicSystem

DIGITS = 20
"""Default number of decimal digits of enclosures, relative to the spectral radius. Chosen by judgement."""

_MOST_DIGITS = 1000
"""Largest permitted number of digits. Chosen by judgement: the computing time grows with the square of this
number and reaches minutes."""


@first_is(PeriodicSystem, Stability, such_as="solve.load('cam')")
def prove(
    system: PeriodicSystem | Stability,
    speed: float | str | None = None,
    digits: int | None = None,
    rounded: bool = False,
    orbit: bool = True,
    executor: Executor | None = None,
) -> Proof:
    """Enclose the multipliers and the periodic solution of a system, and prove the stability verdict.

    For a nonlinear orbit, existence and local uniqueness near a trigonometric polynomial are also proved.

    Parameters
    ----------
    system : PeriodicSystem or Stability
        A model with generated matrices, a system from samples or from a function that accepts symbolic phases
        (see docs/proof.md), or a result for one of these, such as a linear or nonlinear orbit.
    speed : float or str, optional
        Speed in rad/s, or a text with unit. It must be omitted if `system` is a result.
    digits : int, optional
        Decimal digits of the multipliers relative to the spectral radius; 20 by default, and at most 12 for a
        nonlinear orbit.
    rounded : bool, optional
        Whether the proof covers all real numbers within two units in the last place of the given ones.
        Integers are exact. By default, the proof covers exactly the given double-precision numbers.
    orbit : bool, optional
        Whether to enclose the periodic solution also. The orbit of a result is always enclosed.
    executor : Executor, optional
        Executor that computes the steps of the period in parallel, for example a
        `concurrent.futures.ProcessPoolExecutor`.

    Returns
    -------
    Proof
        Enclosures and verdict. The verdict is "undetermined" if no verdict is proved.

    Raises
    ------
    LinearModelError
        If the matrices of the system cannot be evaluated for symbols, or the equations of a nonlinear orbit
        have jumps.
    MissingLibraryError
        If python-flint is not installed.
    StepsError
        If a step cannot be enclosed.
    ValueOutOfBoundsError
        If the number of digits is below 1 or above 1000.

    Examples
    --------
    >>> import solve
    >>> solve.prove(solve.load("mathieu"), 1.0).verdict
    'asymptotically stable'
    """
    wanted = checked_digits(digits)
    if isinstance(system, Stability):
        if speed is not None:
            raise ValueOutOfBoundsError("the result already has a speed; omit the speed")
        result = system
    elif speed is None:
        raise MissingValueError('no speed given; add one, such as "600 rpm"')
    else:
        require_provable(system)
        result = periodic(system, speed) if orbit else floquet(system, speed)
    if isinstance(result, NonlinearOrbit):
        return _enclosed_orbit(result, wanted, rounded, executor)
    from solve.proof.enclosure import enclosed

    return enclosed(require_provable(result.system), result, wanted, rounded, executor)


def _enclosed_orbit(orbit: NonlinearOrbit, digits: int, rounded: bool, executor: Executor | None) -> Proof:
    if not isinstance(orbit.system, LinearisedModel):
        raise LinearModelError(
            "a proof requires the equations of the orbit, which a result read from a file does not contain; "
            "compute the orbit again"
        )
    require_provable(orbit.system.model, nonlinear=True)
    from solve.proof.nonlinear import enclosed_orbit

    return enclosed_orbit(orbit, orbit.system, digits, rounded, executor)


def checked_digits(digits: int | None) -> int:
    """Return the number of digits, or the default for None. Raises ValueOutOfBoundsError."""
    if digits is not None and not 1 <= digits <= _MOST_DIGITS:
        raise ValueOutOfBoundsError(f"digits is {digits}; allowed: 1 to {_MOST_DIGITS}")
    return DIGITS if digits is None else digits


def require_provable(system: PeriodicSystem, nonlinear: bool = False) -> PeriodicSystem:
    """Return the system if its matrices can be enclosed.

    The matrices must be a generated function of the phase, a user's function that accepts symbolic phases, or
    an interpolant of samples. With `nonlinear`, the system must be a model with nonlinear equations without
    jumps. Raises LinearModelError, and MissingLibraryError without python-flint."""
    require_vibration(system)
    if isinstance(system, Model):
        possible = isinstance(system._matrices, MatrixSampler) and not system.assembled
    else:
        possible = type(system) is PeriodicSystem and not nonlinear
    if not possible:
        raise LinearModelError(
            "a proof requires matrices that are symbolic functions of the phase; structures, models with "
            "modal damping and first-order systems do not have them"
        )
    if nonlinear and system.breaks:
        raise LinearModelError(
            "a proof of a nonlinear orbit requires equations without jumps or kinks in the phase; "
            f"{system.labels.name} has breaks"
        )
    from solve.proof.instructions import Instructions
    from solve.proof.symbolic import linearised

    if nonlinear and isinstance(system, Model):
        Instructions.from_function(system.setup.function("residual"))
    else:
        Instructions.from_function(linearised(system))
    return system


def prove_boxes(
    system: Model,
    names: tuple[str, str],
    ranges: tuple[tuple[float, float], tuple[float, float]],
    speed: float | None,
    executor: Executor | None = None,
) -> ProvedBoxes:
    """Divide the ranges of two quantities into boxes, and prove a verdict on as many boxes as possible.

    Parameters
    ----------
    system : Model
        See `require_provable`.
    names : tuple of str
        Names of two parameters, or of one parameter and "speed".
    ranges : tuple of pairs of float
        Lower and upper end of the range of each quantity, in the units of the model; speeds in rad/s.
    speed : float or None
        Speed in rad/s, if it is not one of the two quantities.
    executor : Executor, optional
        Executor that computes monodromy matrices in parallel.

    Raises
    ------
    LinearModelError
        If the system has no generated matrices, or has jumps that move with one of the quantities.
    """
    from solve.proof.boxes import proved_boxes
    from solve.proof.regions import Box, Plane

    require_provable(system)
    plane, box = Plane(system, names, speed), Box(*ranges)
    moved = {plane.at(x, y)[0].breaks for x in box.x for y in box.y}
    if len(moved) > 1:
        raise LinearModelError(
            f"jumps of the equations move with {' or '.join(names)}, which a proved chart does not allow; "
            "choose other quantities"
        )
    return proved_boxes(plane, box, executor)
