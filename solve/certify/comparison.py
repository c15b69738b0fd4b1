"""Error estimates from the difference between two solutions of the same points, and round-off errors.

Column 0 of the errors (P, 2) contains the errors of the orbit, relative to the largest value of each
coordinate. Column 1 contains the errors of the multipliers, relative to the spectral radius."""

from functools import cache

import numpy as np

from solve.arrays import EPS, Array
from solve.certify.certified import SolveRequest
from solve.certify.coefficients import ResampledPoints, aliased_harmonics
from solve.certify.point_solver import PointSolver
from solve.kernel import curves as kernel
from solve.kernel.engines import COMPILED, NUMPY
from solve.methods.free import free
from solve.methods.method import Method, Solutions
from solve.period.curve import Curve, PeriodicCurve
from solve.period.eigenvalues import roundoff_growth
from solve.period.frozen import FrozenModes
from solve.period.grid import Grid
from solve.period.period_map import rest_threshold
from solve.period.points import Points, ScaledEntries
from solve.period.rigid_body import Free

PHASES_PER_STEP = 4
"""Minimum number of phases per step at which curves are compared. With 2 or 8, the errors of 65 results on 14
random test systems stay within their estimates, and the verdicts are the same."""

SAFETY = 2.0
"""Ratio of the error estimate to the difference from a more accurate solution. To first order, the difference
equals the error. The difference is at least half of the error for 99.8 % of the stored random test
systems."""

NO_DIGIT = 0.1
"""Relative error above which a value is not accurate to even one digit. docs/certificate.md states the
measured range."""

RESULT_ROUND_OFF = 64 * EPS
"""Relative size below which a value counts as the round-off of its computation. Chosen by judgement: it
allows for about ten operations.

To compute the effect of round-off in the entries, the entries are also changed by this amount. The effect
then exceeds the round-off of the difference, and is linear if the result has three correct digits. With half
or twice this value, 80 estimates for stiff modes in rotated axes are still not below the errors, and equally
close to them."""

_COEFFICIENTS = 1e-3
"""Relative difference between coefficients and their interpolant below which the effect of the difference is
not computed. It is a fraction of `rtol` times the ratio of the stiffnesses of the softest and the stiffest
mode. The response amplifies this difference by at most the phase advance of a resolved mode, a few hundred
radians. With half or twice this value, the errors of 65 results on 14 random test systems stay within their
estimates, and the verdicts are the same."""

_AMPLIFICATION = 100.0
"""Assumed factor by which the response amplifies aliased harmonics of the coefficients: the amplification at
a resonance with a damping ratio of 0.5 %."""


def better_method(method: Method) -> tuple[Method, int]:
    """Return the more accurate method with which `method` is compared, and the ratio of their numbers of
    steps. The more accurate method has one more stage on the same grid. If there is no such method, `method`
    is compared with itself on twice as many steps."""
    higher = method.with_another_stage
    return (method, 2) if higher is None else (higher, 1)


