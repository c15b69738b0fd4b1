"""One point: the periodic solution of a system, found directly, or its stability alone."""

from solve.certify.all_multipliers import (
    Spectrum,
    refined_multipliers,
    require_step_maps,
    rigid_multipliers,
)
from solve.certify.certified import Certified, Failed, SolveRequest
from solve.certify.reduction import with_reduction_errors
from solve.certify.refinement import STEPS, certified
from solve.kernel.engines import chosen_engine
from solve.methods.choice import Rule, auto, chosen, chosen_for
from solve.methods.radau import Radau
from solve.period.points import OnePoint
from solve.results.orbit import Orbit
from solve.results.rigid import RigidOrbit
from solve.results.stability import Stability
from solve.system import PeriodicSystem, of_any_system, of_system
from solve.terminal import progress
from solve.threads import one_thread
from solve.units import checked_rtol, speed_in_si


@of_any_system
def periodic(
    system: PeriodicSystem,
    speed: float | str,
    method: str | Rule = "auto",
    steps: int | None = None,
    rtol: float = 1e-8,
    engine: str = "auto",
    all_multipliers: bool = False,
) -> Orbit:
    """The T-periodic solution at a speed (rad/s, or a text with unit such as "600 rpm").

    With `steps`, the result is that of the method on this number of steps, with an error estimate from one
    stage more, or from twice as many steps. Without, steps are refined until the estimated errors of orbit
    and multipliers are at most `rtol`. engine: "compiled", "numpy", or "auto" for compiled code if a C
    compiler is available; the first solution of a kind then includes the compilation, once per machine.
    all_multipliers: apply `rtol` to each multiplier, however small, at the cost of more steps. A mechanism
    without coordinates has outputs over the revolution, but neither multipliers nor a verdict. Raises
    ResonanceError if a multiplier is +1, and other SolveError subclasses for bad input, matrices or steps.

    >>> import numpy as np
    >>> def oscillator(phase, speed):
    ...     one = np.ones((len(phase), 1, 1))
    ...     return one, 0.1 * one, 4.0 * one, np.cos(phase)[:, None]
    >>> orbit = periodic(PeriodicSystem(oscillator, ["q"]), 1.0)
    >>> round(float(orbit.harmonics("q")[0][1]), 9)
    0.333148302
    """
    omega = speed_in_si(speed)
    system = system.shown_in(omega)
    if not system.vibrates:
        return RigidOrbit.of(system, omega)
    solved = _solved(system, omega, method, steps, rtol, engine, True, all_multipliers)
    return Orbit(system, omega, *solved)


@of_system
def floquet(
    system: PeriodicSystem,
    speed: float | str,
    method: str | Rule = "auto",
    steps: int | None = None,
    rtol: float = 1e-8,
    engine: str = "auto",
    all_multipliers: bool = False,
) -> Stability:
    """Floquet multipliers of the system at a speed (rad/s, or a text with unit such as "600 rpm").

    With `steps`, the result is that of the method on this number of steps, with an error estimate from one
    stage more, or from twice as many steps. Without, steps are refined until the estimated error is at most
    `rtol`. engine, all_multipliers: as in `periodic`. Raises SolveError subclasses for bad input, matrices or
    steps."""
    omega = speed_in_si(speed)
    system = system.shown_in(omega)
    solved = _solved(system, omega, method, steps, rtol, engine, False, all_multipliers)
    return Stability(system, omega, *solved)


def request(steps: int | None, rtol: float, engine: str, orbit: bool) -> SolveRequest:
    """What is asked of points, with the methods that judge others; engine: COMPILED or NUMPY. Raises
    ValueOutOfBoundsError."""
    return SolveRequest(orbit, checked_rtol(rtol), steps, engine, Radau(), auto)


def _solved(
    system: PeriodicSystem,
    omega: float,
    method: str | Rule,
    steps: int | None,
    rtol: float,
    engine: str,
    orbit: bool,
    every: bool,
) -> tuple[Certified, Spectrum, list[str]]:
    rule, (used, notes) = chosen(method), chosen_engine(engine)
    asked = request(steps, rtol, used, orbit)
    system.checked(omega)
    point = OnePoint(system, omega)
    with one_thread(system.n):
        ((settled, _),) = chosen_for(rule, point)
        if every:
            require_step_maps(settled)
        with progress.task(STEPS):
            (result,) = certified(point, settled, asked)
        if isinstance(result, Failed):
            raise result.reason
        result = with_reduction_errors(result, lambda _: (system, omega))
        every_one = (
            refined_multipliers(point, settled, asked, result.steps, rigid_multipliers(result))
            if every
            else None
        )
    return result, Spectrum(point, result, every_one), notes
