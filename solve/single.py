"""Periodic solution and stability of a system at a single speed."""

from solve.certify.all_multipliers import Spectrum, checked_maps, refined, rigid_multipliers
from solve.certify.certified import Certified, Failed, Request
from solve.certify.reduction import judged_by_enriched
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
    """Compute the T-periodic solution at a speed.

    Parameters
    ----------
    system : PeriodicSystem
        System, for example from `solve.load`.
    speed : float or str
        Ω in rad/s, or a text with unit such as "600 rpm".
    method : str or method object
        Name or object of a method; "auto" selects one.
    steps : int, optional
        Number of steps per period. The error is then estimated from one more stage, or from twice as many
        steps. By default, steps are refined until the estimated errors are at most `rtol`.
    rtol : float
        Relative tolerance of orbit and multipliers.
    engine : {"auto", "compiled", "numpy"}
        "auto" uses compiled code if a C compiler is available. The first solution of a kind includes the
        compilation, once per machine.
    all_multipliers : bool
        Apply `rtol` to each multiplier individually, at the cost of more steps.

    Returns
    -------
    Orbit
        For a mechanism without coordinates, outputs over the revolution without multipliers and verdict.

    Raises
    ------
    ResonanceError
        If a multiplier is +1.
    SolveError
        Other subclasses for invalid input, matrices or steps.

    Examples
    --------
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
    solved = _solve(system, omega, method, steps, rtol, engine, True, all_multipliers)
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
    """Compute the Floquet multipliers at a speed.

    Parameters
    ----------
    system : PeriodicSystem
        System, for example from `solve.load`.
    speed : float or str
        Ω in rad/s, or a text with unit such as "600 rpm".
    method, steps, rtol, engine, all_multipliers
        As in `solve.periodic`.

    Returns
    -------
    Stability
        Multipliers, exponents and verdict, without an orbit.

    Raises
    ------
    SolveError
        Subclasses for invalid input, matrices or steps.

    Examples
    --------
    >>> import numpy as np
    >>> one = np.ones((3, 1, 1))
    >>> system = PeriodicSystem.from_samples(one, one, one, one[:, 0], ["q"])
    >>> round(floquet(system, 1.0).spectral_radius, 6)
    0.043214
    """
    omega = speed_in_si(speed)
    system = system.shown_in(omega)
    solved = _solve(system, omega, method, steps, rtol, engine, False, all_multipliers)
    return Stability(system, omega, *solved)


def request(steps: int | None, rtol: float, engine: str, orbit: bool) -> Request:
    """Solve request with the methods used for comparison; engine: COMPILED or NUMPY. Raises
    ValueOutOfBoundsError."""
    return Request(orbit, checked_rtol(rtol), steps, engine, Radau(), auto)


def _solve(
    system: PeriodicSystem,
    omega: float,
    method: str | Rule,
    steps: int | None,
    rtol: float,
    engine: str,
    orbit: bool,
    all_multipliers: bool,
) -> tuple[Certified, Spectrum, list[str]]:
    rule, (used, notes) = chosen(method), chosen_engine(engine)
    solve_request = request(steps, rtol, used, orbit)
    system.checked(omega)
    point = OnePoint(system, omega)
    with one_thread(system.n):
        ((selected, _),) = chosen_for(rule, point)
        if all_multipliers:
            checked_maps(selected)
        with progress.task(STEPS):
            (result,) = certified(point, selected, solve_request)
        if isinstance(result, Failed):
            raise result.reason
        result = judged_by_enriched(result, lambda _: (system, omega))
        individual = None
        if all_multipliers:
            individual = refined(point, selected, solve_request, result.steps, rigid_multipliers(result))
    return result, Spectrum(point, result, individual), notes