class Comparison(PointSolver):
    """Solver that computes a solution and a more accurate one. The difference between the two solutions
    estimates the error of the first one.

    A collocation method with s stages is compared with s + 1 stages on the same grid. A step with one more
    stage solves the error equation of the step with s stages. The difference of their maps is therefore the
    dual-weighted residual with an exact discrete adjoint. Since the equations are linear, the periodic
    solutions of both sets of maps propagate these local errors exactly. Other methods are compared with the
    same method and twice as many steps.

    Attributes
    ----------
    better : Method
        Method of the more accurate solution.
    step_ratio : int
        Number of steps of the more accurate solution, divided by that of the first solution.
    remaining : float
        Error of the more accurate solution, as a fraction of the difference between both solutions.
    """

    def __init__(self, points: Points, method: Method, request: SolveRequest):
        super().__init__(points, method, request)
        self.better, self.step_ratio = better_method(method)
        self.remaining = 0.0 if self.step_ratio == 1 else 1 / (2.0**method.order - 1)
        # The more accurate solution has more steps or more stages.
        self.max_steps = self.better.most_steps(points.n, points.first_order) // self.step_ratio

    def pair_chunks(self, steps: int, positions: Array) -> list[Array]:
        """Split the positions into chunks for which both solutions fit into memory."""
        return self.chunks(steps * self.step_ratio, positions, self.better)

    def pair(self, steps: int, positions: Array) -> tuple[Solutions, Solutions]:
        """Return the solution with `steps` steps and a more accurate one, for the points with the indices
        `positions` (k,)."""
        equations, rigid = self.equations[positions], self.rigid_body_modes(positions)
        first = self.solve_points(self.method, equations, steps, rigid)
        return first, self.solve_points(self.better, equations, steps * self.step_ratio, rigid)

    def roundoff(self, steps: int, positions: Array, solutions: Solutions, errors: Array) -> Array:
        """Return round-off errors (k, 2) of the solutions of the points with the indices `positions` (k,), on
        a grid of `steps` steps.

        The errors include the round-off of the step maps. If the effect of round-off in the coefficients may
        exceed the `errors` (k, 2), this effect is also included. It is computed as the difference from
        solutions with slightly changed entries."""
        roundoff = roundoff_errors(solutions)
        of = slice(0 if self.request.orbit else 1, 2)
        rows = self.may_exceed(positions, roundoff[:, of], errors[:, of]).nonzero()[0]
        if not len(rows):
            return roundoff
        equations = self.method.linearised(self.equations[positions[rows]], solutions[rows])
        rigid = self._linear_modes(positions[rows], equations)
        changed = ScaledEntries(equations, 1 + RESULT_ROUND_OFF * _signs(equations.n))
        if rigid is None:
            change = self._change(changed, rigid, steps, positions[rows], solutions[rows])
            change = np.where(change < NO_DIGIT, EPS / RESULT_ROUND_OFF * change, np.inf)
            roundoff[rows] = np.maximum(roundoff[rows], change)
        return roundoff

    def _linear_modes(self, positions: Array, equations: Points) -> Free | None:
        """Return the rigid-body modes of the points with the indices `positions` (k,). equations: linear
        equations of these points."""
        return self.rigid_body_modes(positions) if self.method.linear else free(equations)

    def _change(
        self, points: Points, rigid: Free | None, steps: int, positions: Array, solutions: Solutions
    ) -> Array:
        """Return the differences (k, 2) between `solutions` and the solutions of `points`, whose coefficients
        are changed, on the same grid. A difference is infinite if the changed point has no solution."""
        change = np.full((len(positions), 2), np.inf)
        other = self.solve_points(self.method.corrector, points, steps, rigid)
        rows = other.known
        modes, engine = self.modes[positions[rows]], self.request.engine
        change[rows] = differences(other[rows], solutions[rows], modes, engine)
        return change

    def unsampled_errors(self, steps: int, positions: Array, solutions: Solutions) -> Array:
        """Return errors (k, 2) due to variations of the coefficients that neither grid samples, for the
        points with the indices `positions` (k,) on a grid of `steps` steps."""
        if self.step_ratio == 1:
            return self._between_stages(steps, positions, solutions)
        if self.method.samples_evenly:
            return self._aliased(steps, positions)
        return np.zeros((len(positions), 2))

    def _between_stages(self, steps: int, positions: Array, solutions: Solutions) -> Array:
        """Return the differences (k, 2) between `solutions` and solutions with locally averaged coefficients;
        0 if the coefficients agree with their interpolant."""
        method = self.method
        points = method.linearised(self.points[positions], solutions)
        rules = method.stages, self.better.stages
        resampled = ResampledPoints(points, steps, rules)
        errors = np.zeros((len(positions), 2))
        allowed = _COEFFICIENTS * self.request.rtol * self.relative_stiffness(positions)
        rows = (resampled.relative_difference > allowed).nonzero()[0]
        if len(rows):
            if method.linear:
                resampled = ResampledPoints(self.equations[positions[rows]], steps, rules)
            rigid = self._linear_modes(positions[rows], resampled.points)
            errors[rows] = self._change(resampled, rigid, steps, positions[rows], solutions[rows])
        return errors

    def _aliased(self, steps: int, positions: Array) -> Array:
        """Return the errors (k, 2) due to aliasing: the aliased harmonics of the coefficients, multiplied by
        the factor `_AMPLIFICATION`."""
        # The harmonics of the coefficients couple those of a Fourier series, so that only half as many are
        # resolved.
        resolved, points = steps // (2 if self.method.spectral else 1), self.points[positions]
        aliased = (aliased_harmonics(points, loads, resolved) for loads in (True, False))
        return np.column_stack(tuple(aliased)) * _AMPLIFICATION


