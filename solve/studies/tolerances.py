"""Effects of parameter tolerances: probability of instability, probabilities that limits are violated, Sobol
indices, and worst cases."""

import math
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from pathlib import Path

import numpy as np

from solve.arguments import require_integer, unique_names
from solve.arrays import Array
from solve.batch.family import SPEED, SystemFamily
from solve.batch.task import task_of
from solve.errors import SolveError, ValueOutOfBoundsError, counted
from solve.labels import speed_or_usual
from solve.methods.choice import Rule, chosen
from solve.methods.collocated import Collocated
from solve.methods.method import Method
from solve.model.model import Model, of_model
from solve.period.named import Named
from solve.results.tolerances import (
    UNSTABLE,
    ParameterSpread,
    Probability,
    SobolIndices,
    Tolerances,
    WorstPoint,
)
from solve.studies.machines import STABILITY, Event, Machines, Outcome, Quantity
from solve.studies.point_values import kept_for
from solve.studies.probability import MAX_CENTRES, SEARCH_SPREAD, Mixture, centres_of, normal_variables
from solve.studies.requirements import bounds_of, real_quantity, spreads_of
from solve.studies.sobol_indices import sobol_indices
from solve.studies.tracked import leading
from solve.system import shown_in
from solve.terminal import progress
from solve.units import speeds_given

_SEARCH = 8
"""The fraction 1 / _SEARCH of the samples is used to search for rare events. Chosen by judgement."""

_MOST_SPEEDS = 4
"""Maximum number of speeds at which the nearest points of an event are sought. Chosen by judgement."""

_MOST_STEPS = 40
"""Maximum number of evaluations in the search for a worst point. Chosen by judgement."""

_STARTS = 3
"""A worst point is sought from this number of the worst samples. Chosen by judgement: several samples are
needed because maxima may be local."""

_NO_VALUE = 2.0
"""Objective of points without a result. The objective at the start is 1 or -1, so that no line search accepts
such a point."""

_LEAST_SAMPLES, _MOST_SAMPLES = 64, 10**7
"""Smallest and largest number of samples. Intervals from fewer samples are too wide to be useful. Chosen by
judgement."""


