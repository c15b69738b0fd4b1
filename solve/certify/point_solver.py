"""Solver of points by one method on a grid. Points without a solution are returned with the reason."""

import math
from collections.abc import Iterator
from functools import cached_property
from typing import Any

import numpy as np

from solve.arrays import Array, others
from solve.certify.certified import Certified, Failed, SolveRequest
from solve.certify.coefficients import ROUND_OFF
from solve.errors import MatricesError, StepsError
from solve.matrices import leading
from solve.methods.free import driven_freely, free, solutions_on
from solve.methods.method import Method, Solutions, singular_inertia_error
from solve.period.frozen import FrozenModes, balanced, frozen
from solve.period.grid import Grid
from solve.period.points import Points, matrices
from solve.period.rigid_body import Free

_MEMORY = 2**25
"""Memory, in bytes, of the points that are solved in one chunk. Chosen by judgement."""

_WORK = 1e9
"""Number of multiplications for the points that are solved in one chunk. A chunk takes some tenths of a
second, which is the longest delay after an interruption by the user."""

_AMPLIFIED = 32.0
"""Divisor of the bound on the effect of round-off in the entries. With 32, the effect is at most 0.7 of the
divided bound on 430 grids of random test systems, of systems with stiff modes in rotated axes, and of models.
With 16 or 64, none of 80 estimates for stiff modes is below the error."""

_DRIVEN = 1e-9
"""Mean acceleration of a free machine, relative to the moduli of its accelerations, up to which it counts as
zero. Measured round-off for chains whose loads have zero mean: 1e-13."""


class PointSolver:
    """Solver of points by one method.

    Attributes
    ----------
    orders : (2,)
        Orders of convergence of orbit and multipliers.
    modes : FrozenModes
        Frozen modes of all points.
    free : Free or None
        Rigid-body modes of the points. None if there are none, or if the method determines them along an
        orbit.
    """

    def __init__(self, points: Points, method: Method, request: SolveRequest):
        self.points, self.method, self.request = points, method, request
        # The curve of a first-order coordinate results from one integration fewer than that of other
        # coordinates.
        is_lower = bool(points.first_order) and method.stages is not None
        self.orders = np.array([method.curve_order - is_lower, method.order])
        self.modes = frozen(points, engine=request.engine)
        self.free = free(points, self.modes) if method.linear else None

    @cached_property
    def max_steps(self) -> int:
        """Largest number of steps per period."""
        return self.method.most_steps(self.points.n, self.points.first_order)

    def rigid_body_modes(self, positions: Array) -> Free | None:
        """Rigid-body modes of points at positions (k,)."""
        return None if self.free is None else self.free[positions]

    @cached_property
    def equations(self) -> Points:
        """Points with balanced equations. For methods that do not converge, the equations are not balanced,
        because row factors change the modal masses and hence the results of these methods."""
        return balanced(self.points, self.modes) if self.method.converges else self.points

    @cached_property
    def relative_stiffness(self) -> Array:
        """Stiffness (P,) of the softest frozen mode, relative to the stiffest."""
        least, largest = self._extreme_rates
        return np.where(largest > 0, least / np.where(largest > 0, largest, 1.0), 1.0) ** 2

    def may_exceed(self, positions: Array, roundoff: Array, errors: Array) -> Array:
        """Whether (k,) the error due to round-off of the coefficients may exceed one of the `errors` (k, j),
        for points at `positions` (k,). roundoff (k, j): errors due to round-off of the step maps.

        Round-off ε of the largest rate ω₁ changes the smallest rate ω₂ by at most ε ω₁²/(2ω₂), and a
        multiplier by the period T times this change. A second bound is ω₁ T ε, multiplied by the factor of
        cancellation in the stiffness. For a single coordinate, the bound is zero."""
        if self.points.n == 1:
            return np.zeros(len(positions), dtype=bool)
        least, largest = self._extreme_rates[:, positions] * self.points.period
        needed = np.fmin.reduce(errors / roundoff, axis=1) * _AMPLIFIED / largest
        may_exceed = largest / np.maximum(least, 1.0) > needed
        rows = may_exceed.nonzero()[0]
        if len(rows):
            at = positions[rows]
            may_exceed[rows] = self.modes[at].cancellation(self._extreme_rates[0, at]) > needed[rows]
        return may_exceed

    @cached_property
    def _extreme_rates(self) -> Array:
        """Smallest and largest moduli (2, P) of the frozen eigenvalues; 1 for a single coordinate."""
        if self.points.n == 1:
            return np.ones((2, len(self.points)))
        rates = np.abs(self.modes.few_eigenvalues)
        return np.array((rates.min(axis=(1, 2)), rates.max(axis=(1, 2))))

    @cached_property
    def min_steps(self) -> Array:
        """Smallest number of steps (P,) for which the method can be stable at each point."""
        return self.method.least_steps(self.modes)

    def invalid_points(self) -> list[Failed]:
        """Return failures for points with a singular M, and for points at which the method is unstable with
        the requested number of steps.

        Raises StepsError for a number of steps that the method cannot use at any point.
        """
        failures = [Failed(*failure) for failure in singular_inertia(self.points, self.modes)]
        if self.request.steps is None:
            return failures
        rest = others(len(self.points), [failure.position for failure in failures])
        return [*failures, *self.unstable_points(self.request.steps, rest)]

    def unstable_points(self, steps: Any, positions: Array) -> Iterator[Failed]:
        """Yield failures for points at which the method is unstable with `steps` steps.

        Raises StepsError if the method cannot use this number at any point.
        """
        self.method.require_steps(steps, self.points)
        for position in positions[steps < self.min_steps[positions]].tolist():
            reason = StepsError(
                f"{self.method.name} with {steps} steps per period exceeds its stability limit; use at "
                f"least {self.min_steps[position]} steps, or a method without a stability limit (radau)"
            )
            yield Failed(position, reason)

    def chunks(self, steps: int, positions: Array, method: Method | None = None) -> list[Array]:
        """Split the positions into chunks. Each chunk fits into memory, and is solved within the longest
        delay after an interruption (`_WORK`)."""
        if len(positions) < 2:
            return [positions] if len(positions) else []
        method = method or self.method
        n, stages = self.points.n, method.stages
        size = method.bytes_a_step(n, self.request.orbit, self.request.engine)
        size = (size + 8 * self.points.bytes_a_phase) * steps
        rows = n * (1 if stages is None else len(stages.c))
        work = steps * rows**2 * (rows / 3 + 2 * n + 1)
        count = math.ceil(len(positions) * max(size / _MEMORY, work / _WORK))
        return np.array_split(positions, min(len(positions), count))

    def solve(self, steps: int, positions: Array) -> Solutions:
        """Return solutions of the points at positions (k,) on a grid of `steps` steps."""
        rigid = self.rigid_body_modes(positions)
        return self.solve_points(self.method, self.equations[positions], steps, rigid)

    def solve_points(self, method: Method, points: Points, steps: int, rigid: Free | None) -> Solutions:
        """Return solutions of `points` by a method on a grid of `steps` steps. rigid: rigid-body modes of the
        points."""
        grid = Grid.uniform(steps, points.period, points.breaks)
        return solutions_on(method, points, grid, self.request.orbit, self.request.engine, rigid)

    def certify(
        self, positions: Array, solutions: Solutions, errors: Array, absolute: Array
    ) -> Iterator[Certified | Failed]:
        """Yield the solved points, and failures for points whose load drives a rigid-body mode.

        errors (k, 2): relative errors of orbit and multipliers. absolute (k,): absolute errors of the
        multipliers. The defects of the solutions are added to `errors` in place."""
        errors[:, 0] += solutions.defect
        if solutions.free is not None and solutions.driven is not None and self.request.orbit:
            is_driven = solutions.driven > _DRIVEN + 10 * errors[:, 0]
            for row in is_driven.nonzero()[0][:, None]:
                point, modes = self.points[positions[row]], solutions.free.modes[row]
                yield Failed(int(positions[row[0]]), driven_freely(point, modes))
            rows = (~is_driven).nonzero()[0]
            if not len(rows):
                return
            positions, solutions = positions[rows], solutions[rows]
            errors, absolute = errors[rows], absolute[rows]
        modes = self.modes[positions]
        yield Certified(positions, self.method, solutions, errors, absolute, self.request, modes)


