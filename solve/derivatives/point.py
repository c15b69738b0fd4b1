"""Sensitivities at one point: derivatives of quantities of an orbit or of its stability, on the grid of its
solution. Errors are estimated by a method with one more stage."""

from collections.abc import Sequence
from typing import Any, cast

import numpy as np

from solve.arguments import unique_names
from solve.arrays import Array
from solve.certify.comparison import SAFETY
from solve.derivatives.grid_derivatives import GridDerivatives, dependence_of, multiplier_position
from solve.equations import derivatives_of
from solve.errors import NoDerivativeError, ValueOutOfBoundsError
from solve.labels import SPEED
from solve.methods.choice import Rule
from solve.methods.collocated import Collocated
from solve.methods.method import Method
from solve.newton.orbits import nonlinear as nonlinear_orbit
from solve.period.named import EXPONENT, RADIUS, Named, Solved
from solve.results.sensitivities import Sensitivities, Sensitivity
from solve.results.special_orbits import NonlinearOrbit
from solve.results.stability import Stability
from solve.single import floquet, periodic
from solve.system import PeriodicSystem, of_system
from solve.threads import one_thread

_COARSENING = 4
"""Ratio between the numbers of steps of the grid and of a coarser grid, on which the sizes of the terms of
derivatives are estimated. Chosen by judgement."""

_PARAMETERS_PER_ADJOINT = 2
"""Number of parameters for which the forward problems take as long as the adjoint problem of one
statistic."""

_ROUNDOFF = 1e-13
"""Round-off error of a derivative, relative to the estimated size of the terms of its sum. Chosen by
judgement: a few hundred eps."""


@of_system
def sensitivities(
    system: PeriodicSystem,
    speed: float | str,
    of: Sequence[str] | None = None,
    by: Sequence[str] | None = None,
    method: str | Rule = "auto",
    steps: int | None = None,
    rtol: float = 1e-8,
    engine: str = "auto",
    nonlinear: bool = False,
    periods: int | None = None,
) -> Sensitivities:
    """Compute derivatives of quantities of the periodic orbit and of its stability at a speed.

    Parameters
    ----------
    system : Model
        Model with generated equations.
    speed : float or str
        Speed in rad/s, or a string with a unit.
    of : sequence of str, optional
        Quantities such as "q3.max_abs", "contact_force.harmonic5", "spectral_radius", "rho1" (complex),
        "rho1.abs", "exponent1.re". By default, max_abs of the coordinates, and spectral_radius.
    by : sequence of str, optional
        Names of parameters, or "speed". By default, all parameters with respect to which derivatives exist.
    method : str or Method
        "radau", "gauss" or "auto".
    steps, rtol, engine : optional
        As in `periodic`.
    nonlinear : bool
        Whether to differentiate the orbit of the nonlinear equations, as computed by `solve.nonlinear`, and
        its multipliers.
    periods : int, optional
        Period of a nonlinear orbit, as a number of periods of the model.

    Returns
    -------
    Sensitivities
        Derivatives and their errors. For a quantity without a derivative, such as a multiple multiplier, they
        are NaN, and the reason is stated.

    Raises
    ------
    UnknownNameError
        If a quantity or parameter is unknown.
    NoDerivativeError
        If the system has no generated equations, or a parameter is an integer.
    SolveError
        Other subclasses, as in `periodic`.

    Notes
    -----
    Derivatives are those of the numerical solution on its grid, by one forward or adjoint solution (A.
    Griewank, A. Walther, Evaluating Derivatives, 2nd ed., chapter 15). Errors are estimated from a solution
    with one more stage.

    Examples
    --------
    >>> import solve
    >>> found = sensitivities(solve.load("cam"), "600 rpm", of="q3.max_abs", by=["k1", "speed"])
    >>> round(found.elasticities("q3.max_abs")["k1"], 4)
    -2.6535
    """
    quantities, names = quantities_by(system, of, by)
    given = system, speed
    settings: dict[str, Any] = {"method": method, "steps": steps, "rtol": rtol, "engine": engine}
    count = periods_of(nonlinear, periods)
    if nonlinear:
        solved = nonlinear_orbit(*given, periods=count, **settings)
    else:
        orbit = any(quantity.of_orbit for quantity in quantities)
        solved = (periodic if orbit else floquet)(*given, **settings)
    return of_solution(solved, quantities, names)


def periods_of(nonlinear: bool, periods: int | None) -> int:
    """Number of periods of an orbit, by default 1. Raises ValueOutOfBoundsError if `periods` is given for a
    linear orbit."""
    if periods is not None and not nonlinear:
        raise ValueOutOfBoundsError(
            f"periods is {periods!r}, which requires nonlinear=True; add nonlinear=True, or omit periods"
        )
    return 1 if periods is None else periods


def quantities_by(
    system: PeriodicSystem, of: Sequence[str] | None, by: Sequence[str] | None
) -> tuple[list[Named], list[str]]:
    """Return the quantities, and the names of the parameters with respect to which they are differentiated,
    both without duplicates. Raises UnknownNameError, ValueOutOfBoundsError, NoDerivativeError."""
    peaks = [f"{name}.max_abs" for name in system.coordinates]
    varied = derivatives_of(system).names if system.capabilities.variation else ()
    texts, names = _names("of", of, [*peaks, RADIUS]), _names("by", by, [*varied, SPEED])
    quantities = [Named.parse(system, text) for text in texts]
    derivatives_of(system).by(names)
    return quantities, names


