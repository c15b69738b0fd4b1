"""Errors estimated from the difference between two solutions of the same points, and round-off errors.

Errors (P, 2) of orbit and multipliers are relative: to the largest value of each coordinate, and to the
spectral radius."""

from functools import cache, cached_property, lru_cache

import numpy as np

from solve.arrays import Array
from solve.certify.certified import SolveRequest
from solve.certify.coefficients import ResampledPoints, SampledPhases, harmonics
from solve.certify.point_solver import PointSolver
from solve.kernel import curves as kernel
from solve.kernel.engines import COMPILED, NUMPY
from solve.methods.collocation import Collocation
from solve.methods.free import free
from solve.methods.method import Method, Solutions
from solve.period.curve import Curve, PeriodicCurve
from solve.period.eigenvalues import EPS, roundoff_growth
from solve.period.frozen import FrozenModes
from solve.period.grid import Grid
from solve.period.period_map import rest_threshold
from solve.period.points import Points, ScaledEntries
from solve.period.rigid_body import Free

PHASES_PER_STEP = 4
"""Smallest number of phases per step at which curves are compared. With 2 or 8, 65 results on 14 systems of
both populations remain honest with the same verdicts."""

SAFETY = 2.0
"""Ratio of the error estimate to the difference from a better solution. The difference equals the error to
first order, and is at least half of it in 99.8 % of the stored population."""

NO_DIGIT = 0.1
"""Relative error above which a value is not accurate to even one digit. docs/certificate.md states the
measured range."""

ROUND_OFF = 64 * EPS
"""Relative size below which a value is the round-off of its computation: a choice, some ten operations above
the unit round-off. Also the change of entries from which the effect of their round-off is computed: it
exceeds the round-off of the difference, and is linear if the result has three digits. Half and twice leave 80
estimates of stiff modes in turned axes honest and equally sharp."""

_COEFFICIENTS = 1e-3
"""Largest difference between coefficients and their interpolant, relative to the stiffness of the softest
mode, as a fraction of `rtol`. The response amplifies this difference by at most the phase advance of a
resolved mode, a few hundred radians. Half and twice this value leave 65 results on 14 systems of both
populations honest with the same verdicts."""

_AMPLIFICATION = 100.0
"""Factor by which the response may amplify aliased harmonics of the coefficients: that of a resonance with a
damping ratio of 0.5 %."""


def better_method(method: Method) -> tuple[Method, int]:
    """More accurate method with which the results of a method are compared, and the ratio of the numbers of
    steps: one more stage on the same grid, or twice the steps without a variant of higher order."""
    higher = method.with_another_stage
    return (method, 2) if higher is None else (higher, 1)


