"""Sensitivities of quantities at several speeds, and sensitivities of two kinds of speeds: edges of unstable
bands, and critical speeds. Sensitivities of speeds follow from the implicit function theorem (S. G. Krantz,
H. R. Parks, The Implicit Function Theorem, 2013)."""

import functools
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from solve.approximation import slope
from solve.arguments import checked_rtol, first_is, require_steps
from solve.arrays import Array
from solve.derivatives.figures import DIFFERENCE_STEP
from solve.derivatives.point import periods_of, quantities_by, require_stages, sensitivities
from solve.errors import NoResultError, SolveError, ValueOutOfBoundsError
from solve.kernel.engines import chosen_engine
from solve.labels import SPEED
from solve.methods.choice import Rule, chosen
from solve.methods.free import free
from solve.period.named import RADIUS
from solve.period.points import SinglePoint
from solve.period.rigid_body import before_rigid
from solve.results.bands import Bands
from solve.results.critical_speeds import CriticalSpeeds, Maximum
from solve.results.sensitivities import Sensitivities, SensitivitiesOver, Sensitivity
from solve.system import PeriodicSystem, of_system, shown_in
from solve.terminal import progress
from solve.units import speeds_given

_MAX_SHIFT = 1e-2
"""Largest relative correction of a speed, and largest relative step of finite differences. Chosen by
judgement."""

_WIDTH_FRACTION = 0.1
"""Step of the finite differences of derivatives, relative to the width of a maximum. Chosen by judgement."""

_MAX_ERROR = 1e-3
"""Relative error of the derivative with respect to the speed above which an edge counts as having no
derivatives. Chosen by judgement."""

_MEET = "two multipliers coincide at this edge, so that it has no derivatives"
_DAMP = "if the system is undamped, add a little damping, or differentiate the edges by finite differences"

_CORNER = (
    "this speed has no derivatives: another multiplier becomes dominant there, or the maximum is too "
    "narrow for finite differences"
)
_UNBOUNDED = (
    "the response is unbounded at this speed, which therefore has no derivatives; for derivatives of the "
    "edges of unstable bands, use the result of `bands`"
)

_SMOOTH = 0.5
"""Largest permitted relative change of the curvature of a maximum, as computed by finite differences, when
their step is doubled. Chosen by judgement."""

_STEP_REDUCTION = 8.0
"""Factor by which the step is reduced if the maximum is too narrow for it. Chosen by judgement."""

_NEWTON_STEPS = 3
"""Number of Newton corrections of a speed that is accurate to a tolerance. Chosen by judgement: each
correction doubles the number of accurate digits."""


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
    """Derivatives of quantities with respect to parameters at every speed, each computed by
    `solve.sensitivities`.

    Parameters
    ----------
    system : Model
        Model with generated equations.
    speeds : float, str or sequence of float or str
        Speeds in rad/s, strings with a unit, or one string such as "100:900:81 rpm".
    of, by, method, steps, rtol, engine, nonlinear, periods : optional
        As in `sensitivities`.

    Returns
    -------
    SensitivitiesOver
        Derivatives at each speed; NaN with the reason at speeds without a solution.

    Raises
    ------
    NoResultError
        If no speed has a solution.
    SolveError
        Other subclasses for bad input.
    """
    # Settings are checked here, so that they are not refused at every speed.
    periods_of(nonlinear, periods)
    require_stages(rule := chosen(method))
    chosen_engine(engine)
    if steps is not None:
        require_steps(steps)
    settings = rule, steps, checked_rtol(rtol), engine, nonlinear, periods
    given_speeds, (quantities, names) = speeds_given(speeds), quantities_by(system, of, by)
    texts = [quantity.text for quantity in quantities]
    system, omegas = shown_in(system, given_speeds[0]), np.array(given_speeds)
    shape = len(omegas), len(texts), len(names)
    values, derivatives = np.full(shape[:2], np.nan, complex), np.full(shape, np.nan, complex)
    errors, reasons = np.full(shape, np.nan), {}
    with progress.task("speeds", len(omegas)):
        for at, omega in enumerate(omegas.tolist()):
            with progress.subtask("speeds"):
                try:
                    at_speed = sensitivities(system, omega, texts, names, *settings)
                except SolveError as reason:
                    reasons[at] = [f"no result: {reason}"]
                    continue
            all_sensitivities = list(at_speed.found.values())
            values[at], derivatives[at] = (
                [sensitivity.value for sensitivity in all_sensitivities],
                [sensitivity.derivatives for sensitivity in all_sensitivities],
            )
            errors[at] = [sensitivity.errors for sensitivity in all_sensitivities]
            if at_speed.warnings:
                reasons[at] = at_speed.warnings
    if np.isnan(values).all():
        raise NoResultError(f"no speed has a result; at the first speed, {reasons[0][0]}")
    if not (np.imag(values).any() or np.imag(derivatives).any()):
        values, derivatives = np.real(values), np.real(derivatives)
    constant = [system.labels.parameters.get(name, np.nan) for name in names]
    by_speed = np.where(np.array(names) == SPEED, omegas[:, None], constant)
    return SensitivitiesOver(system, omegas, texts, names, by_speed, values, derivatives, errors, reasons)


