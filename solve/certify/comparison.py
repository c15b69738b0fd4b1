"""Error estimates from the difference of two solutions of the same points."""

from abc import ABC, abstractmethod
from functools import lru_cache

import numpy as np

from solve.arrays import Array
from solve.certify.certified import Request
from solve.certify.coefficients import Phases, Resampled, harmonics
from solve.certify.solving import Solving
from solve.methods.collocation import Collocation
from solve.methods.free import free
from solve.methods.method import Method, Solutions
from solve.period.grid import Grid
from solve.period.multipliers import EPS
from solve.period.points import Points

_COEFFICIENTS = 1e-3
"""Fraction of `rtol` by which coefficients may differ from their interpolation, relative to the stiffness of
the softest mode. The response amplifies this by at most the phase advance of a resolved mode, some hundred
radians."""

_ROUND_OFF = 512 * EPS
"""Relative difference of coefficients from their interpolation that is round-off: 4e-14 at most for the
models of this project, 2e-13 with noise of the last digit and 3000 steps."""

_AMPLIFIED = 100.0
"""Factor by which the response may amplify aliased harmonics of the coefficients: a lightly damped
resonance."""


class Comparison(ABC):
    """A solution and a better one on a related grid; their difference is the error of the first.

    solving, better: solvers of both. times: ratio of their numbers of steps. remaining: error of the better
    solution as a fraction of the difference.
    """

    times: int
    remaining = 0.0

    def __init__(self, solving: Solving, better: Solving):
        self.solving, self.better = solving, better

    @property
    def most(self) -> int:
        """Largest number of steps of the first solution."""
        return min(self.solving.most, self.better.most // self.times)

    def solved(self, steps: int, positions: Array) -> tuple[Solutions, Solutions]:
        """Both solutions of points at positions (k,), the first on the given number of steps."""
        return self.solving.solved(steps, positions), self.better.solved(steps * self.times, positions)

    @abstractmethod
    def unresolved(self, steps: int, positions: Array, solutions: Solutions) -> Array:
        """Errors (k, 2) due to variations of the coefficients that neither grid resolves, for the solutions
        of points at positions (k,) on this number of steps."""


class TwoOrders(Comparison):
    """s and s + 1 stages on the same grid.

    A collocation step with one stage more solves the error equation of the step with s stages. The difference
    of their maps is therefore the dual-weighted residual with an exact discrete adjoint. Since the equations
    are linear, the periodic solutions of both chains propagate these local errors exactly.
    """

    times = 1

    def unresolved(self, steps: int, positions: Array, solutions: Solutions) -> Array:
        solving, method = self.solving, self.solving.method
        points = method.linearised(solving.points[positions], solutions)
        phases = phases_of(steps, points.period, points.breaks, method.stages, self.better.method.stages)
        found = np.zeros((len(points), 2))
        allowed = _COEFFICIENTS * solving.request.rtol * solving.softest(positions)
        at = np.flatnonzero(phases.relative_difference(points, _ROUND_OFF) > allowed)
        if len(at):
            equations = method.linearised(solving.equations[positions[at]], solutions[at])
            held = solving.held(positions[at]) if method.linear else free(equations)
            again = solving.on_grid(method.corrector, Resampled(equations, phases), steps, held)
            found[at] = np.inf
            at, again = at[again.known], again[again.known]
            found[at] = solving.differences(again, solutions[at], positions[at])
        return found


class DoubledSteps(Comparison):
    """m and 2m steps of the same method, for methods without a variant of higher order."""

    times = 2

    @property
    def remaining(self) -> float:
        return 1 / (2.0**self.solving.method.order - 1)

    def unresolved(self, steps: int, positions: Array, solutions: Solutions) -> Array:
        method, points = self.solving.method, self.solving.points[positions]
        if not method.samples_evenly:
            return np.zeros((len(points), 2))
        # A Fourier series couples each of its harmonics with those of the coefficients.
        resolved = steps // (2 if method.spectral else 1)
        beyond = (harmonics(points, loads)[:, resolved + 1 :].sum(axis=1) for loads in (True, False))
        return np.column_stack(tuple(beyond)) * _AMPLIFIED


def compared(points: Points, method: Method, request: Request) -> Comparison:
    """Comparison that estimates the errors of a method at points."""
    solving = Solving(points, method, request)
    higher = method.with_another_stage
    return (
        DoubledSteps(solving, solving) if higher is None else TwoOrders(solving, solving.with_method(higher))
    )


@lru_cache(maxsize=32)
def phases_of(
    steps: int, period: float, breaks: tuple[float, ...], lower: Collocation, higher: Collocation
) -> Phases:
    """Phases sampled and compared on a grid by two methods."""
    return Phases.of(Grid.uniform(steps, period, breaks), lower, higher)
