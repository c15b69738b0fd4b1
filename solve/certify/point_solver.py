"""Solver of points by one method on a grid. Points without a solution are returned with the reason."""

import math
from collections.abc import Callable, Iterator
from functools import cached_property, partial
from typing import Any

import numpy as np

from solve.arrays import EPS, Array, others
from solve.certify.certified import Certified, Failed, SolveRequest
from solve.certify.coefficients import COEFFICIENT_ROUND_OFF
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

_FINE = 1024
"""Number of steps above which M is examined at the midpoints of the steps. Where det M is zero, the equations
are singular and accurate solutions have more steps: all of 107 random systems with a zero are refused. Seven
models of this project require at most 768 steps at `rtol` 1e-8."""

_DIP = 2.0
"""Ratio of det M at neighbouring phases above which det M may vanish between these phases. Next to a zero,
the ratio is at least 9 for a quadratic minimum, and at least 3 for a linear decrease to a jump."""


class PointSolver:
    """Solver of points by one method.

    Attributes
    ----------
    orders : (2,)
        Orders of convergence of orbit and multipliers.
    max_steps : int
        Largest number of steps per period.
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
        self.max_steps = method.most_steps(points.n, points.first_order)

    def rigid_body_modes(self, positions: Array) -> Free | None:
        """Rigid-body modes of the points with the indices `positions` (k,)."""
        return None if self.free is None else self.free[positions]

    @cached_property
    def equations(self) -> Points:
        """Points with balanced equations. For methods that do not converge, the equations are not balanced,
        because row factors change the modal masses and hence the results of these methods."""
        return balanced(self.points, self.modes) if self.method.converges else self.points

    def relative_stiffness(self, positions: Array) -> Array:
        """Stiffness (k,) of the softest frozen mode, relative to the stiffest, for points at `positions`
        (k,); 1 if all modes have zero stiffness."""
        least, largest = self._extreme_rates[:, positions]
        return np.fmin(least / largest, 1.0) ** 2

    def may_exceed(self, positions: Array, roundoff: Array, errors: Array) -> Array:
        """Return a mask (k,) of the points at `positions` (k,) at which the error due to round-off of the
        coefficients may exceed one of the `errors` (k, j). roundoff (k, j): errors due to round-off of the
        step maps.

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

    def singular_points(self, steps: int, positions: Array) -> list[Failed]:
        """Return failures for those of the points with the indices `positions` (k,) whose M is singular
        between the sampled phases of the frozen modes. Only grids with many steps are tested."""
        if steps <= _FINE:
            return []
        grid = Grid.uniform(steps, self.points.period, self.points.breaks)
        midpoints = grid.nodes[:-1] + grid.h / 2
        return [Failed(*failure) for failure in _singular(self.points, positions, midpoints)]

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
        """Split the positions into chunks. Each chunk fits into memory. Its solution, which cannot be
        interrupted, takes at most the permitted delay (see `_WORK`)."""
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
        """Return solutions of the points with the indices `positions` (k,) on a grid of `steps` steps."""
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
    """Yield the index of each point whose M is singular at some phase, and the exception for it. The phase
    may lie between the sampled phases.

    The phase is searched only for points without steady inertia at the sampled phases; see
    `FrozenModes.has_steady_inertia`. A shorter dip of det M is found on a fine grid; see
    `PointSolver.singular_points`.
    """
    yield from _singular(points, (~modes.has_steady_inertia()).nonzero()[0], modes.phases)


def _singular(points: Points, positions: Array, phases: Array) -> Iterator[tuple[int, MatricesError]]:
    """For each of the points with the indices `positions` whose M is singular at or near one of the `phases`,
    yield its index and the exception."""
    for position in positions.tolist():
        phase = _singular_phase(points[np.array([position])], phases)
        if phase is not None:
            yield position, singular_inertia_error(f"near phase {phase:.6g}", points.first_order)