@first_is(CriticalSpeeds, Bands, such_as="solve.critical_speeds(model, speeds)")
def speed_sensitivities(
    found: CriticalSpeeds | Bands,
    by: Sequence[str] | None = None,
    method: str | Rule = "auto",
    rtol: float = 1e-8,
) -> Sensitivities:
    """Derivatives, with respect to parameters, of the edges of unstable bands or of critical speeds at
    maxima.

    Parameters
    ----------
    found : Bands or CriticalSpeeds
        Result of `solve.bands` or `solve.critical_speeds`.
    by : sequence of str, optional
        Names of parameters, by default all parameters with respect to which derivatives are available.
    method : str or Method
        "radau", "gauss" or "auto".
    rtol : float
        Relative tolerance, as in `sensitivities`.

    Returns
    -------
    Sensitivities
        Quantities are "band1.from", "band1.to", …, with the bands in ascending order, and "response1",
        "multiplier1", "radius1", …, with the critical speeds in descending order. Edges at the ends of the
        range and integer divisions are omitted. Speeds without derivatives have NaN and the reason.

    Raises
    ------
    NoResultError
        If the result contains no such edge or maximum.
    SolveError
        Other subclasses, as in `sensitivities`.

    Notes
    -----
    At an edge, the spectral radius is 1, so that dΩ/dθ = -(∂|ρ|/∂θ) / (∂|ρ|/∂Ω). At a maximum, the derivative
    g with respect to the speed is 0, so that dΩ/dθ = -(∂g/∂θ) / (∂g/∂Ω). The derivatives of g are computed
    from finite differences, between two speeds, of exact derivatives.
    """
    system = found.system
    names = moving_parameters(system, by)

    def derivatives(quantity: str, speed: float) -> Sensitivity:
        return sensitivities(system, speed, quantity, [*names, SPEED], method, rtol=rtol).found[quantity]

    is_bands = isinstance(found, Bands)
    marked_speeds = _edges(found) if is_bands else _maxima(found)
    differentiate = _of_edge if is_bands else _of_maximum
    if not marked_speeds:
        raise NoResultError(
            f"{system.labels.name} has no {'edge of an unstable range' if is_bands else 'maximum'} between "
            "these speeds; give other speeds"
        )
    by_name = {}
    with progress.task("speeds", len(marked_speeds)):
        for name, quantity, speed in marked_speeds:
            with progress.subtask("speeds"):
                sensitivity = (
                    differentiate(quantity, speed, derivatives)
                    if quantity
                    else _none(speed, len(names), _UNBOUNDED)
                )
            by_name[name] = (
                replace(sensitivity, reason=f"{name}: {sensitivity.reason}")
                if sensitivity.reason
                else sensitivity
            )
    values = {name: system.labels.parameters[name] for name in names}
    return Sensitivities(system, None, values, by_name, "", 0)


def moving_parameters(system: PeriodicSystem, by: Sequence[str] | None = None) -> list[str]:
    """Return the names of the parameters with respect to which speeds are differentiated. By default, they
    are all parameters for which derivatives are available. Raises UnknownNameError, NoDerivativeError,
    ValueOutOfBoundsError."""
    _, differentiable = quantities_by(system, [RADIUS], by)
    if by is not None and SPEED in differentiable:
        raise ValueOutOfBoundsError(
            "'by' contains speed, but the quantities to differentiate are themselves speeds; give "
            "parameters, such as 'k1', or omit 'by'"
        )
    return [name for name in differentiable if name != SPEED]


