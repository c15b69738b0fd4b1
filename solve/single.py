"""One point: the periodic solution of a system, found directly, or its stability alone."""

from solve.certify.certificate import certified
from solve.methods.choice import chosen
from solve.methods.method import Method
from solve.results.orbit import Orbit
from solve.results.stability import Stability
from solve.system import PeriodicSystem
from solve.units import checked_rtol, speed_in_si


def periodic(
    system: PeriodicSystem,
    speed: float | str,
    method: str | Method = "auto",
    steps: int | None = None,
    rtol: float = 1e-8,
) -> Orbit:
    """The T-periodic solution at a speed (rad/s, or a text with unit such as "600 rpm").

    With `steps`, the method's result on that many steps, its error estimated from twice as many;
    without, steps grow until the estimated errors of orbit and multipliers are `rtol` or less.
    Raises ResonanceError where a multiplier is at +1, and other SolveError subclasses for bad input,
    matrices or steps.

    >>> import numpy as np
    >>> def oscillator(phase, speed):
    ...     one = np.ones((len(phase), 1, 1))
    ...     return one, 0.1 * one, 4.0 * one, np.cos(phase)[:, None]
    >>> orbit = periodic(PeriodicSystem(oscillator, ["q"]), 1.0)
    >>> round(float(orbit.harmonics("q")[0][1]), 9)
    0.333148302
    """
    omega, rule = speed_in_si(speed), chosen(method)
    system.checked(omega)
    return Orbit(system, omega, certified(system, omega, rule, steps, checked_rtol(rtol)))


def floquet(
    system: PeriodicSystem,
    speed: float | str,
    method: str | Method = "auto",
    steps: int | None = None,
    rtol: float = 1e-8,
) -> Stability:
    """Floquet multipliers of the system at a speed (rad/s, or a text with unit such as "600 rpm").

    With `steps`, the method's result on that many steps, its error estimated from twice as many;
    without, steps grow until the estimated error is `rtol` or less. Raises SolveError
    subclasses for bad input, matrices or steps.
    """
    omega, rule = speed_in_si(speed), chosen(method)
    system.checked(omega)
    return Stability(system, omega, certified(system, omega, rule, steps, checked_rtol(rtol), orbit=False))
