"""Everything that is asked of a model when it is judged, gathered for one page."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

from solve.arrays import Array
from solve.derivatives.point import sensitivities
from solve.errors import MissingValueError, NoMotionError, NoResultError, SolveError
from solve.methods.choice import Rule, chosen
from solve.newton.orbits import nonlinear
from solve.progress import steps
from solve.reports.page import OVER_SPEEDS, Part, Report
from solve.results.frequencies import Findings
from solve.results.result import Result
from solve.single import floquet, periodic
from solve.studies.bands import bands
from solve.studies.critical_speeds import critical_speeds
from solve.studies.frequencies import frequencies, turn
from solve.studies.sweep import sweep
from solve.studies.validity import validity
from solve.system import PeriodicSystem, of_system
from solve.units import checked_rtol, speeds_given


class Asked(NamedTuple):
    """Heading of a part, what it shows, how its result is found, and what to find where there is none."""

    heading: str
    about: str
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
    """Vibration and stability at a speed (rad/s, or a text with unit; by default that of the case), natural
    frequencies, and over the speeds (rad/s, texts with unit, or one text such as "100:900:81 rpm") response,
    critical speeds, unstable bands and validity; what matters most.

    rtol: at the speed; over the speeds 1e-6 where that is more.

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
    with steps(len(asked)) as step:
        for heading, about, calculate, instead in asked:
            step(heading.lower())
            result, reason = _tried(calculate)
            if reason and instead is not None:
                result, _ = _tried(instead)
            found.append(Part(heading, about, result, reason))
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
    unit = system.speed_unit
    at, between = unit.text(omega), f"from {unit.span(min(omegas), max(omegas))}"
    given = {"method": rule, "rtol": rtol}
    over = {"method": rule, "rtol": max(rtol, OVER_SPEEDS)}

    def loaded(calculate: Callable[[], Result]) -> Callable[[], Result]:
        def found() -> Result:
            system.require_load(omega)
            return calculate()

        return found

    return [
        Asked(
            "Vibration and stability",
            f"The periodic vibration at {at} over one period, its spectrum and its Floquet multipliers.",
            loaded(lambda: periodic(system, omega, **given)),
            lambda: floquet(system, omega, **given),
        ),
        Asked(
            "Vibration by the nonlinear equations",
            f"The periodic vibration at {at} without linearisation, the linear one beside it.",
            loaded(lambda: nonlinear(system, omega, **given)),
        ),
        *_modes(system),
        Asked(
            "Response over speed",
            f"Largest moduli over a period and the spectral radius {between}.",
            loaded(lambda: sweep(system, omegas, **over)),
        ),
        Asked(
            "Critical speeds",
            f"Maxima of the response and of the dominant multiplier, divisions of frequencies, {between}.",
            loaded(lambda: critical_speeds(system, omegas, **over)),
        ),
        Asked(
            "Unstable bands",
            f"Speeds {between} at which disturbances grow.",
            lambda: bands(system, omegas, **over),
        ),
        Asked(
            "Validity of the linear answer",
            f"How far the linear vibration is from the nonlinear one {between}.",
            loaded(lambda: validity(system, omegas, **over)),
        ),
        Asked(
            "What matters most",
            f"Derivatives at {at} by the parameters and the speed, exact but for the errors beside them; "
            "an elasticity is the relative change by the relative change of the parameter.",
            lambda: sensitivities(system, omega, **given),
        ),
    ]


def _modes(system: PeriodicSystem) -> list[Asked]:
    """Over the turn of what moves; with their shapes of what is made of links."""
    place = " with the drive at the beginning of the turn" if system.moves else ""

    def at_rest() -> Findings:
        here = frequencies(system)
        return Findings(here, shapes=here.shapes())

    shapes = Asked(
        "Natural frequencies and modes", f"Undamped natural frequencies and mode shapes{place}.", at_rest
    )
    over = Asked(
        "Natural frequencies over the turn",
        "Undamped natural frequencies with the drive held still at positions of the turn.",
        lambda: Findings(frequencies(system), frequencies(system, turn(system))),
    )
    return [*([shapes] if system.links else []), *([over] if system.moves else [])]
