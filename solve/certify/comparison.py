"""Error estimates from the difference between two solutions of the same points."""

from abc import ABC, abstractmethod
from functools import cache, lru_cache

import numpy as np

from solve.arrays import Array, across
from solve.certify.certified import SolveRequest
from solve.certify.coefficients import ResampledPoints, SampledPhases, harmonics
from solve.certify.estimates import NO_DIGIT, roundoff_errors
from solve.certify.point_solver import PointSolver
from solve.methods.collocation import Collocation
from solve.methods.free import free
from solve.methods.method import Method, Solutions
from solve.period.eigenvalues import EPS
from solve.period.grid import Grid
from solve.period.points import Points, Scaled
from solve.period.rigid_body import Free

_COEFFICIENTS = 1e-3
"""Largest difference between coefficients and their interpolant, relative to the stiffness of the softest
mode, as a fraction of `rtol`. The response amplifies this difference by at most the phase advance of a
resolved mode, a few hundred radians. Half and twice this value leave 65 results on 14 systems of both
populations honest with the same verdicts."""

_PERTURBATION = 64.0
"""Change of entries, in units of round-off, from which the effect of round-off in the coefficients is
computed. It is large enough to exceed the round-off of the difference, and small enough for a linear response
if the result is accurate to three digits. With 32 and 128, 80 estimates of stiff modes in turned axes remain
honest and equally sharp."""

_AMPLIFICATION = 100.0
"""Factor by which the response may amplify aliased harmonics of the coefficients: that of a resonance with a
damping ratio of 0.5 %."""


class Comparison(ABC):
    """Pairs of a solution and a more accurate one on a related grid. Their difference estimates the error of
    the first.

    Attributes
    ----------
    solver : PointSolver
        Solver of the points by the method of the first solution.
    better : Method
        Method of the better solution.
    step_ratio : int
        Ratio of their numbers of steps.
    remaining : float
        Error of the better solution as a fraction of the difference.
    max_steps : int
        Largest number of steps of the first solution.
    """

    step_ratio: int
    remaining = 0.0

    def __init__(self, solver: PointSolver, better: Method):
        self.solver, self.better = solver, better
        # A better solution has at least as many steps or stages.
        self.max_steps = better.most_steps(solver.points.n, solver.points.first_order) // self.step_ratio

    def chunks(self, steps: int, positions: Array) -> list[Array]:
        """Chunks of the positions, split so that both solutions fit into memory."""
        return self.solver.chunks(steps * self.step_ratio, positions, self.better)

    def solve(self, steps: int, positions: Array) -> tuple[Solutions, Solutions]:
        """Both solutions of points at positions (k,). The first has `steps` steps."""
        first = self.solver.solve(steps, positions)
        return first, self.solver.solve(steps * self.step_ratio, positions, self.better)

    def roundoff(self, steps: int, positions: Array, solutions: Solutions, errors: Array) -> Array:
        """Round-off errors (k, 2) of the solutions of points at positions (k,) with `steps` steps.

        The round-off of the coefficients is added to that of the maps if it may exceed the `errors` (k, 2).
        It is the difference from solutions with slightly different entries."""
        solver, roundoff = self.solver, roundoff_errors(solutions)
        may_exceed = roundoff * solver.rounding_amplification(positions)[:, None] > errors
        rows = across(np.logical_or, may_exceed[:, 0 if solver.request.orbit else 1 :]).nonzero()[0]
        if not len(rows):
            return roundoff
        equations = solver.method.linearised(solver.equations[positions[rows]], solutions[rows])
        rigid = self._rigid_body_modes(positions[rows], equations)
        changed = Scaled(equations, 1 + _PERTURBATION * EPS * _signs(equations.n))
        if rigid is None:
            change = self._change(changed, rigid, steps, positions[rows], solutions[rows])
            change = np.where(change < NO_DIGIT, change / _PERTURBATION, np.inf)
            roundoff[rows] = np.maximum(roundoff[rows], change)
        return roundoff

    def _rigid_body_modes(self, positions: Array, equations: Points) -> Free | None:
        """Rigid-body modes of points at positions (k,), given their linear equations."""
        return self.solver.rigid_body_modes(positions) if self.solver.method.linear else free(equations)

    def _change(
        self, points: Points, rigid: Free | None, steps: int, positions: Array, solutions: Solutions
    ) -> Array:
        """Differences (k, 2) between the solutions of points at positions (k,) and the solutions with other
        coefficients on the same grid; infinite if there is no solution with the other coefficients."""
        change = np.full((len(positions), 2), np.inf)
        other = self.solver.solve_points(self.solver.method.corrector, points, steps, rigid)
        rows = other.known
        change[rows] = self.solver.differences(other[rows], solutions[rows], positions[rows])
        return change

    @abstractmethod
    def unsampled_errors(self, steps: int, positions: Array, solutions: Solutions) -> Array:
        """Errors (k, 2) due to variations of the coefficients that neither grid samples, for points at
        positions (k,) with `steps` steps."""


