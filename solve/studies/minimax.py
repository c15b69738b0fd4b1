"""Minimisation of the largest of several values, subject to bounds and equations.

Sequential quadratic programming (D. Kraft, A software package for sequential quadratic programming, DFVLR-FB
88-28, 1988, in SciPy) is applied to the epigraph: it minimises a bound t that no value may exceed."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from solve.arrays import Array
from solve.studies.tracked import Tracked

_LINE_SEARCH, _MAX_STALLED = 5, 2
"""Number of evaluations above which a line search counts as stalled, and number of stalled line searches
after which the minimisation ends: extrema have then merged or vanished, or the improvement is within the
error of the values. Chosen by judgement."""

_CORRECTIONS = 3
"""Number of corrections after which equations hold to round-off: SLSQP satisfies the equations to 4 to 6
digits, and each correction doubles the number of digits."""


@dataclass(frozen=True)
class Excess:
    """Amounts by which values exceed a limit, divided by `scale`; negative if the limit is met."""

    tracked: Tracked
    limit: float
    scale: float

    def values(self, x: Array) -> Array:
        return (self.tracked.values(x) - self.limit) / self.scale

    def slopes(self, x: Array) -> Array:
        return self.tracked.slopes(x) / self.scale


@dataclass(frozen=True)
class Equations:
    """Constraint equations f(x) = 0: functions that return f (e,) and its derivatives (e, r). The variables x
    (r,) are scaled to the range 0 … 1."""

    residuals: Callable[[Array], Array]
    slopes: Callable[[Array], Array]


def minimised(
    objective: Sequence[Tracked],
    limits: Sequence[Excess],
    equations: Equations | None,
    x: Array,
    reach: float,
    rtol: float,
) -> tuple[Array, float]:
    """Minimise the largest value of the objective. Return the variables x (r,), each between 0 and 1, and the
    relative change of the largest value. No element of x changes by more than `reach`. Raises the exceptions
    of the functions that compute the values."""
    from scipy.optimize import minimize

    scale = max(float(np.abs(each.values(x)).max()) for each in objective) or 1.0

    def slack(z: Array) -> Array:
        """Return the distances of the values of the objective from t, and of the excesses from 0, at z = (x,
        t)."""
        parts = [z[-1] - each.values(z[:-1]) / scale for each in objective]
        return np.concatenate([*parts, *(-each.values(z[:-1]) for each in limits)])

    def slack_slopes(z: Array) -> Array:
        parts = []
        for kind, unit, by_level in ((objective, scale, 1.0), (limits, 1.0, 0.0)):
            for each in kind:
                slopes = -each.slopes(z[:-1]) / unit
                parts.append(np.column_stack((slopes, np.full(len(slopes), by_level))))
        return np.concatenate(parts)

    largest = max(float(each.values(x).max()) for each in objective) / scale
    start, level = np.append(x, largest), np.append(np.zeros(len(x)), 1.0)
    # Variables are scaled so that derivatives at the start are at most 1. The first step, which follows the
    # gradient, is then not too long.
    steep = np.abs(slack_slopes(start)).max(axis=0)
    units = 1 / np.maximum(steep, 1.0)
    constraints = [
        {"type": "ineq", "fun": lambda y: slack(units * y), "jac": lambda y: units * slack_slopes(units * y)}
    ]
    if equations is not None:
        constraints.append(
            {
                "type": "eq",
                "fun": lambda y: equations.residuals((units * y)[:-1]),
                "jac": lambda y: units * np.pad(equations.slopes((units * y)[:-1]), ((0, 0), (0, 1))),
            }
        )
    upper = np.append(np.minimum(x + reach, 1.0), np.inf)
    lower = np.append(np.maximum(x - reach, 0.0), -np.inf)
    iterates = _Iterates(start / units)
    with suppress(_StalledError):
        minimize(
            iterates.counted(lambda y: units[-1] * y[-1]),
            iterates.last,
            jac=lambda y: units * level,
            bounds=list(zip(lower / units, upper / units, strict=True)),
            constraints=constraints,
            callback=iterates.accept,
            method="SLSQP",
            options={"ftol": rtol},
        )
    last = np.clip(units * iterates.last, lower, upper)
    return last[:-1], float(last[-1]) - largest


def restored(equations: Equations, x: Array) -> Array:
    """Reduce the residuals of the equations by Gauss-Newton corrections of x (r,) within the bounds 0 and 1.
    Raises the exceptions of the equations."""
    for _ in range(_CORRECTIONS):
        inner = (x > 0) & (x < 1)
        change = np.linalg.lstsq(equations.slopes(x)[:, inner], equations.residuals(x))[0]
        x = x.copy()
        x[inner] = np.clip(x[inner] - change, 0.0, 1.0)
    return x


class _StalledError(Exception):
    """Raised to end a minimisation whose line searches stall."""


@dataclass
class _Iterates:
    """Record of the latest iterate and of the number of stalled line searches."""

    last: Array
    evaluations: int = 0
    stalled: int = 0

    def counted(self, function: Callable[[Array], float]) -> Callable[[Array], float]:
        """Wrap a function so that its evaluations are counted."""

        def value(y: Array) -> float:
            self.evaluations += 1
            return function(y)

        return value

    def accept(self, y: Array) -> None:
        """Record an iterate. Raises _StalledError after several stalled line searches."""
        self.stalled += self.evaluations > _LINE_SEARCH
        self.last, self.evaluations = y.copy(), 0
        if self.stalled >= _MAX_STALLED:
            raise _StalledError
