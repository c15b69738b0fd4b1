"""Sensitivities over speed, and of speeds: of the edges of unstable bands and of critical speeds, by the
implicit function theorem (S. G. Krantz, H. R. Parks, The Implicit Function Theorem, 2013)."""

import functools
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from solve.approximation import slope
from solve.arguments import first_is
from solve.arrays import Array
from solve.derivatives.point import periods_of, quantities_by, sensitivities
from solve.errors import NoResultError, SolveError, ValueOutOfBoundsError
from solve.labels import SPEED
from solve.methods.choice import Rule
from solve.methods.free import free
from solve.period.named import RADIUS
from solve.period.points import OnePoint
from solve.period.rigid_body import before_rigid
from solve.results.bands import Bands
from solve.results.critical_rows import Maximum
from solve.results.critical_speeds import CriticalSpeeds
from solve.results.sensitivities import Sensitivities, Sensitivity
from solve.results.sensitivities_over import SensitivitiesOver
from solve.system import PeriodicSystem, of_system
from solve.terminal import progress
from solve.units import speeds_given

_LOOK = 1e-4
"""Part of a speed about which the curvature of a response is taken."""

_FAR = 1e-2
"""Part of a speed by which corrections and differences stay below."""

_PART = 0.1
"""Part of the width of a maximum over which derivatives are differenced."""

_KNOWN = 1e-3
"""Relative error of the derivative by the speed from which on an edge has none."""

_MEET = "at this edge two multipliers meet, and have no derivative"
_DAMP = "as without damping: give a little of it, or difference the edges themselves"

_CORNER = (
    "its speed has no derivatives: there one multiplier takes the lead from another, or the maximum is too "
    "narrow to be differenced"
)
_UNBOUNDED = (
    "the response grows beyond all bounds at this speed, which has no derivatives; for `bands` those of the "
    "edges of unstable ranges are given"
)

_SMOOTH = 0.5
"""Part by which the curvature of a maximum may change when it is taken twice as far."""

_CLOSER = 8.0
"""Times nearer to a maximum that is too narrow for that."""

_NEWTON = 3
"""Corrections of a speed that was found to a tolerance."""


@of_system
def sensitivities_over(
    system: PeriodicSystem,
    speeds: float | str | Sequence[float | str] | Array,
    of: Sequence[str] | None = None,
    by: Sequence[str] | None = None,
    method: str | Rule = "auto",
    steps: int | None = None,
    rtol: float = 1e-8,
    engine: str = "auto",
    nonlinear: bool = False,
    periods: int | None = None,
) -> SensitivitiesOver:
    """`solve.sensitivities` at every speed (rad/s, texts with unit, or one text such as "100:900:81 rpm").
    Speeds without a solution are NaN with the reason. Raises SolveError subclasses for bad input, and
    NoResultError where no speed has a solution."""
    periods_of(nonlinear, periods)
    settings = method, steps, rtol, engine, nonlinear, periods
    given, (quantities, names) = speeds_given(speeds), quantities_by(system, of, by)
    asked = [each.text for each in quantities]
    system, omegas = system.shown_in(given[0]), np.array(given)
    shape = len(omegas), len(asked), len(names)
    values, derivatives = np.full(shape[:2], np.nan, complex), np.full(shape, np.nan, complex)
    errors, reasons = np.full(shape, np.nan), {}
    with progress.task("speeds", len(omegas)):
        for at, omega in enumerate(omegas.tolist()):
            with progress.subtask("speeds"):
                try:
                    found = sensitivities(system, omega, asked, names, *settings)
                except SolveError as reason:
                    reasons[at] = [f"no result: {reason}"]
                    continue
            every = list(found.found.values())
            values[at], derivatives[at] = [each.value for each in every], [each.derivatives for each in every]
            errors[at] = [each.errors for each in every]
            if found.warnings:
                reasons[at] = found.warnings
    if np.isnan(values).all():
        raise NoResultError(f"no speed has a result; at the first, {reasons[0][0]}")
    if not (np.imag(values).any() or np.imag(derivatives).any()):
        values, derivatives = np.real(values), np.real(derivatives)
    constant = [system.parameters.get(name, np.nan) for name in names]
    by_speed = np.where(np.array(names) == SPEED, omegas[:, None], constant)
    return SensitivitiesOver(system, omegas, asked, names, by_speed, values, derivatives, errors, reasons)