@of_model
def tolerances(
    model: Model,
    speeds: float | str | Sequence[float | str] | None = None,
    vary: Mapping[str, str] | None = None,
    subject: Sequence[str] = (),
    of: Sequence[str] = (),
    samples: int = 4096,
    index_samples: int = 256,
    method: str | Rule = "auto",
    rtol: float = 1e-8,
    engine: str = "auto",
    executor: Executor | None = None,
    store: str | Path | None = None,
    seed: int = 0,
) -> Tolerances:
    """Compute the effects of parameter tolerances: instability, violated limits, and spread of quantities.

    Parameters
    ----------
    model : Model
        Model with the nominal parameters, and with derivatives with respect to those that vary.
    speeds : float, str or sequence, optional
        Speeds in rad/s, strings with a unit, or one string such as "50:300:11 rpm"; by default the speed of
        the case. A machine counts as unstable if it is unstable at one of these speeds.
    vary : mapping of str to str, optional
        Mapping from parameters to tolerances or distributions, such as "±2 %", "±0.1 mm", "normal(8e4, 2e3)"
        or "uniform(7e4, 9e4)". These supplement the tolerances of the case; for the same parameter, they
        replace the tolerance of the case.
    subject : sequence of str
        Limits of quantities at every speed, such as "q3.max_abs < 9 um".
    of : sequence of str
        Further quantities for Sobol indices and worst points, such as "contact_force.min".
    samples : int
        Number of samples for the probabilities.
    index_samples : int
        Base number of samples for the Sobol indices, rounded up to a power of two; 0 for no indices. The
        model is solved for this number times (number of parameters + 2) machines.
    method : str or Method
        "radau", "gauss" or "auto".
    rtol : float
        Relative tolerance of the solutions.
    engine, executor, store : optional
        As in `sweep`.
    seed : int
        Seed of the random numbers.

    Returns
    -------
    Tolerances
        Probabilities with 95 % intervals, Sobol indices, worst points, and the samples.

    Raises
    ------
    MissingValueError
        If no parameter has a tolerance.
    NoResultError
        If the nominal model has no solution.
    UnknownNameError, ValueOutOfBoundsError, UnitError, NoDerivativeError
        For bad input.

    Notes
    -----
    Parameters are independent. For normal distributions, worst points are sought within three standard
    deviations. Samples with an undetermined verdict are counted separately and included in the upper ends of
    the intervals.

    Examples
    --------
    >>> import solve
    >>> pendulum = solve.load("mathieu", delta=1.0, epsilon=0.19, zeta=0.05)
    >>> found = tolerances(pendulum, 1.0, {"epsilon": "±10 %"}, samples=256, index_samples=0)
    >>> 0.2 < found.probability["unstable"].value < 0.8
    True
    """
    machines = _machines(model, speeds, vary or {}, (subject, of), (method, rtol, engine))
    machines.executor, machines.store = executor, store
    for name, count, least in (("samples", samples, _LEAST_SAMPLES), ("index_samples", index_samples, 0)):
        require_integer(name, count, least)
        if count > _MOST_SAMPLES:
            raise ValueOutOfBoundsError(f"{name} is {count}; allowed: up to {_MOST_SAMPLES}")
    require_integer("seed", seed, 0)
    rng = np.random.default_rng(seed)
    with progress.steps(4) as step:
        step("the search for rare events")
        nominal = machines.outcome(machines.nominal, "nominal").values
        wide = SEARCH_SPREAD * rng.standard_normal((samples // _SEARCH, len(machines.spreads)))
        searched = machines.outcome(machines.parameters(wide), "search")
        mixture = _mixture(machines, wide, searched, samples - len(wide))
        step("the samples")
        z = mixture.samples(rng)
        points, weights = machines.parameters(z), mixture.weights(z)
        outcome = machines.outcome(points, "samples")
        step("the Sobol indices")
        sobol, unknown = _sobol(machines, index_samples, rng)
        step("the worst points")
        every = np.concatenate((machines.parameters(wide), points, machines.nominal))
        worst = _worst(machines, every, np.concatenate((searched.values, outcome.values, nominal), axis=1))
    names = [UNSTABLE, *(bound.text for bound in machines.bounds)]
    events = [outcome.unstable, *outcome.beyond]
    bounds: dict[str, tuple[float, ...]] = {}
    for bound in machines.bounds:
        bounds[bound.quantity.text] = (*bounds.get(bound.quantity.text, ()), bound.value)
    probability = {
        name: mixture.probability(weights, *event[1:]) for name, event in zip(names, events, strict=True)
    }
    return Tolerances(
        system=machines.model,
        speeds=np.array(machines.speeds),
        spreads={
            name: ParameterSpread(each.text, machines.model.parameters[name], each.low, each.high)
            for name, each in machines.spreads.items()
        },
        samples=samples,
        solves=machines.solves,
        probability=probability,
        sobol=sobol,
        worst=worst,
        bounds=bounds,
        units={each.named.text: each.named.unit for each in machines.quantities},
        points=points,
        values=machines.worst(outcome.values)[0],
        weights=weights,
        doubts=_doubts(probability, unknown),
    )


def _machines(
    model: Model,
    speeds: float | str | Sequence[float | str] | None,
    vary: Mapping[str, str],
    texts: tuple[Sequence[str], Sequence[str]],
    accuracy: tuple[str | Rule, float, str],
) -> Machines:
    """Return the machines to be sampled, from the arguments of `tolerances`. `texts` contains the limits and
    the quantities; `accuracy` contains the method, the tolerance and the engine. Raises SolveError subclasses
    for invalid input."""
    given = speeds_given(speed_or_usual(model, None) if speeds is None else speeds)
    model = shown_in(model, given[0])
    spreads = spreads_of(model, vary)
    bounds = bounds_of(model, texts[0])
    named = [STABILITY.quantity, *(bound.quantity for bound in bounds)]
    named += [real_quantity(model, text) for text in unique_names(texts[1])]
    distinct = {each.text: each for each in named}.values()
    quantities = [Quantity.with_bounds(each, [STABILITY, *bounds]) for each in distinct]
    method, rtol, engine = accuracy
    rule = chosen(method)
    if isinstance(rule, Method) and not isinstance(rule, Collocated):
        raise ValueOutOfBoundsError(f"method is {rule.name}; allowed for tolerances: radau, gauss, auto")
    family = SystemFamily(model, [*spreads, SPEED])
    orbit = any(each.of_orbit for each in distinct)
    task, _ = task_of(family, rule, rtol, engine, kept_for(list(distinct)), orbit=orbit)
    return Machines(model, spreads, sorted(map(float, given)), quantities, bounds, task)


def _mixture(machines: Machines, z: Array, searched: Outcome, samples: int) -> Mixture:
    """Return a mixture of densities about 0 and, for each event, about the points nearest to 0 at which the
    event occurs. `z` (P, r) are evaluated points, and `searched` contains their results."""
    centres: list[Array] = []
    for limit, event in zip(machines.limits, (searched.unstable, *searched.beyond), strict=True):
        for place in _speeds_of(event):
            gradient = machines.gradient(limit, machines.speeds[place])
            centres += centres_of(gradient, z[event.margins[:, place] > 0])
    centres.sort(key=lambda centre: float(np.linalg.norm(centre)))
    return Mixture.about(centres[:MAX_CENTRES], z.shape[1], samples)


def _speeds_of(event: Event) -> list[int]:
    """Return the indices of the speeds at which an event occurs most often, at most `_MOST_SPEEDS` of them.
    If the event never occurs, return the index of the speed with the largest margin."""
    counts = np.count_nonzero(event.margins > 0, axis=0)
    order = np.argsort(-counts, kind="stable")[:_MOST_SPEEDS]
    if counts.any():
        return [int(place) for place in order if counts[place]]
    known = np.where(np.isnan(event.margins), -np.inf, event.margins)
    return [int(known.max(axis=0).argmax())]


def _sobol(
    machines: Machines, samples: int, rng: np.random.Generator
) -> tuple[dict[str, dict[str, SobolIndices]], int]:
    """Return the Sobol indices and the number of samples without a value. The indices are a mapping from each
    quantity to a mapping from parameters to indices."""
    if not samples:
        return {}, 0

    def evaluate(cube: Array) -> Array:
        parameters = machines.parameters(normal_variables(cube))
        return machines.worst(machines.outcome(parameters, "indices").values)[0]

    # The errors of the values are assumed equal to their tolerance.
    power, error = math.ceil(math.log2(samples)), machines.task.request.rtol
    indices, unknown = sobol_indices(evaluate, len(machines.spreads), 2**power, rng, error)
    by_name = [dict(zip(machines.spreads, each, strict=True)) for each in indices]
    return dict(zip((each.named.text for each in machines.quantities), by_name, strict=True)), unknown


def _worst(machines: Machines, points: Array, values: Array) -> dict[str, WorstPoint]:
    """Search for the worst case of each quantity in the direction of each limit. The search starts from the
    worst of the points (P, r), at which the quantities have the values `values` (q, P, k). The last point is
    the nominal one. If a quantity has no derivatives, the worst of the points is returned."""
    spreads = machines.spreads.values()
    low, high = np.array([(each.low, each.high) for each in spreads]).T
    nominal = machines.worst(values[:, -1:])[0][0]
    found = {}
    for at, quantity in enumerate(machines.quantities):
        climbed = []
        for sign in quantity.limits:
            known = np.where(np.isnan(values[at]), -np.inf, sign * values[at])
            for start in known.max(axis=1).argsort()[-_STARTS:].tolist():
                column = int(known[start].argmax())
                speed, direction = machines.speeds[column], (quantity.named, sign)
                value, parameters = _local_worst_point(machines, direction, speed, points[start], (low, high))
                if math.isnan(value):
                    value = float(values[at, start, column])
                climbed.append((float(quantity.excess(np.array(value))), value, speed, parameters))
        _, value, speed, parameters = max(climbed, key=lambda each: np.nan_to_num(each[0], nan=-np.inf))
        found[quantity.named.text] = WorstPoint(
            value, float(nominal[at]), speed, dict(zip(machines.spreads, parameters.tolist(), strict=True))
        )
    return found


def _local_worst_point(
    machines: Machines,
    direction: tuple[Named, float],
    speed: float,
    start: Array,
    ends: tuple[Array, Array],
) -> tuple[float, Array]:
    """Return the extreme value of a quantity at a speed, for parameters within `ends`, and the parameters
    (r,) with this value. The gradient search begins at `start`. `direction` contains the quantity, and 1 for
    the largest or -1 for the smallest value."""
    from scipy.optimize import minimize

    design = machines.design(speed)
    width = design.high - design.low
    low, high = ((end - design.low) / width for end in ends)
    best: tuple[float, Array] = (-math.inf, start)

    def descent(x: Array) -> tuple[float, Array]:
        nonlocal best
        try:
            value, slopes = leading(design, x, 0, *direction)
        except SolveError:
            return _NO_VALUE, np.zeros(len(x))
        if value > best[0]:
            best = value, design.low + x * width
        return -value / scale, -slopes / scale

    x = np.clip((start - design.low) / width, low, high)
    scale = 1.0
    first = descent(x)[0]
    if math.isinf(best[0]):
        return math.nan, best[1]
    scale = abs(first) or 1.0
    bounds, options = list(zip(low, high, strict=True)), {"maxfun": _MOST_STEPS}
    minimize(descent, x, jac=True, bounds=bounds, method="L-BFGS-B", options=options)
    return direction[1] * best[0], best[1]


def _doubts(probability: Mapping[str, Probability], unknown: int) -> list[str]:
    """Return sentences on samples without a result or with an undetermined verdict."""
    doubts = []
    for name, each in probability.items():
        if each.undetermined or each.failed:
            doubts.append(
                f"{name}: {counted(each.undetermined, 'sample is', 'samples are')} undetermined and "
                f"{counted(each.failed, 'has', 'have')} no result; the upper end of the interval "
                "includes them"
            )
    if unknown:
        doubts.append(f"the Sobol indices omit {counted(unknown, 'group')} of samples without a result")
    return doubts
