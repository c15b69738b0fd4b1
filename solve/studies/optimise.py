"""Optimisation of parameters with guaranteed stability: the largest vibration at any of several speeds is
minimised, with exact derivatives. The limit of the spectral radius applies to the sum of the radius and its
error estimate."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from solve.arguments import NUMBERS_A_POINT, require_integer, require_size, unique_names
from solve.arrays import Array
from solve.equations import derivatives_of, is_nonlinear, require_bounds
from solve.errors import SolveError, ValueOutOfBoundsError
from solve.labels import bounds_in_own_unit, speed_or_usual
from solve.methods.choice import Rule, chosen
from solve.methods.collocated import Collocated
from solve.methods.method import Method
from solve.model.model import Model
from solve.newton.orbits import nonlinear
from solve.period.named import Named
from solve.proof.prove import prove as proof_of
from solve.results.contents import HALF_DEGREES
from solve.results.formatting import measured
from solve.results.optimum import Curves, FreeParameter, Optimum
from solve.results.orbit import Orbit
from solve.results.sweeps import ACCEPTABLE_ERROR
from solve.studies.design_points import Design, DesignPoint
from solve.studies.fit import Bounds
from solve.studies.optimum_search import ROUNDS, Search, State
from solve.studies.range_search import over_range
from solve.studies.requirements import bounds_of, kept_of, real_quantity, spreads_of
from solve.studies.robust import Statistic, deviating
from solve.system import PeriodicSystem, of_system, shown_in
from solve.terminal import progress
from solve.units import speeds_given

Objective = str | Callable[[Sequence[Orbit]], float]
"""Type of objectives: a quantity by name, or a function of the orbits at all speeds."""


@of_system
def optimise(
    model: PeriodicSystem,
    minimise: Objective,
    free: Bounds,
    speeds: float | str | Sequence[float | str] | None = None,
    keep: Sequence[str] = (),
    subject: Sequence[str] = (),
    starts: int = 1,
    method: str | Rule = "auto",
    rtol: float = 1e-8,
    prove: bool = False,
    robust: float | str | None = None,
    vary: Mapping[str, str] | None = None,
) -> Optimum:
    """Minimise the largest value of a quantity at several speeds, subject to bounds and to stability at every
    speed.

    Parameters
    ----------
    model : Model or OutputFeedback
        System with derivatives with respect to the free parameters, such as the gains of a feedback.
    minimise : str or callable
        Quantity to minimise, such as "q3.max_abs", "shaft_torque.rms" or "spectral_radius"; or a function
        that returns a number from the sequence of orbits at the speeds and is differentiated by finite
        differences.
    free : mapping of str to (float or str, float or str)
        Mapping from the name of each free parameter to its lower and upper bound, in the model's units or as
        strings with a unit. The search starts from the parameters of the model.
    speeds : float, str or sequence, optional
        Speeds in rad/s, strings with a unit, or one string such as "50:300:11 rpm"; by default the speed of
        the case. A string of this form is a range: speeds between the given speeds are checked too.
    keep : sequence of str
        Quantities that must not change: a statistic such as "lift.range" or "lift.max", or a curve such as
        "lift@80:100 deg". Changes up to a tolerance are allowed by "lift.range within 0.1 mm".
    subject : sequence of str
        Bounds of quantities at every speed, such as "contact_force.min > 0" or "spectral_radius < 0.9".
    starts : int
        Number of starting points: the first is that of the model, the others are random within the bounds.
    method : str or Method
        "radau", "gauss" or "auto".
    rtol : float
        Relative tolerance of the orbits; the optimum is found to 100 times this tolerance.
    prove : bool
        Whether to prove the verdicts of the optimum, as by `solve.prove`.
    robust : float or str, optional
        Minimise a statistic of the quantity over machines whose parameters deviate by the tolerances of the
        case and of `vary`: the mean plus this number of standard deviations or, for a string such as "95 %",
        this quantile. Tolerances in per cent refer to the initial values of the parameters.
    vary : mapping of str to str, optional
        Mapping from parameters to tolerances or distributions, as in `tolerances`.

    Returns
    -------
    Optimum
        Optimal parameters, the quantity before and after, and the worst value of each requirement.

    Raises
    ------
    UnknownNameError, ValueOutOfBoundsError, UnitError, NoDerivativeError
        For bad input.
    SolveError
        Other subclasses, if the model has no solution at the start.

    Notes
    -----
    The optimisation minimises an upper bound on the local extrema that may become the largest. At every
    speed, the spectral radius plus its error stays below 1; for a model without damping, it equals 1 within
    its error. The optimum is a local one.

    Examples
    --------
    >>> import solve
    >>> cam = solve.load("cam")
    >>> found = optimise(cam, "q3.max_abs", {"c3": (800, 1200), "k3": (2e8, 3e8)}, "600 rpm")
    >>> found.objective < found.before
    True
    """
    require_integer("starts", starts)
    require_size("starts", starts, NUMBERS_A_POINT)
    rule = chosen(method)
    if isinstance(rule, Method) and not isinstance(rule, Collocated):
        raise ValueOutOfBoundsError(f"method is {rule.name}; allowed for an optimum: radau, gauss, auto")
    given = speeds_given(speed_or_usual(model, None) if speeds is None else speeds)
    is_range = isinstance(speeds, str) and speeds.count(":") == 2
    model = shown_in(model, given[0])
    names, low, high = _free(model, free)
    kept, bounds = kept_of(model, keep), bounds_of(model, subject)
    objective = real_quantity(model, minimise) if isinstance(minimise, str) else minimise
    named = [each.quantity for each in bounds] + ([objective] if isinstance(objective, Named) else [])
    orbits = not isinstance(objective, Named) or bool(kept) or any(each.of_orbit for each in named)
    design = Design(model, names, low, high, sorted(map(float, given)), rule, rtol, orbits)
    statistic = None if robust is None else Statistic.parse(robust)
    machines = _machines(design, objective, statistic, vary, is_range)
    search = Search(design, objective, bounds, kept, machines, statistic)
    with progress.task(ROUNDS):
        best, doubts = search.best(starts), []
        if is_range:
            best, doubts = over_range(search, best)
    return _optimum(search, best, doubts, prove)


def _machines(
    design: Design,
    objective: object,
    statistic: Statistic | None,
    vary: Mapping[str, str] | None,
    is_range: bool,
) -> list[Design]:
    """Return the deviating machines of a robust objective, and an empty list for other objectives. Raises
    SolveError subclasses."""
    if statistic is None:
        if vary:
            raise ValueOutOfBoundsError("'vary' requires 'robust'; add robust=3, for example, or omit 'vary'")
        return []
    if is_range or not isinstance(objective, Named):
        raise ValueOutOfBoundsError(
            "'robust' requires a quantity by name and a list of speeds, such as '100 200 300 rpm', instead "
            "of a function or a range"
        )
    if not isinstance(design.model, Model):
        raise ValueOutOfBoundsError(
            f"'robust' requires a model, and {design.model.labels.name} is not a model; omit 'robust'"
        )
    return deviating(design, spreads_of(design.model, vary or {}), statistic.machines)


def _free(model: PeriodicSystem, free: Bounds) -> tuple[Sequence[str], Array, Array]:
    """Return the names, lower bounds (r,) and upper bounds (r,) of the free parameters. Raises
    UnknownNameError, ValueOutOfBoundsError, UnitError, NoDerivativeError."""
    names = unique_names(free)
    if not names:
        raise ValueOutOfBoundsError("'free' is empty; give parameters with bounds, such as k1=4e4:1e5")
    ends = []
    for name in names:
        ends.append(bounds_in_own_unit(model, name, free[name]))
        for end in ends[-1]:
            if not np.isfinite(end):
                raise ValueOutOfBoundsError(f"a bound of {name} is {end:g}; allowed: finite numbers")
            require_bounds(model, {name: end})
    derivatives_of(model).by(names)
    low, high = np.array(ends).T
    return names, low, high


def _optimum(search: Search, best: State, doubts: list[str], prove: bool) -> Optimum:
    """Return the result, checked against nonlinear orbits and, if requested, by proofs."""
    design, objective = search.design, search.minimise
    before, points = design.at(design.start, design.speeds), design.points(best.x)
    values = search.values_at(best.x, points)
    values_before = search.values_at(design.start, before)
    text, unit, curves = "value of the function", "1", None
    if isinstance(objective, Named):
        text, unit = objective.text, objective.unit
        text += f", {search.statistic.text}" if search.statistic else ""
    if isinstance(objective, Named) and objective.of_orbit:
        worst, phase = int(np.argmax(values)), np.linspace(0.0, design.model.period, HALF_DEGREES)
        curves = Curves(phase, *(each[worst].signal(objective.subject, phase) for each in (before, points)))
    confirmed, unconfirmed = _confirmed(search, best, prove)
    if unmet := search.unmet(points):
        names, reached = (" and ".join(texts) for texts in zip(*unmet, strict=True))
        doubts = [
            *doubts,
            f"no design was found that fulfils {names}; the closest reaches {reached}; widen the bounds, or "
            "relax a requirement",
        ]
    warnings = dict.fromkeys(warning for point in points for warning in point.solved.warnings)
    failures = len(search.failures)
    failed = [f"trials without a solution: {failures}, the last: {search.failures[-1]}"] if failures else []
    return Optimum(
        system=design.varied(best.x),
        minimised=text,
        unit=unit,
        parameters={
            name: FreeParameter(design.model.labels.parameters[name], value, low, high)
            for (name, value), low, high in zip(
                design.parameters(best.x).items(), design.low.tolist(), design.high.tolist(), strict=True
            )
        },
        objective=best.objective,
        before=float(values_before.max()),
        constraints=search.requirements(points),
        speeds=np.array(design.speeds),
        values=values,
        values_before=values_before,
        curves=curves,
        confirmed=confirmed,
        doubts=[*doubts, *warnings, *unconfirmed, *failed],
    )


def _confirmed(search: Search, best: State, prove: bool) -> tuple[dict[str, Any], list[str]]:
    """Return a mapping, and sentences on results that are not confirmed. The mapping contains the objective
    and the verdicts of nonlinear orbits and, if `prove` is True, the proved verdicts."""
    design, model = search.design, search.design.varied(best.x)
    confirmed: dict[str, Any] = {}
    doubts: list[str] = []
    if is_nonlinear(model) and design.orbits:
        try:
            orbits = [
                nonlinear(model, each, method=design.method, rtol=design.rtol) for each in design.speeds
            ]
        except SolveError as reason:
            doubts.append(f"the optimum is not confirmed by nonlinear orbits: {reason}")
        else:
            points = [DesignPoint(orbit, design.names) for orbit in orbits]
            value = float(search.values(points).max())
            confirmed |= {"objective": value, "verdicts": [orbit.verdict for orbit in orbits]}
            doubts += _contradictions(search, best, value, points)
            unstable = [
                model.labels.speed_unit.text(orbit.speed) for orbit in orbits if orbit.verdict == "unstable"
            ]
            if unstable:
                doubts.append(f"the nonlinear orbit is unstable at {', '.join(unstable)}")
    if prove:
        proofs = [proof_of(point.solved) for point in design.points(best.x)]
        confirmed["proved"] = [proof.verdict if proof.proved else None for proof in proofs]
        doubts += dict.fromkeys(warning for proof in proofs for warning in proof.warnings)
    return confirmed, doubts


def _contradictions(search: Search, best: State, value: float, points: Sequence[DesignPoint]) -> list[str]:
    """Return sentences on the objective, and on the bounds, for which nonlinear orbits contradict the linear
    model. `value` is the objective of the nonlinear orbits."""
    doubts, minimised = [], search.minimise
    linear = float(search.values(search.design.points(best.x)).max())
    if abs(value - linear) > ACCEPTABLE_ERROR * max(abs(value), abs(linear)):
        is_named = isinstance(minimised, Named)
        name, unit = (minimised.text, minimised.unit) if is_named else ("the function", "1")
        doubts.append(
            f"the linear model is inaccurate at the optimum: {name} of the nonlinear orbits is "
            f"{measured(value, unit)} instead of {measured(linear, unit)}; compare the nonlinear "
            "orbits at the initial values and at the optimum"
        )
    each_bound = search.bounds, search.bounded(search.design.points(best.x))[1:], search.bounded(points)[1:]
    for bound, (_, linear), (requirement, violation) in zip(*each_bound, strict=True):
        if violation > ACCEPTABLE_ERROR and violation - linear > ACCEPTABLE_ERROR:
            reached = measured(requirement.value, bound.quantity.unit)
            doubts.append(f"the nonlinear orbits violate {bound.text}; they reach {reached}")
    return doubts
