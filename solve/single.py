"""Periodic solution of a system at one speed, and stability without the periodic solution."""

from solve.arguments import checked_rtol
from solve.certify.all_multipliers import Spectrum, refined_multipliers, require_step_maps
from solve.certify.certified import Certified, Failed, SolveRequest
from solve.certify.model_errors import with_model_errors
from solve.certify.refinement import STEPS, certified
from solve.kernel.engines import chosen_engine
from solve.methods.choice import RADAU, Rule, auto, chosen, chosen_for
from solve.period.points import SinglePoint
from solve.results.orbit import Orbit
from solve.results.special_orbits import RigidOrbit
from solve.results.stability import Stability
from solve.system import PeriodicSystem, check, of_any_system, of_system, shown_in
from solve.terminal import progress
from solve.threads import one_thread
from solve.units import speed_in_si


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
    """Find the T-periodic solution at a speed.

    Parameters
    ----------
    system : PeriodicSystem
        System to solve.
    speed : float or str
        Speed in rad/s, or a string with a unit such as "600 rpm".
    method : str or Method
        Name of a method, a method object, or "auto".
    steps : int, optional
        Number of steps per period. The error is then estimated from a second solution, with one more stage or
        twice as many steps. By default, steps are refined until the estimated errors are at most `rtol`.
    rtol : float
        Relative tolerance. For each coordinate, it applies to max|error|/max|q| over the period; for
        multipliers, to |error| divided by the spectral radius.
    engine : str
        "compiled", "numpy", or "auto" for compiled code if a C compiler is available. The code is compiled
        once per machine, when it is first used.
    all_multipliers : bool
        Whether to apply `rtol` to each multiplier, however small; this requires more steps.

    Returns
    -------
    Orbit
        Periodic solution. For a mechanism without coordinates, it contains the outputs over the revolution,
        but neither multipliers nor a verdict.

    Raises
    ------
    ResonanceError
        If a multiplier is +1.
    SolveError
        Other subclasses for invalid input, matrices or steps.

    Notes
    -----
    The orbit solves M q̈ + C q̇ + K q = d over a period T with q(0) = q(T) and q̇(0) = q̇(T).

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
    system = shown_in(system, omega)
    if not system.labels.vibrates:
        return RigidOrbit.at_speed(system, omega)
    used, notes = chosen_engine(engine)
    solve_request = request(steps, rtol, used, orbit=True)
    return Orbit(system, omega, *_solve(system, omega, method, solve_request, all_multipliers), notes)


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
    """Find the Floquet multipliers of a system at a speed, without its orbit.

    Parameters
    ----------
    system : PeriodicSystem
        System to solve.
    speed : float or str
        Speed in rad/s, or a string with a unit such as "600 rpm".
    method, steps : optional
        As in `periodic`.
    rtol : float
        Relative tolerance of the multipliers: |error| divided by the spectral radius.
    engine, all_multipliers : optional
        As in `periodic`.

    Returns
    -------
    Stability
        Multipliers, exponents, modes and verdict.

    Raises
    ------
    SolveError
        A subclass, for invalid input, matrices or steps.

    Notes
    -----
    Multipliers are the eigenvalues of the state transition matrix over a period (G. Floquet, Annales
    scientifiques de l'É.N.S. 12, 1883, 47-88).

    Examples
    --------
    >>> import numpy as np
    >>> def oscillator(phase, speed):
    ...     one = np.ones((len(phase), 1, 1))
    ...     return one, 0.1 * one, 4.0 * one, np.zeros((len(phase), 1))
    >>> round(floquet(PeriodicSystem(oscillator, ["q"]), 1.0).spectral_radius, 6)
    0.730403
    """
    omega = speed_in_si(speed)
    system = shown_in(system, omega)
    used, notes = chosen_engine(engine)
    solve_request = request(steps, rtol, used, orbit=False)
    return Stability(system, omega, *_solve(system, omega, method, solve_request, all_multipliers), notes)


def request(steps: int | None, rtol: float, engine: str, orbit: bool) -> SolveRequest:
    """Settings for the solution of points: steps, tolerance, engine, and the reference methods for error
    estimates. The engine is COMPILED or NUMPY. Raises ValueOutOfBoundsError."""
    return SolveRequest(orbit, checked_rtol(rtol), steps, engine, RADAU, auto)


def _solve(
    system: PeriodicSystem,
    omega: float,
    method: str | Rule,
    solve_request: SolveRequest,
    all_multipliers: bool,
) -> tuple[Certified, Spectrum]:
    """Return the certified solution of a point, and its multipliers. With `all_multipliers`, each multiplier
    meets the tolerance."""
    rule = chosen(method)
    check(system, omega)
    point = SinglePoint(system, omega)
    with one_thread(system.n):
        ((method_used, _),) = chosen_for(rule, point)
        if all_multipliers:
            require_step_maps(method_used)
        with progress.task(STEPS):
            (result,) = certified(point, method_used, solve_request)
        if isinstance(result, Failed):
            raise result.reason
        result = with_model_errors(result, lambda _: (system, omega))
        refined = refined_multipliers(point, result) if all_multipliers else None
    return result, Spectrum(point, result, refined, all_multipliers)
