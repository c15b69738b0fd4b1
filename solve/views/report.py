"""Report on a model: computation of all studies for one HTML page."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache, partial
from typing import Any, NamedTuple

from solve.arguments import checked_rtol
from solve.arrays import Array
from solve.certify.coefficients import require_load
from solve.derivatives.point import of_solution, quantities_by
from solve.equations import is_nonlinear
from solve.errors import MissingValueError, NoMotionError, NoResultError, SolveError
from solve.labels import require_motion, speed_or_usual
from solve.methods.choice import Rule, chosen
from solve.newton.orbits import nonlinear
from solve.results.critical_speeds import CriticalSpeeds
from solve.results.frequencies import Findings
from solve.results.orbit import Orbit
from solve.results.result import Result
from solve.results.sensitivities import Sensitivities
from solve.results.sweep import Sweep
from solve.results.sweeps import Validity
from solve.single import floquet, periodic
from solve.studies.bands import bands
from solve.studies.critical_speeds import critical_speeds_of
from solve.studies.frequencies import frequencies, turn
from solve.studies.sweep import sweep, validity
from solve.system import PeriodicSystem, check, of_system, shown_in
from solve.terminal import progress
from solve.units import speeds_given
from solve.views.page import Part, Report
from solve.views.panels import DRAWN_RTOL


class Request(NamedTuple):
    """Section to compute: its texts, the function that computes its result, and a function that computes a
    substitute if there is no result."""

    part: Part
    calculate: Callable[[], Result]
    instead: Callable[[], Result] | None = None


@of_system
def report(
    system: PeriodicSystem,
    speeds: float | str | Sequence[float | str] | Array | None = None,
    speed: float | str | None = None,
    method: str | Rule = "auto",
    rtol: float = 1e-8,
) -> Report:
    """Compute all results of a system, for a report on one HTML page.

    Results at `speed` are the vibration, the stability, the natural frequencies and the sensitivities.
    Results at several speeds are the response, the critical speeds, the unstable bands and the validity of
    the linear model.

    Parameters
    ----------
    system : PeriodicSystem or str
        System, or the name of a model.
    speeds : float, str or sequence of float or str, optional
        Speeds in rad/s, strings with a unit, or one string such as "100:900:81 rpm". Not required for a
        structure at rest.
    speed : float or str, optional
        Speed in rad/s, or a string with a unit; by default the speed of the case.
    method : str or Method
        Method, as in `periodic`.
    rtol : float
        Relative tolerance of results at `speed`. For results at several speeds, it is at least 1e-6.

    Returns
    -------
    Report
        Report. Its method `save` writes the page. A section without a result states the reason.

    Raises
    ------
    MissingValueError
        If a model that moves has no speeds or no speed.
    NoResultError
        If no section has a result.
    SolveError
        For other bad input.
    """
    rule, tolerance = chosen(method), checked_rtol(rtol)
    omegas = [] if speeds is None else speeds_given(speeds)
    try:
        require_motion(system)
    except NoMotionError as reason:
        motion = "Vibration, stability, response, critical speeds, bands, validity and sensitivities."
        parts = [*_parts(_modes(system)), Part("Motion", motion, reason=str(reason))]
    else:
        if not omegas:
            raise MissingValueError('no speeds given; add a range, such as --speeds "100:900:81 rpm"')
        omega = speed_or_usual(system, speed)
        check(system, omega)
        system = shown_in(system, omegas[0])
        parts = _parts(_of_motion(system, omega, omegas, rule, tolerance))
    if not any(part.result for part in parts):
        raise NoResultError(parts[0].reason)
    return Report(system, parts, omegas, tolerance)


def _parts(requests: Sequence[Request]) -> list[Part]:
    """Compute sections. Return them with their results, or with the reasons why results are missing."""
    parts = []
    with progress.steps(len(requests)) as step:
        for part, calculate, instead in requests:
            step(part.heading.lower())
            result, reason = _tried(calculate)
            if reason and instead is not None:
                result, _ = _tried(instead)
            parts.append(replace(part, result=result, reason=reason))
    return parts


def _tried(calculate: Callable[[], Result]) -> tuple[Result | None, str]:
    """Return the result of a computation, or None and the reason of the failure."""
    try:
        return calculate(), ""
    except SolveError as reason:
        return None, str(reason)


def _of_motion(
    system: PeriodicSystem, omega: float, omegas: Sequence[float], rule: Rule, rtol: float
) -> list[Request]:
    """Return the sections of the report for a model that has equations of motion, and not only natural
    frequencies."""
    unit, options = system.labels.speed_unit, {"method": rule, "rtol": rtol}
    at, linear, other = unit.text(omega), "linear orbit" * is_nonlinear(system), "nonlinear orbit"
    orbit = Part(
        "Vibration and stability",
        f"The periodic vibration at {at} over one period, its spectrum and its Floquet multipliers.",
        orbit=linear,
    )
    beyond = Part(
        "Vibration by the nonlinear equations",
        f"The periodic vibration at {at} without linearisation, compared with the linear vibration.",
        orbit=other,
    )
    matters = Part(
        "Sensitivities",
        f"Derivatives at {at} with respect to the parameters and the speed, exact except for the "
        "stated errors; an elasticity is the relative change of the quantity per relative change of "
        "the parameter.",
    )
    nonlinear_one = partial(nonlinear, system, omega, **options)

    @cache
    def solved() -> Orbit:
        return periodic(system, omega, **options)

    def by_parameters() -> Sensitivities:
        return of_solution(solved(), *quantities_by(system, None, None))

    return [
        Request(orbit, _loaded(solved, system, omega), lambda: floquet(system, omega, **options)),
        Request(beyond, _loaded(nonlinear_one, system, omega)),
        *_modes(system),
        *_over_speeds(system, omega, omegas, {**options, "rtol": max(rtol, DRAWN_RTOL)}),
        Request(matters, by_parameters),
    ]


def _over_speeds(
    system: PeriodicSystem, omega: float, omegas: Sequence[float], options: Mapping[str, Any]
) -> list[Request]:
    between = f"from {system.labels.speed_unit.span(min(omegas), max(omegas))}"
    response = f"Largest absolute values over a period and the spectral radius {between}."
    critical = f"Maxima of the response and of the dominant multiplier, divisions of frequencies, {between}."
    unstable = f"Speeds {between} at which perturbations grow."
    off = f"Difference between the linear and the nonlinear vibration {between}."

    @cache
    def swept() -> Sweep:
        result = sweep(system, omegas, **options)
        result.results.require_any()
        return result

    def valid() -> Validity:
        result = validity(system, omegas, **options)
        result.require_any()
        return result

    def between_swept() -> CriticalSpeeds:
        return critical_speeds_of(swept(), **options)

    return [
        Request(Part("Response versus speed", response), _loaded(swept, system, omega)),
        Request(Part("Critical speeds", critical), _loaded(between_swept, system, omega)),
        Request(Part("Unstable bands", unstable), partial(bands, system, omegas, **options)),
        Request(Part("Validity of the linear model", off), _loaded(valid, system, omega)),
    ]


def _loaded(calculate: Callable[[], Result], system: PeriodicSystem, omega: float) -> Callable[[], Result]:
    """Return a computation that first requires that there is a load."""

    def checked() -> Result:
        require_load(system, omega)
        return calculate()

    return checked


def _modes(system: PeriodicSystem) -> list[Request]:
    """Return the sections on natural frequencies: mode shapes of structures, and frequencies of mechanisms
    over the revolution."""
    place = " with the drive at the beginning of the revolution" if system.labels.moves else ""

    def at_start() -> Findings:
        here = frequencies(system)
        return Findings(here, shapes=here.shapes())

    def over_turn() -> Findings:
        return Findings(frequencies(system), frequencies(system, turn(system)))

    about = f"Undamped natural frequencies and mode shapes{place}."
    over = "Undamped natural frequencies with the drive held still at positions of a revolution."
    requests = []
    if system.labels.links:
        requests.append(Request(Part("Natural frequencies and modes", about), at_start))
    if system.labels.moves:
        requests.append(Request(Part("Natural frequencies over a revolution", over), over_turn))
    return requests
