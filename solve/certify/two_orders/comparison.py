"""Two solutions of the same points, of which one is better: their difference is the error of the other."""

from abc import ABC, abstractmethod
from functools import lru_cache

import numpy as np

from solve.arrays import Array
from solve.certify.certified import Request
from solve.certify.solving import Solving
from solve.certify.two_orders.coefficients import Phases, Resampled, SharedSamples, harmonics
from solve.methods.collocation import Collocation
from solve.methods.method import Method, Solutions
from solve.period.grid import Grid
from solve.period.multipliers import EPS
from solve.period.points import Points
from solve.sizes import SMALL

_COEFFICIENTS = 1e-3
"""Fraction of `rtol` by which coefficients may differ from their interpolation: the response amplifies that
by at most the phase advance of a mode that is followed, some hundred radians."""

_AMPLIFIED = 100.0
"""Factor by which the response may amplify harmonics of the coefficients that evenly spaced samples confuse
with lower ones: a light resonance."""


class Comparison(ABC):
    """A solution, and a better one on a related grid whose difference to it is its error.

    solving, better: what gives them. times: steps of the better grid for each of the other one.
    """

    times: int

    def __init__(self, solving: Solving, better: Solving):
        self.solving, self.better = solving, better

    @property
    def most(self) -> int:
        """Most steps of the solution."""
        return min(self.solving.most, self.better.most // self.times)

    def solved(self, steps: int, positions: Array) -> tuple[Solutions, Solutions]:
        """Both solutions of points at positions (k,), on the given steps and on those of the better one."""
        return self.solving.solved(steps, positions), self.better.solved(steps * self.times, positions)

    @abstractmethod
    def unresolved(self, steps: int, positions: Array, solutions: Solutions) -> Array:
        """Errors (k, 2) by variations of the coefficients that neither grid resolves, of points at positions
        (k,) with these solutions on this number of steps."""


class TwoOrders(Comparison):
    """s and s + 1 stages on the same grid.

    A collocation step with one stage more solves the error equation of the step with s stages, so that the
    difference of their maps is the dual-weighted residual with an exact discrete adjoint; the equations being
    linear, closing both chains transports these local errors over the period exactly.
    """

    times = 1

    def solved(self, steps: int, positions: Array) -> tuple[Solutions, Solutions]:
        points, method = self.solving.equations[positions], self.solving.method
        if not method.linear or points.n > SMALL:
            return super().solved(steps, positions)
        shared = SharedSamples(points, self._phases(points, steps))
        return self.solving.on_grid(shared, steps), self.better.on_grid(shared, steps)

    def unresolved(self, steps: int, positions: Array, solutions: Solutions) -> Array:
        solving = self.solving
        points = solving.method.linearised(solving.equations[positions], solutions)
        phases = self._phases(points, steps)
        found = np.zeros((len(points), 2))
        relative = phases.relative_difference(points)
        at = np.flatnonzero(relative > max(64 * EPS, _COEFFICIENTS * solving.request.rtol))
        if len(at):
            again = solving.on_grid(Resampled(points[at], phases), steps)
            found[at] = np.inf
            at, again = at[again.known], again[again.known]
            found[at] = solving.differences(again, solutions[at], positions[at])
        return found

    def _phases(self, points: Points, steps: int) -> Phases:
        lower, higher = self.solving.method.stages, self.better.method.stages
        return phases_of(steps, points.period, points.breaks, lower, higher)


class DoubledSteps(Comparison):
    """m and 2m steps of the same method, for methods without another stage."""

    times = 2

    def unresolved(self, steps: int, positions: Array, solutions: Solutions) -> Array:
        method, points = self.solving.method, self.solving.points[positions]
        if not method.samples_evenly:
            return np.zeros((len(points), 2))
        # A series needs the harmonics of the coefficients about each of its own.
        resolved = steps // (2 if method.spectral else 1)
        return np.full((len(points), 2), _AMPLIFIED * harmonics(points)[resolved + 1 :].sum())


def compared(points: Points, method: Method, request: Request) -> Comparison:
    """How the errors of a method are estimated at points."""
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