class Comparison(PointSolver):
    """Solver of pairs of a solution and a more accurate one. Their difference estimates the error of the
    first.

    A collocation method with s stages is compared with s + 1 stages on the same grid. A step with one more
    stage solves the error equation of the step with s stages. The difference of their maps is therefore the
    dual-weighted residual with an exact discrete adjoint. Since the equations are linear, the periodic
    solutions of both sets of maps propagate these local errors exactly. Other methods are compared with twice
    the steps.

    Attributes
    ----------
    better : Method
        Method of the better solution.
    step_ratio : int
        Ratio of their numbers of steps.
    remaining : float
        Error of the better solution as a fraction of the difference.
    """

    def __init__(self, points: Points, method: Method, request: SolveRequest):
        super().__init__(points, method, request)
        self.better, self.step_ratio = better_method(method)
        self.remaining = 0.0 if self.step_ratio == 1 else 1 / (2.0**method.order - 1)

    @cached_property
    def max_steps(self) -> int:
        """Largest number of steps of the first solution. The better one has as many steps, or stages, at
        least."""
        return self.better.most_steps(self.points.n, self.points.first_order) // self.step_ratio

    def pair_chunks(self, steps: int, positions: Array) -> list[Array]:
        """Chunks of the positions, split so that both solutions fit into memory."""
        return self.chunks(steps * self.step_ratio, positions, self.better)

    def pair(self, steps: int, positions: Array) -> tuple[Solutions, Solutions]:
        """Both solutions of points at positions (k,). The first has `steps` steps."""
        equations, rigid = self.equations[positions], self.rigid_body_modes(positions)
        first = self.solve_points(self.method, equations, steps, rigid)
        return first, self.solve_points(self.better, equations, steps * self.step_ratio, rigid)

    def roundoff(self, steps: int, positions: Array, solutions: Solutions, errors: Array) -> Array:
        """Round-off errors (k, 2) of the solutions of points at positions (k,) with `steps` steps.

        The round-off of the coefficients is added to that of the maps if it may exceed the `errors` (k, 2).
        It is the difference from solutions with slightly different entries."""
        roundoff = roundoff_errors(solutions)
        of = slice(0 if self.request.orbit else 1, 2)
        rows = self.may_exceed(positions, roundoff[:, of], errors[:, of]).nonzero()[0]
        if not len(rows):
            return roundoff
        equations = self.method.linearised(self.equations[positions[rows]], solutions[rows])
        rigid = self._linear_modes(positions[rows], equations)
        changed = ScaledEntries(equations, 1 + ROUND_OFF * _signs(equations.n))
        if rigid is None:
            change = self._change(changed, rigid, steps, positions[rows], solutions[rows])
            change = np.where(change < NO_DIGIT, EPS / ROUND_OFF * change, np.inf)
            roundoff[rows] = np.maximum(roundoff[rows], change)
        return roundoff

    def _linear_modes(self, positions: Array, equations: Points) -> Free | None:
        """Rigid-body modes of points at positions (k,), given their linear equations."""
        return self.rigid_body_modes(positions) if self.method.linear else free(equations)

    def _change(
        self, points: Points, rigid: Free | None, steps: int, positions: Array, solutions: Solutions
    ) -> Array:
        """Differences (k, 2) between the solutions of points at positions (k,) and the solutions with other
        coefficients on the same grid; infinite if there is no solution with the other coefficients."""
        change = np.full((len(positions), 2), np.inf)
        other = self.solve_points(self.method.corrector, points, steps, rigid)
        rows = other.known
        modes, engine = self.modes[positions[rows]], self.request.engine
        change[rows] = differences(other[rows], solutions[rows], modes, engine)
        return change

    def unsampled_errors(self, steps: int, positions: Array, solutions: Solutions) -> Array:
        """Errors (k, 2) due to variations of the coefficients that neither grid samples, for points at
        positions (k,) with `steps` steps."""
        if self.step_ratio == 1:
            return self._between_stages(steps, positions, solutions)
        if self.method.samples_evenly:
            return self._aliased(steps, positions)
        return np.zeros((len(positions), 2))

    def _between_stages(self, steps: int, positions: Array, solutions: Solutions) -> Array:
        """Differences from solutions with coefficients projected on the stages, if the coefficients differ
        from their interpolant."""
        method = self.method
        points = method.linearised(self.points[positions], solutions)
        stages = method.stages, self.better.stages
        phases = _sampled_phases(steps, points.period, points.breaks, *stages)
        resampled = ResampledPoints(points, phases)
        errors = np.zeros((len(positions), 2))
        allowed = _COEFFICIENTS * self.request.rtol * self.relative_stiffness[positions]
        rows = (resampled.relative_difference > allowed).nonzero()[0]
        if len(rows):
            if method.linear:
                resampled = ResampledPoints(self.equations[positions[rows]], phases)
            rigid = self._linear_modes(positions[rows], resampled.points)
            errors[rows] = self._change(resampled, rigid, steps, positions[rows], solutions[rows])
        return errors

    def _aliased(self, steps: int, positions: Array) -> Array:
        """Amplitudes of those harmonics of the coefficients that evenly spaced samples alias, multiplied by
        the amplification of errors."""
        # Each harmonic of a Fourier series is coupled to the harmonics of the coefficients.
        resolved, points = steps // (2 if self.method.spectral else 1), self.points[positions]
        aliased = (harmonics(points, loads)[:, resolved + 1 :].sum(axis=1) for loads in (True, False))
        return np.column_stack(tuple(aliased)) * _AMPLIFICATION


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
    return SampledPhases.on_grid(Grid.uniform(steps, period, breaks), lower, higher)