def require_stages(rule: Rule) -> None:
    """Raise ValueOutOfBoundsError for a method without stages."""
    if isinstance(rule, Method) and not isinstance(rule, Collocated):
        raise ValueOutOfBoundsError(f"method is {rule.name}; sensitivities support radau, gauss and auto")


def of_solution(solved: Stability, quantities: Sequence[Named], names: Sequence[str]) -> Sensitivities:
    """Sensitivities of an existing solution. It must be an orbit if the quantities require one. Raises
    ValueOutOfBoundsError for methods without stages."""
    rule, system, dependence = solved.certified.method, solved.system, dependence_of(solved, names)
    require_stages(rule)
    assert isinstance(rule, Collocated)
    free = solved.certified.solutions.free
    of_orbits = sum(quantity.of_orbit for quantity in quantities)
    if free is not None and of_orbits and free.modes.conserving.any():
        raise NoDerivativeError(
            "orbit sensitivities are not available for a machine that rotates freely if inertia or "
            "gyroscopic forces vary along its rigid-body mode; request sensitivities of multipliers, "
            "or add drag"
        )
    adjoint = (
        dependence.partial_outputs and free is None and _PARAMETERS_PER_ADJOINT * of_orbits <= len(names)
    )
    shared = names, adjoint, {}
    by_method = GridDerivatives(solved, rule, solved.steps, dependence, *shared)
    better = GridDerivatives(solved, rule.with_another_stage, solved.steps, dependence.less_accurate, *shared)
    coarse = GridDerivatives(solved, rule, max(1, solved.steps // _COARSENING), dependence, *shared)
    with one_thread(system.n):
        slopes = list(zip(by_method.slopes(quantities), better.slopes(quantities), strict=True))
        found = _with_errors(quantities, slopes, by_method, coarse)
    values = [solved.speed if name == SPEED else system.labels.parameters[name] for name in names]
    by = dict(zip(names, values, strict=True))
    notes = [*solved.notes, *(solved.doubts if isinstance(solved, NonlinearOrbit) else [])]
    return Sensitivities(system, solved.speed, by, found, rule.name, solved.steps, notes)


def _names(what: str, given: Sequence[str] | None, default: Sequence[str]) -> list[str]:
    """Names without duplicates. Raises ValueOutOfBoundsError if the list is empty."""
    names = list(unique_names(default if given is None else given))
    if not names:
        raise ValueOutOfBoundsError(f"'{what}' is empty; give names, or omit '{what}'")
    return names


def _multiplier_error(solved: Stability, quantity: Named) -> float:
    """Relative error of the multiplier that is a factor in the derivative of the quantity; 0 if there is no
    such factor.

    The difference between results with different numbers of stages does not include this error.
    """
    if quantity.of_orbit or quantity.subject == EXPONENT:
        return 0.0
    at = multiplier_position(solved, quantity)
    leading = solved.spectrum.leading
    if at < len(leading):
        return float(solved.certified.absolute[0] / np.abs(leading[at]))
    return float(solved.multiplier_errors[at])


def _with_errors(
    quantities: Sequence[Named],
    slopes: Sequence[Sequence[Array | NoDerivativeError]],
    grid: GridDerivatives,
    coarse: GridDerivatives,
) -> dict[str, Sensitivity]:
    """Mapping from quantities to sensitivities with errors.

    The error is twice the difference between the derivatives by the method and by a method with one more
    stage, plus the effect of the error of the multiplier. It is at least the round-off, which is estimated on
    a coarser grid."""
    found = {}
    sizes = coarse.slopes(quantities, sizes=True)
    for quantity, results, size in zip(quantities, slopes, sizes, strict=True):
        failures = [str(each) for each in (*results, size) if isinstance(each, NoDerivativeError)]
        if failures:
            found[quantity.text] = _without(quantity, failures[0], grid)
            continue
        by_method, better = map(np.asarray, results)
        error = SAFETY * np.abs(by_method - better)
        error += _multiplier_error(grid.solved, quantity) * np.abs(by_method)
        error = np.maximum(error, _ROUNDOFF * np.asarray(size))
        found[quantity.text] = _sensitivity(quantity, by_method, error, grid)
    return found


def _without(quantity: Named, reason: str, grid: GridDerivatives) -> Sensitivity:
    """Sensitivity that contains the reason why the quantity has no derivatives."""
    nothing = np.full(len(grid.names), np.nan)
    return Sensitivity(quantity.value(cast(Solved, grid.solved)), quantity.unit, nothing, nothing, reason)


def _sensitivity(quantity: Named, fine: Array, errors: Array, grid: GridDerivatives) -> Sensitivity:
    """Sensitivity of a quantity. It contains a reason if the derivatives with respect to some parameters do
    not exist."""
    moved = grid.jumps(quantity.subject)
    reasons = {
        "several extrema are equally large, and their derivatives differ": np.isnan(fine) & ~moved,
        (
            f"{quantity.subject} jumps at phases that depend on these parameters, and sums over samples do "
            "not resolve the jumps"
        ): moved,
    }
    reason = "; ".join(
        f"{quantity.text} has no derivative with respect to {', '.join(np.array(grid.names)[at])}: {why}"
        for why, at in reasons.items()
        if at.any()
    )
    return Sensitivity(quantity.value(cast(Solved, grid.solved)), quantity.unit, fine, errors, reason)