class TwoOrders(Comparison):
    """Comparison of s stages with s + 1 stages on the same grid.

    A collocation step with one more stage solves the error equation of the step with s stages. The difference
    of their maps is therefore the dual-weighted residual with an exact discrete adjoint. Since the equations
    are linear, the periodic solutions of both sets of maps propagate these local errors exactly."""

    step_ratio = 1

    def unsampled_errors(self, steps: int, positions: Array, solutions: Solutions) -> Array:
        """Differences from solutions with coefficients projected on the stages, if the coefficients differ
        from their interpolant."""
        solver, method = self.solver, self.solver.method
        points = method.linearised(solver.points[positions], solutions)
        stages = method.stages, self.better.stages
        phases = _sampled_phases(steps, points.period, points.breaks, *stages)
        errors = np.zeros((len(points), 2))
        allowed = _COEFFICIENTS * solver.request.rtol * solver.relative_stiffness[positions]
        rows = (phases.relative_difference(points) > allowed).nonzero()[0]
        if len(rows):
            equations = method.linearised(solver.equations[positions[rows]], solutions[rows])
            rigid = self._rigid_body_modes(positions[rows], equations)
            resampled = ResampledPoints(equations, phases)
            errors[rows] = self._change(resampled, rigid, steps, positions[rows], solutions[rows])
        return errors


class DoubledSteps(Comparison):
    """Comparison of m steps with 2m steps of the same method, for methods without a variant of higher
    order."""

    step_ratio = 2

    @property
    def remaining(self) -> float:
        return 1 / (2.0**self.solver.method.order - 1)

    def unsampled_errors(self, steps: int, positions: Array, solutions: Solutions) -> Array:
        """Amplitudes of those harmonics of the coefficients that evenly spaced samples alias, multiplied by
        the amplification of errors."""
        method, points = self.solver.method, self.solver.points[positions]
        if not method.samples_evenly:
            return np.zeros((len(points), 2))
        # Each harmonic of a Fourier series is coupled to the harmonics of the coefficients.
        resolved = steps // (2 if method.spectral else 1)
        aliased = (harmonics(points, loads)[:, resolved + 1 :].sum(axis=1) for loads in (True, False))
        return np.column_stack(tuple(aliased)) * _AMPLIFICATION


def comparison_of(points: Points, method: Method, request: SolveRequest) -> Comparison:
    """Comparison by which the errors of a method at points are estimated."""
    solver, higher = PointSolver(points, method, request), method.with_another_stage
    if higher is None:
        return DoubledSteps(solver, method)
    return TwoOrders(solver, higher)


@cache
def _signs(n: int) -> Array:
    """Changes (1, 3n² + n) of the entries of M, C, K and d, in units of round-off.

    Changes of the diagonal of a symmetric stiffness do not cancel: their effect on a mode x is Σ x_i² K_ii,
    which is at least 1/n of Σ |x_i K_ij x_j|. The changes have different factors, so that changes of two
    terms that balance each other in a mode do not cancel."""
    diagonal = np.eye(n).ravel()
    return np.concatenate((-diagonal, 2 * diagonal, diagonal, (-1.0) ** np.arange(n)))[None]


@lru_cache(maxsize=32)
def _sampled_phases(
    steps: int, period: float, breaks: tuple[float, ...], lower: Collocation, higher: Collocation
) -> SampledPhases:
    """Phases that two methods sample on a grid, and phases at which the coefficients are compared."""
    return SampledPhases.of(Grid.uniform(steps, period, breaks), lower, higher)