def singular_inertia(points: Points, modes: FrozenModes) -> Iterator[tuple[int, MatricesError]]:
    """Yield the position of each point with an M that is singular at some phase, and the exception for it.
    The phase may lie between the sampled phases.

    The phase is searched only for points without steady inertia at the sampled phases; see
    `FrozenModes.has_steady_inertia`.
    """
    for position in (~modes.has_steady_inertia()).nonzero()[0].tolist():
        phase = _singular_phase(points[np.array([position])], modes.phases)
        if phase is not None:
            yield position, singular_inertia_error(f"near phase {phase:.6g}", points.first_order)


def _singular_phase(point: Points, phases: Array) -> float | None:
    """Return the phase at which det M of a point changes sign, or has a minimum that is zero within
    round-off; None if there is no such phase."""
    from scipy.optimize import minimize_scalar

    jumps = np.sort(np.add.outer(point.period * np.arange(-1, 2), np.mod(point.breaks, point.period)).ravel())
    signs, logarithms = _determinants(point, phases)
    if not (logarithms < np.inf).all():
        return None
    piece = np.searchsorted(jumps, phases)
    changes = ((signs[1:] * signs[:-1] <= 0) & (piece[1:] == piece[:-1])).nonzero()[0]
    if len(changes):
        return float(phases[changes[0]])
    at, median = int(logarithms.argmin()), np.median(logarithms)
    ends = np.concatenate(([-np.inf], jumps, [np.inf]))[[piece[at], piece[at] + 1]]

    def determinant(phase: float) -> float:
        sign, logarithm = _determinants(point, np.array([phase]))
        return float(signs[at] * sign[0] * np.exp(logarithm[0] - median))

    spacing = float(phases[1] - phases[0])
    bounds = max(phases[at] - spacing, ends[0]), min(phases[at] + spacing, ends[1])
    lowest: Any = minimize_scalar(
        determinant, bounds=bounds, method="bounded", options={"xatol": 1e-9 * spacing}
    )
    return float(lowest.x) % point.period if lowest.fun <= ROUND_OFF else None


def _determinants(point: Points, phases: Array) -> tuple[Array, Array]:
    """Return the signs (k,) of det M, and the logarithms (k,) of |det M|."""
    M, C, _, _ = (part[0] for part in matrices(point, np.mod(phases, point.period)))
    with np.errstate(invalid="ignore"):
        return np.linalg.slogdet(leading(M, C, point.first_order))
