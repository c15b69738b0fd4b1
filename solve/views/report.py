"""Everything that is asked of a model when it is judged, gathered for one page."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache, partial
from typing import Any, NamedTuple

from solve.arrays import Array
from solve.derivatives.point import of_solution, quantities_by
from solve.errors import MissingValueError, NoMotionError, NoResultError, SolveError
from solve.methods.choice import Rule, chosen
from solve.newton.orbits import nonlinear
from solve.results.critical_speeds import CriticalSpeeds
from solve.results.frequencies import Findings
from solve.results.orbit import Orbit
from solve.results.result import Result
from solve.results.sensitivities import Sensitivities
from solve.results.sweep import Sweep
from solve.results.validity import Validity
from solve.single import floquet, periodic
from solve.studies.bands import bands
from solve.studies.critical_speeds import critical_speeds_of
from solve.studies.frequencies import frequencies, turn
from solve.studies.sweep import sweep
from solve.studies.validity import validity
from solve.system import PeriodicSystem, of_system, require_load
from solve.terminal import progress
from solve.units import checked_rtol, speeds_given
from solve.views.page import OVER_SPEEDS, Part, Report


class Asked(NamedTuple):
    """A part that is still to be made: how its result is found, and what to find where there is none."""

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
    """Vibration and stability at a speed, natural frequencies and what matters most; over the speeds
    response, critical speeds, unstable bands and validity.

    speeds: in rad/s, texts with unit, or one text such as "100:900:81 rpm". speed: in rad/s or a text with
    unit, by default that of the case. rtol: at the speed; over the speeds 1e-6 where that is more.

    `.save("report.html")` writes the page. A part without a result says why, and the others stand; a
    structure without motion has its frequencies and modes alone, and needs no speeds. Raises
    MissingValueError where a model that moves has no speeds or no speed, NoResultError where no part has a
    result, and other SolveError subclasses for bad input.
    """
    rule, tolerance = chosen(method), checked_rtol(rtol)
    omegas = [] if speeds is None else speeds_given(speeds)
    try:
        system.require_motion()
    except NoMotionError as reason:
        motion = "Vibration, stability, response, critical speeds, bands, validity and sensitivities."
        parts = [*_parts(_modes(system)), Part("Motion", motion, reason=str(reason))]
    else:
        if not omegas:
            raise MissingValueError('no speeds given; add a range, such as --speeds "100:900:81 rpm"')
        omega = system.speed_or_usual(speed)
        system.checked(omega)
        system = system.shown_in(omegas[0])
        parts = _parts(_of_motion(system, omega, omegas, rule, tolerance))
    if not any(part.result for part in parts):
        raise NoResultError(parts[0].reason)
    return Report(system, parts, omegas, tolerance)


def _parts(asked: Sequence[Asked]) -> list[Part]:
    """Each with its result, or with the reason why there is none."""
    found = []
    with progress.steps(len(asked)) as step:
        for part, calculate, instead in asked:
            step(part.heading.lower())
            result, reason = _tried(calculate)
            if reason and instead is not None:
                result, _ = _tried(instead)
            found.append(replace(part, result=result, reason=reason))
    return found


def _tried(calculate: Callable[[], Result]) -> tuple[Result | None, str]:
    """The result, or why there is none."""
    try:
        return calculate(), ""
    except SolveError as reason:
        return None, str(reason)


def _of_motion(
    system: PeriodicSystem, omega: float, omegas: Sequence[float], rule: Rule, rtol: float
) -> list[Asked]:
    """The parts of a model that moves."""
    unit, given = system.speed_unit, {"method": rule, "rtol": rtol}
    at, linear, other = unit.text(omega), "linear orbit" * system.nonlinear, "nonlinear orbit"
    orbit = Part(
        "Vibration and stability",
        f"The periodic vibration at {at} over one period, its spectrum and its Floquet multipliers.",
        orbit=linear,
    )
    beyond = Part(
        "Vibration by the nonlinear equations",
        f"The periodic vibration at {at} without linearisation, the linear one beside it.",
        orbit=other,
    )
    matters = Part(
        "What matters most",
        f"Derivatives at {at} by the parameters and the speed, exact but for the errors beside them; "
        "an elasticity is the relative change by the relative change of the parameter.",
    )
    nonlinear_one = partial(nonlinear, system, omega, **given)

    @cache
    def solved() -> Orbit:
        return periodic(system, omega, **given)

    def by_parameters() -> Sensitivities:
        asked = quantities_by(system, None, None)
        return of_solution(solved(), *asked)

    return [
        Asked(orbit, _loaded(solved, system, omega), lambda: floquet(system, omega, **given)),
        Asked(beyond, _loaded(nonlinear_one, system, omega)),
        *_modes(system),
        *_over_speeds(system, omega, omegas, {**given, "rtol": max(rtol, OVER_SPEEDS)}),
        Asked(matters, by_parameters),
    ]


def _over_speeds(
    system: PeriodicSystem, omega: float, omegas: Sequence[float], given: Mapping[str, Any]
) -> list[Asked]:
    between = f"from {system.speed_unit.span(min(omegas), max(omegas))}"
    response = f"Largest moduli over a period and the spectral radius {between}."
    critical = f"Maxima of the response and of the dominant multiplier, divisions of frequencies, {between}."
    unstable = f"Speeds {between} at which disturbances grow."
    off = f"How far the linear vibration is from the nonlinear one {between}."

    @cache
    def swept() -> Sweep:
        found = sweep(system, omegas, **given)
        found.results.require_any()
        return found

    def judged() -> Validity:
        found = validity(system, omegas, **given)
        found.require_any()
        return found

    def between_swept() -> CriticalSpeeds:
        return critical_speeds_of(swept(), **given)

    return [
        Asked(Part("Response over speed", response), _loaded(swept, system, omega)),
        Asked(Part("Critical speeds", critical), _loaded(between_swept, system, omega)),
        Asked(Part("Unstable bands", unstable), partial(bands, system, omegas, **given)),
        Asked(Part("Validity of the linear answer", off), _loaded(judged, system, omega)),
    ]


def _loaded(calculate: Callable[[], Result], system: PeriodicSystem, omega: float) -> Callable[[], Result]:
    """Refused where there is no load."""

    def found() -> Result:
        require_load(system, omega)
        return calculate()

    return found


def _modes(system: PeriodicSystem) -> list[Asked]:
    """Over the turn of what moves; with their shapes of what is made of links."""
    place = " with the drive at the beginning of the turn" if system.moves else ""

    def at_rest() -> Findings:
        here = frequencies(system)
        return Findings(here, shapes=here.shapes())

    def over_turn() -> Findings:
        return Findings(frequencies(system), frequencies(system, turn(system)))

    about = f"Undamped natural frequencies and mode shapes{place}."
    over = "Undamped natural frequencies with the drive held still at positions of the turn."
    found = []
    if system.links:
        found.append(Asked(Part("Natural frequencies and modes", about), at_rest))
    if system.moves:
        found.append(Asked(Part("Natural frequencies over the turn", over), over_turn))
    return found
