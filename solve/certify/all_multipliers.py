"""Every multiplier of a point with an error of its own, from the factors of its period: the monodromy matrix
holds none below eps‖Φ‖."""

import math
from dataclasses import dataclass

import numpy as np

from solve.arrays import Array
from solve.certify.certified import Request
from solve.errors import StepsError
from solve.methods.method import Method, OneStep
from solve.period.grid import Grid
from solve.period.points import Points
from solve.period.product_eigenvalues import ProductEigenvalues, balanced_blocks, product_eigenvalues

_NO_DIGIT = 0.1
"""Relative error from which on a multiplier is not known."""

_GAIN = 0.5
"""Part of itself to which twice the steps must bring the largest error, for more to be tried."""

_EXACT_ZERO = -1e6
"""Logarithm that stands for that of an exact zero where multipliers of two grids are matched."""


@dataclass(frozen=True)
class AllMultipliers:
    """logarithms (N,) of the multipliers ρ, falling in modulus, + imaginary part first, -inf for an exact
    zero; errors (N,): estimated relative error of each ρ, NaN where it has no digit, as of modes that the
    `steps` do not follow."""

    logarithms: Array
    errors: Array
    steps: int

    rtol: float

    @property
    def unresolved(self) -> int:
        """How many have no digit."""
        return int(np.isnan(self.errors).sum())

    @property
    def warnings(self) -> list[str]:
        """A sentence where an error is above the tolerance that was asked for."""
        if self.unresolved:
            missed = f"{self.unresolved} of {len(self.errors)} multipliers have no digit"
        elif (worst := float(self.errors.max())) > self.rtol:
            missed = f"every multiplier is known to {worst:.1e} of itself, not to rtol {self.rtol:g}"
        else:
            return []
        return [f"{missed}: {self.steps} steps do not follow the fastest modes, or rounding is in the way"]


def checked_maps(method: Method) -> None:
    """Raise StepsError for a method that has no maps of steps."""
    if not isinstance(method, OneStep):
        raise StepsError(
            f"{method.name} has no maps of steps from which all multipliers could come; use radau or gauss"
        )


def all_multipliers(point: Points, method: Method, request: Request, steps: int) -> AllMultipliers:
    """Of one point, on `steps` and as many more as bring the error of each to `rtol`; fewer where twice the
    steps gain nothing or take too much memory. With steps of the request's own: on those and twice as many.

    Raises StepsError for a method that has no maps of steps.
    """
    most = method.most_steps(point.n)
    coarse, before = _logarithms(point, method, request, steps), math.inf
    while True:
        steps *= 2
        fine = _logarithms(point, method, request, steps)
        errors = np.maximum(_distances(coarse.logarithms[0], fine.logarithms[0]), fine.errors[0])
        largest = float(errors.max())
        done = largest <= request.rtol or request.steps is not None
        if done or 2 * steps > most or largest > _GAIN * before:
            known = np.where(errors < _NO_DIGIT, errors, np.nan)
            return AllMultipliers(fine.logarithms[0], known, steps, request.rtol)
        coarse, before = fine, largest if largest < _NO_DIGIT else math.inf


def _logarithms(point: Points, method: Method, request: Request, steps: int) -> ProductEigenvalues:
    grid = Grid.uniform(steps, point.period, point.breaks)
    solutions = method.solutions(point, grid, False, request.engine)
    for reason in solutions.failures.values():
        raise reason
    assert solutions.steps is not None
    blocks = balanced_blocks(solutions.steps.A)
    return product_eigenvalues(blocks.factors, blocks.rounding)


def _distances(coarse: Array, fine: Array) -> Array:
    """Relative distance (N,) of the fine multipliers to the matched coarse ones, from their logarithms."""
    from scipy.optimize import linear_sum_assignment

    ours, theirs = (np.where(np.isneginf(np.real(part)), _EXACT_ZERO, part) for part in (fine, coarse))
    apart = ours[:, None] - theirs
    turned = np.angle(np.exp(1j * np.imag(apart)))
    distance = np.hypot(np.real(apart), turned)
    return distance[np.arange(len(fine)), linear_sum_assignment(distance)[1]]
