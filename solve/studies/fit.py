"""Identification of model parameters from measured vibration, by nonlinear least squares with exact
derivatives."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from solve.arguments import unique_names
from solve.arrays import EPS, Array
from solve.errors import ValueOutOfBoundsError, counted, require_name
from solve.labels import bounds_in_own_unit
from solve.methods.choice import Rule
from solve.model.model import Model, of_model
from solve.results.fit import Channel, Fitted, Interval
from solve.studies.fit_diagnostics import diagnose
from solve.studies.fit_problem import Problem, require_elastic_modes
from solve.studies.least_squares import Minimum, minimise
from solve.studies.measured import measured
from solve.system import shown_in
from solve.terminal import progress
from solve.units import speed_in_si

_CONFIDENCE = 0.95
"""Probability that a confidence interval contains the parameter, for independent normal errors."""

_UNIDENTIFIABLE = 0.5
"""Relative standard deviation above which a combination of parameters counts as unidentifiable. Chosen by
judgement."""

_SHARE = 0.1
"""A parameter is listed in an unidentifiable combination if its component is at least this fraction of the
largest component. Chosen by judgement."""

Bounds = Mapping[str, tuple[float | str, float | str]]
"""Type of mappings from names of parameters to lower and upper bounds: numbers in the unit of the parameter,
or strings with a unit."""


@of_model
def fit(
    model: Model,
    data: str | Path,
    free: Sequence[str],
    bounds: Bounds | None = None,
    speed: float | str | None = None,
    robust: bool = False,
    method: str | Rule = "auto",
    rtol: float = 1e-7,
) -> Fitted:
    """Fit parameters so that the linear orbit matches a measurement. The fit starts from the values of the
    model.

    Parameters
    ----------
    model : Model
        Model whose parameters are fitted; its values are the start.
    data : str or Path
        File of measured vibration; for its format, see `solve.studies.measured.measured`. Each channel is
        normalised by its root mean square.
    free : sequence of str
        Names of the free parameters. For positive parameters, the logarithm is fitted.
    bounds : mapping of str to (float or str, float or str), optional
        Lower and upper bounds by name, in the model's units or as strings with a unit.
    speed : float or str, optional
        Speed in rad/s, or a string with a unit; required if the file has no column of speeds.
    robust : bool
        Whether large residuals contribute their moduli, instead of their squares, to the objective.
    method : str or Method
        "radau", "gauss" or "auto".
    rtol : float
        Relative tolerance of the orbits.

    Returns
    -------
    Fitted
        Fitted values with their confidence intervals.

    Raises
    ------
    SolveError
        A subclass for bad input, and if the model has no orbit for its initial values.

    Notes
    -----
    The method is a trust-region reflective one (M. A. Branch, T. F. Coleman, Y. Li, SIAM J. Sci. Comput. 21,
    1999, 1-23). If the model rejects the parameters of a trial, the step is shortened.
    """
    names = unique_names(free)
    if not names:
        raise ValueOutOfBoundsError("no parameters to fit are given; give their names, such as k1, k2")
    for name in names:
        require_name(f"parameter of {model.labels.name}", name, model.parameters)
    model.derivatives.by(names)
    sets = measured(data, model, None if speed is None else speed_in_si(speed))
    require_elastic_modes(model, sets)
    model = shown_in(model, sets[0].speed)
    problem = Problem(model, sets, names, method, rtol)
    count = sum(len(values) for values in problem.measured)
    if count <= len(names):
        raise ValueOutOfBoundsError(
            f"{counted(len(names), 'parameter requires', 'parameters require')} {len(names) + 1} or more "
            f"measured values, not {count}; fit fewer parameters, or measure more values"
        )
    limits = _limits(problem, bounds or {})
    with progress.task("trials"):
        minimum = minimise(problem, limits, robust)
    return _fitted(problem, minimum, Path(data).name)


def _limits(problem: Problem, bounds: Bounds) -> tuple[Array, Array]:
    """Return the lower and upper bounds (r,) of the fit variables x. Raises ValueOutOfBoundsError,
    UnitError."""
    low, high = np.full((2, len(problem.names)), np.inf) * np.array([[-1.0], [1.0]])
    for name, ends in bounds.items():
        if name not in problem.names:
            raise ValueOutOfBoundsError(
                f"bounds are given for {name}, which is not free; add it to the free parameters, or "
                "omit its bounds"
            )
        least, most = bounds_in_own_unit(problem.model, name, ends)
        at = list(problem.names).index(name)
        if problem.by_logarithm[at]:
            low[at], high[at] = np.log(least) if least > 0 else -np.inf, np.log(most)
        else:
            low[at], high[at] = least / problem.unit[at], most / problem.unit[at]
    return low, high


def _fitted(problem: Problem, minimum: Minimum, file: str) -> Fitted:
    """Return the result of the fit, with intervals, correlations and warnings."""
    from scipy.stats import t

    x, count = minimum.x, len(minimum.residuals)
    values, model = problem.values(x), problem.varied(x)
    covariance, unresolved, unidentifiable = _uncertainty(
        problem, values, minimum.jacobian, minimum.sigma, count
    )
    deviations = np.sqrt(np.diag(covariance))
    half_width = np.where(
        unresolved | (not minimum.stationary),
        np.inf,
        t.ppf((1 + _CONFIDENCE) / 2, count - len(x)) * deviations,
    )
    with np.errstate(over="ignore"):
        ends = [problem.unscaled(problem.clipped(x) + side * half_width) for side in (-1, 1)]
    intervals = {
        name: Interval(float(value), float(low), float(high))
        for name, value, low, high in zip(problem.names, values, *ends, strict=True)
    }
    channels = [
        Channel(data.speed, data.orders, name, data.at, data.channels[name], computed, data.position)
        for data in problem.sets
        for name, computed, _ in problem.computed(model, data)
    ]
    scale = np.where(deviations > 0, deviations, 1.0)
    residual = float(np.sqrt(np.mean(minimum.residuals**2)))
    correlations = covariance / scale / scale[:, None]
    doubts = [*minimum.warnings, *diagnose(channels, model.period, problem.ratios)]
    return Fitted(model, file, intervals, correlations, residual, unidentifiable, channels, doubts)


def _uncertainty(
    problem: Problem, values: Array, jac: Array, sigma: float, count: int
) -> tuple[Array, Array, list[str]]:
    """Return the covariance (r, r) of x in the identifiable directions; a mask (r,) of the parameters that
    have a component in another direction; and sentences that name the unidentifiable combinations."""
    _, sizes, axes = np.linalg.svd(jac, full_matrices=False)
    is_identifiable = sizes > EPS * count * sizes[0]
    spread = np.where(is_identifiable, sigma / np.where(is_identifiable, sizes, 1.0), np.inf)
    rate = np.where(problem.by_logarithm | (values == 0), 1.0, problem.unit / np.where(values, values, 1.0))
    unidentifiable = [
        _sentence(problem.names, axis * rate)
        for axis, deviation in zip(axes, spread, strict=True)
        if deviation > _UNIDENTIFIABLE
    ]
    unresolved = np.asarray((np.abs(axes[~is_identifiable]) > _SHARE).any(axis=0))
    return (axes.T * np.where(is_identifiable, spread, 0.0) ** 2) @ axes, unresolved, unidentifiable


def _sentence(names: Sequence[str], axis: Array) -> str:
    """Return a sentence that names a combination of parameters that the data do not determine."""
    lead = axis[np.abs(axis).argmax()]
    parts = [
        f"{name} by {100 * share:+.3g} %"
        for name, share in zip(names, (axis / lead).tolist(), strict=True)
        if abs(share) > _SHARE
    ]
    if len(parts) == 1:
        return f"the data do not determine {parts[0].split()[0]}"
    names = ", ".join(part.split()[0] for part in parts)
    return (
        f"the data do not determine {names} separately: changes of {', '.join(parts)} together have no clear "
        "effect"
    )
