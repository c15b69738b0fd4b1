"""Minimisation of the largest of several values, subject to bounds and equations.

Sequential quadratic programming (D. Kraft, A software package for sequential quadratic programming, DFVLR-FB
88-28, 1988, in SciPy) on the epigraph: the smallest t that is not exceeded by any value is sought."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from solve.arrays import Array
from solve.studies.tracked import Tracked

_MAX_ITERATIONS = 60
"""Largest number of iterations in a round. Chosen by judgement: rounds of cam and manipulator take 10 to
40."""

_LINE_SEARCH, _MAX_STALLED = 5, 2
"""Number of evaluations above which a line search is stalled, and number of stalled line searches after which
a round ends: extrema have then merged or vanished, or the gain is within the error of the values. Chosen by
judgement."""

_CORRECTIONS = 3
"""Number of corrections after which equations hold to round-off: SLSQP satisfies the equations to 4 to 6
digits, and each correction doubles the number of digits."""


@dataclass(frozen=True)
class Limited:
    """Values that must not exceed a limit. scale: size by which they are divided in the optimisation."""

    values: Tracked
    limit: float
    scale: float


@dataclass(frozen=True)
class Excess:
    """Amounts by which values exceed their limit, in units of its scale; negative below it."""

    limited: Limited

    def values(self, x: Array) -> Array:
        return (self.limited.values.values(x) - self.limited.limit) / self.limited.scale

    def slopes(self, x: Array) -> Array:
        return self.limited.values.slopes(x) / self.limited.scale


@dataclass(frozen=True)
class Equations:
    """Equations f(x) = 0 with derivatives. `residuals` (e,) and `slopes` (e, r) refer to x scaled to 0 …
    1."""

    residuals: Callable[[Array], Array]
    slopes: Callable[[Array], Array]


def minimised(
    objective: Sequence[Tracked],
    limits: Sequence[Limited],
    equations: Equations | None,
    x: Array,
    reach: float,
    rtol: float,
) -> tuple[Array, float]:
    """Variables x (r,) in 0 … 1 that minimise the largest value of the objective, and the relative change of
    this value. reach: largest change of an element of x. Raises the exceptions of the functions that compute
    the values."""
    from scipy.optimize import minimize

    scale = max(float(np.abs(each.values(x)).max()) for each in objective) or 1.0
    rows = [Limited(each, np.nan, scale) for each in objective], limits

    def slack(z: Array) -> Array:
        """Distances of the values from t, or from their limits, at z = (x, t)."""
        parts = [z[-1] - each.values.values(z[:-1]) / scale for each in rows[0]]
        parts += [(each.limit - each.values.values(z[:-1])) / each.scale for each in rows[1]]
        return np.concatenate(parts)

    def slack_slopes(z: Array) -> Array:
        parts = []
        for kind, by_level in zip(rows, (1.0, 0.0), strict=True):
            for each in kind:
                slopes = -each.values.slopes(z[:-1]) / each.scale
                parts.append(np.column_stack((slopes, np.full(len(slopes), by_level))))
        return np.concatenate(parts)

    largest = max(float(each.values(x).max()) for each in objective) / scale
    start, level = np.append(x, largest), np.append(np.zeros(len(x)), 1.0)
    # Values are scaled to derivatives of at most 1 at the start, so that the first step, along the gradient,
    # is not too long.
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
            options={"maxiter": _MAX_ITERATIONS, "ftol": rtol},
        )
    last = np.clip(units * iterates.last, lower, upper)
    return last[:-1], float(last[-1]) - largest


def restored(equations: Equations, x: Array) -> Array:
    """Variables x (r,) in 0 … 1 with smaller residuals of the equations, by Gauss-Newton corrections within
    the bounds. Raises the exceptions of the equations."""
    for _ in range(_CORRECTIONS):
        inner = (x > 0) & (x < 1)
        change = np.linalg.lstsq(equations.slopes(x)[:, inner], equations.residuals(x))[0]
        x = x.copy()
        x[inner] = np.clip(x[inner] - change, 0.0, 1.0)
    return x


class _StalledError(Exception):
    """Raised to end a round whose line searches stall."""


@dataclass
class _Iterates:
    """Latest iterate, and the number of line searches that stalled."""

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