def differences(coarse: Solutions, fine: Solutions, modes: FrozenModes, engine: str = NUMPY) -> Array:
    """Differences (P, 2) of solutions from more accurate ones, for points with these frozen modes.

    The difference of the orbits is max|difference|/max|q|, the largest of all coordinates. A coordinate that
    is zero except for round-off (the mass at a tuned absorber) is compared with the displacement that all
    loads on it would cause."""
    multipliers = coarse.multipliers.difference(fine.multipliers)
    orbit = np.zeros_like(multipliers)
    if coarse.curve is not None and fine.curve is not None:
        change, largest = _curve_differences(coarse.grid, coarse.curve, fine.grid, fine.curve, engine)
        scales = _coordinate_scales(largest, orbit_roundoff(fine), modes)
        orbit = (change / np.where(scales > 0, scales, 1.0)).max(axis=1)
    return np.array((orbit, multipliers)).T


def _curve_differences(
    coarse: Grid, curve: PeriodicCurve, fine: Grid, better: PeriodicCurve, engine: str
) -> tuple[Array, Array]:
    """Largest moduli (P, n) of the differences of two curves, and of the better curve, at phases that are
    evenly spaced in the steps of the coarse grid."""
    per_fine_step, rest = divmod(PHASES_PER_STEP * coarse.steps, fine.steps)
    is_shared = not rest and per_fine_step <= PHASES_PER_STEP
    if not (is_shared and (fine.smooth or coarse.steps == fine.steps)):
        fractions = coarse.h[:, None] * (np.arange(PHASES_PER_STEP) / PHASES_PER_STEP)
        phases = (coarse.nodes[:-1, None] + fractions).ravel()
        return largest_moduli(curve.sampled(PHASES_PER_STEP), better(phases))
    per_step = PHASES_PER_STEP, per_fine_step
    if engine == COMPILED and isinstance(curve, Curve) and isinstance(better, Curve):
        compiled = kernel.differences(curve.coefficients, better.coefficients, per_step)
        if compiled is not None:
            return compiled
    return largest_moduli(
        *(each.sampled(count) for each, count in zip((curve, better), per_step, strict=True))
    )


def largest_moduli(q: Array, better: Array) -> tuple[Array, Array]:
    """Largest moduli (P, n) of the differences between values (P, n, k), and of the more accurate values."""
    return np.abs(q - better).max(axis=2), np.abs(better).max(axis=2)


def _coordinate_scales(largest: Array, roundoff: Array, modes: FrozenModes) -> Array:
    """Scales (P, n) for the errors of coordinates: the `largest` moduli, or the load scale where these are
    round-off.

    If forces on a coordinate cancel, the condition number contains the ratio of these forces to the
    coordinate. The `roundoff` (P,) is then relative to the coordinate, which is accurate to one digit if
    `roundoff` is below `NO_DIGIT`."""
    limit = np.maximum(roundoff, rest_threshold(roundoff))[:, None]
    is_small = largest <= limit * largest.max(axis=1, keepdims=True)
    if not is_small.any():
        return largest
    rows = is_small.any(axis=1).nonzero()[0]
    scales, loads = largest.copy(), modes[rows].load_scale(largest[rows])
    size, roundoff = largest[rows], roundoff[rows, None]
    cancels = (size * roundoff >= EPS * loads) & (roundoff < NO_DIGIT)
    scales[rows] = np.where(cancels | (size > limit[rows] * loads), size, loads)
    return scales


def orbit_roundoff(solutions: Solutions) -> Array:
    """Round-off error (P,) of the orbit, from the condition number of the periodic system."""
    return np.fmax(EPS * roundoff_growth(solutions.grid.steps) * solutions.condition, ROUND_OFF)


def roundoff_errors(solutions: Solutions) -> Array:
    """Round-off errors (P, 2) of orbit and multipliers."""
    return np.array((orbit_roundoff(solutions), np.maximum(solutions.multiplier_rounding, ROUND_OFF))).T