def _singular_phase(point: Points, phases: Array) -> float | None:
    """Return a phase at which det M of a point changes sign, or has a minimum that is zero within round-off;
    None if no such phase is found.

    phases (k,): midpoints of a grid. A minimum is searched next to each phase at which the modulus of det M
    is at most 1/`_DIP` of the modulus at a neighbouring phase, up to the nearest jump of the matrices."""
    period = point.period
    jumps = np.sort(np.add.outer(period * np.arange(-1, 2), np.mod(point.breaks, period)).ravel())
    phases = np.concatenate((phases[-2:] - period, phases, phases[:2] + period))
    signs, logarithms = _determinants(point, phases)
    if not (logarithms < np.inf).all():
        return None
    piece = np.searchsorted(jumps, phases)
    is_inside = piece[1:] == piece[:-1]
    changes = ((signs[:-1] == 0) | ((signs[1:] * signs[:-1] < 0) & is_inside)).nonzero()[0]
    if len(changes):
        return float(phases[changes[0]]) % period
    rises = np.where(is_inside, np.diff(logarithms), 0.0)
    falls = -rises[1:-2]
    is_lowest = (falls >= 0) & (rises[2:-1] >= 0)
    highest = np.maximum.reduce((falls, falls - rises[:-3], rises[2:-1], rises[2:-1] + rises[3:]))
    median = float(np.median(logarithms))
    ends = np.concatenate(([-np.inf], jumps, [np.inf]))
    for at in 2 + (is_lowest & (highest >= math.log(_DIP))).nonzero()[0]:
        low, high = np.clip(phases[[at - 1, at + 1]], ends[piece[at]], ends[piece[at] + 1]).tolist()
        phase = _zero_between(partial(_relative_determinant, point, float(signs[at]), median), low, high)
        if phase is not None:
            return phase % period
    return None


def _zero_between(function: Callable[[float], float], low: float, high: float) -> float | None:
    """Return the phase of the minimum of a function between `low` and `high`; None if the minimum is
    positive. A minimum that is zero within round-off and the resolution of the search does not count as
    positive. Away from the minimum, the function is positive.

    At an end, where the coefficients may jump, the function is extrapolated linearly from inside."""
    from scipy.optimize import minimize_scalar

    width = high - low
    lowest: Any = minimize_scalar(
        lambda fraction: function(low + width * fraction),
        bounds=(0.0, 1.0),
        method="bounded",
        options={"xatol": 1e-9},
    )
    # The search resolves the square root of EPS of its interval. At a kink, the minimum found exceeds the
    # true one by up to the slope times this distance.
    resolved = 4 * EPS**0.5 * max(function(low + width / 8), function(high - width / 8))
    if lowest.fun <= max(COEFFICIENT_ROUND_OFF, resolved):
        return float(low + width * lowest.x)
    for end, inward in ((low, 1e-6 * width), (high, -1e-6 * width)):
        if 2 * function(end + inward) - function(end + 2 * inward) <= COEFFICIENT_ROUND_OFF:
            return float(end)
    return None


def _relative_determinant(point: Points, sign: float, median: float, phase: float) -> float:
    """Return sign·det M at a phase, relative to the modulus with the logarithm `median`."""
    signs, logarithms = _determinants(point, np.array([phase]))
    return float(sign * signs[0] * np.exp(logarithms[0] - median))


def _determinants(point: Points, phases: Array) -> tuple[Array, Array]:
    """Return the signs (k,) of det M, and the logarithms (k,) of |det M|."""
    signs, logarithms = [], []
    count = math.ceil(len(phases) * 32 * point.n**2 / _MEMORY)
    for some_phases in np.array_split(np.mod(phases, point.period), count):
        M, C, _, _ = (part[0] for part in matrices(point, some_phases))
        with np.errstate(invalid="ignore"):
            sign, logarithm = np.linalg.slogdet(leading(M, C, point.first_order))
        signs.append(sign)
        logarithms.append(logarithm)
    return np.concatenate(signs), np.concatenate(logarithms)