@first_is(CriticalSpeeds, Bands, such_as="solve.critical_speeds(model, speeds)")
def speed_sensitivities(
    found: CriticalSpeeds | Bands,
    by: Sequence[str] | None = None,
    method: str | Rule = "auto",
    rtol: float = 1e-8,
) -> Sensitivities:
    """Derivatives of the edges of unstable bands, or of the maxima of critical speeds, by parameters.

    found: what `solve.bands` or `solve.critical_speeds` gives. An edge is where the spectral radius is 1,
    dΩ/dθ = -(∂|ρ|/∂θ) / (∂|ρ|/∂Ω); a maximum is where the derivative by the speed is 0, whose own derivatives
    are differences over speed of exact ones. Quantities are "band1.from", "band1.to", …, with the bands as
    they rise, and "response1", "multiplier1", "radius1", …, with the critical speeds as they fall; edges at
    the ends of the range, and integer divisions, are left out. Speeds without derivatives have NaN and the
    reason. by: names of parameters, by default all by which there are derivatives. Raises NoResultError
    where there is no such speed, and what `solve.sensitivities` raises.
    """
    system = found.system
    names = moving_parameters(system, by)

    def derivatives(of: str, speed: float) -> Sensitivity:
        return sensitivities(system, speed, of, [*names, SPEED], method, rtol=rtol).found[of]

    places, way = (_edges(found), _of_edge) if isinstance(found, Bands) else (_maxima(found), _of_maximum)
    if not places:
        raise NoResultError(f"{system.name} has no edge or maximum between these speeds; give other speeds")
    made = {}
    with progress.task("speeds", len(places)):
        for name, of, speed in places:
            with progress.subtask("speeds"):
                each = way(of, speed, derivatives) if of else _none(speed, len(names), _UNBOUNDED)
            made[name] = replace(each, reason=f"{name}: {each.reason}") if each.reason else each
    values = {name: system.parameters[name] for name in names}
    return Sensitivities(system, None, values, made, "", 0)


def moving_parameters(system: PeriodicSystem, by: Sequence[str] | None = None) -> list[str]:
    """Names of parameters that may move speeds, by default all by which there are derivatives. Raises
    UnknownNameError, NoDerivativeError, ValueOutOfBoundsError."""
    _, every = quantities_by(system, [RADIUS], by)
    if by is not None and SPEED in every:
        raise ValueOutOfBoundsError(
            "by is speed, which is what moves; give parameters, such as 'k1', or leave by out"
        )
    return [name for name in every if name != SPEED]


def _edges(found: Bands) -> list[tuple[str, str, float]]:
    """Name, quantity and speed of each."""
    return [
        (f"band{number}.{word}", RADIUS, speed)
        for number, band in enumerate(found, start=1)
        for word, speed, is_open in (("from", band.low, band.open_low), ("to", band.high, band.open_high))
        if not is_open
    ]


def _maxima(found: CriticalSpeeds) -> list[tuple[str, str, float]]:
    """Name, quantity and speed of each; no quantity where the response has no height."""
    ways = {"response": f"{found.quantity}.{found.figure}", "multiplier": "", "radius": RADIUS}

    def quantity(of: str, maximum: Maximum) -> str:
        if maximum.height == np.inf:
            return ""
        return of or _dominant(found.system, maximum)

    return [
        (f"{way}{number}", quantity(of, maximum), maximum.speed)
        for way, of in ways.items()
        for number, maximum in enumerate(
            (getattr(row, way) for row in found.rows if getattr(row, way) is not None), start=1
        )
    ]


def _dominant(system: PeriodicSystem, maximum: Maximum) -> str:
    """The real part of the largest multiplier but those of rigid-body modes, which are +1."""
    held = free(OnePoint(system, maximum.speed))
    largest = np.array([maximum.height])
    before = 0 if held is None or before_rigid(largest) else int(held.modes.multiplicity[0])
    return f"rho{before + 1}.re"


Derivatives = Callable[[str, float], Sensitivity]


def _of_edge(of: str, speed: float, derivatives: Derivatives) -> Sensitivity:
    found = derivatives(of, speed)
    for _ in range(_NEWTON):
        moved = (1 - float(np.real(found.value))) / found.derivatives[-1]
        if not abs(moved) < _FAR * speed:
            break
        speed += moved
        found = derivatives(of, speed)
    *by, along = found.derivatives
    *off, off_along = found.errors
    if not off_along < _KNOWN * abs(along):
        return _none(speed, len(by), f"{found.reason or _MEET}; {_DAMP}")
    slopes = -np.array(by) / along
    return Sensitivity(
        speed, "rad/s", slopes, (np.array(off) + np.abs(slopes) * off_along) / abs(along), found.reason
    )


def _of_maximum(of: str, speed: float, derivatives: Derivatives) -> Sensitivity:
    # The two differences below have all but one of their steps in common.
    @functools.cache
    def gradient(omega: float) -> Array:
        return derivatives(of, omega).derivatives

    value, start = derivatives(of, speed), speed
    if value.reason:
        return _none(speed, len(value.derivatives) - 1, value.reason)

    def curvature(step: float) -> float:
        return float(np.real(gradient(start + step)[-1] - gradient(start - step)[-1])) / (2 * step)

    for step in (_LOOK * speed, _LOOK * speed / _CLOSER):
        near, far = curvature(step), curvature(2 * step)
        if near < 0 and abs(far - near) < _SMOOTH * abs(near):
            break
    else:
        return _none(speed, len(value.derivatives) - 1, _CORNER)
    for _ in range(_NEWTON):
        moved = -float(np.real(gradient(speed)[-1])) / near
        if not abs(moved) < _FAR * speed:
            break
        speed += moved
    width = _PART * float(np.sqrt(abs(np.real(value.value) / near)))
    width = min(width, _FAR * speed / 2)
    fine, rough = (slope(gradient, speed, each) for each in (width, 2 * width))
    slopes, other = (-each[:-1] / each[-1] for each in (fine, rough))
    return Sensitivity(speed, "rad/s", slopes, np.abs(slopes - other), "")


def _none(speed: float, count: int, reason: str) -> Sensitivity:
    """Of a speed without derivatives."""
    nothing = np.full(count, np.nan)
    return Sensitivity(speed, "rad/s", nothing, nothing, reason)