@cache
def _signs(n: int) -> Array:
    """Return test changes (1, 3n² + n) of the entries of M, C, K and d, in units of round-off.

    The changes of the diagonal entries of a symmetric stiffness matrix have the same sign, so that their
    effects on a mode x do not cancel. Their sum, Σ x_i² K_ii, is at least 1/n of Σ |x_i K_ij x_j|. This
    second sum bounds the effect of equal relative changes of all entries of K. M, C and K change by different
    factors, so that the changes of two terms that balance in a mode do not cancel."""
    diagonal = np.eye(n).ravel()
    return np.concatenate((-diagonal, 2 * diagonal, diagonal, (-1.0) ** np.arange(n)))[None]


def differences(coarse: Solutions, fine: Solutions, modes: FrozenModes, engine: str = NUMPY) -> Array:
    """Return the differences (P, 2) between coarse and more accurate solutions of points. modes: frozen modes
    of these points.

    The difference of the orbits is the maximum of max|difference|/max|q| over all coordinates. A coordinate
    that is zero except for round-off, such as the coordinate of a mass with a tuned absorber, is compared
    with the displacement that all loads on it would cause."""
    multipliers = coarse.multipliers.difference(fine.multipliers)
    orbit = np.zeros(len(multipliers))
    if coarse.curve is not None and fine.curve is not None:
        change, largest = _curve_differences(coarse.grid, coarse.curve, fine.grid, fine.curve, engine)
        scales = _coordinate_scales(change, largest, fine, modes)
        orbit = (change / np.where(scales > 0, scales, 1.0)).max(axis=1)
    return np.array((orbit, multipliers)).T


def _curve_differences(
    coarse: Grid, curve: PeriodicCurve, fine: Grid, better: PeriodicCurve, engine: str
) -> tuple[Array, Array]:
    """Return the largest moduli (P, n) of the difference of two curves, and those of the more accurate curve
    `better`. The curves are compared at evenly spaced phases of each step of the coarse grid."""
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
    """Return the largest moduli (P, n) of the differences between the values `q` and `better` (P, n, k), and
    those of `better`."""
    return np.abs(q - better).max(axis=2), np.abs(better).max(axis=2)


def _coordinate_scales(change: Array, largest: Array, solutions: Solutions, modes: FrozenModes) -> Array:
    """Return the scales (P, n) to which the errors of coordinates of `solutions` are relative: the moduli
    `largest` (P, n), or the load scale of a coordinate whose modulus is round-off.

    Such a modulus is round-off of the load scale. If the system is ill-conditioned, a larger modulus may also
    be round-off. Two solutions for the coordinate then have no common digit: their difference `change` (P, n)
    is at least half as large as the coordinate.

    If forces on a coordinate cancel, the condition number includes this cancellation. The round-off error is
    then relative to the coordinate, which is accurate to one digit if this error is below `NO_DIGIT`."""
    roundoff = orbit_roundoff(solutions)[:, None]
    rest = rest_threshold(roundoff, roundoff_growth(solutions.grid.steps))
    # Coordinates may have different units, so that the second criterion is not sufficient. Two solutions may
    # share their round-off.
    is_doubtful = 2 * SAFETY * change >= NO_DIGIT * largest
    is_doubtful |= largest <= np.maximum(roundoff, rest) * largest.max(axis=1, keepdims=True)
    rows = is_doubtful.any(axis=1).nonzero()[0]
    if not len(rows):
        return largest
    scales, loads = largest.copy(), modes[rows].load_scale(largest[rows])
    size, roundoff, rest = largest[rows], roundoff[rows], rest[rows]
    has_no_digit = 2 * change[rows] >= size
    is_roundoff = (size <= rest * loads) | (has_no_digit & (size <= roundoff * loads))
    cancels = (size * roundoff >= EPS * loads) & (roundoff < NO_DIGIT)
    scales[rows] = np.where(is_roundoff & ~cancels, loads, size)
    return scales


def orbit_roundoff(solutions: Solutions) -> Array:
    """Return the round-off errors (P,) of the orbits, from the condition numbers of the periodic systems."""
    return np.fmax(EPS * roundoff_growth(solutions.grid.steps) * solutions.condition, RESULT_ROUND_OFF)


def roundoff_errors(solutions: Solutions) -> Array:
    """Return the round-off errors (P, 2) of orbits and multipliers."""
    return np.array(
        (orbit_roundoff(solutions), np.maximum(solutions.multiplier_rounding, RESULT_ROUND_OFF))
    ).T
