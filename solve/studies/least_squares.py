"""Nonlinear least squares in a domain with unknown limits, which are detected by trials (M. A. Branch, T. F.
Coleman, Y. Li, SIAM J. Sci. Comput. 21 (1999) 1-23, as implemented in SciPy).

A trial outside the domain has NaN residuals. SciPy's trust-region reflective method then reduces the trust
radius to a quarter of the step and tries again from the same point, without comparing the objective with the
quadratic model. Large finite residuals would distort the next radius.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from solve.arrays import ROUND_OFF, Array
from solve.errors import (
    MatricesError,
    NoOrbitError,
    NoResultError,
    ResonanceError,
    SolveError,
    StructureError,
    counted,
)

_OUTLIER = 2.0
"""Number of standard deviations above which a residual contributes its modulus, instead of its square, to a
robust fit. Chosen by judgement."""

_SPREAD = 1.4826
"""Ratio of the standard deviation to the median of the moduli, for normally distributed residuals."""

_OFFSET = 0.1
"""Relative offset above which a point does not count as a minimum: the distance to the stationary point is
then at least a tenth of the standard error. Bates and Watts stop at 0.001. SciPy's ftol of 1e-8 leads to 1e-4
√(n/p) for n values and p parameters, which is about 0.01 for 10 000 values."""

EXACT = 1e-5
"""Relative residual up to which the residuals are explained by errors of the orbits (tolerance 1e-7) and of
finite differences. Chosen by judgement."""

_MOVED = 1e-8
"""Relative change below which a parameter counts as unchanged: SciPy's xtol."""

_OF_VALUES = MatricesError, NoOrbitError, ResonanceError, StructureError
"""Exceptions that are caused by parameter values. The messages do not contain these values."""


class LeastSquares(Protocol):
    """Least-squares problem: residuals (k,) and Jacobian (k, r) as functions of x (r,). Both raise SolveError
    subclasses outside the domain."""

    @property
    def start(self) -> Array: ...
    def residuals(self, x: Array) -> Array: ...
    def jacobian(self, x: Array) -> Array: ...
    def described(self, x: Array) -> str:
        """Text that lists the parameters at x (r,), with values and units."""
        ...


@dataclass
class Minimum:
    """Final point of the iteration: x (r,), residuals (k,), Jacobian (k, r), and standard deviation `sigma`
    of the residuals. `stationary` is True if the point counts as a minimum. `warnings` are reasons for doubt,
    one sentence each."""

    x: Array
    residuals: Array
    jacobian: Array
    sigma: float
    stationary: bool
    warnings: Sequence[str]


def minimise(problem: LeastSquares, bounds: tuple[Array, Array], robust: bool) -> Minimum:
    """Minimise the residuals by the trust-region reflective method, from the start of the problem. If
    `robust` is True, large residuals contribute their moduli instead of their squares. Raises SolveError
    subclasses, with the initial values in the message, if the residuals do not exist at the start."""
    from scipy.optimize import least_squares

    trials = _Trials(problem, _at_start(problem).shape)
    settings: dict[str, Any] = {"jac": problem.jacobian, "bounds": bounds, "x_scale": "jac"}
    solution = least_squares(trials.residuals, problem.start, **settings)
    for _ in range(2 if robust else 0):
        scale = _OUTLIER * _spread(solution.fun)
        if scale > 0:
            solution = least_squares(trials.residuals, solution.x, loss="soft_l1", f_scale=scale, **settings)
    left = len(solution.fun) - len(solution.x)
    sigma = _spread(solution.fun) if robust else float(np.sqrt(2 * solution.cost / left))
    exact = np.sqrt(np.mean(solution.fun**2)) <= EXACT
    stationary = bool(robust or exact or _offset(solution) <= _OFFSET)
    doubts = [] if exact else _doubts(problem, solution, trials, stationary)
    return Minimum(solution.x, solution.fun, solution.jac, sigma, stationary, doubts)


def _spread(residuals: Array) -> float:
    return float(_SPREAD * np.median(np.abs(residuals)))


@dataclass
class _Trials:
    """Residuals of a problem; NaN outside its domain. `failures` contains the reason for each failed trial,
    one sentence each."""

    problem: LeastSquares
    shape: tuple[int, ...]
    failures: list[str] = field(default_factory=list)

    def residuals(self, x: Array) -> Array:
        try:
            values = self.problem.residuals(x)
            if np.isfinite(values).all() and np.isfinite(self.problem.jacobian(x)).all():
                return values
            reason = "values or derivatives that are not finite"
        except SolveError as error:
            reason = str(error)
        self.failures.append(f"{self.problem.described(x)}: {reason}")
        return np.full(self.shape, np.nan)


def _at_start(problem: LeastSquares) -> Array:
    """Return the residuals (k,) at the start. Raises SolveError subclasses whose message contains the initial
    values."""
    where, remedy = problem.described(problem.start), "start from other values with --set NAME=NUMBER"
    try:
        values, slopes = problem.residuals(problem.start), problem.jacobian(problem.start)
    except _OF_VALUES as error:
        raise type(error)(f"the fit starts from {where}, where {error}; {remedy}") from None
    for what, numbers in (("values", values), ("derivatives", slopes)):
        if not np.isfinite(numbers).all():
            raise NoResultError(
                f"the fit starts from {where}, where {what} computed for the data are not finite; {remedy}"
            )
    return values


def _doubts(problem: LeastSquares, found: Any, trials: _Trials, stationary: bool) -> list[str]:
    """Return reasons why the final point may not be a minimum, one sentence each."""
    count = len(trials.failures)
    outside = f" ({counted(count, 'trial')} had no result, the last {trials.failures[-1]})" if count else ""
    start = problem.start
    if (np.abs(found.x - start) <= _MOVED * np.maximum(1.0, np.abs(start))).all():
        which = ", already a minimum" if stationary else f", which is not a minimum{outside}"
        return [
            f"the fit did not move from its start, {problem.described(start)}{which}; try other initial "
            "values"
        ]
    if found.status == 0:
        return [
            f"the fit was stopped after {counted(found.nfev, 'trial')}{outside}; continue from its result"
        ]
    if not stationary:
        return [
            f"the fit ended away from a minimum{outside}; bound the free parameters, or use other "
            "initial values"
        ]
    return []


def _offset(found: Any) -> float:
    """Return the relative offset for the parameters that are not at a bound (D. M. Bates, D. G. Watts,
    Technometrics 23 (1981) 179-183): the ratio of two components of the residuals, in the tangent plane and
    normal to it. Each component is divided by the square root of its number of degrees of freedom."""
    free = found.active_mask == 0
    axes, sizes, _ = np.linalg.svd(found.jac[:, free], full_matrices=False)
    # Singular values of directions that the data cannot identify were measured as 4e-14 to 6e-14.
    is_significant = sizes > ROUND_OFF * max(sizes, default=0.0)
    inside = axes[:, is_significant].T @ found.fun
    rank, across = len(inside), found.fun - axes[:, is_significant] @ inside
    if not rank:
        return 0.0
    normal = np.sqrt(np.sum(across**2) / (len(found.fun) - rank))
    return float(np.sqrt(np.sum(inside**2) / rank) / max(normal, np.finfo(float).tiny))