def _edges(found: Bands) -> list[tuple[str, str, float]]:
    """Return the name, quantity and speed of each edge that is not an end of the range of speeds."""
    return [
        (f"band{number}.{word}", RADIUS, speed)
        for number, band in enumerate(found, start=1)
        for word, speed, is_open in (("from", band.low, band.open_low), ("to", band.high, band.open_high))
        if not is_open
    ]


def _maxima(found: CriticalSpeeds) -> list[tuple[str, str, float]]:
    """Return the name, quantity and speed of each maximum. The quantity is empty if the response is
    unbounded."""
    ways = {"response": f"{found.quantity}.{found.figure}", "multiplier": "", "radius": RADIUS}

    def quantity(stated: str, maximum: Maximum) -> str:
        if maximum.height == np.inf:
            return ""
        return stated or _dominant(found.system, maximum)

    return [
        (f"{way}{number}", quantity(of, maximum), maximum.speed)
        for way, of in ways.items()
        for number, maximum in enumerate(
            (getattr(row, way) for row in found.rows if getattr(row, way) is not None), start=1
        )
    ]


def _dominant(system: PeriodicSystem, maximum: Maximum) -> str:
    """Return the name of the real part of the largest multiplier, excluding the multipliers +1 of rigid-body
    modes."""
    rigid = free(SinglePoint(system, maximum.speed))
    largest = np.array([maximum.height])
    before = 0 if rigid is None or before_rigid(largest) else int(rigid.modes.multiplicity[0])
    return f"rho{before + 1}.re"


Derivatives = Callable[[str, float], Sensitivity]


def _of_edge(quantity: str, speed: float, derivatives: Derivatives) -> Sensitivity:
    of_radius = derivatives(quantity, speed)
    for _ in range(_NEWTON_STEPS):
        moved = (1 - float(np.real(of_radius.value))) / of_radius.derivatives[-1]
        if not abs(moved) < _MAX_SHIFT * speed:
            break
        speed += moved
        of_radius = derivatives(quantity, speed)
    *by, along = of_radius.derivatives
    *off, off_along = of_radius.errors
    if not off_along < _MAX_ERROR * abs(along):
        return _none(speed, len(by), f"{of_radius.reason or _MEET}; {_DAMP}")
    slopes = -np.array(by) / along
    return Sensitivity(
        speed, "rad/s", slopes, (np.array(off) + np.abs(slopes) * off_along) / abs(along), of_radius.reason
    )


def _of_maximum(quantity: str, speed: float, derivatives: Derivatives) -> Sensitivity:
    # Cached, because the finite differences below share all points except one.
    @functools.cache
    def gradient(omega: float) -> Array:
        return derivatives(quantity, omega).derivatives

    value, start = derivatives(quantity, speed), speed
    if value.reason:
        return _none(speed, len(value.derivatives) - 1, value.reason)

    def curvature(step: float) -> float:
        return float(np.real(gradient(start + step)[-1] - gradient(start - step)[-1])) / (2 * step)

    for step in (DIFFERENCE_STEP * speed, DIFFERENCE_STEP * speed / _STEP_REDUCTION):
        near, far = curvature(step), curvature(2 * step)
        if near < 0 and abs(far - near) < _SMOOTH * abs(near):
            break
    else:
        return _none(speed, len(value.derivatives) - 1, _CORNER)
    for _ in range(_NEWTON_STEPS):
        moved = -float(np.real(gradient(speed)[-1])) / near
        if not abs(moved) < _MAX_SHIFT * speed:
            break
        speed += moved
    width = _WIDTH_FRACTION * float(np.sqrt(abs(np.real(value.value) / near)))
    width = min(width, _MAX_SHIFT * speed / 2)
    fine, rough = (slope(gradient, speed, each) for each in (width, 2 * width))
    slopes, other = (-each[:-1] / each[-1] for each in (fine, rough))
    return Sensitivity(speed, "rad/s", slopes, np.abs(slopes - other), "")


def _none(speed: float, count: int, reason: str) -> Sensitivity:
    """Return an entry for a speed without derivatives, with the reason."""
    nothing = np.full(count, np.nan)
    return Sensitivity(speed, "rad/s", nothing, nothing, reason)
